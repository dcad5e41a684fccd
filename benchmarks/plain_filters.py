"""The extended Kalman filter as one would first write it, in NumPy and with filterpy where that is installed.

States are SOC and relaxation voltage, and for the joint filter the logarithms of the factors on capacity,
series resistance and relaxation resistance. No gate, no model error, no watch: less work than the project's
filter does.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bms.cell import Cell
from bms.estimators.gate import Sensors
from bms.estimators.joint import DAY_S, JointOptions

try:
    from filterpy.kalman import ExtendedKalmanFilter
except ImportError:
    ExtendedKalmanFilter = None

Array = NDArray[np.float64]


class Model(NamedTuple):
    """A cell with one relaxation pair of constant values, as the filters see it."""

    slope_V: Callable[[float], Any]
    ocv_V: Callable[[float], Any]
    capacity_C: float
    resistance_ohm: float
    relaxation_ohm: float
    time_constant_s: float
    current_sd_A: float
    voltage_sd_V: float
    drift_per_s: Array


def model_of(cell: Cell, joint: bool) -> tuple[Model, Array]:
    """The model, and the variances at the start but for the SOC's, by the options' defaults."""
    options, sensors, pair = JointOptions(), Sensors(), cell.relaxation[0]
    sd = [options.relaxation_start_V]
    drift = [options.soc_drift, 0.0]
    if joint:
        sd += [options.capacity_sd, options.resistance_sd, options.relaxation_sd]
        drift += [options.capacity_drift, options.resistance_drift, options.relaxation_drift]
    model = Model(
        slope_V=cell.ocv.slope_V,
        ocv_V=cell.ocv,
        capacity_C=cell.capacity_C,
        resistance_ohm=float(np.asarray(cell.resistance_ohm)),
        relaxation_ohm=float(np.asarray(pair.resistance_ohm)),
        time_constant_s=float(np.asarray(pair.resistance_ohm)) * float(pair.capacitance_F or 0.0),
        current_sd_A=sensors.current_sd_A,
        voltage_sd_V=sensors.voltage_sd_V,
        drift_per_s=np.square(drift) / DAY_S,
    )
    return model, np.square(sd)


def move(model: Model, x: Array, current_A: float) -> tuple[Array, Array, Array]:
    """State after a second, its Jacobian, and the noise of the current through it."""
    q, r1 = (x[2], x[4]) if x.size > 2 else (0.0, 0.0)
    per, ohm = math.exp(-q) / model.capacity_C, model.relaxation_ohm * math.exp(r1)
    rise = math.exp(-r1) / model.time_constant_s
    keep = math.exp(-rise)
    after, jacobian, driven = x.copy(), np.eye(x.size), np.zeros(x.size)
    driven[0], driven[1] = per, ohm * (1.0 - keep)
    after[0] += per * current_A
    after[1] = keep * x[1] + driven[1] * current_A
    jacobian[1, 1] = keep
    if x.size > 2:
        jacobian[0, 2] = -per * current_A
        jacobian[1, 4] = driven[1] * current_A + (x[1] - ohm * current_A) * keep * rise
    noise = np.outer(driven, driven) * model.current_sd_A**2
    return after, jacobian, noise + np.diag(model.drift_per_s)


def see(model: Model, x: Array, current_A: float) -> tuple[float, Array, float]:
    """Expected voltage, its slopes, and the variance of a reading."""
    ohm = model.resistance_ohm * (math.exp(x[3]) if x.size > 2 else 1.0)
    slopes = np.zeros((1, x.size))
    slopes[0, 0], slopes[0, 1] = model.slope_V(x[0]), 1.0
    if x.size > 2:
        slopes[0, 3] = ohm * current_A
    expected = float(model.ocv_V(x[0])) + x[1] + ohm * current_A
    return expected, slopes, model.voltage_sd_V**2 + (ohm * model.current_sd_A) ** 2


def numpy_filter(
    cell: Cell, current_A: Array, voltage_V: Array, soc: float, soc_sd: float, joint: bool
) -> Array:
    """Run the filter with NumPy's matrices; the SOC after each sample, shape (n,)."""
    model, variances = model_of(cell, joint)
    x = np.zeros(variances.size + 1)
    x[0], p = soc, np.diag([soc_sd**2, *variances])
    socs = np.empty(current_A.size)
    for k, (current, voltage) in enumerate(zip(current_A.tolist(), voltage_V.tolist(), strict=True)):
        if k > 0:
            x, jacobian, noise = move(model, x, float(current_A[k - 1]))
            p = jacobian @ p @ jacobian.T + noise
        expected, h, r = see(model, x, current)
        gain = (p @ h.T) / (h @ p @ h.T + r)
        x = x + gain[:, 0] * (voltage - expected)
        left = np.eye(x.size) - gain @ h
        p = left @ p @ left.T + r * (gain @ gain.T)
        socs[k] = x[0]
    return socs


def filterpy_filter(
    cell: Cell, current_A: Array, voltage_V: Array, soc: float, soc_sd: float, joint: bool
) -> Array:
    """Run the same filter on filterpy's `ExtendedKalmanFilter`."""
    model, variances = model_of(cell, joint)
    size = variances.size + 1
    ekf = ExtendedKalmanFilter(dim_x=size, dim_z=1)
    ekf.x = np.zeros((size, 1))
    ekf.x[0, 0], ekf.P = soc, np.diag([soc_sd**2, *variances])
    after = ekf.x

    def predict_x(u: float = 0.0) -> None:
        ekf.x = after

    ekf.predict_x = predict_x
    socs = np.empty(current_A.size)
    for k, (current, voltage) in enumerate(zip(current_A.tolist(), voltage_V.tolist(), strict=True)):
        if k > 0:
            moved, ekf.F, ekf.Q = move(model, ekf.x[:, 0], float(current_A[k - 1]))
            after = moved[:, None]
            ekf.predict()
        expected, h, r = see(model, ekf.x[:, 0], current)
        ekf.update(np.array([[voltage]]), lambda x, h=h: h, lambda x, e=expected: np.array([[e]]), R=r)
        socs[k] = ekf.x[0, 0]
    return socs

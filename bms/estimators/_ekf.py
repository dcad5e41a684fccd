"""The extended Kalman filter as a numba kernel; the maths stands in `bms.estimators.joint` and `.ekf`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms._ecm import Circuit, ocv_and_slope, ocv_at, parameters_at
from bms.estimators import _gate, _watch
from bms.estimators._absorb import notice, take_occasion, take_voltage
from bms.estimators._ekf_plain import run_plain
from bms.estimators._gate import Gate, glance, is_temperature, judge, warm
from bms.estimators._joint import (
    SLOPE,
    STATE,
    Noise,
    Ohms,
    Places,
    Settings,
    add_noise,
    carry,
    carry_shared,
    covariance_row,
    factor,
    lasting_ohm,
    move_and_linearise,
    see_wide,
    spread_of,
    table_slopes,
    white_variance,
)
from bms.estimators._report import keep_inside, report

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def forecast(
    places: Places,
    noise: Noise,
    g: Array,
    m: Array,
    ohm: Ohms,
    drive_A: float,
    charge_C2: float,
    is_gap: bool,
    step_s: float,
    per_C: float,
    rate: float,
) -> None:
    """Move state and covariances over a step."""
    top = covariance_row(places)
    move_and_linearise(places, m, ohm, drive_A, step_s, per_C, rate, noise.still_A)
    carry(places, m, top)
    carry(places, m, top + places.size)
    fades = min(step_s * noise.error_per_s, abs(drive_A) * step_s * per_C * noise.error_per_soc)
    carry_shared(places, m, max(1.0 - fades, 0.0))
    doubt = math.sqrt(charge_C2) / step_s if is_gap else g[_watch.DOUBT_A]
    add_noise(places, noise, m, ohm, doubt, charge_C2, per_C, step_s)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def expect(
    places: Places, m: Array, ohm: Ohms, ocv_V: float, over_soc: float, current_A: float
) -> tuple[float, float]:
    """Expected voltage and series resistance; the slopes go to their row."""
    current = current_A - m[STATE, places.bias] if places.bias >= 0 else current_A
    series = ohm[0] * factor(m, STATE, places.resistance)
    expected = ocv_V + m[STATE, 1] + series * current
    m[SLOPE, 0], m[SLOPE, 1] = over_soc, 1.0
    for i in range(2, places.size):
        m[SLOPE, i] = 0.0
    if places.v2 >= 0:
        m[SLOPE, places.v2] = 1.0
        expected += m[STATE, places.v2]
    if places.hysteresis >= 0:
        m[SLOPE, places.hysteresis] = ohm[5]
        expected += ohm[5] * m[STATE, places.hysteresis]
    if places.bias >= 0:
        m[SLOPE, places.bias] = -series
    if places.resistance >= 0:
        m[SLOPE, places.resistance] = series * current
    return expected, series


@njit(cache=True, nogil=True, error_model="numpy")
def run_joint(
    circuit: Circuit,
    gate: Gate,
    settings: Settings,
    memory: Array,
    current_A: Array,
    voltage_V: Array,
    step_s: Array,
    temperature_C: Array,
    every: int,
    rows: Array,
    row: Array,
) -> None:
    """Take samples; see `bms.estimators.base.KernelEstimator` for the arguments."""
    guide, knot, cubic, table = circuit.guide, circuit.knot, circuit.cubic, circuit.table
    nodes_C, activation_K, reference_K = circuit.temperature_C, circuit.activation_K, circuit.reference_K
    varies, rate, per_C = circuit.varies, circuit.hysteresis_rate, 1.0 / circuit.capacity_C
    heat_capacity, thermal_K_per_W = circuit.heat_capacity_J_per_K, circuit.thermal_resistance_K_per_W
    places, noise, watch, nominal = settings.places, settings.noise, settings.watch, settings.nominal
    g, m = memory[: _watch.END], memory[_watch.END :].reshape(-1, places.size)
    top = covariance_row(places)
    pending, at, due = int(g[_gate.PENDING]), 0, 0 if rows.shape[0] else -1
    celsius = g[_gate.TEMPERATURE_C]
    ohm = parameters_at(table, nodes_C, activation_K, reference_K, m[STATE, 0], celsius)
    for k in range(current_A.size):
        seen = glance(gate, g, current_A[k], voltage_V[k], step_s[k], temperature_C[k])
        if seen.flags == _gate.UNUSUAL:
            seen = judge(gate, g, current_A[k], voltage_V[k], step_s[k], temperature_C[k])
        flags, step, celsius = seen.flags, seen.step_s, seen.temperature_C
        if heat_capacity > 0.0 and not is_temperature(temperature_C[k]):
            celsius = warm(g, gate.ambient_C, heat_capacity, thermal_K_per_W, step)
        if step > 0.0:
            if varies:
                ohm = parameters_at(table, nodes_C, activation_K, reference_K, m[STATE, 0], celsius)
            is_gap = flags & _gate.GAP != 0
            forecast(
                places, noise, g, m, ohm, seen.drive_A, seen.charge_variance_C2, is_gap, step, per_C, rate
            )
        g[_watch.DOUBT_A] = seen.doubt_A
        fresh = notice(g, flags, seen.usable)
        if fresh:
            take_occasion(places, noise, guide, knot, cubic, g, m, fresh, voltage_V[k])
        flags |= keep_inside(places, m)
        residual = math.nan
        if seen.usable:
            soc, variance = m[STATE, 0], m[top, 0] + g[_watch.ERROR_V2] * m[top + places.size, 0]
            ocv, over_soc = ocv_and_slope(guide, knot, cubic, soc)
            bent, spread = 0.0, spread_of(variance, g[_watch.SPREAD])
            g[_watch.SPREAD] = spread
            if spread > 0.0:
                low, high = ocv_at(guide, knot, cubic, soc - spread), ocv_at(guide, knot, cubic, soc + spread)
                ocv, over_soc, bent = see_wide(ocv, low, high, 0.5 / spread)
            if varies:
                ohm = parameters_at(table, nodes_C, activation_K, reference_K, soc, celsius)
                over_r, over_h = table_slopes(table, nodes_C, activation_K, reference_K, soc, celsius)
                over_soc += over_r * seen.now_A
                if places.hysteresis >= 0:
                    over_soc += over_h * m[STATE, places.hysteresis]
            expected, series = expect(places, m, ohm, ocv, over_soc, seen.now_A)
            white = white_variance(noise, ohm, series, seen.doubt_A, step)
            residual = voltage_V[k] - expected
            flags |= take_voltage(
                places, noise, watch, g, m, bent, white, residual, step, lasting_ohm(ohm), per_C
            )
            flags |= keep_inside(places, m)
        if heat_capacity > 0.0:
            over_V = voltage_V[k] - ocv_at(guide, knot, cubic, m[STATE, 0])
            if varies and not seen.usable:
                ohm = parameters_at(table, nodes_C, activation_K, reference_K, m[STATE, 0], celsius)
            g[_gate.HEAT_W] = seen.now_A * over_V if seen.usable else seen.now_A**2 * ohm[0]
        pending |= flags
        if k == due or k == current_A.size - 1:
            report(places, m, m[:0], nominal, g[_watch.ERROR_V2], row)
            row[2], row[3] = residual, flags
        if k == due:
            rows[at] = row
            rows[at, 3] = pending
            pending, at, due = 0, at + 1, due + every
    g[_gate.PENDING] = pending


@njit(cache=True, nogil=True, error_model="numpy")
def run(
    circuit: Circuit,
    gate: Gate,
    settings: Settings,
    memory: Array,
    current_A: Array,
    voltage_V: Array,
    step_s: Array,
    temperature_C: Array,
    every: int,
    rows: Array,
    row: Array,
) -> None:
    """Take samples with the kernel that fits the state; the arguments are those of `run_joint`."""
    if settings.plain:
        run_plain(
            circuit, gate, settings, memory, current_A, voltage_V, step_s, temperature_C, every, rows, row
        )
    else:
        run_joint(
            circuit, gate, settings, memory, current_A, voltage_V, step_s, temperature_C, every, rows, row
        )

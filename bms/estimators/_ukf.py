"""The unscented Kalman filter as a numba kernel; the maths stands in `bms.estimators.ukf` and `.joint`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms._ecm import Circuit, ocv_at, parameters_at
from bms.estimators import _gate, _watch
from bms.estimators._absorb import notice, take_occasion, take_voltage
from bms.estimators._gate import Gate, glance, is_temperature, judge, warm
from bms.estimators._joint import (
    SLOPE,
    STATE,
    Ohms,
    Places,
    Settings,
    add_noise,
    carry,
    carry_shared,
    covariance_row,
    factor,
    lasting_ohm,
    move,
    move_and_linearise,
    white_variance,
)
from bms.estimators._report import keep_inside, report

Array = NDArray[np.float64]

LEAST_PIVOT = 1e-24
"""A variance below this is none: the state is known, and its row of the root stays empty."""


class Sigma(NamedTuple):
    """Weights of the sigma points."""

    reach: float  # distance from the mean in standard deviations, sqrt(n + lambda)
    centre: float  # weight of the central point in the mean
    centre_spread: float  # ... and in the covariance
    outer: float  # weight of each other point


class UkfSettings(NamedTuple):
    """Settings of the unscented filter."""

    joint: Settings
    sigma: Sigma


@njit(cache=True, nogil=True, error_model="numpy")
def take_root(n: int, m: Array, top: int, error_V2: float, s: Array) -> None:
    """Lower Cholesky factor of the covariance, and ``error_V2`` times that of the model error, to ``s[:n]``.

    A pivot that is not positive, by rounding or because the state is known, leaves its column empty.
    """
    for j in range(n):
        pivot = m[top + j, j] + error_V2 * m[top + n + j, j]
        for k in range(j):
            pivot -= s[j, k] * s[j, k]
        for i in range(j):
            s[i, j] = 0.0
        if pivot > LEAST_PIVOT:
            root = math.sqrt(pivot)
            s[j, j] = root
            for i in range(j + 1, n):
                total = m[top + i, j] + error_V2 * m[top + n + i, j]
                for k in range(j):
                    total -= s[i, k] * s[j, k]
                s[i, j] = total / root
        else:
            for i in range(j, n):
                s[i, j] = 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def spread_points(n: int, m: Array, reach: float, s: Array) -> None:
    """Sigma points to the 2 n + 1 rows behind the root: the state, then pairs along the root's columns."""
    for i in range(n):
        s[n, i] = m[STATE, i]
        for j in range(n):
            s[n + 1 + 2 * j, i] = m[STATE, i] + reach * s[i, j]
            s[n + 2 + 2 * j, i] = m[STATE, i] - reach * s[i, j]


@njit(cache=True, nogil=True, error_model="numpy")
def gather(n: int, m: Array, top: int, sigma: Sigma, s: Array) -> None:
    """Mean and covariance of the moved points."""
    for i in range(n):
        total = 0.0
        for q in range(n + 1, 3 * n + 1):
            total += s[q, i] - s[n, i]
        # About the central point, as the weights of the others may be large and of both signs.
        m[STATE, i] = s[n, i] + sigma.outer * total
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for q in range(n + 1, 3 * n + 1):
                total += (s[q, i] - m[STATE, i]) * (s[q, j] - m[STATE, j])
            centre = (s[n, i] - m[STATE, i]) * (s[n, j] - m[STATE, j])
            m[top + i, j] = m[top + j, i] = sigma.outer * total + sigma.centre_spread * centre


@njit(cache=True, nogil=True, error_model="numpy")
def slopes_from_points(places: Places, m: Array, sigma: Sigma, s: Array, seen: Array) -> tuple[float, float]:
    """Mean voltage, and the variance left out by the slopes ``h = P_xz' P^-1``, which go to their row.

    Differences over a pair of points are ``h L`` with the root L of P, so h comes by back substitution.
    """
    n = places.size
    total, square = 0.0, 0.0
    for q in range(1, 2 * n + 1):
        total += seen[q] - seen[0]
    mean = seen[0] + sigma.outer * total
    for q in range(1, 2 * n + 1):
        square += (seen[q] - mean) * (seen[q] - mean)
    variance = sigma.outer * square + sigma.centre_spread * (seen[0] - mean) * (seen[0] - mean)
    for j in range(n - 1, -1, -1):
        m[SLOPE, j] = 0.0
        if s[j, j] > 0.0:
            along = (seen[1 + 2 * j] - seen[2 + 2 * j]) / (2.0 * sigma.reach)
            variance -= along * along
            for i in range(j + 1, n):
                along -= m[SLOPE, i] * s[i, j]
            m[SLOPE, j] = along / s[j, j]
    return mean, max(variance, 0.0)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def voltage_of(places: Places, s: Array, q: int, ohm: Ohms, ocv_V: float, current_A: float) -> float:
    """Voltage at a point."""
    current = current_A - s[q, places.bias] if places.bias >= 0 else current_A
    voltage = ocv_V + s[q, 1] + ohm[0] * factor(s, q, places.resistance) * current
    if places.v2 >= 0:
        voltage += s[q, places.v2]
    if places.hysteresis >= 0:
        voltage += ohm[5] * s[q, places.hysteresis]
    return float(voltage)


@njit(cache=True, nogil=True, error_model="numpy")
def run(
    circuit: Circuit,
    gate: Gate,
    settings: UkfSettings,
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
    joint, sigma = settings.joint, settings.sigma
    places, noise, watch, nominal = joint.places, joint.noise, joint.watch, joint.nominal
    n = places.size
    g, m = memory[: _watch.END], memory[_watch.END :].reshape(-1, n)
    s, seen_V = np.zeros((3 * n + 1, n)), np.zeros(2 * n + 1)
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
            take_root(n, m, top, 0.0, s)
            spread_points(n, m, sigma.reach, s)
            for q in range(n, 3 * n + 1):
                if varies:
                    ohm = parameters_at(table, nodes_C, activation_K, reference_K, s[q, 0], celsius)
                move(places, s, q, ohm, seen.drive_A, step, per_C, rate, noise.still_A)
            if varies:
                ohm = parameters_at(table, nodes_C, activation_K, reference_K, m[STATE, 0], celsius)
            move_and_linearise(places, m, ohm, seen.drive_A, step, per_C, rate, noise.still_A)
            gather(n, m, top, sigma, s)
            carry(places, m, top + n)
            fades = min(step * noise.error_per_s, abs(seen.drive_A) * step * per_C * noise.error_per_soc)
            carry_shared(places, m, max(1.0 - fades, 0.0))
            doubt = g[_watch.DOUBT_A]
            if flags & _gate.GAP:
                doubt = math.sqrt(seen.charge_variance_C2) / step
            add_noise(places, noise, m, ohm, doubt, seen.charge_variance_C2, per_C, step)
        g[_watch.DOUBT_A] = seen.doubt_A
        fresh = notice(g, flags, seen.usable)
        if fresh:
            take_occasion(places, noise, guide, knot, cubic, g, m, fresh, voltage_V[k])
        flags |= keep_inside(places, m)
        residual = math.nan
        if seen.usable:
            take_root(n, m, top, g[_watch.ERROR_V2], s)
            spread_points(n, m, sigma.reach, s)
            for q in range(2 * n + 1):
                soc = s[n + q, 0]
                if varies:
                    ohm = parameters_at(table, nodes_C, activation_K, reference_K, soc, celsius)
                ocv = ocv_at(guide, knot, cubic, soc)
                seen_V[q] = voltage_of(places, s, n + q, ohm, ocv, seen.now_A)
            expected, bent = slopes_from_points(places, m, sigma, s, seen_V)
            if varies:
                ohm = parameters_at(table, nodes_C, activation_K, reference_K, m[STATE, 0], celsius)
            series = ohm[0] * factor(m, STATE, places.resistance)
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

"""Coulomb counting as a numba kernel; the maths stands in `bms.estimators.coulomb`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms._ecm import Circuit, ocv_at, parameters_at
from bms.estimators import _gate, _watch
from bms.estimators._gate import Gate, glance, judge
from bms.estimators._reset import read_rest

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

SOC, START_VARIANCE, SINCE_RESET_S, WHITE_C2, DOUBT_C2, START_SOC, WAS_AT_REST = 0, 1, 2, 3, 4, 5, 6
MEAN_V, MEAN_A, MEAN_SOC, SPAN_S, CHECK_S, DOUBTED_C, ALARM_S = range(7, 14)
SIZE = 14
"""Places in the memory behind the gate's; the second line is what the voltage is compared by: recent means,
the time that they span and since the last comparison, the charge put in doubt, how long it is flagged."""

CHECK_EVERY_S = 10.0
FAR_SD = 3.0


class Settings(NamedTuple):
    """Settings of coulomb counting."""

    current_sd_A: float
    bias_sd_A: float
    capacity_share: float  # relative standard deviation of the capacity
    full_sd: float
    rest_doubt_V: float
    contrary_V: float  # a voltage farther than this from all that is believed contradicts
    limit_A: float  # no current is larger
    resets_at_rest: bool
    resets_at_full: bool


@njit(cache=True, nogil=True, inline="always")
def _variance(settings: Settings, x: Array, per_C: float) -> float:
    """Variance of the SOC: where it started, noise, doubt, offset, and the capacity."""
    offset = settings.bias_sd_A * x[SINCE_RESET_S] * per_C
    scale = settings.capacity_share * (x[SOC] - x[START_SOC])
    charge = (x[WHITE_C2] + x[DOUBT_C2]) * per_C * per_C
    return float(x[START_VARIANCE] + charge + offset * offset + scale * scale)


@njit(cache=True, nogil=True)
def _restart(x: Array, soc: float, variance: float) -> None:
    x[MEAN_SOC] += soc - x[SOC]
    x[SOC], x[START_SOC], x[START_VARIANCE] = soc, soc, variance
    x[SINCE_RESET_S], x[WHITE_C2], x[DOUBT_C2] = 0.0, 0.0, 0.0


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _remember(x: Array, current_A: float, voltage_V: float, step_s: float) -> None:
    """Move the recent means of voltage, current and SOC."""
    x[SPAN_S] += step_s
    weight = min(step_s * _watch.PER_MEAN, 1.0)
    if x[SPAN_S] * _watch.PER_MEAN < 1.0 and step_s > 0.0:
        weight = step_s / x[SPAN_S]
    x[MEAN_V] += weight * (voltage_V - x[MEAN_V])
    x[MEAN_A] += weight * (current_A - x[MEAN_A])
    x[MEAN_SOC] += weight * (x[SOC] - x[MEAN_SOC])


@njit(cache=True, nogil=True)
def _compare(
    guide: IntArray, knot: Array, cubic: Array, lasting_ohm: float, settings: Settings, x: Array, per_C: float
) -> None:
    """Doubt the counted charge while the mean voltage contradicts all that is believed.

    It may be the current that is wrong, by so much as explains the voltage, see
    `bms.estimators._absorb.suspect`.
    """
    step_s, x[CHECK_S] = x[CHECK_S], 0.0
    soc, before = min(max(x[MEAN_SOC], 0.0), 1.0), x[DOUBTED_C]
    reach = FAR_SD * math.sqrt(min(_variance(settings, x, per_C), 1.0 / 12.0))
    shown_V = x[MEAN_V] - lasting_ohm * x[MEAN_A]
    low_V = ocv_at(guide, knot, cubic, max(soc - reach, 0.0))
    high_V = ocv_at(guide, knot, cubic, min(soc + reach, 1.0))
    off_V = max(low_V - shown_V, shown_V - high_V)
    if off_V <= settings.contrary_V:
        x[DOUBTED_C] = 0.0
        x[ALARM_S] = max(x[ALARM_S] - step_s, 0.0)
        return
    doubt_A = off_V / max(lasting_ohm, off_V / settings.limit_A)
    x[DOUBTED_C] = before + doubt_A * step_s
    x[DOUBT_C2] += x[DOUBTED_C] * x[DOUBTED_C] - before * before
    x[ALARM_S] = min(x[ALARM_S] + _watch.ALARM_RATE * step_s, _watch.ALARM_HOLD_S)


@njit(cache=True, nogil=True)
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
    """Take samples; see `bms.estimators.base.KernelEstimator` for the arguments."""
    guide, knot, cubic, per_C = circuit.guide, circuit.knot, circuit.cubic, 1.0 / circuit.capacity_C
    table, nodes_C = circuit.table, circuit.temperature_C
    activation_K, reference_K = circuit.activation_K, circuit.reference_K
    g, x = memory[: _gate.SIZE], memory[_gate.SIZE :]
    pending, at, due = int(g[_gate.PENDING]), 0, 0 if rows.shape[0] else -1
    for k in range(current_A.size):
        seen = glance(gate, g, current_A[k], voltage_V[k], step_s[k], temperature_C[k])
        if seen.flags == _gate.UNUSUAL:
            seen = judge(gate, g, current_A[k], voltage_V[k], step_s[k], temperature_C[k])
        flags = seen.flags
        x[SOC] += seen.drive_A * seen.step_s * per_C
        x[SINCE_RESET_S] += seen.step_s
        x[WHITE_C2] += (settings.current_sd_A * seen.step_s) ** 2
        x[DOUBT_C2] += seen.charge_variance_C2
        if settings.resets_at_full and flags & _gate.FULL:
            _restart(x, 1.0, settings.full_sd**2)
        at_rest = flags & _gate.REST != 0
        if settings.resets_at_rest and at_rest and seen.usable and x[WAS_AT_REST] == 0.0:
            soc, doubt = read_rest(guide, knot, cubic, voltage_V[k], settings.rest_doubt_V)
            before = _variance(settings, x, per_C)
            gain = before / (before + doubt) if before + doubt > 0.0 else 0.0
            _restart(x, x[SOC] + gain * (soc - x[SOC]), (1.0 - gain) * before)
        x[WAS_AT_REST] = 1.0 if at_rest else 0.0
        x[CHECK_S] += seen.step_s
        if seen.usable and seen.doubt_A == 0.0:
            _remember(x, seen.now_A, voltage_V[k], min(seen.step_s, gate.gap_s))
            if x[CHECK_S] >= CHECK_EVERY_S and x[SPAN_S] * _watch.PER_MEAN > 1.0:
                x[CHECK_S] = min(x[CHECK_S], gate.gap_s)
                ohm = parameters_at(
                    table, nodes_C, activation_K, reference_K, x[MEAN_SOC], seen.temperature_C
                )
                _compare(guide, knot, cubic, ohm[0] + ohm[1] + ohm[3], settings, x, per_C)
        if x[ALARM_S] > 0.0:
            flags |= _gate.MISMATCH
        if not 0.0 <= x[SOC] <= 1.0:
            x[SOC] = min(max(x[SOC], 0.0), 1.0)
            flags |= _gate.LIMIT
        pending |= flags
        if k == due or k == current_A.size - 1:
            # Nothing is less certain than a SOC that is anywhere between empty and full.
            variance = min(_variance(settings, x, per_C), 1.0 / 12.0)
            row[0], row[1], row[2], row[3] = x[SOC], variance, math.nan, flags
        if k == due:
            rows[at] = row
            rows[at, 3] = pending
            pending, at, due = 0, at + 1, due + every
    g[_gate.PENDING] = pending

r"""The equivalent circuit as numba kernels; the maths stands in `bms.cell`.

The current is held over a step of length :math:`h` (zero-order hold), and every state is moved exactly:

.. math::

    SOC' = SOC + \frac{h I}{Q}, \quad v_j' = e_j v_j + R_j (1 - e_j) I, \quad e_j = \exp(-h / \tau_j), \quad
    h' = f h + (1 - f) \operatorname{sign} I, \quad f = \exp(-\kappa h |I| / Q) .

Parameters that follow SOC or temperature are frozen over the step at its start. A voltage is sampled at the
start of a step, with the current of that step flowing. Beyond empty and full the OCV stays at its end value.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

ABSOLUTE_ZERO_C = -273.15


class Circuit(NamedTuple):
    """A cell as the kernels see it; `bms.circuit.tabulate` builds it."""

    capacity_C: float
    guide: IntArray  # (g + 1,) first segment of the OCV in each of g equal parts of [0, 1]
    knot: Array  # (n,) SOC nodes of the OCV
    cubic: Array  # (n - 1, 4) its cubics, highest power first, in soc - knot
    table: (
        Array  # (t, m, 6): R, R1, tau1, R2, tau2, hysteresis voltage over temperature and uniform SOC nodes
    )
    temperature_C: Array  # (t,)
    activation_K: float  # E / R_g
    reference_K: float
    varies: bool  # whether the table depends on SOC or temperature
    hysteresis_rate: float
    heat_capacity_J_per_K: float  # 0: isothermal
    thermal_resistance_K_per_W: float


@njit(cache=True, nogil=True, inline="always")
def find_segment(guide: IntArray, knot: Array, soc: float) -> int:
    """Find the segment of the OCV that holds ``soc``, which lies in [0, 1]."""
    at = guide[int(soc * (guide.size - 1))]
    while at < knot.size - 2 and soc >= knot[at + 1]:
        at += 1
    return int(at)


@njit(cache=True, nogil=True)
def ocv_at(guide: IntArray, knot: Array, cubic: Array, soc: float) -> float:
    """Open-circuit voltage at ``soc``, clipped to [0, 1]."""
    inside = min(max(soc, 0.0), 1.0)
    at = find_segment(guide, knot, inside)
    x = inside - knot[at]
    return float(((cubic[at, 0] * x + cubic[at, 1]) * x + cubic[at, 2]) * x + cubic[at, 3])


@njit(cache=True, nogil=True)
def ocv_and_slope(guide: IntArray, knot: Array, cubic: Array, soc: float) -> tuple[float, float]:
    """Open-circuit voltage and its slope at ``soc``, clipped to [0, 1]."""
    inside = min(max(soc, 0.0), 1.0)
    at = find_segment(guide, knot, inside)
    x = inside - knot[at]
    a, b, c, d = cubic[at, 0], cubic[at, 1], cubic[at, 2], cubic[at, 3]
    return ((a * x + b) * x + c) * x + d, (3.0 * a * x + 2.0 * b) * x + c


@njit(cache=True, nogil=True)
def parameters_at(
    table: Array, nodes_C: Array, activation_K: float, reference_K: float, soc: float, temperature_C: float
) -> tuple[float, float, float, float, float, float]:
    """Look up R, R1, tau1, R2, tau2 and the hysteresis voltage, linear in SOC and temperature."""
    x = min(max(soc, 0.0), 1.0) * (table.shape[1] - 1)
    m = min(int(x), table.shape[1] - 2)
    x -= m
    t = 0
    y = 0.0
    if nodes_C.size > 1:
        while t < nodes_C.size - 2 and temperature_C >= nodes_C[t + 1]:
            t += 1
        y = min(max((temperature_C - nodes_C[t]) / (nodes_C[t + 1] - nodes_C[t]), 0.0), 1.0)
    up = min(t + 1, nodes_C.size - 1)
    r = _blend(table, t, up, m, 0, x, y)
    r1 = _blend(table, t, up, m, 1, x, y)
    tau1 = _blend(table, t, up, m, 2, x, y)
    r2 = _blend(table, t, up, m, 3, x, y)
    tau2 = _blend(table, t, up, m, 4, x, y)
    if activation_K > 0.0:
        factor = math.exp(activation_K * (1.0 / (temperature_C - ABSOLUTE_ZERO_C) - 1.0 / reference_K))
        r, r1, tau1, r2, tau2 = r * factor, r1 * factor, tau1 * factor, r2 * factor, tau2 * factor
    return r, r1, tau1, r2, tau2, _blend(table, t, up, m, 5, x, y)


@njit(cache=True, nogil=True, inline="always")
def _blend(table: Array, t: int, up: int, m: int, column: int, x: float, y: float) -> float:
    low: float = table[t, m, column] + x * (table[t, m + 1, column] - table[t, m, column])
    if y == 0.0:
        return low
    high: float = table[up, m, column] + x * (table[up, m + 1, column] - table[up, m, column])
    return low + y * (high - low)


@njit(cache=True, nogil=True, inline="always")
def move_hysteresis(h: float, moved_soc: float, rate: float) -> float:
    """Move the hysteresis state along a change of SOC."""
    if moved_soc == 0.0:
        return h
    keep = math.exp(-rate * abs(moved_soc))
    return keep * h + math.copysign(1.0 - keep, moved_soc)


@njit(cache=True, nogil=True, inline="always")
def move_temperature(
    temperature_C: float, heat_W: float, ambient_C: float, thermal_resistance: float, keep: float
) -> float:
    """Move the thermal node exactly under constant heat; ``keep`` is ``exp(-h / (R_th C_th))``."""
    target = ambient_C + thermal_resistance * heat_W
    return target + keep * (temperature_C - target)


@njit(cache=True, nogil=True)
def simulate(
    circuit: Circuit,
    factors: Array,
    state: Array,
    current_A: Array,
    step_s: Array,
    ambient_C: Array,
    voltage_V: Array,
    track: Array,
) -> None:
    """Move a cell along a current; ``state`` is left at the end of the last step.

    Parameters
    ----------
    circuit : Circuit
        The cell.
    factors : ndarray, shape (4,)
        On capacity, series resistance, relaxation resistances, relaxation times.
    state : ndarray, shape (5,)
        SOC, v1, v2, h, temperature; changed.
    current_A : ndarray, shape (n,)
        Current held over each step.
    step_s, ambient_C : ndarray, shape (n,) or (1,)
        Length of each step and temperature of the surroundings; one value holds throughout.
    voltage_V : ndarray, shape (n,)
        Filled with the terminal voltage at the start of each step.
    track : ndarray, shape (5, n), (1, n) or (0, 0)
        Filled with the states (or the SOC alone) at the start of each step.
    """
    guide, knot, cubic, table, nodes_C = (
        circuit.guide,
        circuit.knot,
        circuit.cubic,
        circuit.table,
        circuit.temperature_C,
    )
    activation_K, reference_K = circuit.activation_K, circuit.reference_K
    varies, rate = circuit.varies, circuit.hysteresis_rate
    heat_capacity, thermal_resistance = circuit.heat_capacity_J_per_K, circuit.thermal_resistance_K_per_W
    capacity_C = circuit.capacity_C * factors[0]
    soc, v1, v2, h, temperature_C = state[0], state[1], state[2], state[3], state[4]
    tracked = track.shape[0]
    last_step = -1.0
    r, r1, tau1, r2, tau2, hysteresis_V = parameters_at(
        table, nodes_C, activation_K, reference_K, soc, temperature_C
    )
    r, r1, r2 = r * factors[1], r1 * factors[2], r2 * factors[2]
    tau1, tau2 = tau1 * factors[3], tau2 * factors[3]
    e1, e2, keep, moved = 0.0, 0.0, 0.0, 0.0
    here = 0
    for k in range(current_A.size):
        current = current_A[k]
        step = step_s[min(k, step_s.size - 1)]
        around_C = ambient_C[min(k, ambient_C.size - 1)]
        if heat_capacity == 0.0:
            temperature_C = around_C
        if varies:
            r, r1, tau1, r2, tau2, hysteresis_V = parameters_at(
                table, nodes_C, activation_K, reference_K, soc, temperature_C
            )
            r, r1, r2 = r * factors[1], r1 * factors[2], r2 * factors[2]
            tau1, tau2 = tau1 * factors[3], tau2 * factors[3]
        if varies or step != last_step:
            e1, e2 = math.exp(-step / tau1), math.exp(-step / tau2)
            moved = step / capacity_C
            if heat_capacity > 0.0:
                keep = math.exp(-step / (heat_capacity * thermal_resistance))
            last_step = step
        over_V = h * hysteresis_V + v1 + v2 + r * current
        inside = min(max(soc, 0.0), 1.0)
        # That a SOC is still in its segment, the processor foresees.
        if not knot[here] <= inside < knot[here + 1]:
            here = find_segment(guide, knot, inside)
        x = inside - knot[here]
        ocv_V = ((cubic[here, 0] * x + cubic[here, 1]) * x + cubic[here, 2]) * x + cubic[here, 3]
        voltage_V[k] = ocv_V + over_V
        if tracked > 0:
            track[0, k] = soc
            if tracked > 1:
                track[1, k], track[2, k], track[3, k], track[4, k] = v1, v2, h, temperature_C
        if heat_capacity > 0.0:
            temperature_C = move_temperature(
                temperature_C, current * over_V, around_C, thermal_resistance, keep
            )
        v1 = e1 * v1 + r1 * (1.0 - e1) * current
        v2 = e2 * v2 + r2 * (1.0 - e2) * current
        if rate > 0.0:
            h = move_hysteresis(h, moved * current, rate)
        soc += moved * current
    state[0], state[1], state[2], state[3], state[4] = soc, v1, v2, h, temperature_C


@njit(cache=True, nogil=True)
def simulate_members(
    circuit: Circuit,
    factors: Array,
    state: Array,
    current_A: Array,
    step_s: Array,
    ambient_C: Array,
    voltage_V: Array,
    track: Array,
) -> None:
    """Move many cells, each with its own factors (m, 4) and state (m, 5); the rest as in `simulate`.

    ``current_A`` has the shape (1, n), one for all, or (m, n); ``voltage_V`` and ``track`` are (m, n); a
    track of no rows is not written.
    """
    nothing = np.empty((0, 0))
    for i in range(factors.shape[0]):
        row = current_A[min(i, current_A.shape[0] - 1)]
        kept = track[i : i + 1] if track.shape[0] else nothing
        simulate(circuit, factors[i], state[i], row, step_s, ambient_C, voltage_V[i], kept)

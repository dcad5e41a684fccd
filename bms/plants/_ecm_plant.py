r"""One step of a cell that is asked for a power, as a numba kernel; the maths stands in `bms.plants.ecm`.

Everything a plant is stands in two arrays, ``m`` (what changes) and ``c`` (what does not), at the places
below: one array costs a call from Python a tenth of a microsecond, a tuple of thirteen fields several.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms._ecm import find_segment, move_hysteresis, move_temperature, ocv_at, parameters_at

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

SOC, V1, V2, HYSTERESIS, TEMPERATURE_C = range(5)
"""The state, in the order of `bms._ecm.simulate`."""
OHM, OHM1, TAU1, OHM2, TAU2, HYSTERESIS_V = range(5, 11)
"""The parameters at that state."""
CURRENT_A, VOLTAGE_V, WITHHELD_W = range(11, 14)
"""The last step: current, voltage at its end, power that was asked for and not delivered."""
CHARGE_C, TERMINAL_J, SERIES_J, RELAXATION_J, HYSTERESIS_J, REWRITTEN_J = range(14, 20)
"""The ledger since the start."""
SIZE = 20

CAPACITY_C, RESISTANCE, RELAXATION, SLOWNESS = range(4)
ACTIVATION_K, REFERENCE_K, VARIES, RATE, HEAT_CAPACITY, THERMAL_OHM, AMBIENT_C = range(4, 11)
DISCHARGE_A, CHARGE_A, LOWEST_V, HIGHEST_V = range(11, 15)
CONSTANTS = 15
"""Places of the constants: capacity, factors on R, R_j and tau_j, the circuit's numbers, limits."""


@njit(cache=True, nogil=True)
def ocv_integral(guide: IntArray, knot: Array, cubic: Array, below: Array, soc: float) -> float:
    """Integral of the OCV from empty to ``soc`` over SOC; ``below`` holds it at the knots."""
    inside = min(max(soc, 0.0), 1.0)
    at = find_segment(guide, knot, inside)
    x = inside - knot[at]
    a, b, c, d = cubic[at, 0], cubic[at, 1], cubic[at, 2], cubic[at, 3]
    beyond = (soc - inside) * (((a * x + b) * x + c) * x + d)
    return float(below[at] + (((a * x / 4.0 + b / 3.0) * x + c / 2.0) * x + d) * x + beyond)


@njit(cache=True, nogil=True)
def look_up(table: Array, nodes_C: Array, c: Array, m: Array) -> None:
    """Write the parameters at the state to their places, and what their change does to the capacitors."""
    r, r1, tau1, r2, tau2, hysteresis_V = parameters_at(
        table, nodes_C, c[ACTIVATION_K], c[REFERENCE_K], m[SOC], m[TEMPERATURE_C]
    )
    r1, r2 = r1 * c[RELAXATION], r2 * c[RELAXATION]
    tau1, tau2 = tau1 * c[SLOWNESS], tau2 * c[SLOWNESS]
    if m[OHM] > 0.0:
        m[REWRITTEN_J] -= _capacitor_energy(m)
    m[OHM], m[OHM1], m[TAU1] = r * c[RESISTANCE], r1, tau1
    m[OHM2], m[TAU2], m[HYSTERESIS_V] = r2, tau2, hysteresis_V
    m[REWRITTEN_J] += _capacitor_energy(m)


@njit(cache=True, nogil=True)
def _capacitor_energy(m: Array) -> float:
    """Energy in the capacitors of the relaxation pairs."""
    energy = 0.0
    if m[OHM1] > 0.0:
        energy += 0.5 * m[TAU1] / m[OHM1] * m[V1] * m[V1]
    if m[OHM2] > 0.0:
        energy += 0.5 * m[TAU2] / m[OHM2] * m[V2] * m[V2]
    return energy


@njit(cache=True, nogil=True)
def source_voltage(guide: IntArray, knot: Array, cubic: Array, m: Array) -> float:
    """Voltage behind the series resistance: what the terminals show without a current."""
    return float(ocv_at(guide, knot, cubic, m[SOC]) + m[HYSTERESIS_V] * m[HYSTERESIS] + m[V1] + m[V2])


@njit(cache=True, nogil=True)
def limited_current(source_V: float, power_W: float, step_s: float, c: Array, m: Array) -> float:
    """Solve for the current at a power, within the limits; what they withhold goes to its place."""
    ohm = m[OHM]
    low = max(-c[DISCHARGE_A], -0.5 * source_V / ohm, min(0.0, (c[LOWEST_V] - source_V) / ohm))
    low = max(low, min(0.0, -m[SOC] * c[CAPACITY_C] / step_s))
    high = min(c[CHARGE_A], max(0.0, (c[HIGHEST_V] - source_V) / ohm))
    high = min(high, max(0.0, (1.0 - m[SOC]) * c[CAPACITY_C] / step_s))
    root = math.sqrt(max(source_V * source_V + 4.0 * ohm * power_W, 0.0))
    current = 2.0 * power_W / (source_V + root)
    m[WITHHELD_W] = 0.0
    if current < low:
        m[WITHHELD_W] = low * (source_V + ohm * low) - power_W
        return float(low)
    return float(min(current, high))


@njit(cache=True, nogil=True)
def _relax(v: float, ohm: float, tau: float, current: float, step: float) -> tuple[float, float, float]:
    """Move a relaxation voltage; also its integral over the step and the energy its resistor takes."""
    keep = math.exp(-step / tau)
    end = ohm * current
    gap = v - end
    area = end * step + gap * tau * (1.0 - keep)
    if ohm == 0.0:
        return end + gap * keep, area, 0.0
    square = end * end * step + 2.0 * end * gap * tau * (1.0 - keep)
    square += 0.5 * gap * gap * tau * (1.0 - keep * keep)
    return end + gap * keep, area, square / ohm


@njit(cache=True, nogil=True)
def _hysteresis_work(h: float, charge_C: float, capacity_C: float, rate: float) -> float:
    """Integral of the hysteresis state over the charge that passes."""
    per = capacity_C / rate
    turned = abs(charge_C) / per
    return float(abs(charge_C) + (math.copysign(h, h * charge_C) - 1.0) * per * -math.expm1(-turned))


@njit(cache=True, nogil=True)
def carry(
    guide: IntArray,
    knot: Array,
    cubic: Array,
    below: Array,
    table: Array,
    nodes_C: Array,
    c: Array,
    m: Array,
    source_V: float,
    current: float,
    step: float,
) -> None:
    """Hold a current over a step: move the state, keep the ledger, and read the voltage at the end."""
    capacity_C, before = c[CAPACITY_C], ocv_integral(guide, knot, cubic, below, m[SOC])
    charge = step * current
    over_V = source_V - ocv_at(guide, knot, cubic, m[SOC]) + m[OHM] * current
    v1, area1, lost1 = _relax(m[V1], m[OHM1], m[TAU1], current, step)
    v2, area2, lost2 = _relax(m[V2], m[OHM2], m[TAU2], current, step)
    work = 0.0
    if c[RATE] > 0.0 and charge != 0.0:
        work = m[HYSTERESIS_V] * _hysteresis_work(m[HYSTERESIS], charge, capacity_C, c[RATE])
        m[HYSTERESIS] = move_hysteresis(m[HYSTERESIS], charge / capacity_C, c[RATE])
    if c[HEAT_CAPACITY] > 0.0:
        keep = math.exp(-step / (c[HEAT_CAPACITY] * c[THERMAL_OHM]))
        m[TEMPERATURE_C] = move_temperature(
            m[TEMPERATURE_C], current * over_V, c[AMBIENT_C], c[THERMAL_OHM], keep
        )
    series = m[OHM] * current * charge
    m[SOC] += charge / capacity_C
    m[V1], m[V2] = v1, v2
    m[CHARGE_C] += charge
    moved = capacity_C * (ocv_integral(guide, knot, cubic, below, m[SOC]) - before)
    m[TERMINAL_J] += moved + work + (area1 + area2) * current + series
    m[SERIES_J] += series
    m[RELAXATION_J] += lost1 + lost2
    m[HYSTERESIS_J] += work
    if c[VARIES] != 0.0:
        look_up(table, nodes_C, c, m)
    m[CURRENT_A] = current
    m[VOLTAGE_V] = source_voltage(guide, knot, cubic, m) + m[OHM] * current


@njit(cache=True, nogil=True)
def step_power(
    guide: IntArray,
    knot: Array,
    cubic: Array,
    below: Array,
    table: Array,
    nodes_C: Array,
    c: Array,
    m: Array,
    power_W: float,
    step_s: float,
) -> tuple[float, float]:
    """Find the current for a power at the start of a step, hold it, and return it with the last voltage."""
    source_V = source_voltage(guide, knot, cubic, m)
    current = limited_current(source_V, power_W, step_s, c, m)
    carry(guide, knot, cubic, below, table, nodes_C, c, m, source_V, current, step_s)
    return m[CURRENT_A], m[VOLTAGE_V]


@njit(cache=True, nogil=True)
def step_current(
    guide: IntArray,
    knot: Array,
    cubic: Array,
    below: Array,
    table: Array,
    nodes_C: Array,
    c: Array,
    m: Array,
    current_A: float,
    step_s: float,
) -> tuple[float, float]:
    """Hold a given current over a step, whatever the limits."""
    m[WITHHELD_W] = 0.0
    source_V = source_voltage(guide, knot, cubic, m)
    carry(guide, knot, cubic, below, table, nodes_C, c, m, source_V, current_A, step_s)
    return m[CURRENT_A], m[VOLTAGE_V]

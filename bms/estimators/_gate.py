r"""What every estimator does with a sample before it believes it.

A reading is *bad* when it is missing (NaN, inf), outside its range, or stuck: the same number at ten
samples or more while the other reading says that it must move (both are stuck when a voltage stays the same
to the last bit while a few per cent of the charge seem to pass). A bad voltage is not used. A bad current is
replaced, with the doubt :math:`s_I`, the recent spread: for ten seconds by the last one that was read, unless
that was stuck, then by the recent mean :math:`\bar I` over some ten minutes, in which a reading stands for
the time since the last good one. The error of a replaced current persists, so over a bad stretch the doubt
about the charge grows linearly and its variance with the square:

.. math:: d' = d + s_I h, \qquad \Delta \operatorname{var}(\text{charge}) = d'^2 - d^2 .

The same holds over a gap between samples; over a long one the battery is taken to have rested, with the doubt
of half an hour of use. A temperature that no battery has is passed over, as a missing one is: the last one
stays, or, where the cell has a thermal node, moves with it. A sample also gives away rest (little current for
long enough) and full charge. Of a current that flows from its sample on, the step before the first quiet
sample belongs to neither, unless it is a gap over which the battery is taken to have rested.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms._ecm import move_temperature

Array = NDArray[np.float64]

CURRENT_MISSING = 1
CURRENT_RANGE = 2
VOLTAGE_MISSING = 4
VOLTAGE_RANGE = 8
STUCK = 16
GAP = 32
OUTLIER = 64
MISMATCH = 128
LIMIT = 256
REST = 512
FULL = 1024
UNUSUAL = -1
"""Not an ordinary sample: `judge` is to be asked; the memory is untouched."""

STUCK_SAMPLES = 10
STUCK_JUMPS = 3
HELD_S = 10.0
COLDEST_C, HOTTEST_C = -60.0, 150.0
SHORTEST_S, LONGEST_S = 1e-6, 1e9

SEEN, LAST_A, LAST_DOUBT_A, MEAN_A, SQUARE_A2, DOUBT_C = 0, 1, 2, 3, 4, 5
RAW_V, SAME_V, LOW_A, HIGH_A = 6, 7, 8, 9
RAW_A, SAME_A, JUMPS = 10, 11, 12
REST_S, FULL_S, TEMPERATURE_C, SAME_C, PENDING, CALM, LEFT_V, HEAT_W = range(13, 21)
GONE_S = 21
SIZE = 22
"""Places in the gate's part of an estimator's memory, and how many there are.

SEEN is 1 after a sample and 2 after a current that was believed. REST_S and FULL_S are NOT_NOW where the last
sample was neither quiet nor full.
"""
NOT_NOW = -1.0


class Gate(NamedTuple):
    """Limits of what is believed."""

    current_limit_A: float
    voltage_low_V: float
    voltage_high_V: float
    gap_s: float  # a longer step is a gap
    long_gap_s: float  # over a longer gap the battery rested
    per_memory: float  # 1 / the time constant of the current's mean and spread, 1/s
    stuck_A: float  # a current swing that must move the voltage
    jump_V: float  # a voltage jump that needs a current
    stuck_C: float  # a charge that must move the voltage
    doubt_A: float  # least doubt about a replaced current
    start_A: float  # spread of the current before any was seen
    rest_A: float  # no more than this is rest
    rest_after_s: float
    full_V: float  # inf: no full charge known
    full_A: float
    full_after_s: float
    ambient_C: float  # temperature of the surroundings, where the cell's own is not measured
    looks_back: bool  # the current of a sample flowed since the one before, not from here on


class Screened(NamedTuple):
    """What the gate makes of a sample."""

    drive_A: float  # current that flowed since the previous sample
    now_A: float  # current that flows as the voltage is read
    doubt_A: float  # standard deviation of now_A beyond sensor noise
    charge_variance_C2: float  # added to the variance of the charge by this step
    usable: bool  # whether the voltage may be used
    temperature_C: float
    step_s: float
    flags: int


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def glance(
    gate: Gate, g: Array, current_A: float, voltage_V: float, step_s: float, temperature_C: float
) -> Screened:
    """Take an ordinary sample as `screen` would; of another, say so and touch nothing.

    A kernel calls this and, where the flags are UNUSUAL, `judge`: inlined together, numba counts
    references to the memory at every sample, which takes as long as the rest.

    Parameters
    ----------
    gate : Gate
        Limits.
    g : ndarray, shape (SIZE,)
        The gate's memory; changed.
    current_A, voltage_V, step_s, temperature_C : float
        The sample; the step since the previous one is taken as 0 at the first.
    """
    # After an ordinary sample, an ordinary one is told from all others here; NaN fails each comparison.
    ordinary = (
        g[CALM] == 1.0
        and gate.rest_A < abs(current_A) <= gate.current_limit_A
        and gate.voltage_low_V <= voltage_V <= gate.voltage_high_V
        and voltage_V < gate.full_V
        and SHORTEST_S <= step_s <= gate.gap_s
        and voltage_V != g[RAW_V]
        and current_A != g[RAW_A]
        and math.isnan(temperature_C)
    )
    drive = current_A if gate.looks_back else g[LAST_A]
    if ordinary:
        g[RAW_V], g[RAW_A], g[LAST_A] = voltage_V, current_A, current_A
        _remember_current(gate, g, current_A, step_s)
    flags = 0 if ordinary else UNUSUAL
    # The last use of the memory is in no branch, and nothing was called: else numba counts references to it.
    return Screened(drive, current_A, 0.0, 0.0, True, g[TEMPERATURE_C], step_s, flags)


@njit(cache=True, nogil=True, error_model="numpy")
def screen(
    gate: Gate, g: Array, current_A: float, voltage_V: float, step_s: float, temperature_C: float
) -> Screened:
    """Judge a sample and remember what the next one is judged by; arguments as for `glance`."""
    seen = glance(gate, g, current_A, voltage_V, step_s, temperature_C)
    if seen.flags == UNUSUAL:
        seen = judge(gate, g, current_A, voltage_V, step_s, temperature_C)
    return seen


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _remember_current(gate: Gate, g: Array, current_A: float, step_s: float) -> None:
    """Move the recent mean and mean square."""
    weight = min(step_s * gate.per_memory, 1.0)
    g[MEAN_A] += weight * (current_A - g[MEAN_A])
    g[SQUARE_A2] += weight * (current_A * current_A - g[SQUARE_A2])


@njit(cache=True, nogil=True, error_model="numpy")
def judge(
    gate: Gate, g: Array, current_A: float, voltage_V: float, step_s: float, temperature_C: float
) -> Screened:
    """Look at a sample from every side."""
    first = g[SEEN] == 0.0
    step = 0.0 if first or step_s < SHORTEST_S else min(step_s, LONGEST_S)
    if is_temperature(temperature_C):
        g[TEMPERATURE_C] = temperature_C
    if first:
        g[SQUARE_A2] = gate.start_A * gate.start_A
    flags = _range_flags(gate, current_A, voltage_V)
    stuck_current, stuck_voltage = _stuck(gate, g, current_A, voltage_V, step, flags, first)
    if stuck_current or stuck_voltage:
        flags |= STUCK
    bad_current = stuck_current or flags & (CURRENT_MISSING | CURRENT_RANGE) != 0
    bad_voltage = stuck_voltage or flags & (VOLTAGE_MISSING | VOLTAGE_RANGE) != 0
    mean = g[MEAN_A]
    spread = math.sqrt(max(g[SQUARE_A2] - mean * mean, 0.0)) + gate.doubt_A
    if bad_current:
        g[GONE_S] += step
        held = g[GONE_S] <= HELD_S and not stuck_current and not first
        now, doubt = g[LAST_A] if held else mean, spread
    else:
        # It stands for all the time without a reading, but beyond a gap for no more than any other.
        since = min(step + g[GONE_S], gate.gap_s)
        g[GONE_S] = 0.0
        now, doubt = current_A, 0.0
        if g[SEEN] < 2.0:
            # Else the mean would come from zero, in ten minutes; the spread stays what it was before any.
            g[SEEN], g[MEAN_A] = 2.0, now
            g[SQUARE_A2] += now * now
        _remember_current(gate, g, now, since)
    drive, drive_doubt = (now, doubt) if gate.looks_back else (g[LAST_A], g[LAST_DOUBT_A])
    long = step > gate.gap_s and step > gate.long_gap_s
    if step > gate.gap_s:
        flags |= GAP
        drive = 0.0 if long else mean
        drive_doubt = spread * gate.long_gap_s / step if long else spread
    before = g[DOUBT_C]
    g[DOUBT_C] = before + drive_doubt * step if drive_doubt > 0.0 else 0.0
    added = g[DOUBT_C] * g[DOUBT_C] - before * before if drive_doubt > 0.0 else 0.0
    flags |= _occasion(gate, g, now, voltage_V, step, long, bad_current, bad_voltage)
    g[SEEN], g[LAST_A], g[LAST_DOUBT_A] = max(g[SEEN], 1.0), now, doubt
    busy = g[REST_S] == NOT_NOW and g[FULL_S] == NOT_NOW
    calm = flags == 0 and busy and g[SAME_V] + g[SAME_A] + g[JUMPS] + g[DOUBT_C] == 0.0
    g[CALM] = 1.0 if calm else 0.0
    return Screened(drive, now, doubt, added, not bad_voltage, g[TEMPERATURE_C], step, flags)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def warm(
    g: Array, ambient_C: float, heat_capacity_J_per_K: float, thermal_K_per_W: float, step_s: float
) -> float:
    """Move the temperature that is not measured by the heat of the sample before."""
    keep = math.exp(-step_s / (heat_capacity_J_per_K * thermal_K_per_W))
    g[TEMPERATURE_C] = move_temperature(g[TEMPERATURE_C], g[HEAT_W], ambient_C, thermal_K_per_W, keep)
    return float(g[TEMPERATURE_C])


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def is_temperature(temperature_C: float) -> bool:
    """Whether a battery can have this temperature; NaN is none."""
    return COLDEST_C <= temperature_C <= HOTTEST_C


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _range_flags(gate: Gate, current_A: float, voltage_V: float) -> int:
    flags = 0
    if not math.isfinite(current_A):
        flags |= CURRENT_MISSING
    elif abs(current_A) > gate.current_limit_A:
        flags |= CURRENT_RANGE
    if not math.isfinite(voltage_V):
        flags |= VOLTAGE_MISSING
    elif voltage_V < gate.voltage_low_V or voltage_V > gate.voltage_high_V:
        flags |= VOLTAGE_RANGE
    return flags


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _stuck(
    gate: Gate, g: Array, current_A: float, voltage_V: float, step_s: float, flags: int, first: bool
) -> tuple[bool, bool]:
    """Count repeated readings of current and voltage, and how far the other reading moved meanwhile."""
    has_current = flags & (CURRENT_MISSING | CURRENT_RANGE) == 0
    has_voltage = flags & (VOLTAGE_MISSING | VOLTAGE_RANGE) == 0
    if has_voltage:
        if voltage_V == g[RAW_V] and not first:
            if g[SAME_V] == 0.0:
                g[LOW_A], g[HIGH_A] = g[LAST_A], g[LAST_A]
            g[SAME_V] += 1.0
            g[LEFT_V] = math.nan
            g[SAME_C] += abs(g[LAST_A]) * step_s
        else:
            if abs(voltage_V - g[RAW_V]) > gate.jump_V:
                # A spike of one sample, which comes back, was no jump.
                back = g[JUMPS] > 0.0 and abs(voltage_V - g[LEFT_V]) <= gate.jump_V
                g[JUMPS] += -1.0 if back else 1.0
                g[LEFT_V] = math.nan if back else g[RAW_V]
            else:
                g[LEFT_V] = math.nan
            g[RAW_V], g[SAME_V], g[SAME_C] = voltage_V, 0.0, 0.0
    if has_current:
        g[LOW_A], g[HIGH_A] = min(g[LOW_A], current_A), max(g[HIGH_A], current_A)
        if current_A == g[RAW_A] and not first:
            g[SAME_A] += 1.0
        else:
            g[RAW_A], g[SAME_A], g[JUMPS] = current_A, 0.0, 0.0
    repeats_voltage, repeats_current = g[SAME_V] >= STUCK_SAMPLES, g[SAME_A] >= STUCK_SAMPLES
    both = repeats_voltage and repeats_current and g[SAME_C] > gate.stuck_C
    stuck_voltage = repeats_voltage and g[HIGH_A] - g[LOW_A] > gate.stuck_A
    return both or (repeats_current and g[JUMPS] >= STUCK_JUMPS), both or stuck_voltage


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _occasion(
    gate: Gate,
    g: Array,
    current_A: float,
    voltage_V: float,
    step_s: float,
    rested: bool,
    bad_current: bool,
    bad_voltage: bool,
) -> int:
    """Notice rest and full charge, both only after they have lasted."""
    flags = 0
    if bad_current or abs(current_A) > gate.rest_A:
        g[REST_S] = NOT_NOW
    else:
        # What flowed before this sample is that of the one before, unless it looks back.
        counts = gate.looks_back or rested or g[REST_S] >= 0.0
        g[REST_S] = max(g[REST_S], 0.0) + (step_s if counts else 0.0)
        if g[REST_S] >= gate.rest_after_s:
            flags |= REST
    if bad_current or bad_voltage or voltage_V < gate.full_V or not 0.0 <= current_A <= gate.full_A:
        g[FULL_S] = NOT_NOW
    else:
        counts = gate.looks_back or g[FULL_S] >= 0.0
        g[FULL_S] = max(g[FULL_S], 0.0) + (step_s if counts else 0.0)
        if g[FULL_S] >= gate.full_after_s:
            flags |= FULL
    return flags

"""Kernels that the Kalman-type filters share; the maths stands in `bms.estimators.joint`.

All that a filter believes stands in the rows of one array ``m`` of ``size`` columns, see the places below: an
array handed to a kernel costs as much as its arithmetic here, so there is one. States that move come first
(SOC, one or two relaxation voltages, hysteresis), those that stay behind them (current bias, logarithms of
parameter factors), so that the transition is ``[[D, B], [0, 1]]`` with D diagonal.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms._ecm import move_hysteresis, parameters_at
from bms.estimators._watch import Watch

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Ohms = tuple[float, float, float, float, float, float]

STATE, SHARED, SEEN, ERRED, GAIN, SLOPE, DRIFT, LOWER, UPPER = 0, 1, 2, 3, 4, 5, 6, 7, 8
PRIOR, DRIVEN, MOVED = 9, 10, 11
"""Rows: state; its covariance with the model error; with the innovation, plain and per unit of the model
error; gain; slopes of the voltage; drift of the variances in a second; bounds; variances before any sample;
slopes of the moving states over the current; from there on, the moving states' slopes over all states (as
many rows as there are columns), then the covariance, then the covariance per unit variance of the model
error."""

MOST_VARIANCE = 1.0 / 12.0
"""Nothing is less certain than a SOC that is anywhere between empty and full."""
WIDE_VARIANCE = 1e-4
"""Above this the OCV is not taken as straight over a standard deviation."""
FAST = 0.25
"""Share of the model error's variance that changes fast; it keeps parameters from following the error."""
FAST_S = 60.0
"""How fast, s."""
DOUBT_S = 600.0
"""How long the error of a current lasts that stands in for a missing one."""


class Places(NamedTuple):
    """Where states stand in the vector; -1 for those that the filter does not have."""

    size: int
    moving: int
    v2: int
    hysteresis: int
    bias: int
    capacity: int
    resistance: int
    relaxation: int
    capacitance: int


class Noise(NamedTuple):
    """Noise of sensors and states, and when readings at rest and full charge are used."""

    current_A2: float
    voltage_V2: float
    error_per_s: float  # 1 / time over which the model error changes
    error_per_soc: float  # 1 / throughput in SOC over which it changes
    limit_A: float
    full_variance: float
    rest_V: float
    flat_V: float
    bend_s: float  # how long the error lasts that the bend of the curve makes
    still_A: float
    resets_at_rest: bool
    resets_at_full: bool


class Settings(NamedTuple):
    """Settings of a joint filter."""

    places: Places
    noise: Noise
    watch: Watch
    nominal: Array  # (size - moving,) see `bms.estimators._report.report`
    plain: bool  # two states and constant parameters


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def factor(a: Array, row: int, at: int) -> float:
    """The factor on a parameter whose logarithm stands at ``at``; 1 for one that is not estimated."""
    return math.exp(a[row, at]) if at >= 0 else 1.0


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def move(
    places: Places,
    a: Array,
    row: int,
    ohm: Ohms,
    current_A: float,
    step_s: float,
    per_C: float,
    rate: float,
    still_A: float,
) -> None:
    """Move the state in a row of ``a`` over a step; ``per_C`` is 1 / nominal capacity.

    Currents up to ``still_A`` do not turn the hysteresis: noise would, as it has always some sign.
    """
    current = current_A - a[row, places.bias] if places.bias >= 0 else current_A
    grown = factor(a, row, places.relaxation)
    slowed = grown * factor(a, row, places.capacitance)
    moved = step_s * per_C / factor(a, row, places.capacity) * current
    a[row, 0] += moved
    keep = math.exp(-step_s / (ohm[2] * slowed))
    a[row, 1] = keep * a[row, 1] + ohm[1] * grown * (1.0 - keep) * current
    if places.v2 >= 0:
        keep = math.exp(-step_s / (ohm[4] * slowed))
        a[row, places.v2] = keep * a[row, places.v2] + ohm[3] * grown * (1.0 - keep) * current
    if places.hysteresis >= 0 and abs(current) > still_A:
        a[row, places.hysteresis] = move_hysteresis(a[row, places.hysteresis], moved, rate)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def move_and_linearise(
    places: Places,
    m: Array,
    ohm: Ohms,
    current_A: float,
    step_s: float,
    per_C: float,
    rate: float,
    still_A: float,
) -> None:
    """Move the state as `move` does, and write its slopes over state and current to their rows."""
    current = current_A - m[STATE, places.bias] if places.bias >= 0 else current_A
    grown = factor(m, STATE, places.relaxation)
    slowed = grown * factor(m, STATE, places.capacitance)
    per = step_s * per_C / factor(m, STATE, places.capacity)
    moved = per * current
    m[MOVED, 0], m[DRIVEN, 0] = 1.0, per
    m[STATE, 0] += moved
    if places.capacity >= 0:
        m[MOVED, places.capacity] = -moved
    for pair in range(2):
        at = 1 if pair == 0 else places.v2
        if at >= 0:
            r, rise = ohm[1 + 2 * pair] * grown, step_s / (ohm[2 + 2 * pair] * slowed)
            keep = math.exp(-rise)
            lag = (m[STATE, at] - r * current) * keep * rise
            m[MOVED + at, at], m[DRIVEN, at] = keep, r * (1.0 - keep)
            m[STATE, at] = keep * m[STATE, at] + m[DRIVEN, at] * current
            if places.relaxation >= 0:
                m[MOVED + at, places.relaxation] = m[DRIVEN, at] * current + lag
            if places.capacitance >= 0:
                m[MOVED + at, places.capacitance] = lag
    at = places.hysteresis
    if at >= 0:
        turned = moved if abs(current) > still_A else 0.0
        turn = rate * abs(turned)
        keep, sign = math.exp(-turn), math.copysign(1.0, turned)
        m[MOVED + at, at] = keep
        m[DRIVEN, at] = rate * per * keep * (1.0 - sign * m[STATE, at]) if turned != 0.0 else 0.0
        if places.capacity >= 0:
            m[MOVED + at, places.capacity] = (m[STATE, at] - sign) * keep * turn
        m[STATE, at] = move_hysteresis(m[STATE, at], turned, rate)
    if places.bias >= 0:
        for i in range(places.moving):
            m[MOVED + i, places.bias] = -m[DRIVEN, i]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def covariance_row(places: Places) -> int:
    """First row of the covariance; that per unit variance of the model error begins ``size`` rows below."""
    return MOVED + places.size


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def rows_of(size: int) -> int:
    """How many rows an array of beliefs has."""
    return MOVED + 3 * size


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def carry(places: Places, m: Array, top: int) -> None:
    """Move the covariance whose rows begin at ``top`` along the transition."""
    first, n = places.moving, places.size
    # The mirror image below the diagonal takes the moved part while the other one is still needed.
    for i in range(first):
        for j in range(first, n):
            total = m[MOVED + i, i] * m[top + i, j]
            for k in range(first, n):
                total += m[MOVED + i, k] * m[top + k, j]
            m[top + j, i] = total
    for i in range(first):
        keep = m[MOVED + i, i]
        for j in range(i + 1):
            total = keep * m[top + i, j] * m[MOVED + j, j]
            for k in range(first, n):
                total += keep * m[top + i, k] * m[MOVED + j, k] + m[MOVED + i, k] * m[top + k, j]
            m[top + i, j] = total
    for i in range(first):
        for j in range(i):
            m[top + j, i] = m[top + i, j]
        for j in range(first, n):
            m[top + i, j] = m[top + j, i]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def carry_shared(places: Places, m: Array, keeps: float) -> None:
    """Move the covariance of the state with the model error, of which a part ``keeps`` remains."""
    for i in range(places.moving):
        total = m[MOVED + i, i] * m[SHARED, i]
        for k in range(places.moving, places.size):
            total += m[MOVED + i, k] * m[SHARED, k]
        m[SHARED, i] = total
    for i in range(places.size):
        m[SHARED, i] *= keeps


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def add_noise(
    places: Places,
    noise: Noise,
    m: Array,
    ohm: Ohms,
    doubt_A: float,
    charge_C2: float,
    per_C: float,
    step_s: float,
) -> None:
    """Add what a step adds to the covariance: sensor noise, drift, doubt about the current."""
    top = covariance_row(places)
    for i in range(places.moving):
        for j in range(places.moving):
            m[top + i, j] += noise.current_A2 * m[DRIVEN, i] * m[DRIVEN, j]
    for i in range(places.size):
        m[top + i, i] += m[DRIFT, i] * step_s
    if charge_C2 > 0.0:
        m[top, 0] += charge_C2 * per_C * per_C
        doubt = min(doubt_A, noise.limit_A)
        keep, spread = m[MOVED + 1, 1], ohm[1] * doubt
        m[top + 1, 1] += (1.0 - keep * keep) * spread * spread
        if places.v2 >= 0:
            keep, spread = m[MOVED + places.v2, places.v2], ohm[3] * doubt
            m[top + places.v2, places.v2] += (1.0 - keep * keep) * spread * spread
    if m[top, 0] > 0.25:
        shrink = math.sqrt(MOST_VARIANCE / m[top, 0])
        for i in range(places.size):
            m[top, i] *= shrink
            m[top + i, 0] *= shrink


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def spread_of(variance: float, before: float) -> float:
    """Distance from the mean at which a wide belief looks at the curve; 0 for a narrow one.

    One standard deviation; that of ``before`` serves while it is right to 10 %, for a root takes time.
    """
    square = before * before
    spread = before
    if variance <= WIDE_VARIANCE:
        spread = 0.0
    elif not 0.8 * variance < square < 1.2 * variance:
        spread = math.sqrt(min(variance, MOST_VARIANCE))
    return spread


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def see_wide(ocv_V: float, low_V: float, high_V: float, per_width: float) -> tuple[float, float, float]:
    """Mean OCV, slope, and the variance due to the bend, by differences over 1 / ``per_width``."""
    bend = 0.5 * (low_V + high_V) - ocv_V
    return ocv_V + bend, (high_V - low_V) * per_width, 2.0 * bend * bend


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def lasting(step_s: float, seconds: float) -> float:
    """By how much a variance counts in an update whose error is the same in all samples for some seconds.

    The first sample has no step; it counts as one of a series at 1 s.
    """
    return 1.0 + seconds / (max(step_s, 0.1) if step_s > 0.0 else 1.0)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def lasting_ohm(ohm: Ohms) -> float:
    """Resistance to a current that lasts."""
    return ohm[0] + ohm[1] + ohm[3]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def white_variance(noise: Noise, ohm: Ohms, series_ohm: float, doubt_A: float, step_s: float) -> float:
    """Variance of a voltage reading: sensor, current, and doubt about the current, which lasts."""
    white = noise.voltage_V2 + series_ohm * series_ohm * noise.current_A2
    if doubt_A > 0.0 and step_s > 0.0:
        spread = doubt_A * (series_ohm + ohm[1] + ohm[3])
        white += spread * spread * (1.0 + 2.0 * DOUBT_S / step_s)
    return white


@njit(cache=True, nogil=True, error_model="numpy")
def table_slopes(
    table: Array, nodes_C: Array, activation_K: float, reference_K: float, soc: float, temperature_C: float
) -> tuple[float, float]:
    """Slopes over the SOC of series resistance and hysteresis voltage."""
    low, high = max(soc - 0.005, 0.0), min(soc + 0.005, 1.0)
    below = parameters_at(table, nodes_C, activation_K, reference_K, low, temperature_C)
    above = parameters_at(table, nodes_C, activation_K, reference_K, high, temperature_C)
    return (above[0] - below[0]) / (high - low), (above[5] - below[5]) / (high - low)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def weigh(places: Places, m: Array, coupling: float) -> tuple[float, float]:
    """Covariance of the states with a measurement of the slopes in their row, and its variance without noise.

    ``coupling`` is how much of the model error the measurement carries.

    Returns
    -------
    tuple of float
        The variances, plain and per unit variance of the model error.
    """
    n, top = places.size, covariance_row(places)
    plain, unit = 0.0, coupling * coupling
    for i in range(n):
        a, b = 0.0, coupling * m[SHARED, i]
        for j in range(n):
            a += m[top + i, j] * m[SLOPE, j]
            b += m[top + n + i, j] * m[SLOPE, j]
        m[SEEN, i], m[ERRED, i] = a, b
        plain += m[SLOPE, i] * a
        unit += m[SLOPE, i] * (b + coupling * m[SHARED, i])
    return plain, unit


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def held_gain(noise: Noise, gain: float, without: float, slope: float) -> float:
    """Gain on the SOC, held back where the OCV is flat, and not turned round by the model error.

    The model error makes a gain negative when it is sure to have stayed as it was; one that turns with the
    current, as hysteresis does, would then be read the wrong way round. ``without`` is the gain without it.
    """
    held = max(gain, min(without, 0.0))
    if noise.flat_V > 0.0:
        held *= slope * slope / (slope * slope + noise.flat_V * noise.flat_V)
    return held


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def hold_back(noise: Noise, m: Array, without: float) -> None:
    """Hold back the gain on the SOC in its row, see `held_gain`."""
    m[GAIN, 0] = held_gain(noise, m[GAIN, 0], without, m[SLOPE, 0])


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def correct(
    places: Places, m: Array, coupling: float, noise_V2: float, plain: float, unit: float, innovation_V: float
) -> None:
    """Move the state by the gain in its row, and the covariances as any gain does (Joseph's form).

    With one measurement, ``(1 - k h') P (1 - k h')' + k r k'`` is
    ``P - k (P h)' - (P h) k' + k (h' P h + r) k'``.
    """
    n, top = places.size, covariance_row(places)
    crossed, total = coupling, plain + noise_V2
    for i in range(n):
        crossed += m[SLOPE, i] * m[SHARED, i]
    for i in range(n):
        gain = m[GAIN, i]
        m[STATE, i] += gain * innovation_V
        for j in range(i + 1):
            other = m[GAIN, j]
            a = gain * (other * total - m[SEEN, j]) - m[SEEN, i] * other
            b = gain * (other * unit - m[ERRED, j]) - m[ERRED, i] * other
            m[top + i, j] += a
            m[top + j, i] = m[top + i, j]
            m[top + n + i, j] += b
            m[top + n + j, i] = m[top + n + i, j]
    for i in range(n):
        m[SHARED, i] -= m[GAIN, i] * crossed

"""Kernels that take a voltage, a rest or a full charge into a belief; the maths: `bms.estimators.joint`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms.estimators import _gate, _watch
from bms.estimators._joint import (
    ERRED,
    FAST,
    FAST_S,
    GAIN,
    MOST_VARIANCE,
    SEEN,
    SHARED,
    SLOPE,
    STATE,
    Noise,
    Places,
    correct,
    covariance_row,
    hold_back,
    lasting,
    weigh,
)
from bms.estimators._reset import read_rest
from bms.estimators._watch import Watch, added_noise, is_lost, learn, mismatch_flag, weights

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

WAS_FULL, WAS_RESTING = 1, 2
FAR = 16.0
"""Square of the distance in standard deviations beyond which a full charge or a rest overrules the belief."""
CURVE_SOC = 0.003
"""Error of the OCV curve along the SOC: where it is steep, a table is off by many millivolts between nodes.

Left out where the user says that the model has no error at all."""
LOST_V = 0.02
"""Standard deviation of the relaxation voltages when a belief is given up."""


@njit(cache=True, nogil=True, error_model="numpy")
def give_up(places: Places, m: Array, voltages: int) -> None:
    """Forget what was believed of the SOC, and most of what was of the first few voltages behind it."""
    n, top = places.size, covariance_row(places)
    for i in range(n):
        m[top, i] = m[top + i, 0] = 0.0
        m[top + n, i] = m[top + n + i, 0] = 0.0
    m[SHARED, 0] = 0.0
    m[top, 0] = MOST_VARIANCE
    for i in range(1, voltages):
        m[top + i, i] += LOST_V * LOST_V


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def take_voltage(
    places: Places,
    noise: Noise,
    watch: Watch,
    g: Array,
    m: Array,
    bent_V2: float,
    white_V2: float,
    innovation_V: float,
    step_s: float,
) -> int:
    """Judge an innovation and, if it is believed, update.

    Parameters
    ----------
    places, noise, watch : NamedTuple
        Settings.
    g, m : ndarray
        Memory of gate and watch, and the belief with the slopes of the voltage in their row; changed.
    bent_V2, white_V2 : float
        Variance of the voltage due to what the slopes leave out, and due to white noise.
    innovation_V, step_s : float
        Measured minus expected voltage, and the time since the last one.

    Returns
    -------
    int
        Flags.
    """
    plain, unit = weigh(places, m, 1.0)
    error = g[_watch.ERROR_V2]
    if watch.error_V2 > 0.0:
        bent_V2 += CURVE_SOC * CURVE_SOC * m[SLOPE, 0] * m[SLOPE, 0]
    white = white_V2 + added_noise(g[_watch.EXCESS_V2], white_V2)
    held = plain + bent_V2 + error * unit
    noise_V2 = white + bent_V2 * lasting(step_s, noise.bend_s)
    noise_V2 += FAST * error * lasting(step_s, FAST_S)
    total = plain + error * unit + noise_V2
    lost = is_lost(watch, g[_watch.MEAN_V], g[_watch.NOISE_V2], g[_watch.SLOW_V2])
    if lost or innovation_V * innovation_V > watch.outlier * (held + white):
        flags = refuse(places, g, m, lost)
    else:
        g[_watch.REJECTED] = 0.0
        if watch.active:
            watch_innovation(watch, g, innovation_V, white_V2, held, step_s)
        per_total = 1.0 / total
        for i in range(places.size):
            m[GAIN, i] = (m[SEEN, i] + error * m[ERRED, i]) * per_total
        hold_back(noise, m, m[SEEN, 0] * per_total)
        correct(places, m, 1.0, noise_V2, plain, unit, innovation_V)
        flags = mismatch_flag(watch, g[_watch.EXCESS_V2], g[_watch.ERROR_V2])
    return flags


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def watch_innovation(
    watch: Watch, g: Array, innovation_V: float, white_V2: float, held_V2: float, step_s: float
) -> None:
    """Let the watch learn from an innovation that is believed."""
    weight, hold = weights(step_s)
    mean, noise, slow, excess, error = learn(
        watch,
        g[_watch.MEAN_V],
        g[_watch.NOISE_V2],
        g[_watch.SLOW_V2],
        g[_watch.EXCESS_V2],
        g[_watch.ERROR_V2],
        innovation_V,
        white_V2,
        held_V2,
        weight,
        hold,
    )
    g[_watch.MEAN_V], g[_watch.NOISE_V2], g[_watch.SLOW_V2] = mean, noise, slow
    g[_watch.EXCESS_V2], g[_watch.ERROR_V2] = excess, error


@njit(cache=True, nogil=True, error_model="numpy")
def refuse(places: Places, g: Array, m: Array, lost: bool) -> int:
    """Count a refused voltage; after too many in a row, or when ``lost``, the belief is given up.

    The next voltage is weighed against a SOC that may be anything.
    """
    for i in range(places.size):
        m[GAIN, i] = 0.0
    g[_watch.REJECTED] += 1.0
    if not lost and g[_watch.REJECTED] < _watch.MOST_REJECTED:
        return _gate.OUTLIER
    g[_watch.REJECTED] = 0.0
    g[_watch.MEAN_V], g[_watch.NOISE_V2], g[_watch.EXCESS_V2] = 0.0, 0.0, 0.0
    give_up(places, m, places.moving - (1 if places.hysteresis >= 0 else 0))
    return _gate.OUTLIER | _gate.MISMATCH


@njit(cache=True, nogil=True, error_model="numpy")
def take_soc(places: Places, g: Array, m: Array, soc: float, coupling: float, variance: float) -> None:
    """Update with a SOC read elsewhere.

    A reading far from the belief overrules it. One that says less than is known already is left aside, else
    the same reading taken twice would count twice.
    """
    n, top = places.size, covariance_row(places)
    for i in range(n):
        m[SLOPE, i] = 1.0 if i == 0 else 0.0
        m[GAIN, i] = 0.0
    error = g[_watch.ERROR_V2]
    known = m[top, 0] + error * m[top + n, 0]
    read = variance + coupling * coupling * error
    distance = soc - m[STATE, 0]
    if distance * distance > FAR * (known + read):
        give_up(places, m, 1)
        known = m[top, 0]
    if known <= read:
        return
    plain, unit = weigh(places, m, coupling)
    # Such noise that the variance afterwards is that of the reading.
    added = max(known * read / (known - read) - coupling * coupling * error, variance)
    total = plain + error * unit + added
    for i in range(n):
        m[GAIN, i] = (m[SEEN, i] + error * m[ERRED, i]) / total
    correct(places, m, coupling, added, plain, unit, distance)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def notice(g: Array, flags: int, usable: bool) -> int:
    """Say which of full charge and rest has just begun."""
    state = WAS_FULL if flags & _gate.FULL else 0
    if flags & _gate.REST and usable:
        state |= WAS_RESTING
    fresh = state & ~int(g[_watch.OCCASION])
    g[_watch.OCCASION] = state
    return fresh


@njit(cache=True, nogil=True, error_model="numpy")
def take_occasion(
    places: Places,
    noise: Noise,
    guide: IntArray,
    knot: Array,
    cubic: Array,
    g: Array,
    m: Array,
    fresh: int,
    voltage_V: float,
) -> None:
    """Use the beginning of a full charge or of a rest, as `notice` tells them."""
    if noise.resets_at_full and fresh & WAS_FULL:
        take_soc(places, g, m, 1.0, 0.0, noise.full_variance)
    elif noise.resets_at_rest and fresh & WAS_RESTING:
        soc, variance = read_rest(guide, knot, cubic, voltage_V, noise.rest_V)
        take_soc(places, g, m, soc, math.sqrt(variance) / noise.rest_V, variance)

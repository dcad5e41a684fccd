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
    PRIOR,
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
from bms.estimators._watch import Watch, added_noise, is_lost, learn, longest_alarm, mismatch_flag, weights

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

WAS_FULL, WAS_RESTING = 1, 2
FAR = 16.0
"""Square of the distance in standard deviations beyond which a full charge or a rest overrules the belief."""
CURVE_SOC = 0.003
"""Error of the OCV curve along the SOC: where it is steep, a table is off by many millivolts between nodes.

Left out where the user says that the model has no error at all."""


@njit(cache=True, nogil=True, error_model="numpy")
def give_up(places: Places, m: Array) -> None:
    """Forget what was believed of the SOC."""
    n, top = places.size, covariance_row(places)
    for i in range(n):
        m[top, i] = m[top + i, 0] = 0.0
        m[top + n, i] = m[top + n + i, 0] = 0.0
    m[SHARED, 0] = 0.0
    m[top, 0] = MOST_VARIANCE


@njit(cache=True, nogil=True, error_model="numpy")
def start_anew(places: Places, watch: Watch, g: Array, m: Array) -> None:
    """Forget all that voltages taught: none can say which of them were wrong.

    Parameters and hysteresis are what they were before the first sample. The relaxation follows from the
    current, so it keeps its mean.
    """
    g[_watch.MEAN_V], g[_watch.NOISE_V2], g[_watch.SLOW_V2], g[_watch.EXCESS_V2] = 0.0, 0.0, 0.0, 0.0
    g[_watch.ERROR_V2], g[_watch.TRUST_S] = watch.error_V2, _watch.LEAST_TRUST_S
    g[_watch.DOUBT_C], g[_watch.MISMATCH_S] = 0.0, 0.0
    g[_watch.ALARM_S] = longest_alarm(g[_watch.PATIENCE_S])
    n, top = places.size, covariance_row(places)
    for i in range(n):
        m[SHARED, i] = 0.0
        for j in range(n):
            m[top + i, j] = m[top + n + i, j] = 0.0
        m[top + i, i] = m[PRIOR, i]
        if i != 0 and i != 1 and i != places.v2:
            m[STATE, i] = 0.0
    m[top, 0] = MOST_VARIANCE
    m[top + 1, 1] += watch.lost_V2
    if places.v2 >= 0:
        m[top + places.v2, places.v2] += watch.lost_V2


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
    ohm: float,
    per_C: float,
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
    ohm, per_C : float
        Resistance to a lasting current, and 1 / capacity.

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
        flags = refuse(places, watch, g, m, lost, step_s)
    else:
        g[_watch.TRUST_S] = min(g[_watch.TRUST_S] + step_s, _watch.MOST_TRUST_S)
        shown = 0.0
        if watch.active:
            given = held - (error - watch.error_V2) * unit
            shown = watch_innovation(watch, g, innovation_V, white_V2, held, given, step_s)
        per_total = 1.0 / total
        for i in range(places.size):
            m[GAIN, i] = (m[SEEN, i] + error * m[ERRED, i]) * per_total
        hold_back(noise, m, m[SEEN, 0] * per_total)
        correct(places, m, 1.0, noise_V2, plain, unit, innovation_V)
        flags = mismatch_flag(watch, g[_watch.EXCESS_V2], shown)
        if flags or is_suspected(g):
            flags |= suspect(places, noise, watch, g, m, flags, shown, ohm, step_s, per_C)
    return flags


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def watch_innovation(
    watch: Watch,
    g: Array,
    innovation_V: float,
    white_V2: float,
    held_V2: float,
    given_V2: float,
    step_s: float,
) -> float:
    """Let the watch learn from an innovation that is believed; what it finds not explained, see `learn`."""
    weight, quick, hold = weights(step_s)
    mean, noise, slow, excess, error, shown = learn(
        watch,
        g[_watch.MEAN_V],
        g[_watch.NOISE_V2],
        g[_watch.SLOW_V2],
        g[_watch.EXCESS_V2],
        g[_watch.ERROR_V2],
        innovation_V,
        white_V2,
        held_V2,
        given_V2,
        weight,
        quick,
        hold,
    )
    g[_watch.MEAN_V], g[_watch.NOISE_V2], g[_watch.SLOW_V2] = mean, noise, slow
    g[_watch.EXCESS_V2], g[_watch.ERROR_V2] = excess, error
    return shown


@njit(cache=True, nogil=True, error_model="numpy")
def refuse(places: Places, watch: Watch, g: Array, m: Array, lost: bool, step_s: float) -> int:
    """Refuse a voltage; after minutes of such ones in a row, or when ``lost``, the belief is given up.

    The next voltage is weighed against a SOC that may be anything.
    """
    for i in range(places.size):
        m[GAIN, i] = 0.0
    g[_watch.TRUST_S] -= min(max(step_s, _watch.LEAST_STEP_S), _watch.MOST_STEP_S)
    if not lost and g[_watch.TRUST_S] > 0.0:
        return _gate.OUTLIER
    start_anew(places, watch, g, m)
    g[_watch.ALARM_S] = max(g[_watch.ALARM_S], _watch.REFUSED_HOLD_S)
    return _gate.OUTLIER | _gate.MISMATCH


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def is_suspected(g: Array) -> bool:
    """Whether `suspect` has something to end, though nothing new has been found."""
    return bool(g[_watch.ALARM_S] > 0.0 or g[_watch.PATIENCE_S] > _watch.LEAST_PATIENCE_S)


@njit(cache=True, nogil=True, error_model="numpy")
def suspect(
    places: Places,
    noise: Noise,
    watch: Watch,
    g: Array,
    m: Array,
    mismatch: int,
    shown_V2: float,
    ohm: float,
    step_s: float,
    per_C: float,
) -> int:
    """Doubt the counted charge while a mean of the innovations is not explained, and end what does not end.

    It may be the current that is wrong, by so much as explains that mean; its error lasts, so the doubt about
    the charge grows with the time, and its variance with the square. A mismatch that stands for long may be
    what wrong readings taught: the belief is given up.

    Returns
    -------
    int
        Flags, those of `refuse` for a belief given up.
    """
    before = g[_watch.DOUBT_C]
    g[_watch.DOUBT_C] = 0.0
    if not mismatch:
        g[_watch.MISMATCH_S] = max(g[_watch.MISMATCH_S] - step_s, 0.0)
        g[_watch.CALM_S] += step_s
        if g[_watch.CALM_S] > _watch.CALM_AFTER_S:
            g[_watch.PATIENCE_S] = _watch.LEAST_PATIENCE_S
        g[_watch.ALARM_S] = max(g[_watch.ALARM_S] - step_s, 0.0)
        return _gate.MISMATCH if g[_watch.ALARM_S] > 0.0 else 0
    if shown_V2 > 0.0:
        least = math.sqrt(shown_V2) / noise.limit_A
        doubt = before + math.sqrt(shown_V2) / max(ohm, least) * step_s
        g[_watch.DOUBT_C] = doubt
        top = covariance_row(places)
        added = (doubt * doubt - before * before) * per_C * per_C
        m[top, 0] += min(added, max(MOST_VARIANCE - m[top, 0], 0.0))
    alarm = g[_watch.ALARM_S] + _watch.ALARM_RATE * step_s
    g[_watch.ALARM_S] = max(g[_watch.ALARM_S] - step_s, min(alarm, longest_alarm(g[_watch.PATIENCE_S])))
    g[_watch.CALM_S] = 0.0
    g[_watch.MISMATCH_S] += step_s
    if g[_watch.MISMATCH_S] <= g[_watch.PATIENCE_S]:
        return mismatch
    start_anew(places, watch, g, m)
    g[_watch.PATIENCE_S] = min(_watch.MORE_PATIENCE * g[_watch.PATIENCE_S], _watch.MOST_PATIENCE_S)
    return mismatch | _gate.OUTLIER


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
        give_up(places, m)
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

"""Whether the innovations look as the model says they should; the maths stands in `bms.estimators.joint`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms.estimators import _gate

Array = NDArray[np.float64]

MEAN_V, NOISE_V2, SLOW_V2, EXCESS_V2 = _gate.SIZE, _gate.SIZE + 1, _gate.SIZE + 2, _gate.SIZE + 3
ERROR_V2, TRUST_S, OCCASION, DOUBT_A = _gate.SIZE + 4, _gate.SIZE + 5, _gate.SIZE + 6, _gate.SIZE + 7
SPREAD, DOUBT_C, PATIENCE_S = _gate.SIZE + 8, _gate.SIZE + 9, _gate.SIZE + 10
MISMATCH_S, CALM_S, ALARM_S = _gate.SIZE + 11, _gate.SIZE + 12, _gate.SIZE + 13
END = _gate.SIZE + 14
"""Places behind the gate's in a filter's memory, and where they end: the watch's own, and what the filter
recalls of the sample before."""

PER_MEAN = 1.0 / 300.0
"""1 / time constant of the means, 1/s."""
PER_HOLD = 1.0 / 43200.0
"""1 / time constant with which a model error that was seen is forgotten, 1/s."""
PER_EXCESS = 1.0 / 150.0
"""1 / time constant of the surplus of squared innovations, 1/s."""
LEAST_TRUST_S, MOST_TRUST_S = 10.0, 300.0
"""Seconds of refused voltages before the belief is held to be wrong, not the voltages: of a belief that none
has confirmed yet, and of one that many have. Charge carries it longer, but a wrong one must not stand."""
ALARM_RATE, ALARM_HOLD_S = 4.0, 480.0
"""MISMATCH stands so many times as long as innovations called for it, up to this, s, ..."""
ALARM_PER_PATIENCE, ALARM_WITHIN_S = 2.0, 450.0
"""... or so many times what the patience is beyond this, s: a model always wrong is always flagged."""
LEAST_PATIENCE_S, MOST_PATIENCE_S, MORE_PATIENCE = 300.0, 43200.0, 2.0
"""How long a mismatch may stand before the belief is given up, s: longer each time, as a wrong model stays
wrong."""
CALM_AFTER_S = 86400.0
"""After so long without a mismatch it is as short as at first, s: a wrong model has its calm hours."""
LEAST_STEP_S, MOST_STEP_S = 0.1, 5.0
"""What a refused voltage counts at least and at most, s: no single one says that the belief is wrong."""


class Watch(NamedTuple):
    """Settings of the watch."""

    error_V2: float  # variance of the slow model error that is always there
    most_V2: float  # variance of the largest model error that is believed
    outlier: float  # square of the innovation in standard deviations beyond which it is refused
    active: bool  # whether errors that are seen raise the model error
    lost_V2: float  # variance of the relaxation voltages when a belief is given up
    seen_V2: float  # a model error or an excess of noise of this variance is worth a flag


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def weights(step_s: float) -> tuple[float, float, float]:
    """Parts of the means, the surplus, and of a model error that was seen, that a step replaces."""
    return min(step_s * PER_MEAN, 1.0), min(step_s * PER_EXCESS, 1.0), min(step_s * PER_HOLD, 1.0)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def learn(
    watch: Watch,
    mean_V: float,
    noise_V2: float,
    slow_V2: float,
    excess_V2: float,
    error_V2: float,
    innovation_V: float,
    white_V2: float,
    held_V2: float,
    given_V2: float,
    weight: float,
    quick: float,
    hold: float,
) -> tuple[float, float, float, float, float, float]:
    """Move the means, and the model error with them.

    Parameters
    ----------
    watch : Watch
        Settings.
    mean_V, noise_V2, slow_V2, excess_V2, error_V2 : float
        The mean innovation; the variance that white noise gives it; the mean variance of all that lasts, with
        the model error that was given; the mean surplus of the squared innovation over its variance; the
        variance of the model error.
    innovation_V, white_V2, held_V2, given_V2 : float
        The innovation, its variance due to white noise, due to what lasts, and the same with the model error
        that was given.
    weight, quick, hold : float
        Parts that the step replaces, from `weights`.

    Returns
    -------
    tuple of float
        The first five, moved, and the square of a mean that is not explained by what was given, else 0.
    """
    keep = 1.0 - weight
    mean = mean_V + weight * (innovation_V - mean_V)
    noise = keep * keep * noise_V2 + weight * weight * white_V2
    # A mean forgets by amplitudes, so its variance falls twice as fast.
    slow = slow_V2 + (weight if given_V2 > slow_V2 else min(weight + weight, 1.0)) * (given_V2 - slow_V2)
    surplus = innovation_V * innovation_V - white_V2 - held_V2
    # A wide belief that innovations do not use says nothing of their noise.
    excess = max(excess_V2 + quick * (surplus - excess_V2), 0.0)
    error = error_V2 - (error_V2 - watch.error_V2) * hold
    square, shown = mean * mean, 0.0
    if square > 16.0 * noise + 2.25 * slow:
        shown = square - 16.0 * noise
        error = max(error, min(shown, watch.most_V2))
        shown = shown if shown > watch.error_V2 + watch.seen_V2 else 0.0
    return mean, noise, slow, excess, error, shown


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def is_lost(watch: Watch, mean_V: float, noise_V2: float, slow_V2: float) -> bool:
    """Whether the innovations have a mean that no believable model error explains: the belief is wrong."""
    return mean_V * mean_V > watch.most_V2 + 16.0 * noise_V2 + 2.25 * slow_V2


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def added_noise(excess_V2: float, white_V2: float) -> float:
    """White noise beyond the known one that the innovations show; a fifth of the known one is chance."""
    return max(excess_V2 - 0.2 * white_V2, 0.0)


REFUSED_HOLD_S = 1200.0
"""How long MISMATCH stands after a belief was given up against refused voltages, s: they may be wrong."""


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def longest_alarm(patience_s: float) -> float:
    """How long MISMATCH stands at most."""
    return max(ALARM_PER_PATIENCE * (patience_s - ALARM_WITHIN_S), ALARM_HOLD_S)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def mismatch_flag(watch: Watch, excess_V2: float, shown_V2: float) -> int:
    """MISMATCH while innovations show a model error, or noise, well above what was given."""
    if shown_V2 > 0.0 or excess_V2 > 4.0 * watch.seen_V2:
        return _gate.MISMATCH
    return 0

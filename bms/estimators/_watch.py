"""Whether the innovations look as the model says they should; the maths stands in `bms.estimators.joint`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms.estimators import _gate

Array = NDArray[np.float64]

MEAN_V, NOISE_V2, SLOW_V2, EXCESS_V2 = _gate.SIZE, _gate.SIZE + 1, _gate.SIZE + 2, _gate.SIZE + 3
ERROR_V2, REJECTED, OCCASION, DOUBT_A = _gate.SIZE + 4, _gate.SIZE + 5, _gate.SIZE + 6, _gate.SIZE + 7
SPREAD = _gate.SIZE + 8
END = _gate.SIZE + 9
"""Places behind the gate's in a filter's memory, and where they end: the watch's own, and what the filter
recalls of the sample before."""

PER_MEAN = 1.0 / 300.0
"""1 / time constant of the means, 1/s."""
PER_HOLD = 1.0 / 43200.0
"""1 / time constant with which a model error that was seen is forgotten, 1/s."""
MOST_REJECTED = 10
"""Voltages in a row that are refused before the belief is held to be wrong, not the voltages."""


class Watch(NamedTuple):
    """Settings of the watch."""

    error_V2: float  # variance of the slow model error that is always there
    most_V2: float  # variance of the largest model error that is believed
    outlier: float  # square of the innovation in standard deviations beyond which it is refused
    active: bool  # whether errors that are seen raise the model error
    seen_V2: float  # a model error or an excess of noise of this variance is worth a flag


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def weights(step_s: float) -> tuple[float, float]:
    """Parts of the means, and of a model error that was seen, that a step replaces."""
    return min(step_s * PER_MEAN, 1.0), min(step_s * PER_HOLD, 1.0)


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
    weight: float,
    hold: float,
) -> tuple[float, float, float, float, float]:
    """Move the means, and the model error with them.

    Parameters
    ----------
    watch : Watch
        Settings.
    mean_V, noise_V2, slow_V2, excess_V2, error_V2 : float
        The mean innovation; the variance that white noise gives it; the mean variance of all that lasts; the
        mean surplus of the squared innovation over its variance; the variance of the model error.
    innovation_V, white_V2, held_V2 : float
        The innovation, its variance due to white noise and due to what lasts.
    weight, hold : float
        Parts of means and model error that a step replaces, from `weights`.

    Returns
    -------
    tuple of float
        The first five, moved.
    """
    keep = 1.0 - weight
    mean = mean_V + weight * (innovation_V - mean_V)
    noise = keep * keep * noise_V2 + weight * weight * white_V2
    slow = slow_V2 + weight * (held_V2 - slow_V2)
    surplus = innovation_V * innovation_V - white_V2 - held_V2
    excess = excess_V2 + weight * (surplus - excess_V2)
    error = error_V2 - (error_V2 - watch.error_V2) * hold
    square = mean * mean
    if square > 16.0 * noise + 2.25 * slow:
        error = max(error, min(square - 16.0 * noise, watch.most_V2))
    return mean, noise, slow, excess, error


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def is_lost(watch: Watch, mean_V: float, noise_V2: float, slow_V2: float) -> bool:
    """Whether the innovations have a mean that no believable model error explains: the belief is wrong."""
    return mean_V * mean_V > 9.0 * watch.most_V2 + 16.0 * noise_V2 + 2.25 * slow_V2


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def added_noise(excess_V2: float, white_V2: float) -> float:
    """White noise beyond the known one that the innovations show; a fifth of the known one is chance."""
    return max(excess_V2 - 0.2 * white_V2, 0.0)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def mismatch_flag(watch: Watch, excess_V2: float, error_V2: float) -> int:
    """MISMATCH while the model error or the noise stands well above what was given."""
    if error_V2 - watch.error_V2 > watch.seen_V2 or excess_V2 > 4.0 * watch.seen_V2:
        return _gate.MISMATCH
    return 0

"""Fewer points for the eye: keep the extremes of every stretch, so that no peak goes missing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def extremes(values: NDArray[np.floating], stride: int) -> NDArray[np.intp]:
    """Return where each stretch of a series has its least and its greatest value, in order of time.

    Parameters
    ----------
    values : ndarray, shape (n,)
        The series, without NaN.
    stride : int
        Samples in a stretch, at least 1; the last one may be shorter.

    Returns
    -------
    ndarray of int, shape (2 * ceil(n / stride),)
        Two indices a stretch, ascending; they are equal where a stretch is constant.
    """
    if values.size == 0:
        return np.empty(0, dtype=np.intp)
    starts = np.arange(0, values.size, stride)
    missing = starts.size * stride - values.size
    # Repeating the last sample changes neither extreme, and argmin returns the first of equals.
    rows = np.concatenate((values, np.repeat(values[-1:], missing))).reshape(-1, stride)
    pairs = np.stack((rows.argmin(axis=1), rows.argmax(axis=1)), axis=1)
    pairs.sort(axis=1)
    return (pairs + starts[:, None]).ravel()


def stride_for(samples: int, points: int) -> int:
    """Return the least stride that leaves at most ``points`` stretches of a series."""
    return max(1, -(-samples // max(points, 1)))

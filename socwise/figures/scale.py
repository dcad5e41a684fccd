"""Where to cut an axis off, so that a few long bars do not flatten all others."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

_OUTLYING = 3.0
_HEADROOM = 1.5


def cut_of(lengths: Sequence[float]) -> float | None:
    """Return where to cut bars off, or None where all of them can be read on one scale.

    Parameters
    ----------
    lengths : sequence of float
        Lengths of the bars; finite.

    Returns
    -------
    float or None
        Half as much again as the longest bar that is at most three times as long as the median one.
    """
    if not lengths or (middle := median(lengths)) <= 0.0 or max(lengths) <= _OUTLYING * middle:
        return None
    return _HEADROOM * max(length for length in lengths if length <= _OUTLYING * middle)

r"""The interval of a saving in per cent, where the baseline is as uncertain as the saving.

With means ``A`` and ``B`` of two policies and the half widths of the intervals of ``A``, ``B`` and
``A - B``, the values ``R`` of ``A / B`` that the sample does not rule out are those for which zero lies in
the interval of ``A - R B`` (Fieller's theorem):

.. math:: (A - R B)^2 \le a^2 - 2 R c + R^2 b^2, \qquad c = (a^2 + b^2 - d^2) / 2.

To divide the interval of ``A - B`` by ``B`` instead would let a policy save more than all there is. One is
inside the interval of the ratio exactly where zero is inside that of the difference.
"""

from __future__ import annotations

import math


def ratio_interval(
    mean: float, baseline: float, half_mean: float, half_baseline: float, half_difference: float
) -> tuple[float, float]:
    """Return the 95 % interval of ``mean / baseline``.

    Parameters
    ----------
    mean, baseline : float
        Means of the two policies.
    half_mean, half_baseline, half_difference : float
        Half widths of the 95 % intervals of the two and of their paired difference, in the same unit.

    Returns
    -------
    tuple of float
        Low and high; NaN where the baseline may be zero or an interval is unknown.
    """
    covariance = 0.5 * (half_mean**2 + half_baseline**2 - half_difference**2)
    square = baseline**2 - half_baseline**2
    linear = mean * baseline - covariance
    constant = mean**2 - half_mean**2
    inside = linear**2 - square * constant
    if not (baseline > 0.0 and square > 0.0 and inside >= 0.0):
        return math.nan, math.nan
    root = math.sqrt(inside)
    return (linear - root) / square, (linear + root) / square

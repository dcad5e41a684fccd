r"""Piecewise-linear functions of SOC, and their expectation under a Beta belief.

[L] takes the true SOC to be Beta distributed around the estimate (eqs 10-13): with mean ``s`` and
variance ``p``, ``n = s (1 - s) / p - 1``, ``a = s n``, ``b = (1 - s) n``. Everything that is averaged over
that belief (``alpha``, the penalties Gamma and Upsilon) is given by a table, so it is piecewise linear, may
jump, and its expectation has a closed form. With ``F`` the distribution function and
``M(x) = E[S; S <= x] = s I_x(a + 1, b)``, a segment ``c + g x`` on ``(x0, x1)`` contributes

.. math:: c\,[F(x_1) - F(x_0)] + g\,[M(x_1) - M(x_0)].

No quadrature rule has to resolve the spike of a density that piles up at 0 or 1, or the jump of a penalty.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betainc

from bms.errors import BatteryError

POINT_MASS_VARIANCE = 1e-14
"""At or below this variance the belief is the point mass at its mean (the densities' limit p -> 0)."""

LARGEST_RELATIVE_VARIANCE = 0.99
"""p is clipped to this share of s (1 - s), where the Beta density degenerates to masses at 0 and 1."""


@dataclass(frozen=True, eq=False)
class PiecewiseLinear:
    """A piecewise-linear function on [0, 1] that may jump at its nodes and is constant beyond them.

    Parameters
    ----------
    soc : ndarray, shape (n,)
        Strictly increasing nodes.
    left, right : ndarray, shape (n,)
        The limits from below and from above at each node. A point mass on a jump takes the lower of the two.
    """

    soc: NDArray[np.float64]
    left: NDArray[np.float64]
    right: NDArray[np.float64]

    def __post_init__(self) -> None:
        nodes = np.asarray(self.soc)
        if nodes.ndim != 1 or nodes.size == 0 or np.any(np.diff(nodes) <= 0.0):
            raise BatteryError(f"nodes of a piecewise-linear function must increase strictly, got {nodes}")
        for name in ("soc", "left", "right"):
            array = np.array(getattr(self, name), dtype=np.float64)
            if array.shape != nodes.shape or not np.all(np.isfinite(array)):
                raise BatteryError(f"{name} must hold {nodes.size} finite numbers, one per node, got {array}")
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @classmethod
    def continuous(cls, soc: ArrayLike, value: ArrayLike) -> PiecewiseLinear:
        """Build the function that joins the points ``(soc, value)`` by straight lines."""
        values = np.asarray(value, dtype=np.float64)
        return cls(np.asarray(soc, dtype=np.float64), values, values)

    def __call__(self, soc: ArrayLike) -> NDArray[np.float64]:
        """Evaluate at ``soc``, taking the lower limit on a jump."""
        points = np.asarray(soc, dtype=np.float64)
        below = np.clip(np.searchsorted(self.soc, points, side="right") - 1, -1, self.soc.size - 1)
        start = np.clip(below, 0, self.soc.size - 2) if self.soc.size > 1 else np.zeros_like(below)
        stop = np.minimum(start + 1, self.soc.size - 1)
        width = np.where(stop > start, self.soc[stop] - self.soc[start], 1.0)
        weight = np.clip((points - self.soc[start]) / width, 0.0, 1.0)
        inside = (1.0 - weight) * self.right[start] + weight * self.left[stop]
        inside = np.where(points < self.soc[0], self.left[0], inside)
        inside = np.where(points > self.soc[-1], self.right[-1], inside)
        on_node = (below >= 0) & (points == self.soc[np.maximum(below, 0)])
        at_node = np.minimum(self.left, self.right)[np.maximum(below, 0)]
        return np.where(on_node, at_node, inside)

    def expectation(self, mean: ArrayLike, variance: ArrayLike) -> NDArray[np.float64]:
        """Average over a Beta belief, [L] eqs 10-13, in closed form.

        Parameters
        ----------
        mean, variance : array_like
            Mean in [0, 1] and variance of the belief; broadcast against each other. The variance is clipped
            to 0.99 mean (1 - mean); where it vanishes the value at the mean is returned.

        Returns
        -------
        ndarray
            The expectation, of the broadcast shape.
        """
        s, p = np.broadcast_arrays(np.asarray(mean, np.float64), np.asarray(variance, np.float64))
        spread = s * (1.0 - s)
        p = np.minimum(p, LARGEST_RELATIVE_VARIANCE * spread)
        result = np.array(self(s), dtype=np.float64, ndmin=0)
        # Negated, so that a variance of NaN gives NaN and not the point mass.
        wide = ~(p <= POINT_MASS_VARIANCE)
        if not np.any(wide):
            return result
        s_wide = s[wide]
        precision = spread[wide] / p[wide] - 1.0
        a, b = s_wide * precision, (1.0 - s_wide) * precision
        total = np.full_like(s_wide, 0.0)
        cdf_below = np.zeros_like(s_wide)
        partial_below = np.zeros_like(s_wide)
        for start, intercept, slope in self._segments():
            stop = start[1]
            cdf = betainc(a, b, stop) if stop < 1.0 else np.ones_like(s_wide)
            partial = s_wide * betainc(a + 1.0, b, stop) if stop < 1.0 else s_wide
            total += intercept * (cdf - cdf_below) + slope * (partial - partial_below)
            cdf_below, partial_below = cdf, partial
        result[wide] = total
        return result

    def _segments(self) -> list[tuple[tuple[float, float], float, float]]:
        """List ``((x0, x1), intercept, slope)`` over [0, 1], the constant ends included."""
        inner = np.clip(self.soc, 0.0, 1.0)
        found: list[tuple[tuple[float, float], float, float]] = []
        if self.soc[0] > 0.0:
            found.append(((0.0, float(inner[0])), float(self.left[0]), 0.0))
        for i in range(self.soc.size - 1):
            if inner[i + 1] > inner[i]:
                slope = (self.left[i + 1] - self.right[i]) / (self.soc[i + 1] - self.soc[i])
                intercept = self.right[i] - slope * self.soc[i]
                found.append(((float(inner[i]), float(inner[i + 1])), float(intercept), float(slope)))
        if self.soc[-1] < 1.0:
            found.append(((float(inner[-1]), 1.0), float(self.right[-1]), 0.0))
        return found

r"""Operators with weights that are never negative, for beliefs narrower than a few cells of the grid.

Cubic look-ups and the weights of `ems.smoothing` are exact where the cost-to-go is smooth on the scale of the
grid. Where neither the belief nor the innovation smooths its kinks they overshoot, the minimum over the
controls picks what overshoots downwards, step after step, and the program promises less than the optimum with
nothing uncertain. With weights that are not negative no value can leave the range of those it is made from:
the value comes out a little too high instead, by an error of first order in the spacing.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

Array = NDArray[np.float64]

REACH = 5.0
"""Standard deviations after which the Gaussian is cut off."""


WIDE = 1.5
"""Above this many cells hat functions add a sixth to the variance, to seven digits."""


def hat_weights(spread: ArrayLike, grid_step: float) -> Array:
    r"""Build weights of Gaussian smoothing that are never negative and have the variance they should.

    With the hat function ``h`` the weight of the node ``t`` steps away is ``E[h(rho nu - t)]``, the second
    difference of ``A(x) = E[max(rho nu - x, 0)]``. That is the expectation of a function that is linear
    between its nodes, and it spreads more than the Gaussian does, by up to a sixth of a squared cell, and by
    ``rho`` where ``rho^2`` is meant. So the Gaussian is taken narrower, until the variance is that asked for.

    Parameters
    ----------
    spread : array_like, shape (operators, n)
        Standard deviation at each node, in the unit of the grid.
    grid_step : float
        Spacing of the grid.

    Returns
    -------
    ndarray, shape (operators, taps, n)
        As those of `ems.smoothing.smoothing_weights`; zero spread gives the identity.
    """
    rho = _narrowed(np.atleast_2d(np.asarray(spread, dtype=np.float64)) / grid_step)
    half = math.ceil(REACH * float(rho.max())) + 1 if rho.max() > 0.0 else 0
    offsets = np.arange(-half, half + 1, dtype=np.float64)
    weights = np.stack([_hat(rho, offset) for offset in offsets], axis=1)
    return np.ascontiguousarray(weights / weights.sum(axis=1, keepdims=True))


def _narrowed(rho: Array) -> Array:
    """Give the width at which hat functions have the variance ``rho^2``, all in cells."""
    width = np.concatenate(([0.0], np.geomspace(1e-12, WIDE, 2000)))
    reach = np.arange(1, math.ceil(2.0 * REACH * WIDE), dtype=np.float64)
    variance = np.sum([2.0 * t**2 * _hat(width, t) for t in reach], axis=0)
    narrow = np.interp(np.square(rho), variance, width)
    wide = np.sqrt(np.maximum(np.square(rho) - 1.0 / 6.0, 0.0))
    return np.where(np.square(rho) < variance[-1], narrow, wide)


def _hat(rho: Array, offset: float) -> Array:
    """Expectation of the hat function at an offset, in cells."""
    some = rho > 0.0
    tame = np.where(some, rho, 1.0)
    found = _excess(tame, offset - 1.0) - 2.0 * _excess(tame, offset) + _excess(tame, offset + 1.0)
    return np.where(some, np.maximum(found, 0.0), float(offset == 0.0))


def _excess(rho: Array, above: float) -> Array:
    z = above / rho
    density = np.exp(-0.5 * np.square(z)) / math.sqrt(2.0 * math.pi)
    return np.asarray(rho * density - above * ndtr(-z), dtype=np.float64)


def linear_shares(level: Array, variance: Array) -> tuple[NDArray[np.int64], tuple[Array, Array]]:
    """Weigh the two levels around each variance; beyond the last level that level holds.

    Parameters
    ----------
    level : ndarray, shape (q,)
        Rising variances, two or more.
    variance : ndarray
        Any shape.

    Returns
    -------
    tuple
        Index of the lower level, and the weights of it and the next.
    """
    lower = np.clip(np.searchsorted(level, variance, side="right") - 1, 0, level.size - 2)
    part = np.clip((variance - level[lower]) / (level[lower + 1] - level[lower]), 0.0, 1.0)
    return lower, (1.0 - part, part)

r"""Smoothing operators: the Gaussian expectation of a tabulated cost-to-go, as weights on its nodes.

Between the nodes of a uniform grid the cost-to-go is taken as the cubic through the four nearest nodes. With
``phi`` the cardinal function of that interpolation (a cubic on each of (-2,-1), (-1,0), (0,1), (1,2)) and
``rho`` the standard deviation in grid steps, the expectation at a node is ``sum_t w_t J_(j+t)`` with

.. math:: w_t(\rho) = E[\varphi(\rho \nu - t)] = \sum_m \sum_n c_{mn}(t) \int_m^{m+1} x^n\, N(x; 0,
\rho^2)\,dx,

and the truncated moments in closed form. The weights reproduce cubics exactly: smoothing adds the variance
``rho^2`` and no numerical diffusion, which linear interpolation would (a sixth of the squared spacing per
step).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

Array = NDArray[np.float64]

REACH = 5.0
"""Standard deviations after which the Gaussian is cut off; the weights are rescaled to sum to one."""

CARDINAL = {  # phi on (m, m + 1) as coefficients of 1, x, x^2, x^3
    -2: (1.0, 11.0 / 6.0, 1.0, 1.0 / 6.0),
    -1: (1.0, 0.5, -1.0, -0.5),
    0: (1.0, -0.5, -1.0, 0.5),
    1: (1.0, -11.0 / 6.0, 1.0, -1.0 / 6.0),
}


def truncated_moments(lower: Array, rho: Array) -> list[Array]:
    """Moments 0 to 3 of N(0, rho^2) on (lower, lower + 1), each of the broadcast shape."""
    upper = lower + 1.0
    below, above = lower / rho, upper / rho
    norm = 1.0 / (rho * math.sqrt(2.0 * math.pi))
    f_below, f_above = norm * np.exp(-0.5 * below**2), norm * np.exp(-0.5 * above**2)
    square = rho**2
    zeroth = ndtr(above) - ndtr(below)
    first = -square * (f_above - f_below)
    second = square * zeroth - square * (upper * f_above - lower * f_below)
    third = 2.0 * square * first - square * (upper**2 * f_above - lower**2 * f_below)
    return [np.asarray(zeroth), first, second, third]


def smoothing_weights(spread: ArrayLike, grid_step: float) -> Array:
    """Build the weights of Gaussian smoothing at every node.

    Parameters
    ----------
    spread : array_like, shape (operators, n)
        Standard deviation at each node, in the unit of the grid.
    grid_step : float
        Spacing of the grid.

    Returns
    -------
    ndarray, shape (operators, taps, n)
        Weight of the node ``t`` to the right, ``t = -taps//2 .. taps//2``; zero spread gives the identity.
    """
    rho = np.atleast_2d(np.asarray(spread, dtype=np.float64)) / grid_step
    half = int(np.ceil(REACH * rho.max())) + 2 if rho.max() > 0.0 else 0
    offsets = np.arange(-half, half + 1, dtype=np.float64)
    weights = np.zeros((rho.shape[0], offsets.size, rho.shape[1]))
    wide = rho > 1e-6
    tame = np.where(wide, rho, 1.0)
    for index, offset in enumerate(offsets):
        for m, coefficients in CARDINAL.items():
            # phi(x - t) is a cubic in x on (m + t, m + t + 1); expand (x - t)^n
            a0, a1, a2, a3 = coefficients
            t = offset
            shifted = (
                a0 - a1 * t + a2 * t**2 - a3 * t**3,
                a1 - 2.0 * a2 * t + 3.0 * a3 * t**2,
                a2 - 3.0 * a3 * t,
                a3,
            )
            moments = truncated_moments(np.asarray(m + t, dtype=np.float64), tame)
            weights[:, index] += sum(c * moment for c, moment in zip(shifted, moments, strict=True))
        weights[:, index] = np.where(wide, weights[:, index], float(offset == 0.0))
    return np.ascontiguousarray(weights / weights.sum(axis=1, keepdims=True))

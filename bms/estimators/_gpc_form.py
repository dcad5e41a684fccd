"""The quadratic form of the recursive gPC estimator; the maths stands in `bms.estimators.gpc_gradient`.

Scalars are passed where that is possible: numbers that were stored one by one are slow to load as vectors.

In what is inlined, no array is used for the last time inside a branch, and nothing is called that is not
inlined itself: otherwise numba counts references to the arrays, a locked instruction each, which took as long
as the arithmetic.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vector = tuple[float, float, float, float, float, float]
"""One number for each parameter."""

ALPHA, R, BETA, XI, X10, BIAS = 0, 1, 2, 3, 4, 5
THETA = 6
"""Parameters; the last one, the offset of the current sensor, is there only where it was asked for."""


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def lagrange(node: Array, barycentric: Array, xi: float, value: Array, slope: Array) -> None:
    """Lagrange polynomials through the nodes at ``xi``, and their derivatives."""
    for j in range(node.size):
        product, derivative = 1.0, 0.0
        for i in range(node.size):
            if i != j:
                derivative = derivative * (xi - node[i]) + product
                product *= xi - node[i]
        value[j] = product * barycentric[j]
        slope[j] = derivative * barycentric[j]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def coefficients(theta: Array, value: Array, c: Array, with_bias: bool) -> None:
    """Fill c(theta): what the regressors are multiplied with."""
    alpha = theta[ALPHA]
    c[0], c[1], c[2] = alpha * theta[X10], alpha, theta[R]
    for j in range(value.size):
        c[3 + j] = theta[BETA] * value[j]
    if with_bias:
        c[3 + value.size] = -alpha * theta[BIAS]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def pull_back(
    theta: Array, value: Array, slope: Array, r: Array, with_bias: bool
) -> tuple[float, float, float, float, float, float]:
    """Multiply with (dc/dtheta)': from a vector along c to one along theta."""
    n = value.size
    along, across = 0.0, 0.0
    for j in range(n):
        along += value[j] * r[3 + j]
        across += slope[j] * r[3 + j]
    of_alpha, of_bias = theta[X10] * r[0] + r[1], 0.0
    if with_bias:
        of_alpha -= theta[BIAS] * r[3 + n]
        of_bias = -theta[ALPHA] * r[3 + n]
    return of_alpha, r[2], along, theta[BETA] * across, theta[ALPHA] * r[0], of_bias


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def push_forward(theta: Array, value: Array, slope: Array, d: Array, with_bias: bool, out: Array) -> None:
    """Multiply with dc/dtheta: from a step of theta to one of c."""
    n = value.size
    out[0] = theta[X10] * d[ALPHA] + theta[ALPHA] * d[X10]
    out[1], out[2] = d[ALPHA], d[R]
    for j in range(n):
        out[3 + j] = value[j] * d[BETA] + theta[BETA] * slope[j] * d[XI]
    if with_bias:
        out[3 + n] = -theta[BIAS] * d[ALPHA] - theta[ALPHA] * d[BIAS]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def quadratic(m: Array, c: Array, out: Array) -> None:
    """Multiply the symmetric matrix, of which the lower half is kept, with a vector."""
    n = c.size
    for p in range(n):
        total = 0.0
        for q in range(p + 1):
            total += m[p, q] * c[q]
        for q in range(p + 1, n):
            total += m[q, p] * c[q]
        out[p] = total


@njit(cache=True, nogil=True, error_model="numpy")
def form(m: Array, v: Array) -> float:
    """Evaluate v' M v for the symmetric matrix, of which the lower half is kept."""
    total = 0.0
    for p in range(v.size):
        for q in range(p):
            total += 2.0 * m[p, q] * v[p] * v[q]
        total += m[p, p] * v[p] * v[p]
    return total


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def accumulate(m: Array, b: Array, z: Array, difference_V: float, forget: float, weight_s: float) -> None:
    """Forget a little, then add a sample to the lower half of M and to b."""
    for p in range(z.size):
        scaled = weight_s * z[p]
        b[p] = forget * b[p] + scaled * difference_V
        for q in range(p + 1):
            m[p, q] = forget * m[p, q] + scaled * z[q]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def scale(gain: Array, g: Vector) -> tuple[Vector, float]:
    """Multiply a gradient with the gains, eqs 80-85; and the fall of the cost along that."""
    d = (gain[0] * g[0], gain[1] * g[1], gain[2] * g[2], gain[3] * g[3], gain[4] * g[4], gain[5] * g[5])
    fall = d[0] * g[0] + d[1] * g[1] + d[2] * g[2] + d[3] * g[3] + d[4] * g[4] + d[5] * g[5]
    return d, fall


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def bound_curvature(m: Array, theta: Array, value: Array, slope: Array, d: Vector, with_bias: bool) -> float:
    """Bound the curvature along ``d``: a sum over the diagonal, to be multiplied with the form's width."""
    end = m.shape[0] - 1
    last, of_bias = m[end, end], theta[BIAS] * d[0] + theta[ALPHA] * d[5]
    first = theta[X10] * d[0] + theta[ALPHA] * d[4]
    bound = first * first * m[0, 0] + d[0] * d[0] * m[1, 1] + d[1] * d[1] * m[2, 2]
    beta_d3 = theta[BETA] * d[3]
    for j in range(value.size):
        part = value[j] * d[2] + slope[j] * beta_d3
        bound += part * part * m[3 + j, 3 + j]
    if with_bias:
        bound += of_bias * of_bias * last
    return float(bound)


@njit(cache=True, nogil=True, error_model="numpy")
def curvature_along(
    m: Array, theta: Array, value: Array, slope: Array, d: Vector, with_bias: bool, move: Array, along: Array
) -> float:
    """Curvature of the cost along ``d``; ``move`` and ``along`` are scratch."""
    move[0], move[1], move[2], move[3], move[4], move[5] = d
    push_forward(theta, value, slope, move, with_bias, along)
    return form(m, along)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def walk(theta: Array, d: Vector, length: float) -> None:
    """Take a step against ``d``."""
    theta[0] -= length * d[0]
    theta[1] -= length * d[1]
    theta[2] -= length * d[2]
    theta[3] -= length * d[3]
    theta[4] -= length * d[4]
    theta[5] -= length * d[5]


@njit(cache=True, nogil=True, error_model="numpy")
def projected_variance(factor: Array, n: int, z: Array, positive: bool) -> float:
    """Variance of a linear function of the parameters, its slopes in ``z``; those are overwritten."""
    total = 0.0
    for i in range(n):
        if positive:
            for k in range(i):
                z[i] -= factor[i, k] * z[k]
            z[i] /= factor[i, i]
        total += z[i] * z[i]
    return total

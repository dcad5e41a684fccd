"""Cholesky factors of small matrices, without the overhead of a library call."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, nogil=True)
def factorise(a: Array, n: int) -> bool:
    """Replace the lower half of the leading (n, n) part by its Cholesky factor.

    Returns
    -------
    bool
        Whether the matrix was positive definite; if not, its content has no meaning.
    """
    for i in range(n):
        for j in range(i + 1):
            total = a[i, j]
            for k in range(j):
                total -= a[i, k] * a[j, k]
            if i > j:
                a[i, j] = total / a[j, j]
            elif total > 0.0:
                a[i, i] = math.sqrt(total)
            else:
                return False
    return True


@njit(cache=True, nogil=True)
def solve_factored(factor: Array, n: int, x: Array) -> None:
    """Solve ``L L' x = b`` in place for a factor from `factorise`."""
    for i in range(n):
        total = x[i]
        for k in range(i):
            total -= factor[i, k] * x[k]
        x[i] = total / factor[i, i]
    for i in range(n - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, n):
            total -= factor[k, i] * x[k]
        x[i] = total / factor[i, i]

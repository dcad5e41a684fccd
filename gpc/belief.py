"""What a chaos filter believes and what an update teaches it; whether its covariance can be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpc.errors import ChaosError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ChaosBelief:
    """What the filter believes: an expansion, and the covariance beside it.

    Attributes
    ----------
    coefficients : ndarray, shape (S, n)
        Of the n states, in the orthonormal basis.
    remainder : ndarray, shape (n, n)
        ``N``, the covariance that no germ represents; zero for the filters of the report.
    """

    coefficients: Array
    remainder: Array

    @property
    def mean(self) -> Array:
        """Mean of the states, shape (n,)."""
        return np.asarray(self.coefficients[0], dtype=np.float64)

    @property
    def chaos_covariance(self) -> Array:
        """Covariance in the coefficients, [M] eq 20, shape (n, n)."""
        return self.coefficients[1:].T @ self.coefficients[1:]

    @property
    def covariance(self) -> Array:
        """Total covariance ``C + N``, shape (n, n)."""
        return self.chaos_covariance + self.remainder


@dataclass(frozen=True, eq=False)
class Innovation:
    """What an update learnt.

    Attributes
    ----------
    residual : ndarray, shape (m,)
        Measurement less its forecast mean.
    covariance : ndarray, shape (m, m)
        Of the residual, as the filter believes.
    gain : ndarray, shape (n, m)
        ``K``.
    """

    residual: Array
    covariance: Array
    gain: Array

    @property
    def nis(self) -> float:
        """Normalised innovation squared: chi-square of m degrees of freedom if the filter is honest."""
        return normalised_square(self.residual, self.covariance)


def as_covariance(given: ArrayLike, size: int, name: str) -> Array:
    """Read a covariance: a variance for all, one each, or a symmetric matrix.

    Returns
    -------
    ndarray, shape (size, size)

    Raises
    ------
    ChaosError
        When the shape differs, a value is not finite, a variance negative or the matrix not symmetric.
    """
    value = np.asarray(given, dtype=np.float64)
    if value.shape not in ((), (size,), (size, size)):
        raise ChaosError(
            f"{name} must be a number, {size} variances or a {size} x {size} matrix, got {value.shape}"
        )
    matrix = value if value.ndim == 2 else np.diag(np.broadcast_to(value, (size,)))
    if not np.all(np.isfinite(matrix)) or np.any(np.diagonal(matrix) < 0.0):
        raise ChaosError(f"{name} must be finite with variances of 0 or more, got {value.tolist()}")
    if not np.allclose(matrix, matrix.T, rtol=1e-9, atol=0.0):
        raise ChaosError(f"{name} must be symmetric")
    return np.array(matrix)


def normalised_square(error: ArrayLike, covariance: ArrayLike) -> float:
    """Give ``e' P^-1 e``: the NEES of an estimate's error, the NIS of an innovation.

    Returns
    -------
    float
        Chi-square distributed with as many degrees of freedom as the error has entries, if P is honest;
        infinite when P is not positive definite.
    """
    vector = np.atleast_1d(np.asarray(error, dtype=np.float64))
    try:
        # By Cholesky: of a matrix singular but for rounding, a plain solution can be negative.
        root = np.linalg.cholesky(np.atleast_2d(np.asarray(covariance, dtype=np.float64)))
    except np.linalg.LinAlgError:
        return np.inf
    return float(np.sum(np.linalg.solve(root, vector) ** 2))

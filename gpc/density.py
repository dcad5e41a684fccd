r"""Probability density of an expansion: by change of variables in one germ, by kernels on a sample in more.

For :math:`X = p(\xi)` with one germ, every root of :math:`p(\xi) = x` on the support contributes:

.. math:: f_X(x) = \sum_{\xi:\,p(\xi) = x} \rho(\xi) / |p'(\xi)|.

The roots of :math:`\sum_{k \le n} c_k \psi_k` are the eigenvalues of the comrade matrix, which is the
tridiagonal matrix of the recurrence less :math:`\sqrt{b_n}/c_n\,(c_0 \ldots c_{n-1})` in its last row
(Barnett, Linear Algebra Appl. 10, 1975): no monomials, whose coefficients would be badly conditioned.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpc.basis import Family
from gpc.galerkin import germ_matrix

Array = NDArray[np.float64]

NEGLIGIBLE = 1e-13
"""Leading coefficients below this share of the largest are rounding and would put roots at infinity."""

REAL = 1e-7
"""Imaginary part, relative to one plus the root, up to which a root counts as real."""


def density_of_one_germ(family: Family, coefficients: Array, x: Array) -> Array:
    """Evaluate the density of a polynomial of one germ.

    Parameters
    ----------
    family : Family
        Family of the germ.
    coefficients : ndarray, shape (n + 1,)
        Of the orthonormal polynomials of degree 0 to n; not all but the first zero.
    x : ndarray
        Values of the polynomial.

    Returns
    -------
    ndarray, shape of x
        Infinite at the value of an extremum.
    """
    kept = np.flatnonzero(np.abs(coefficients) > NEGLIGIBLE * np.abs(coefficients[1:]).max())
    degree = int(kept[-1])
    used = coefficients[: degree + 1]
    values = x.ravel()
    shifted = np.repeat(used[np.newaxis, :degree], values.size, axis=0)
    shifted[:, 0] -= values
    comrade = np.repeat(germ_matrix(family, degree)[np.newaxis], values.size, axis=0)
    scale = np.sqrt(family.recurrence(degree + 1)[1][degree]) / used[degree]
    comrade[:, -1, :] -= scale * shifted
    roots = np.linalg.eigvals(comrade)
    real = np.asarray(roots.real, dtype=np.float64)
    lower, upper = family.support
    # At an end of the support rounding must not lose the root.
    counts = (
        (np.abs(roots.imag) <= REAL * (1.0 + np.abs(real))) & (real >= lower - REAL) & (real <= upper + REAL)
    )
    real = np.clip(real, lower, upper)
    slope = np.tensordot(used, family.evaluate_with_derivative(real, degree)[1], axes=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = np.where(counts, family.density(real) / np.abs(slope), 0.0)
    return np.asarray(np.sum(parts, axis=1), dtype=np.float64).reshape(x.shape)


def density_of_sample(sample: Array, x: Array) -> Array:
    """Evaluate the Gaussian kernel density of a sample, bandwidth by Scott's rule.

    Parameters
    ----------
    sample : ndarray, shape (draws,)
    x : ndarray
        Points.

    Returns
    -------
    ndarray, shape of x
    """
    # scipy.stats takes a second to import, and few who use a chaos draw a density.
    from scipy.stats import gaussian_kde

    return np.asarray(gaussian_kde(sample)(x.ravel()), dtype=np.float64).reshape(x.shape)

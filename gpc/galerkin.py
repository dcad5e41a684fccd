r"""Galerkin projection of linear differential equations with an uncertain coefficient, [M] eqs 66-76.

The solution of

.. math:: \dot x = -(\sigma_0 + \sigma_1 \xi)\,x + u(t)

is expanded in the first N orthonormal polynomials of the germ, :math:`x(t, \xi) \approx \sum_{i<N}
\psi_i(\xi)\,q_i(t)`; projecting the equation on each of them leaves

.. math:: \dot q = A\,q + B\,u, \qquad A = -\sigma_0 I - \sigma_1 \Xi, \quad
          \Xi_{ij} = E[\xi\,\psi_i\,\psi_j], \quad B = e_1.

The recurrence of the family says that :math:`\Xi` is tridiagonal, with :math:`a_i` on the diagonal and
:math:`\sqrt{b_i}` beside it: there is nothing to integrate. It has the N Gauss nodes as eigenvalues, so at
these nodes the expansion equals the exact solution at all times, and A is stable when the coefficient is
positive on the support.

A coefficient that is itself an expansion :math:`r = \sum_k r_k \Psi_k` in several germs acts on another
expansion by the matrix :math:`\sum_k r_k\,E[\Psi_i \Psi_j \Psi_k]`.

Over a step h with u held, :math:`q(t + h) = \Phi q(t) + \Gamma u` is exact, with both from one matrix
exponential of :math:`[[A, B], [0, 0]]\,h`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm

from gpc.basis import Family
from gpc.errors import ChaosError
from gpc.index_set import Indices
from gpc.nodes import MOST_ENTRIES, check_germs

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """Deterministic equations ``q' = state q + input u`` of the coefficients.

    Attributes
    ----------
    state : ndarray, shape (S, S)
    input : ndarray, shape (S,)
    """

    state: Array
    input: Array

    def hold(self, step: float) -> tuple[Array, Array]:
        """Discretise exactly for an input that is held over each step.

        Parameters
        ----------
        step : float
            Length of a step, 0 or more, in the time unit of the system.

        Returns
        -------
        tuple of ndarray, shapes (S, S) and (S,)
            ``Phi`` and ``Gamma`` of ``q(t + step) = Phi q(t) + Gamma u(t)``.

        Raises
        ------
        ChaosError
            When the step is negative or not finite.
        """
        if not 0.0 <= step < np.inf:
            raise ChaosError(f"a time step must be 0 or more and finite, got {step!r}")
        terms = self.input.size
        joint = np.zeros((terms + 1, terms + 1))
        joint[:terms, :terms] = self.state
        joint[:terms, terms] = self.input
        held = np.asarray(expm(step * joint), dtype=np.float64)
        return held[:terms, :terms], held[:terms, terms]


def germ_matrix(family: Family, terms: int) -> Array:
    r"""Give :math:`\Xi_{ij} = E[\xi\,\psi_i\,\psi_j]`, symmetric and tridiagonal.

    Parameters
    ----------
    family : Family
        Family of the germ.
    terms : int
        Number N of polynomials, degrees 0 to N - 1.

    Returns
    -------
    ndarray, shape (N, N)

    Raises
    ------
    ChaosError
        When there is no term.
    """
    if terms < 1:
        raise ChaosError(f"an expansion needs 1 term or more, got {terms}")
    a, b = family.recurrence(terms)
    beside = np.sqrt(b[1:])
    matrix: Array = np.diag(a) + np.diag(beside, 1) + np.diag(beside, -1)
    return matrix


def uncertain_decay(family: Family, terms: int, rate: float, rate_slope: float) -> LinearSystem:
    """Project ``x' = -(rate + rate_slope xi) x + u`` on the first polynomials of the germ, [M] eqs 71-76.

    Parameters
    ----------
    family : Family
        Family of the germ xi.
    terms : int
        Number N of terms; 1 is the deterministic equation at the mean of the rate.
    rate : float
        ``sigma_0`` in 1/s; for a rate uniform between two bounds their mean, [M] eq 67.
    rate_slope : float
        ``sigma_1`` in 1/s; for a rate uniform between two bounds half their difference, [M] eq 68.

    Returns
    -------
    LinearSystem
        Of the N coefficients; unstable when the rate is negative at a Gauss node of N points.

    Raises
    ------
    ChaosError
        When there is no term or a rate is not finite.
    """
    if not (np.isfinite(rate) and np.isfinite(rate_slope)):
        raise ChaosError(f"the rate and its slope must be finite, got {rate!r} and {rate_slope!r}")
    germ = germ_matrix(family, terms)
    state = -rate * np.eye(terms) - rate_slope * germ
    constant = np.zeros(terms)
    constant[0] = 1.0
    return LinearSystem(state, constant)


def triple_products(families: Sequence[Family], indices: Indices) -> Array:
    r"""Give :math:`E[\Psi_i\,\Psi_j\,\Psi_k]` for every three terms.

    Parameters
    ----------
    families : sequence of Family
        One per germ, independent.
    indices : ndarray of int, shape (S, d)
        Degrees of the terms.

    Returns
    -------
    ndarray, shape (S, S, S)
        Symmetric in its axes; with the constant as third term the identity.

    Raises
    ------
    ChaosError
        When the index set does not fit the families, or is too large.
    """
    check_germs(families, indices)
    terms = indices.shape[0]
    if terms**3 > MOST_ENTRIES:
        raise ChaosError(f"{terms} terms make too many triple products; lower the order")
    products = np.ones((terms, terms, terms))
    for k, family in enumerate(families):
        degree = indices[:, k]
        highest = int(degree.max())
        # Three polynomials of the highest degree need 2 n - 1 >= 3 highest.
        nodes, weights = family.gauss((3 * highest) // 2 + 1)
        psi = family.evaluate(nodes, highest)
        single = np.einsum("in,jn,kn,n->ijk", psi, psi, psi, weights, optimize=True)
        products *= single[np.ix_(degree, degree, degree)]
    return products


def multiplication(families: Sequence[Family], indices: Indices, coefficients: ArrayLike) -> Array:
    """Give the matrix by which an uncertain factor acts on the coefficients of an expansion.

    Parameters
    ----------
    families : sequence of Family
        One per germ, independent.
    indices : ndarray of int, shape (S, d)
        Degrees of the terms.
    coefficients : array_like, shape (S,)
        Expansion of the factor.

    Returns
    -------
    ndarray, shape (S, S)
        Symmetric; ``-multiplication(...)`` is the state matrix of a decay with this uncertain rate.

    Raises
    ------
    ChaosError
        As `triple_products`, or when there is not one coefficient per term.
    """
    factor = np.asarray(coefficients, dtype=np.float64)
    if factor.shape != (indices.shape[0],):
        raise ChaosError(f"give one coefficient for each of the {indices.shape[0]} terms, got {factor.shape}")
    return np.tensordot(triple_products(families, indices), factor, axes=1)

r"""Orthonormal polynomials in one random variable, and their Gauss rules.

Every family belongs to a probability density :math:`\rho` (its integral is 1), and
:math:`\langle f, g \rangle = E[f(\xi)\,g(\xi)]` with :math:`\xi \sim \rho`. The monic orthogonal polynomials
obey

.. math:: \pi_{k+1}(x) = (x - a_k)\,\pi_k(x) - b_k\,\pi_{k-1}(x), \qquad \pi_{-1} = 0,\; \pi_0 = 1,

with :math:`a_k` and :math:`b_k > 0` known in closed form, and :math:`E[\pi_k^2] = b_1 \cdots b_k`. The
orthonormal ones, :math:`\psi_k = \pi_k / \sqrt{E[\pi_k^2]}`, therefore obey

.. math:: \sqrt{b_{k+1}}\,\psi_{k+1}(x) = (x - a_k)\,\psi_k(x) - \sqrt{b_k}\,\psi_{k-1}(x),

which is stable upwards in :math:`k` and never forms a factorial; differentiated once, it gives the slopes.
The nodes of the n-point Gauss rule are the eigenvalues of the symmetric tridiagonal matrix with diagonal
:math:`a_0 \ldots a_{n-1}` and off-diagonal :math:`\sqrt{b_1} \ldots \sqrt{b_{n-1}}` (Golub and Welsch, Math.
Comp. 23, 1969); the weight of node :math:`x` is :math:`1 / \sum_{k<n} \psi_k(x)^2`. The rule is exact for
polynomials up to degree :math:`2n - 1`.

Since the basis is orthonormal, a coefficient 30 of the classical :math:`P_1(x) = x` on [-1, 1] is
:math:`30 / \sqrt 3` here (ERRATA, [M] eq 20).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigh_tridiagonal
from scipy.special import betaln, xlog1py

from gpc.errors import ChaosError

Array = NDArray[np.float64]


class Family(ABC):
    """A family of orthonormal polynomials: a concrete one states its recurrence and its random variable."""

    @property
    @abstractmethod
    def support(self) -> tuple[float, float]:
        """Give the ends of the interval on which the variable lives."""

    @abstractmethod
    def density(self, x: ArrayLike) -> Array:
        """Evaluate the probability density of the variable at ``x``; zero outside the support."""

    @abstractmethod
    def sample(self, generator: np.random.Generator, size: int) -> Array:
        """Draw ``size`` values of the variable, shape (size,)."""

    @abstractmethod
    def recurrence(self, n: int) -> tuple[Array, Array]:
        """Give the first ``n`` coefficients of the monic recurrence.

        Returns
        -------
        tuple of ndarray, shapes (n,) and (n,)
            ``a_0 ... a_{n-1}`` and ``b_0 ... b_{n-1}``, where ``b_0 = 1`` is the mass of the density.
        """

    def evaluate(self, x: ArrayLike, degree: int) -> Array:
        """Evaluate the orthonormal polynomials of degree 0 to ``degree``.

        Parameters
        ----------
        x : array_like
            Points.
        degree : int
            Highest degree, at least 0.

        Returns
        -------
        ndarray, shape (degree + 1, *x.shape)

        Raises
        ------
        ChaosError
            When the degree is negative.
        """
        points = np.asarray(x, dtype=np.float64)
        a, root = self._steps(degree)
        psi = np.empty((degree + 1, *points.shape))
        psi[0] = 1.0
        for k in range(degree):
            psi[k + 1] = (points - a[k]) * psi[k]
            if k > 0:
                psi[k + 1] -= root[k] * psi[k - 1]
            psi[k + 1] /= root[k + 1]
        return psi

    def evaluate_with_derivative(self, x: ArrayLike, degree: int) -> tuple[Array, Array]:
        """Evaluate the orthonormal polynomials of degree 0 to ``degree`` and their first derivatives.

        Parameters
        ----------
        x : array_like
            Points.
        degree : int
            Highest degree, at least 0.

        Returns
        -------
        tuple of ndarray, shapes (degree + 1, *x.shape)
            Values, those of `evaluate`, and slopes.

        Raises
        ------
        ChaosError
            When the degree is negative.
        """
        points = np.asarray(x, dtype=np.float64)
        psi = self.evaluate(points, degree)
        a, root = self._steps(degree)
        slope = np.zeros_like(psi)
        for k in range(degree):
            slope[k + 1] = psi[k] + (points - a[k]) * slope[k]
            if k > 0:
                slope[k + 1] -= root[k] * slope[k - 1]
            slope[k + 1] /= root[k + 1]
        return psi, slope

    def _steps(self, degree: int) -> tuple[Array, Array]:
        """Give ``a_k`` and the square roots of ``b_k`` for k = 0 to ``degree``."""
        if degree < 0:
            raise ChaosError(f"the degree of a polynomial is 0 or more, got {degree}")
        a, b = self.recurrence(degree + 1)
        return a, np.sqrt(b)

    def gauss(self, n: int) -> tuple[Array, Array]:
        """Build the Gauss rule of ``n`` points, exact up to degree ``2 n - 1``.

        Returns
        -------
        tuple of ndarray, shapes (n,) and (n,)
            Nodes, increasing, and positive weights that sum to 1: ``weights @ f(nodes)`` is an expectation.

        Raises
        ------
        ChaosError
            When ``n`` is less than 1.
        """
        if n < 1:
            raise ChaosError(f"a Gauss rule has 1 point or more, got {n}")
        a, b = self.recurrence(n)
        nodes = np.asarray(eigh_tridiagonal(a, np.sqrt(b[1:]), eigvals_only=True), dtype=np.float64)
        # Eigenvectors would give the weights too, but the tiny ones at far nodes only to absolute precision.
        weights = 1.0 / np.sum(self.evaluate(nodes, n - 1) ** 2, axis=0)
        return nodes, weights / weights.sum()


@final
@dataclass(frozen=True)
class Legendre(Family):
    """Polynomials of a variable uniform on [-1, 1]: ``a_k = 0``, ``b_k = k^2 / (4 k^2 - 1)``."""

    def recurrence(self, n: int) -> tuple[Array, Array]:
        """Give the first ``n`` coefficients of the monic recurrence, see `Family.recurrence`."""
        k = np.arange(n, dtype=np.float64)
        b = np.ones(n)
        b[1:] = k[1:] ** 2 / (4.0 * k[1:] ** 2 - 1.0)
        return np.zeros(n), b

    @property
    def support(self) -> tuple[float, float]:
        """Give the ends of the interval, -1 and 1."""
        return -1.0, 1.0

    def density(self, x: ArrayLike) -> Array:
        """Evaluate the density, one half on [-1, 1], see `Family.density`."""
        return np.where(np.abs(np.asarray(x, dtype=np.float64)) <= 1.0, 0.5, 0.0)

    def sample(self, generator: np.random.Generator, size: int) -> Array:
        """Draw ``size`` values, see `Family.sample`."""
        return generator.uniform(-1.0, 1.0, size)


@final
@dataclass(frozen=True)
class Hermite(Family):
    """Polynomials of a standard normal variable (the probabilists' ones): ``a_k = 0``, ``b_k = k``."""

    def recurrence(self, n: int) -> tuple[Array, Array]:
        """Give the first ``n`` coefficients of the monic recurrence, see `Family.recurrence`."""
        b = np.arange(n, dtype=np.float64)
        b[:1] = 1.0
        return np.zeros(n), b

    @property
    def support(self) -> tuple[float, float]:
        """Give the ends of the interval: the whole line."""
        return -np.inf, np.inf

    def density(self, x: ArrayLike) -> Array:
        """Evaluate the standard normal density, see `Family.density`."""
        points = np.asarray(x, dtype=np.float64)
        return np.asarray(np.exp(-0.5 * points**2) / np.sqrt(2.0 * np.pi), dtype=np.float64)

    def sample(self, generator: np.random.Generator, size: int) -> Array:
        """Draw ``size`` values, see `Family.sample`."""
        return generator.standard_normal(size)


@final
@dataclass(frozen=True)
class Jacobi(Family):
    r"""Polynomials of ``xi = 2 B - 1`` on [-1, 1], where ``B`` is Beta(a, b) on [0, 1].

    The density is proportional to :math:`(1 + x)^{a-1} (1 - x)^{b-1}`; in the classical notation
    :math:`P^{(b-1,\,a-1)}`. ``Jacobi(1, 1)`` is `Legendre`.

    Parameters
    ----------
    a, b : float
        Shape parameters, positive.

    Raises
    ------
    ChaosError
        When a shape parameter is not positive and finite.
    """

    a: float
    b: float

    def __post_init__(self) -> None:
        for name, value in (("a", self.a), ("b", self.b)):
            if not 0.0 < value < np.inf:
                raise ChaosError(f"the Beta parameter {name} must be positive and finite, got {value!r}")

    def recurrence(self, n: int) -> tuple[Array, Array]:
        """Give the first ``n`` coefficients of the monic recurrence, see `Family.recurrence`."""
        s = self.a + self.b
        centre, scale = np.empty(n), np.ones(n)
        # The general formulas are 0/0 for k = 0, and for k = 1 where a + b = 1.
        centre[:1] = (self.a - self.b) / s
        scale[1:2] = 4.0 * self.a * self.b / (s**2 * (s + 1.0))
        k = np.arange(1, n, dtype=np.float64)
        centre[1:] = (self.a - self.b) * (s - 2.0) / ((2.0 * k + s - 2.0) * (2.0 * k + s))
        k = np.arange(2, n, dtype=np.float64)
        middle = 2.0 * k + s - 2.0
        numerator = 4.0 * k * (k + self.a - 1.0) * (k + self.b - 1.0) * (k + s - 2.0)
        scale[2:] = numerator / (middle**2 * (middle + 1.0) * (middle - 1.0))
        return centre, scale

    @property
    def support(self) -> tuple[float, float]:
        """Give the ends of the interval, -1 and 1."""
        return -1.0, 1.0

    def density(self, x: ArrayLike) -> Array:
        """Evaluate the density, infinite at an end whose exponent is negative, see `Family.density`."""
        points = np.asarray(x, dtype=np.float64)
        inside = np.abs(points) <= 1.0
        at = np.where(inside, points, 0.0)
        # In logarithms: the Beta function of large parameters underflows.
        log = xlog1py(self.a - 1.0, at) + xlog1py(self.b - 1.0, -at) - betaln(self.a, self.b)
        return np.where(inside, np.exp(log - (self.a + self.b - 1.0) * np.log(2.0)), 0.0)

    def sample(self, generator: np.random.Generator, size: int) -> Array:
        """Draw ``size`` values, see `Family.sample`."""
        return 2.0 * generator.beta(self.a, self.b, size) - 1.0


def beta_rule(a: float, b: float, n: int) -> tuple[Array, Array]:
    """Build the Gauss-Jacobi rule of ``n`` points for an expectation over Beta(a, b) on [0, 1].

    Returns
    -------
    tuple of ndarray, shapes (n,) and (n,)
        Nodes in (0, 1) and weights that sum to 1.

    Raises
    ------
    ChaosError
        When a shape parameter is not positive or ``n`` is less than 1.
    """
    nodes, weights = Jacobi(a, b).gauss(n)
    return 0.5 * (1.0 + nodes), weights

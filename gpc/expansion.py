r"""A polynomial chaos expansion, and what it says: moments, Sobol indices, samples, density.

A quantity :math:`X(\xi) = \sum_j x_j \Psi_j(\xi)` in an orthonormal basis with :math:`\Psi_0 = 1` has

.. math:: E[X] = x_0, \qquad \operatorname{Cov}(X, Y) = \sum_{j \ge 1} x_j\,y_j

([M] eq 20, true in an *orthonormal* basis only). The variance is a sum over terms, and a term belongs to the
germs whose degree in it is not zero: the share of the terms of exactly one set of germs is its Sobol index
(Sudret, Reliab. Eng. Syst. Saf. 93, 2008). A first-order index counts one germ alone, a total index every
term in which the germ takes part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpc.basis import Family
from gpc.collocation import Collocation
from gpc.density import density_of_one_germ, density_of_sample
from gpc.errors import ChaosError
from gpc.index_set import Indices
from gpc.nodes import basis_matrix, check_germs

Array = NDArray[np.float64]

ROUNDING = 1e-20
"""Part of a mean square below which a variance is rounding: a standard deviation of 1e-10 of the size."""


@dataclass(frozen=True, eq=False)
class Expansion:
    """Chaos expansion of one output or of an array of outputs.

    Parameters
    ----------
    families : sequence of Family
        One per germ, d of them, independent.
    indices : ndarray of int, shape (S, d)
        Degrees of the terms; the first row is the constant.
    coefficients : array_like, shape ``(S, *outputs)``
        In the orthonormal basis.

    Raises
    ------
    ChaosError
        When the shapes do not fit or a coefficient is not finite.
    """

    families: Sequence[Family]
    indices: Indices
    coefficients: Array

    def __post_init__(self) -> None:
        coefficients = np.array(self.coefficients, dtype=np.float64)
        check_germs(self.families, self.indices)
        if coefficients.ndim < 1 or coefficients.shape[0] != self.indices.shape[0]:
            raise ChaosError(
                f"the first axis of the coefficients counts the {self.indices.shape[0]} terms,"
                f" got shape {coefficients.shape}"
            )
        if not np.all(np.isfinite(coefficients)):
            raise ChaosError("a coefficient is NaN or inf; the model failed at a node")
        coefficients.flags.writeable = False
        object.__setattr__(self, "families", tuple(self.families))
        object.__setattr__(self, "coefficients", coefficients)

    @classmethod
    def of(cls, collocation: Collocation, values: ArrayLike) -> Expansion:
        """Expand a quantity known by its values at the nodes of a collocation, shape ``(Q, *outputs)``."""
        return cls(collocation.families, collocation.indices, collocation.project(values))

    def __call__(self, germs: ArrayLike) -> Array:
        """Evaluate at germs, shape ``(..., d)``; gives shape ``(..., *outputs)``."""
        return np.tensordot(basis_matrix(self.families, self.indices, germs), self.coefficients, axes=1)

    @property
    def mean(self) -> Array:
        """Mean, shape ``(*outputs)``."""
        return np.asarray(self.coefficients[0], dtype=np.float64)

    @property
    def variance(self) -> Array:
        """Variance of each output, shape ``(*outputs)``."""
        return np.asarray(np.sum(self.coefficients[1:] ** 2, axis=0), dtype=np.float64)

    @property
    def covariance(self) -> Array:
        """Covariance of all outputs with all, shape ``(*outputs, *outputs)``."""
        return np.tensordot(self.coefficients[1:], self.coefficients[1:], axes=(0, 0))

    @property
    def varies(self) -> NDArray[np.bool_]:
        """Whether an output has a variance beyond the rounding of its own size, shape ``(*outputs)``."""
        return np.asarray(is_variance(self.variance, self.mean**2 + self.variance))

    def sobol(self, *germs: int) -> Array:
        """Give the share of the variance that belongs to exactly these germs together.

        Parameters
        ----------
        *germs : int
            Numbers of the germs, from 0; one for a first-order index, two for their interaction.

        Returns
        -------
        ndarray, shape ``(*outputs)``
            Between 0 and 1; 0 for an output without variance, or with one that is rounding (`varies`).

        Raises
        ------
        ChaosError
            When there is no germ of that number.
        """
        asked = np.zeros(self.indices.shape[1], dtype=bool)
        for germ in germs:
            if not 0 <= germ < asked.size:
                raise ChaosError(f"there is no germ {germ}; germs are numbered 0 to {asked.size - 1}")
            asked[germ] = True
        if not germs:
            raise ChaosError("name one germ or more")
        return self._share(np.all((self.indices > 0) == asked, axis=1))

    @property
    def first_order(self) -> Array:
        """First-order Sobol indices, shape ``(d, *outputs)``."""
        return np.stack([self.sobol(k) for k in range(self.indices.shape[1])])

    @property
    def total(self) -> Array:
        """Total Sobol indices, shape ``(d, *outputs)``."""
        return np.stack([self._share(self.indices[:, k] > 0) for k in range(self.indices.shape[1])])

    def _share(self, terms: NDArray[np.bool_]) -> Array:
        """Give the part of the variance in these terms."""
        part = np.sum(self.coefficients[terms] ** 2, axis=0)
        return np.asarray(np.divide(part, self.variance, out=np.zeros_like(part), where=self.varies))

    def sample(self, generator: np.random.Generator, size: int) -> Array:
        """Draw ``size`` values of the outputs together, shape ``(size, *outputs)``."""
        return self(sample_germs(self.families, generator, size))

    def density(
        self, x: ArrayLike, generator: np.random.Generator | None = None, draws: int = 20_000
    ) -> Array:
        """Evaluate the probability density of a single output.

        With one germ by change of variables, exactly; it is infinite where the expansion has an extremum.
        With more by a Gaussian kernel density (Scott's rule) of a sample, which blurs edges.

        Parameters
        ----------
        x : array_like
            Values of the output.
        generator : numpy.random.Generator, optional
            Source of the sample; needed with two germs or more.
        draws : int
            Size of the sample.

        Returns
        -------
        ndarray, shape of x

        Raises
        ------
        ChaosError
            When there are several outputs, no variance, or no generator where one is needed.
        """
        if self.coefficients.ndim != 1:
            raise ChaosError(
                f"a density is that of one output, got outputs of shape {self.mean.shape}; pick one"
            )
        if not self.varies:
            raise ChaosError(f"an output without variance has no density; it is {float(self.mean):g}")
        points = np.asarray(x, dtype=np.float64)
        if len(self.families) == 1:
            by_degree = np.zeros(int(self.indices.max()) + 1)
            by_degree[self.indices[:, 0]] = self.coefficients
            return density_of_one_germ(self.families[0], by_degree, points)
        if generator is None:
            raise ChaosError("a density in two germs or more is that of a sample: give a numpy Generator")
        return density_of_sample(self.sample(generator, draws), points)


def is_variance(variance: ArrayLike, mean_square: ArrayLike) -> NDArray[np.bool_]:
    """Tell variances from the rounding of outputs of a mean square."""
    return np.asarray(np.asarray(variance) > ROUNDING * np.asarray(mean_square), dtype=np.bool_)


def sample_germs(families: Sequence[Family], generator: np.random.Generator, size: int) -> Array:
    """Draw germs, shape (size, d); one germ after the other from the same generator.

    Raises
    ------
    ChaosError
        When ``size`` is less than 1.
    """
    if size < 1:
        raise ChaosError(f"a sample has 1 draw or more, got {size}")
    return np.stack([family.sample(generator, size) for family in families], axis=-1)


def affine_coefficients(
    families: Sequence[Family], indices: Indices, centre: ArrayLike, spread: ArrayLike, germs: Sequence[int]
) -> Array:
    r"""Expand quantities that are each a line in one germ: ``centre_i + spread_i * xi_{germs[i]}``.

    Parameters
    ----------
    families : sequence of Family
        One per germ.
    indices : ndarray of int, shape (S, d)
        Degrees of the terms; must hold the linear term of each germ used.
    centre : array_like, shape (n,)
        Values where the germ is zero.
    spread : array_like, shape (n,)
        Half-range for a germ on [-1, 1], standard deviation for a normal one; 0 for a known quantity.
    germs : sequence of int, length n
        Which germ each quantity follows; of no effect where the spread is 0.

    Returns
    -------
    ndarray, shape (S, n)
        Since :math:`\xi = a_0 + \sqrt{b_1}\,\psi_1`, a half-range of 30 is :math:`30/\sqrt 3` in a Legendre
        basis (ERRATA, [M] eq 20).

    Raises
    ------
    ChaosError
        When shapes differ, a germ does not exist, or its linear term is not in the index set.
    """
    check_germs(families, indices)
    middle, half = np.atleast_1d(np.asarray(centre, float)), np.atleast_1d(np.asarray(spread, float))
    if middle.ndim != 1 or middle.shape != half.shape or middle.size != len(germs):
        raise ChaosError(
            f"centre, spread and germs need one entry per quantity, got {middle.shape}, {half.shape}"
            f" and {len(germs)}"
        )
    coefficients = np.zeros((indices.shape[0], middle.size))
    coefficients[0] = middle
    for i, germ in enumerate(germs):
        if half[i] == 0.0:
            continue
        if not 0 <= germ < len(families):
            raise ChaosError(f"there is no germ {germ}; germs are numbered 0 to {len(families) - 1}")
        linear = (indices[:, germ] == 1) & (indices.sum(axis=1) == 1)
        if not linear.any():
            raise ChaosError(
                f"the index set lacks the linear term of germ {germ}; take an order of 1 or more"
            )
        a, b = families[germ].recurrence(2)
        coefficients[0, i] += half[i] * a[0]
        coefficients[linear, i] = half[i] * np.sqrt(b[1])
    return coefficients

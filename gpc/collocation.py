r"""Collocation: from values of a model at nodes to the coefficients of its expansion, and back.

With independent germs :math:`\xi = (\xi_1 \ldots \xi_d)` and terms :math:`j = 0 \ldots S-1`, the node
matrix is :math:`A_{ij} = \Psi_j(\mu^i)` at nodes :math:`\mu^1 \ldots \mu^Q` ([M] eqs 9-15). Values
:math:`X_i` of a model at the nodes and coefficients :math:`x_j` belong together by

.. math:: X = A\,x, \qquad x = A^{\#} X,

where :math:`A^{\#}` (S by Q) is set up once. Two ways to it:

- regression: the pseudo-inverse of A, for any set of :math:`Q \ge S` nodes, for instance the well-conditioned
  ones of `gpc.nodes`;
- quadrature: :math:`A^{\#} = A^T W` on the full tensor Gauss grid, the discrete
  :math:`x_j = E[X\,\Psi_j]`.

Both reproduce a polynomial of the expansion's terms exactly: :math:`A^{\#} A = I`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpc.basis import Family
from gpc.errors import ChaosError
from gpc.index_set import Indices
from gpc.nodes import MOST_ENTRIES, basis_matrix, check_germs, selected_nodes, tensor_grid

Array = NDArray[np.float64]

MOST_ILL = 50.0
"""The condition number of a node matrix beyond which a regression is refused (ERRATA, [M] Tables 3-4)."""


@dataclass(frozen=True, eq=False)
class Collocation:
    """Nodes of an expansion and the two linear maps between values and coefficients.

    Build it with `regression`, `quadrature` or `collocate`.

    Attributes
    ----------
    families : tuple of Family
        One per germ.
    indices : ndarray of int, shape (S, d)
        Degrees of the terms.
    nodes : ndarray, shape (Q, d)
        Germs at the nodes.
    matrix : ndarray, shape (Q, S)
        ``A``: coefficients to values.
    inverse : ndarray, shape (S, Q)
        ``A#``: values to coefficients.
    """

    families: tuple[Family, ...]
    indices: Indices
    nodes: Array
    matrix: Array
    inverse: Array

    @cached_property
    def condition(self) -> float:
        """Condition number of the node matrix in the 2-norm."""
        return float(np.linalg.cond(self.matrix))

    def project(self, values: ArrayLike) -> Array:
        """Turn values at the nodes, shape (Q, ...), into coefficients, shape (S, ...)."""
        return np.tensordot(self.inverse, np.asarray(values, dtype=np.float64), axes=1)

    def at_nodes(self, coefficients: ArrayLike) -> Array:
        """Turn coefficients, shape (S, ...), into values at the nodes, shape (Q, ...)."""
        return np.tensordot(self.matrix, np.asarray(coefficients, dtype=np.float64), axes=1)


def regression(
    families: Sequence[Family], indices: Indices, nodes: ArrayLike, *, most_ill: float = MOST_ILL
) -> Collocation:
    """Set up least-squares projection on given nodes.

    Parameters
    ----------
    families : sequence of Family
        One per germ.
    indices : ndarray of int, shape (S, d)
        Degrees of the terms.
    nodes : array_like, shape (Q, d)
        Germs, at least as many nodes as terms.
    most_ill : float
        Highest condition number of the node matrix that is accepted.

    Returns
    -------
    Collocation

    Raises
    ------
    ChaosError
        When there are fewer nodes than terms or the node matrix is ill-conditioned.
    """
    points = np.array(nodes, dtype=np.float64)
    matrix = basis_matrix(families, indices, points)
    if matrix.ndim != 2 or matrix.shape[0] < matrix.shape[1]:
        raise ChaosError(
            f"{indices.shape[0]} terms need at least as many nodes, shape (Q, {len(families)}),"
            f" got {points.shape}; add nodes or lower the order"
        )
    singular = np.linalg.svd(matrix, compute_uv=False)
    if not singular[0] <= most_ill * singular[-1]:
        with np.errstate(divide="ignore"):
            condition = singular[0] / singular[-1]
        raise ChaosError(
            f"the node matrix of {matrix.shape[0]} nodes and {matrix.shape[1]} terms has condition number"
            f" {condition:.3g}, more than {most_ill:g}: it would blow up every error; take `selected_nodes`,"
            " more nodes, a lower order or `quadrature`"
        )
    inverse = np.asarray(np.linalg.pinv(matrix), dtype=np.float64)
    return Collocation(tuple(families), indices, points, matrix, inverse)


def quadrature(
    families: Sequence[Family], indices: Indices, points: int | Sequence[int] | None = None
) -> Collocation:
    """Set up projection by the full tensor Gauss rule.

    Parameters
    ----------
    families : sequence of Family
        One per germ.
    indices : ndarray of int, shape (S, d)
        Degrees of the terms.
    points : int or sequence of int, optional
        Points per germ; default and least: one more than the highest degree of the germ.

    Returns
    -------
    Collocation

    Raises
    ------
    ChaosError
        When a rule has too few points to tell the terms apart, or the grid is too large.
    """
    check_germs(families, indices)
    least = [int(degree) + 1 for degree in indices.max(axis=0)]
    number = least if points is None else [points] * len(least) if isinstance(points, int) else list(points)
    if len(number) == len(least) and any(n < m for n, m in zip(number, least, strict=True)):
        raise ChaosError(f"the terms need at least {least} Gauss points per germ, got {number}")
    nodes, weights = tensor_grid(families, number)
    if weights.size * indices.shape[0] > MOST_ENTRIES:
        raise ChaosError(
            f"a grid of {weights.size} nodes for {indices.shape[0]} terms is too large; lower the order, or"
            " use `regression` on nodes of your own"
        )
    matrix = basis_matrix(families, indices, nodes)
    return Collocation(tuple(families), indices, nodes, matrix, matrix.T * weights)


def collocate(families: Sequence[Family], indices: Indices, count: int | None = None) -> Collocation:
    """Set up least-squares projection on ``count`` selected nodes (default: as many as terms).

    Raises
    ------
    ChaosError
        As `selected_nodes` and `regression`.
    """
    return regression(families, indices, selected_nodes(families, indices, count))

"""Nodes of a chaos: the multivariate basis on them, tensor Gauss grids, and well-conditioned parts of these.

A node is a point of germs, a row of shape (d,). The full grid of a chaos with many germs is far larger than
its number S of terms; S of its points suffice for a regression. They are chosen here by a QR decomposition
with column pivoting of the grid's node matrix, transposed, each point weighted with the root of its
probability: at order 2 with 3 points per germ the chosen part has condition number 3.4 for 4 germs and 6.0
for 7 (unweighted 4.3 and 8.1). More nodes are added where the leverage ``a (A'A)^-1 a'`` is largest, which
raises det(A'A) most.

Grids are symmetric, so many points are equal choices; the first of them is taken, up to rounding, lest the
nodes differ between machines.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpc.basis import Family
from gpc.errors import ChaosError
from gpc.index_set import Indices

Array = NDArray[np.float64]

MOST_ENTRIES = 50_000_000
"""Entries of a node matrix beyond which a grid is refused: 0.4 GB."""


def basis_matrix(families: Sequence[Family], indices: Indices, germs: ArrayLike) -> Array:
    r"""Evaluate the multivariate orthonormal basis.

    Parameters
    ----------
    families : sequence of Family
        One per germ, d of them.
    indices : ndarray of int, shape (S, d)
        Degrees of the terms, from `gpc.index_set`.
    germs : array_like, shape (..., d)
        Points.

    Returns
    -------
    ndarray, shape (..., S)

    Raises
    ------
    ChaosError
        When the numbers of germs differ.
    """
    points = np.asarray(germs, dtype=np.float64)
    check_germs(families, indices)
    if points.ndim == 0 or points.shape[-1] != len(families):
        raise ChaosError(
            f"the last axis of the germs must have {len(families)} entries, one per family,"
            f" got {points.shape}"
        )
    matrix = np.ones((*points.shape[:-1], indices.shape[0]))
    for k, family in enumerate(families):
        psi = family.evaluate(points[..., k], int(indices[:, k].max()))
        matrix *= np.moveaxis(psi, 0, -1)[..., indices[:, k]]
    return matrix


def check_germs(families: Sequence[Family], indices: Indices) -> None:
    """Refuse an index set that does not fit the families.

    Raises
    ------
    ChaosError
        When the index set is empty, or has not one column per family, or a negative degree.
    """
    if indices.ndim != 2 or indices.shape[0] < 1 or indices.shape[1] != len(families):
        raise ChaosError(
            f"an index set has one row per term and one column per germ: {len(families)} families do not fit"
            f" shape {indices.shape}"
        )
    if indices.min() < 0 or indices[0].any():
        raise ChaosError("an index set holds degrees of 0 or more, and its first row is the constant")


def tensor_grid(families: Sequence[Family], points: int | Sequence[int]) -> tuple[Array, Array]:
    """Build the full tensor product of Gauss rules.

    Parameters
    ----------
    families : sequence of Family
        One per germ.
    points : int or sequence of int
        Points per germ; a rule of n points is exact up to degree 2 n - 1 in its germ.

    Returns
    -------
    tuple of ndarray, shapes (Q, d) and (Q,)
        Nodes, the last germ running fastest, and weights that sum to 1.

    Raises
    ------
    ChaosError
        When there is no germ, the numbers do not fit, or the grid is too large.
    """
    number = [points] * len(families) if isinstance(points, int) else list(points)
    if not families or len(number) != len(families):
        raise ChaosError(f"give points for each of the {len(families)} germs (at least one), got {points!r}")
    total = float(np.prod(np.asarray(number, dtype=np.float64)))
    if total * len(families) > MOST_ENTRIES:
        raise ChaosError(
            f"a full grid of {' x '.join(map(str, number))} points has {total:.3g} nodes, too many to hold;"
            " lower the order or keep fewer germs"
        )
    rules = [family.gauss(n) for family, n in zip(families, number, strict=True)]
    nodes = np.stack(np.meshgrid(*(rule[0] for rule in rules), indexing="ij"), axis=-1)
    weights = np.ones(1)
    for _, weight in rules:
        weights = np.outer(weights, weight).ravel()
    return nodes.reshape(-1, len(families)), weights


def selected_nodes(families: Sequence[Family], indices: Indices, count: int | None = None) -> Array:
    """Choose well-conditioned nodes from the tensor Gauss grid of (highest degree + 1) points per germ.

    Parameters
    ----------
    families : sequence of Family
        One per germ.
    indices : ndarray of int, shape (S, d)
        Degrees of the terms.
    count : int, optional
        Number Q of nodes, from S (default) to the size of the grid.

    Returns
    -------
    ndarray, shape (Q, d)
        The S nodes of the pivoted QR decomposition first, then those of largest leverage.

    Raises
    ------
    ChaosError
        When ``count`` is out of range or the grid too large.
    """
    check_germs(families, indices)
    grid, weights = tensor_grid(families, [int(degree) + 1 for degree in indices.max(axis=0)])
    terms = indices.shape[0]
    wanted = terms if count is None else count
    if not terms <= wanted <= weights.size:
        raise ChaosError(
            f"the number of nodes must lie between the {terms} terms and the {weights.size} points of the"
            f" Gauss grid, got {wanted}"
        )
    if weights.size * terms > MOST_ENTRIES:
        raise ChaosError(
            f"choosing among {weights.size} grid points for {terms} terms is too large; lower the order,"
            " or give nodes of your own to `regression`"
        )
    matrix = basis_matrix(families, indices, grid)
    chosen = _pivots(matrix * np.sqrt(weights)[:, np.newaxis])
    return grid[_add_by_leverage(matrix, chosen, wanted)]


def _first_largest(values: Array) -> int:
    """Give the first of the largest; rounding must not choose among equals."""
    return int(np.argmax(values >= values.max() * (1.0 - 1e-9)))


def _pivots(rows: Array) -> list[int]:
    """Pick as many rows as there are columns, each the farthest from the span of those before."""
    left = rows.copy()
    chosen: list[int] = []
    for _ in range(rows.shape[1]):
        square = np.sum(left**2, axis=1)
        square[chosen] = 0.0
        at = _first_largest(square)
        chosen.append(at)
        direction = left[at] / np.sqrt(square[at])
        left -= np.outer(left @ direction, direction)
    return chosen


def _add_by_leverage(matrix: Array, chosen: list[int], wanted: int) -> list[int]:
    """Add rows until there are enough, each the one that raises det(A'A) most."""
    inverse = np.linalg.inv(matrix[chosen].T @ matrix[chosen])
    while len(chosen) < wanted:
        leverage = np.sum((matrix @ inverse) * matrix, axis=1)
        leverage[chosen] = 0.0
        at = _first_largest(leverage)
        chosen.append(at)
        step = inverse @ matrix[at]
        inverse -= np.outer(step, step) / (1.0 + matrix[at] @ step)
    return chosen

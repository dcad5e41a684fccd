r"""Mean, standard deviation, quantiles, Sobol indices and error of what members of a design gave.

A sample's Sobol indices are those of a chaos fitted to it by least squares, of the highest order up to 4 that
leaves three members per term; ``explained`` says which part of the variance that chaos holds. Correlated
parameters have no index: the chaos has independent germs, the first of which carries what the first parameter
shares with all others, so that a share of the variance would depend on the order of the parameters.

A chaos has no standard error. What limits its mean are the degrees that it lacks; its ``error`` is what the
next one would be if degrees fell half as fast from the last, :math:`e_p`, on as they did down to it,
:math:`e_p \sqrt{e_p / e_{p-1}}` but at most :math:`e_p`. Here :math:`e` is the root of the sum of squared
coefficients of a degree, and the last takes in what the grid resolves beyond it. It is a cautious guess,
often ten times too large where the model is smooth. Where the model has a kink, as at the capacity, which no
polynomial follows, the degrees do not fall and the error shows it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivecycles.traffic.sampling import Design
from gpc import (
    Collocation,
    Expansion,
    Family,
    basis_matrix,
    count_terms,
    total_order,
)
from gpc.expansion import is_variance

Array = NDArray[np.float64]

HIGHEST_FIT = 4
PER_TERM = 3


class Summary(NamedTuple):
    """Statistics of outputs of any shape, as `drivecycles.traffic.uncertainty.Spread` describes them."""

    mean: Array
    sd: Array
    error: Array
    quantiles: Array
    first_order: Array | None
    total: Array | None
    explained: Array | None
    expansion: Expansion | None


def of_sample(
    families: Sequence[Family], plan: Design, germs: Array, outcome: Array, levels: Sequence[float]
) -> Summary:
    """Summarise a sample.

    Parameters
    ----------
    families : sequence of Family
        One per germ.
    plan : Design
        Where the members are.
    germs : ndarray, shape (M, d)
        Their germs.
    outcome : ndarray, shape ``(*outputs, M)``
        What they gave.
    levels : sequence of float
        Of the quantiles.
    """
    first, total, explained = _fitted_indices(families, germs, outcome)
    return Summary(
        outcome.mean(axis=-1),
        outcome.std(axis=-1, ddof=1),
        plan.error(outcome),
        np.quantile(outcome, levels, axis=-1),
        first,
        total,
        explained,
        None,
    )


def of_chaos(plan: Collocation, outcome: Array, levels: Sequence[float], germs: Array) -> Summary:
    """Summarise values at the nodes of a Gauss grid; quantiles are those at ``germs``, shape (n, d)."""
    values = np.moveaxis(outcome, -1, 0)
    expansion = Expansion.of(plan, values)
    basis = basis_matrix(plan.families, plan.indices, germs)
    quantiles = np.empty((len(levels), *outcome.shape[:-1]))
    # Row by row: a whole field of thousands of draws would not fit.
    for at in range(outcome.shape[0]):
        drawn = np.tensordot(basis, expansion.coefficients[:, at], axes=1)
        quantiles[:, at] = np.quantile(drawn, levels, axis=0)
    weight = plan.inverse[0]
    left = np.tensordot(weight, (values - plan.at_nodes(expansion.coefficients)) ** 2, axes=1)
    variance = np.tensordot(weight, (values - expansion.mean) ** 2, axes=1)
    return Summary(
        expansion.mean,
        np.sqrt(expansion.variance),
        _next_degree(expansion, left),
        quantiles,
        expansion.first_order,
        expansion.total,
        _held(left, variance, np.tensordot(weight, values**2, axes=1)),
        expansion,
    )


def _fitted_indices(
    families: Sequence[Family], germs: Array, outcome: Array
) -> tuple[Array, Array, Array] | tuple[None, None, None]:
    """Fit a chaos to a sample: its first-order and total indices, and the variance it holds."""
    size, dimension = germs.shape
    fitting = [p for p in range(1, HIGHEST_FIT + 1) if PER_TERM * count_terms(dimension, p) <= size]
    if not fitting:
        return None, None, None
    indices = total_order(dimension, fitting[-1])
    matrix = basis_matrix(families, indices, germs)
    flat = outcome.reshape(-1, size).T
    solution = np.asarray(np.linalg.lstsq(matrix, flat, rcond=None)[0], dtype=np.float64)
    fitted = Expansion(families, indices, solution.reshape(-1, *outcome.shape[:-1]))
    left = np.mean((flat - matrix @ solution) ** 2, axis=0).reshape(outcome.shape[:-1])
    return fitted.first_order, fitted.total, _held(left, outcome.var(axis=-1), np.mean(outcome**2, axis=-1))


def _next_degree(expansion: Expansion, left: Array) -> Array:
    """Guess the size of the degree after the last from the last two; ``left`` is the variance left over."""
    degree = expansion.indices.sum(axis=1)
    order = int(degree.max())
    last: Array = np.sqrt(np.sum(expansion.coefficients[degree == order] ** 2, axis=0) + left)
    if order < 2:
        return last
    before = np.sqrt(np.sum(expansion.coefficients[degree == order - 1] ** 2, axis=0))
    ratio = np.divide(last, before, out=np.ones_like(last), where=before > last)
    return np.asarray(last * np.sqrt(ratio), dtype=np.float64)


def _held(left: Array, variance: Array, square: Array) -> Array:
    """Give the part of a variance that is not left over; 1 where there is none beside the mean square."""
    varies = is_variance(variance, square)
    share: Array = 1.0 - np.divide(left, variance, out=np.zeros_like(left), where=varies)
    return share

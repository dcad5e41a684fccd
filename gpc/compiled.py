"""A chaos filter as arrays, laid out for `gpc._ekf`, from whose pieces a model compiles its loop."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpc.belief import ChaosBelief
from gpc.ekf import GpcEkf
from gpc.errors import ChaosError

Array = NDArray[np.float64]


class FilterArrays(NamedTuple):
    """Settings and start of a filter on n states, S terms and Q nodes.

    Attributes
    ----------
    forward, back : ndarray, shapes (S, Q) and (Q, S)
        Coefficients to values at the nodes, and back.
    chaos, remainder : ndarray, shapes (n, S) and (n, n)
        Belief to start from; a loop changes them, so they are copies.
    growth, added : ndarray, shape (n, S)
        Inflation: a coefficient is multiplied by the one, then the other is added.
    diagonal : ndarray, shape (n,)
        Added to the covariance in the gain.
    carried : bool
        Whether a remainder is kept.
    lower, upper : ndarray, shape (n,)
        Bounds at the nodes.
    share : float
        Of a state's variance in the remainder, beyond which the filter restarts.
    """

    forward: Array
    back: Array
    chaos: Array
    remainder: Array
    growth: Array
    added: Array
    diagonal: Array
    carried: bool
    lower: Array
    upper: Array
    share: float


def as_arrays(gpc: GpcEkf, belief: ChaosBelief) -> FilterArrays:
    """Lay out a filter and its start.

    Parameters
    ----------
    gpc : GpcEkf
        A regression has its parameters as states and its outputs as measured function.
    belief : ChaosBelief
        To start from.

    Raises
    ------
    ChaosError
        When some states must not be updated, a setting does not have one value per state, or the filter
        restarts without the linear terms of a germ per state in the rows after the constant.
    """
    if gpc.updated is not None:
        raise ChaosError(
            "a compiled filter updates every state; leave outputs out of the state and measure them instead"
        )
    chaos = np.ascontiguousarray(belief.coefficients.T)
    n = chaos.shape[0]
    linear = np.eye(n, dtype=np.int64)
    if gpc.restarts_at < 1.0 and not np.array_equal(gpc.collocation.indices[1 : n + 1], linear):
        raise ChaosError(f"a restart needs a germ for each of {n} states, as `gpc.index_set` orders them")
    growth, added = np.ones_like(chaos), np.zeros_like(chaos)
    if gpc.inflation is not None:
        initial = gpc.inflation.initial.T
        factor = np.asarray(gpc.inflation.factor)[:, np.newaxis]
        if initial.shape != chaos.shape:
            raise ChaosError(f"inflation of {initial.shape[0]} states does not fit a filter of {n}")
        if gpc.inflation.kind == "additive":
            added = np.ascontiguousarray(factor * initial)
        else:
            growth = np.ascontiguousarray(np.where(initial != 0.0, 1.0 + factor, 1.0))
    return FilterArrays(
        np.ascontiguousarray(gpc.collocation.matrix.T),
        np.ascontiguousarray(gpc.collocation.inverse.T),
        # A transposed single row is contiguous already, and would be the belief itself.
        chaos.copy(),
        np.array(belief.remainder),
        growth,
        added,
        _per_state("diagonal", gpc.diagonal, 0.0, n),
        gpc.carry,
        _per_state("lower bound", gpc.lower, -np.inf, n),
        _per_state("upper bound", gpc.upper, np.inf, n),
        gpc.restarts_at if gpc.carry else 1.0,
    )


def _per_state(name: str, given: ArrayLike | None, default: float, n: int) -> Array:
    value = np.asarray(default if given is None else given, dtype=np.float64)
    if value.shape not in ((), (n,)):
        raise ChaosError(f"give the {name} as one value per state, {n} of them, got shape {value.shape}")
    return np.array(np.broadcast_to(value, (n,)))

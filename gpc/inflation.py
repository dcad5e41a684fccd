"""Remedies of [M] eqs 25-26 for a chaos that contracts to a point: wider parameters, scattered states.

They keep a filter awake without a claim about its covariance; `gpc.ekf.GpcEkf` with ``carry=True`` needs
neither.
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpc.collocation import Collocation
from gpc.errors import ChaosError

Array = NDArray[np.float64]

Kind = Literal["additive", "multiplicative"]


@dataclass(frozen=True, eq=False)
class Inflation:
    """Widening of parameters before each forecast, [M] eq 25.

    The equation adds ``c_d p_d^2 mu_d`` at the nodes, where ``p_d^2`` is the coefficient of the linear term
    of the parameter's own germ (an index, not a square: ERRATA). In an orthonormal basis that adds ``c_d``
    times this coefficient to itself.

    Parameters
    ----------
    kind : {"additive", "multiplicative"}
        Additive adds a part of the *initial* linear coefficient, the initial half-range, at each step;
        multiplicative a part of the current one, which fades with it.
    factor : array_like, shape (n,)
        ``c_d`` per state, 0 or more; 0 leaves a state alone.
    initial : array_like, shape (S, n)
        The coefficients the filter starts from; all but their constant row counts as spread.

    Raises
    ------
    ChaosError
        When the kind is unknown, shapes differ or a factor is negative.
    """

    kind: Kind
    factor: Array
    initial: Array

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            near = difflib.get_close_matches(str(self.kind), get_args(Kind), n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise ChaosError(
                f"unknown inflation {self.kind!r}: allowed are {', '.join(get_args(Kind))}{hint}"
            )
        factor = np.array(self.factor, dtype=np.float64)
        spread = np.array(self.initial, dtype=np.float64)
        if spread.ndim != 2 or factor.shape != spread.shape[1:]:
            raise ChaosError(
                f"inflation needs one factor per state: {factor.shape} does not fit coefficients"
                f" of shape {spread.shape}"
            )
        if not np.all((factor >= 0.0) & (factor < np.inf)):
            raise ChaosError(f"an inflation factor must be 0 or more and finite, got {factor.tolist()}")
        spread[0] = 0.0
        object.__setattr__(self, "factor", factor)
        object.__setattr__(self, "initial", spread)

    def apply(self, coefficients: Array) -> Array:
        """Widen coefficients, shape (S, n)."""
        if self.kind == "additive":
            return coefficients + self.factor * self.initial
        growth = np.where(self.initial != 0.0, 1.0 + self.factor, 1.0)
        return coefficients * growth


def scatter(
    collocation: Collocation, coefficients: ArrayLike, half_range: ArrayLike, generator: np.random.Generator
) -> Array:
    """Shake the initial states at every node, [M] eq 26.

    Each node's states move by independent uniform noise, which the projection turns into terms of every kind,
    the mean among them. A germ of its own for each uncertain initial state says the same honestly
    (`gpc.expansion.affine_coefficients`).

    Parameters
    ----------
    collocation : Collocation
        Of the filter.
    coefficients : array_like, shape (S, n)
        To start from.
    half_range : array_like, shape (n,)
        ``N`` per state: noise in [-N, N]; 0 for parameters.
    generator : numpy.random.Generator
        Source of the noise.

    Returns
    -------
    ndarray, shape (S, n)

    Raises
    ------
    ChaosError
        When shapes differ.
    """
    start, half = np.asarray(coefficients, dtype=np.float64), np.asarray(half_range, dtype=np.float64)
    if start.ndim != 2 or half.shape != start.shape[1:]:
        raise ChaosError(f"give one half-range per state: {half.shape} does not fit {start.shape}")
    noise = generator.uniform(-1.0, 1.0, (collocation.nodes.shape[0], half.size)) * half
    return start + collocation.project(noise)

r"""A Kalman filter on polynomial chaos coefficients, [M] part 1 (gPC-EKF), with a covariance one can trust.

The state (parameters included, eq 21) is an expansion :math:`x = \sum_i x^i \Psi_i(\xi)`. A forecast runs the
model at the collocation nodes and projects the result (eqs 9-15); the covariance is read off the coefficients
(eq 20); an update with :math:`z = H x + v`, :math:`v \sim N(0, R)`, moves every coefficient (eqs 22, 23):

.. math:: K = P H^T (H P H^T + R)^{-1}, \qquad x^i \leftarrow x^i + K (z\,\delta_{i0} - H x^i).

For :math:`i \ge 1` that multiplies the spread by :math:`I - K H`, so the chaos covariance becomes
:math:`(I - KH) C (I - KH)^T`. The measurement is expanded as if it were free of noise: the :math:`K R K^T` of
the Joseph form is missing, C is too small after every update, and the filter falls asleep (the collapse is
asymptotic: ERRATA). Here a matrix N, the covariance that no germ represents, is carried beside the chaos:

.. math:: N \leftarrow \Phi N \Phi^T + Q, \qquad N \leftarrow (I - KH) N (I - KH)^T + K R K^T, \qquad
          P = C + N.

:math:`\Phi` and the slope of a nonlinear H are central differences over one standard deviation about the
mean. For a linear model with Gaussian noise, mean and P are those of the Kalman filter. As measurements come
in, spread passes from C to N; `GpcEkf.restart` moves it back into germs, where the model's curvature is seen.
The filter does so by itself when of some state more than the share ``restarts_at`` of the variance is in N.

Three modes of this one filter differ in a few settings:

- full germ: `GpcEkf.full_germ`, the one to use. Every uncertain state, initial states as well as parameters,
  has a germ of its own, and N is carried;
- report: `GpcEkf.report`, without N. As it stands that is the unmodified filter (eqs 20-23); with a small
  diagonal ``c`` on P in the gain, parameters inflated before each forecast and initial states scattered
  (`gpc.inflation`) it is the modified one (eqs 24-26);
- regression: `GpcEkf.regression` (eq 27), for states that are outputs computed anew from the parameters at
  each step; their rows of K are zero. It goes with N or without. Leaving the outputs out of the state and
  giving the model as ``measure`` to `GpcEkf.update` is the same filter.

`gpc.compiled` prepares a filter for a compiled loop; `gpc.consistency` judges what it claims.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpc.basis import Legendre
from gpc.belief import ChaosBelief, Innovation, as_covariance
from gpc.collocation import Collocation, collocate
from gpc.errors import ChaosError
from gpc.expansion import affine_coefficients
from gpc.index_set import total_order
from gpc.inflation import Inflation

Array = NDArray[np.float64]

Function = Callable[[Array], Array]
"""Vectorised: rows of states, shape (q, n), to rows of results."""


LEAST_PIVOT = 1e-14
"""Share of a variance below which a pivot of Cholesky's factor counts as none."""


@dataclass(frozen=True, eq=False)
class GpcEkf:
    """Filter on chaos coefficients; it holds settings only, and beliefs pass through it.

    Parameters
    ----------
    collocation : Collocation
        Basis, nodes, and both maps between values and coefficients.
    carry : bool
        Carry N beside the chaos (default); False is the report's filter.
    diagonal : array_like, shape (n,), optional
        ``c`` of [M] eq 24, added to the covariance in the gain only. At most 1 % of the measurement variance
        on states, 0 on parameters (ERRATA: more biases them).
    inflation : Inflation, optional
        Widening of parameters before each forecast, [M] eq 25.
    updated : array_like of bool, shape (n,), optional
        States that a measurement may move; default all.
    lower, upper : array_like, shape (n,), optional
        Bounds on the states at the nodes, so that a model never sees a mass below zero, say.
    restarts_at : float
        Share of a state's variance in N beyond which an update ends with a restart; 1 is never.

    Raises
    ------
    ChaosError
        When a bound lies above another, the diagonal is negative or the share not in (0, 1].
    """

    collocation: Collocation
    carry: bool = True
    diagonal: ArrayLike | None = None
    inflation: Inflation | None = None
    updated: ArrayLike | None = None
    lower: ArrayLike | None = None
    upper: ArrayLike | None = None
    restarts_at: float = 1.0

    def __post_init__(self) -> None:
        lower, upper = self._bounds()
        if not np.all(lower < upper):
            raise ChaosError(f"each lower bound must lie below its upper, got {lower} and {upper}")
        if self.diagonal is not None and not np.all(np.asarray(self.diagonal, dtype=np.float64) >= 0.0):
            raise ChaosError(f"the diagonal added to the covariance must be 0 or more, got {self.diagonal}")
        if not 0.0 < self.restarts_at <= 1.0:
            raise ChaosError(f"restarts_at is a share in (0, 1], 1 for never, got {self.restarts_at}")

    @classmethod
    def full_germ(
        cls,
        centre: ArrayLike,
        half_range: ArrayLike,
        *,
        order: int = 2,
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        restarts_at: float = 0.7,
    ) -> tuple[GpcEkf, ChaosBelief]:
        """Set up the filter that gives every uncertain state a germ of its own, and what it starts from.

        Parameters
        ----------
        centre, half_range : array_like, shape (n,)
            Each state is uniform within ``half_range`` of ``centre``; 0 for one that is known.
        order : int
            Total order of the expansions; nodes are as many as terms.
        lower, upper, restarts_at
            As for the class. A restart needs a germ for every state and an order of 2 or more: without them
            there is none.

        Raises
        ------
        ChaosError
            When shapes differ, a half-range is negative, none is positive, or a bound is wrong.
        """
        middle, half = np.asarray(centre, dtype=np.float64), np.asarray(half_range, dtype=np.float64)
        if middle.ndim != 1 or half.shape != middle.shape or not np.all((half >= 0.0) & (half < np.inf)):
            raise ChaosError(
                f"give one half-range of 0 or more per state, got {half.tolist()} for {middle.size} states"
            )
        germs = int(np.count_nonzero(half))
        families, indices = (Legendre(),) * germs, total_order(germs, order)
        place = np.maximum(np.cumsum(half > 0.0) - 1, 0).tolist()
        share = restarts_at if germs == middle.size and order > 1 else 1.0
        gpc = cls(collocate(families, indices), lower=lower, upper=upper, restarts_at=share)
        return gpc, gpc.start(affine_coefficients(families, indices, middle, half, place))

    @classmethod
    def report(
        cls,
        collocation: Collocation,
        *,
        diagonal: ArrayLike | None = None,
        inflation: Inflation | None = None,
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
    ) -> GpcEkf:
        """Set up the filter of [M] eqs 20-23, which grows over-confident, or with options that of 24-26."""
        return cls(collocation, False, diagonal, inflation, None, lower, upper)

    @classmethod
    def regression(
        cls,
        collocation: Collocation,
        outputs: int,
        parameters: int,
        *,
        carry: bool = True,
        inflation: Inflation | None = None,
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
    ) -> GpcEkf:
        """Set up the filter of [M] eq 27 for states ordered as outputs, then parameters.

        Raises
        ------
        ChaosError
            When there is no output or no parameter.
        """
        if outputs < 1 or parameters < 1:
            raise ChaosError(f"a regression needs outputs and parameters, got {outputs} and {parameters}")
        updated = np.arange(outputs + parameters) >= outputs
        return cls(collocation, carry, None, inflation, updated, lower, upper)

    def start(self, coefficients: ArrayLike, remainder: ArrayLike | None = None) -> ChaosBelief:
        """Start from coefficients, shape (S, n), and a covariance that no germ represents, shape (n, n).

        Raises
        ------
        ChaosError
            When shapes differ, a value is not finite, or a remainder is given that is not carried.
        """
        given = np.array(coefficients, dtype=np.float64)
        terms = self.collocation.indices.shape[0]
        if given.ndim != 2 or given.shape[0] != terms or not np.all(np.isfinite(given)):
            raise ChaosError(
                f"the filter starts from finite coefficients of shape ({terms}, n), got {given.shape}"
            )
        size = given.shape[1]
        if remainder is None:
            return ChaosBelief(given, np.zeros((size, size)))
        self._needs_carry("a remainder")
        return ChaosBelief(given, as_covariance(remainder, size, "the remainder"))

    def forecast(
        self, belief: ChaosBelief, model: Function, process_noise: ArrayLike | None = None
    ) -> ChaosBelief:
        """Move a belief over one step of the model.

        Parameters
        ----------
        belief : ChaosBelief
        model : callable
            States at the start of the step, shape (q, n), to states at its end, row by row.
        process_noise : array_like, optional
            ``Q``: a variance for all states, one each, or shape (n, n).

        Returns
        -------
        ChaosBelief

        Raises
        ------
        ChaosError
            When the model returns a wrong shape or no finite value, or process noise is not carried.
        """
        size = belief.mean.size
        coefficients = belief.coefficients
        if self.inflation is not None:
            coefficients = self.inflation.apply(coefficients)
        widened = ChaosBelief(coefficients, belief.remainder)
        moved, slope = self._evaluate(model, widened, belief.remainder)
        remainder = slope @ belief.remainder @ slope.T
        if process_noise is not None:
            self._needs_carry("process noise")
            remainder = remainder + as_covariance(process_noise, size, "the process noise")
        if moved.shape[1] != size:
            raise ChaosError(f"the model must return its {size} states, got {moved.shape[1]}")
        return ChaosBelief(moved, remainder)

    def update(
        self, belief: ChaosBelief, measurement: ArrayLike, noise: ArrayLike, measure: ArrayLike | Function
    ) -> tuple[ChaosBelief, Innovation]:
        """Weigh a belief against a measurement.

        Parameters
        ----------
        belief : ChaosBelief
        measurement : array_like, shape (m,)
        noise : array_like
            ``R``: a variance for all outputs, one each, or shape (m, m).
        measure : array_like, shape (m, n), or callable
            ``H``, or states, shape (q, n), to outputs, shape (q, m), row by row.

        Returns
        -------
        tuple of ChaosBelief and Innovation

        Raises
        ------
        ChaosError
            When shapes differ, or a measurement is not finite: leave the update out then.
        """
        value = np.atleast_1d(np.asarray(measurement, dtype=np.float64))
        if value.ndim != 1 or not np.all(np.isfinite(value)):
            raise ChaosError(
                f"a measurement is a finite vector, got {measurement!r}; leave out what is missing"
            )
        beside = self._beside(belief)
        expected, slope = self._evaluate(measure, belief, beside)
        if expected.shape[1] != value.size:
            raise ChaosError(f"{value.size} values were measured, but the model gives {expected.shape[1]}")
        r = as_covariance(noise, value.size, "the measurement noise")
        cross = belief.coefficients[1:].T @ expected[1:] + beside @ slope.T
        total = expected[1:].T @ expected[1:] + slope @ beside @ slope.T + r
        gain = _gain(cross, total)
        if self.updated is not None:
            gain = gain * np.asarray(self.updated, dtype=bool)[:, np.newaxis]
        error = -expected
        error[0] += value
        remainder = belief.remainder
        if self.carry:
            keep = np.eye(belief.mean.size) - gain @ slope
            remainder = keep @ remainder @ keep.T + gain @ r @ gain.T
        updated = ChaosBelief(belief.coefficients + error @ gain.T, remainder)
        if self.carry and np.any(np.diagonal(remainder) > self.restarts_at * np.diagonal(updated.covariance)):
            updated = self.restart(updated)
        return updated, Innovation(error[0], total, gain)

    def restart(self, belief: ChaosBelief) -> ChaosBelief:
        """Move the whole covariance into germs: an expansion linear in them, by Cholesky's factor.

        Mean and total covariance stay; the shape of the distribution becomes that of the germs.

        Raises
        ------
        ChaosError
            When there are fewer germs than states or the index set has no linear terms.
        """
        indices = self.collocation.indices
        size, germs = belief.mean.size, indices.shape[1]
        linear = [np.flatnonzero((indices[:, k] == 1) & (indices.sum(axis=1) == 1)) for k in range(germs)]
        if germs < size or any(row.size == 0 for row in linear):
            raise ChaosError(
                f"a restart needs a germ with a linear term for each of {size} states, got {germs}"
            )
        coefficients = np.zeros_like(belief.coefficients)
        coefficients[0] = belief.mean
        left = belief.covariance
        for k in range(size):
            # Of a variance that germs before explain, rounding leaves a rest that is no germ.
            if left[k, k] > LEAST_PIVOT * belief.covariance[k, k]:
                coefficients[linear[k][0], k:] = left[k:, k] / np.sqrt(left[k, k])
                left = left - np.outer(coefficients[linear[k][0]], coefficients[linear[k][0]])
        return ChaosBelief(coefficients, np.zeros((size, size)))

    def _bounds(self) -> tuple[Array, Array]:
        lower = np.asarray(-np.inf if self.lower is None else self.lower, dtype=np.float64)
        upper = np.asarray(np.inf if self.upper is None else self.upper, dtype=np.float64)
        return lower, upper

    def _beside(self, belief: ChaosBelief) -> Array:
        """Give the covariance that enters a gain beside that of the chaos: N and the diagonal of eq 24."""
        if self.diagonal is None:
            return belief.remainder
        diagonal = np.asarray(self.diagonal, dtype=np.float64)
        if diagonal.shape not in ((), belief.mean.shape):
            raise ChaosError(f"give the diagonal as one value per state, got shape {diagonal.shape}")
        return belief.remainder + np.diag(np.broadcast_to(diagonal, belief.mean.shape))

    def _needs_carry(self, what: str) -> None:
        if not self.carry:
            raise ChaosError(f"{what} has no place in the chaos alone; set up the filter with carry=True")

    def _evaluate(
        self, function: ArrayLike | Function, belief: ChaosBelief, beside: Array
    ) -> tuple[Array, Array]:
        """Give the coefficients of a function of the states, and its slope where ``beside`` needs it."""
        if not callable(function):
            matrix = np.atleast_2d(np.asarray(function, dtype=np.float64))
            if matrix.ndim != 2 or matrix.shape[1] != belief.mean.size:
                raise ChaosError(
                    f"H has one column for each of {belief.mean.size} states, got {matrix.shape}"
                )
            return belief.coefficients @ matrix.T, matrix
        lower, upper = self._bounds()
        nodes = np.clip(self.collocation.at_nodes(belief.coefficients), lower, upper)
        mean = np.clip(belief.mean, lower, upper)
        # A state without variance beside the chaos needs no slope: its column meets only zeros.
        active = np.flatnonzero(np.diagonal(beside) > 0.0)
        reach = np.sqrt(np.diagonal(belief.chaos_covariance + beside)[active])
        reach = np.maximum(reach, 1e-7 * np.abs(mean[active]))
        points = np.repeat(mean[np.newaxis], 2 * active.size, axis=0)
        ahead, behind = np.arange(active.size), np.arange(active.size, 2 * active.size)
        points[ahead, active] += reach
        points[behind, active] -= reach
        points = np.clip(points, lower, upper)
        values = _call(function, np.concatenate([nodes, points]))
        count = nodes.shape[0]
        slope = np.zeros((values.shape[1], mean.size))
        between = points[ahead, active] - points[behind, active]
        change = values[count + ahead] - values[count + behind]
        slope[:, active] = (change / between[:, np.newaxis]).T
        return self.collocation.project(values[:count]), slope


def _gain(cross: Array, total: Array) -> Array:
    """Give K of [M] eq 23."""
    try:
        return np.asarray(np.linalg.solve(total, cross.T).T, dtype=np.float64)
    except np.linalg.LinAlgError:
        raise ChaosError(
            "the innovation has a singular covariance: give every output a measurement noise above 0"
        ) from None


def _call(function: Function, states: Array) -> Array:
    """Call a user's function and look at what comes back."""
    values = np.asarray(function(states), dtype=np.float64)
    if values.ndim != 2 or values.shape[0] != states.shape[0]:
        raise ChaosError(
            f"a model maps rows of states to rows of results: {states.shape} gave {values.shape}"
        )
    bad = np.flatnonzero(~np.all(np.isfinite(values), axis=1))
    if bad.size:
        raise ChaosError(
            f"the model gave NaN or inf at the states {states[bad[0]].tolist()}; bound the states by lower"
            " and upper"
        )
    return values

r"""Put [L]'s postulate to the test: fit gamma, beta and mu to what an estimator does.

[L] eqs 3 to 13 (`bms.uncertainty`) say how the variance :math:`m_k` of the error of a SOC estimate moves
along a trip, given estimates and currents. An estimator that was watched where the truth is known gives, in
realization r at step k, an error :math:`e_{rk}` and the variance :math:`p_{rk}` that it claims. Gamma, beta
and mu minimise the composite quasi-likelihood

.. math::

    \sum_{r,k} \Bigl[ \log m + \frac{q}{m} \Bigr]_{rk}
    + \frac1L \sum_{r,k} \Bigl[ \log v + \frac{M^2}{v} \Bigr]_{rk}, \qquad
    q = w\,e^2 + (1 - w)\,p, \qquad v_k = \sum_{j=k}^{k+L-1} K_j m_j .

The first sum is about *levels*: least where m is the mean of the real and of the claimed squares. The second
is about *learning*: M is what the estimate moved over L = 300 s beside the charge that passed, and by [L] eqs
5 and 8 its variance is v. Both are least at the mean of the squares whatever their distribution and
correlation (Patton, J. Econometrics 160, 2011). With w = 0 no truth is needed. Gauss-Newton steps on the
logarithms, with slopes that are carried along the recursion.

**What is identifiable.** Levels alone show :math:`\sigma_d^2 \sigma_w^2 = p^2 (1 - K)` in a steady state,
one number; what is learnt tells measurement from drift. What tells beta from gamma is that p follows
:math:`|i|`; what confirms mu is that p follows alpha. An estimator that learns next to nothing from the
voltage within a trip has no mu: the fit then runs to its bound, and says so.

**Standard errors** are those of a bootstrap over realizations, because errors within one are correlated: each
sample moves the minimum by one Gauss-Newton step. They say what other realizations of the same trip would
have given, not whether the model is right.

**How wrong is it.** The fit says what share of the claimed and of the real spread's changes m explains,
whether errors are as large as m and as p say (NEES, share within two standard deviations), and how far the
steps :math:`\epsilon_k = e_{k+1} - (1 - K_k) e_k` are from being white, which [L] eq 6 wants: their variance
over its prediction, and the variance of their sum over a minute over 60 variances of a single one.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bms import _kernels as _kernels
from bms import _uncertainty_fit
from bms._filter import Filter
from bms.errors import BatteryError
from bms.filtering import tabulate_filter
from bms.pack import Pack
from bms.uncertainty import UncertaintyModel

Array = NDArray[np.float64]

NAMES = ("gamma", "beta", "mu")
LOWEST = np.array([1e-13, 1e-14, 1e-8])
HIGHEST = np.array([1e-2, 1e-3, 100.0])
"""Bounds of the search; at a mu of 100 a voltage says nothing of the SOC within hours."""
STARTS = ((1e-8, 1e-9, 1e-2), (1e-6, 3.9e-7, 2e-3), (1e-8, 1e-9, 10.0))
AT_BOUND = 1.05
ITERATIONS = 60
SETTLED = 1e-9
"""A step that gains less than this at every sample is the last one."""
VAGUE, TOGETHER = 1.0, 0.95
"""Standard error of a logarithm, and correlation of two, beyond which a parameter is not identifiable."""
STILL = 1e-3
"""Below this the bootstrap does not move a logarithm, and its correlations mean nothing."""
MINUTE_S, APART_S = 60.0, 300.0


@dataclass(frozen=True, eq=False)
class Behaviour:
    """What an estimator did in n realizations over N steps, where the truth was known.

    Parameters
    ----------
    step_s : float
        Length of a step.
    soc, error, variance : ndarray, shape (n, N + 1)
        Estimate, true SOC less estimate, claimed variance; before each step and at the end.
    current_A : ndarray, shape (n, N)
        Current over each step.

    Raises
    ------
    BatteryError
        When the shapes do not fit together, or a number is not finite.
    """

    step_s: float
    soc: Array
    error: Array
    variance: Array
    current_A: Array

    def __post_init__(self) -> None:
        n, steps = self.current_A.shape
        for name in ("soc", "error", "variance"):
            if getattr(self, name).shape != (n, steps + 1):
                raise BatteryError(
                    f"{name} has the shape {getattr(self, name).shape} for {n} realizations of {steps} steps"
                )
        if n < 2 or steps < 2:
            raise BatteryError(
                f"{n} realizations of {steps} steps are too few to fit; give 2 or more of each"
            )
        arrays = (self.soc, self.error, self.variance, self.current_A)
        if not all(np.all(np.isfinite(array)) for array in arrays):
            raise BatteryError("a trajectory holds NaN or inf; leave out realizations that broke off")


@dataclass(frozen=True, slots=True)
class Fit:
    """How well a fitted model does; see the module for the words.

    Parameters
    ----------
    explained_believed, explained_real : float
        Share of the changes of the claimed, and of the real, standard deviation along the trip that the model
        explains: 1 is all, 0 no more than their mean, below 0 less. Where it hardly changes, that says
        little;
    off_believed, off_real : float
        Distance of the model's standard deviation from them, root mean square along the trip, as a share of
        their mean.
    nees_estimator, nees_model : float
        Mean of the squared error over the claimed, and over the model's, variance; 1 is right.
    inside_estimator, inside_model : float
        Share of samples within two standard deviations; 0.954 is right for normal errors.
    step_ratio : float
        Variance of the steps of the error over what the model says; 1 is right.
    minute_ratio : float
        Variance of their sum over a minute over that of as many white ones; 1 is right.
    moved_ratio : float
        Mean square of what the estimate moves in five minutes, beside the charge, over the model's; 1 is
        right.
    correlation, correlation_model : float
        Correlation of errors five minutes apart, real and by the model.
    """

    explained_believed: float
    explained_real: float
    off_believed: float
    off_real: float
    nees_estimator: float
    nees_model: float
    inside_estimator: float
    inside_model: float
    step_ratio: float
    minute_ratio: float
    moved_ratio: float
    correlation: float
    correlation_model: float


@dataclass(frozen=True, eq=False)
class FittedUncertainty:
    """[L]'s model as it fits an estimator.

    Parameters
    ----------
    model : UncertaintyModel
        gamma, beta and mu.
    error_weight : float
        The weight w of the real errors.
    standard_errors : UncertaintyModel
        Their standard errors, of the bootstrap.
    log_correlation : ndarray, shape (3, 3)
        Correlation of their logarithms in the bootstrap.
    fit : Fit
        How well it fits.
    notes : tuple of str
        What is not identifiable, in words.
    """

    model: UncertaintyModel
    error_weight: float
    standard_errors: UncertaintyModel
    log_correlation: Array
    fit: Fit
    notes: tuple[str, ...]


def fit_uncertainty(
    behaviour: Behaviour, pack: Pack, *, error_weight: float = 0.5, resamples: int = 200, seed: int = 0
) -> FittedUncertainty:
    """Fit gamma, beta and mu.

    Parameters
    ----------
    behaviour : Behaviour
        What the estimator did.
    pack : Pack
        Gives alpha.
    error_weight : float
        The weight w: 1 fits the real errors, 0 the claimed variances.
    resamples : int
        Bootstrap samples, at least 2.
    seed : int
        Seed of the bootstrap.

    Raises
    ------
    BatteryError
        When the weight is not within [0, 1], or there are too few resamples.
    """
    if not 0.0 <= error_weight <= 1.0:
        raise BatteryError(f"error_weight is {error_weight:g}; it is a share between 0 and 1")
    if resamples < 2:
        raise BatteryError(f"{resamples} resamples give no standard error; take 2 or more, 200 by default")
    search = _Search(behaviour, pack, error_weight)
    theta = search.minimise(search.mean_path().best_of(STARTS))
    drawn = search.resample(theta, resamples, np.random.default_rng(seed))
    spread = drawn.std(axis=0, ddof=1)
    moves = spread > STILL
    correlation = np.eye(3)
    if moves.sum() > 1:
        correlation[np.ix_(moves, moves)] = np.corrcoef(drawn[:, moves].T)
    return FittedUncertainty(
        model=_as_model(theta),
        error_weight=error_weight,
        standard_errors=_as_model(theta * spread),
        log_correlation=correlation,
        fit=assess(behaviour, pack, _as_model(theta)),
        notes=_notes(theta, spread, correlation),
    )


def model_variance(behaviour: Behaviour, pack: Pack, model: UncertaintyModel) -> tuple[Array, Array, Array]:
    """Run [L] eq 9 along what an estimator did, from the variance that it claims at the start.

    Returns
    -------
    tuple of ndarray
        Variance, shape (n, N + 1); gain and variance of the measurement, shape (n, N).
    """
    theta = np.array([model.gamma, model.beta, model.mu])
    path, gain = np.empty(behaviour.soc.shape), np.empty(behaviour.current_A.shape)
    noise = np.empty(behaviour.current_A.shape)
    soc, current_A, start = _own(behaviour)
    _uncertainty_fit.trace(
        _unit_filter(pack), soc, current_A, behaviour.step_s, start, theta, path, gain, noise
    )
    return path, gain, noise


def assess(behaviour: Behaviour, pack: Pack, model: UncertaintyModel) -> Fit:
    """Say how well a model describes an estimator.

    Parameters
    ----------
    behaviour : Behaviour
        What the estimator did; best not what the model was fitted to.
    pack : Pack
        Gives alpha.
    model : UncertaintyModel
        gamma, beta and mu.
    """
    path, gain, noise = model_variance(behaviour, pack, model)
    error, h = behaviour.error, behaviour.step_s
    square, claimed = np.square(error), np.maximum(behaviour.variance, _uncertainty_fit.LEAST_VARIANCE)
    steps = error[:, 1:] - (1.0 - gain) * error[:, :-1]
    said = model.process_variance(behaviour.current_A, h) + np.square(gain) * noise
    minute = min(max(round(MINUTE_S / h), 1), steps.shape[1])
    sums = steps[:, : steps.shape[1] // minute * minute].reshape(steps.shape[0], -1, minute).sum(axis=2)
    lag = _lag(behaviour)
    first, later = error[:, :-lag], error[:, lag:]
    kept = np.concatenate([np.zeros((error.shape[0], 1)), np.cumsum(np.log1p(-gain), axis=1)], axis=1)
    learnt = np.concatenate([np.zeros((error.shape[0], 1)), np.cumsum(gain * path[:, :-1], axis=1)], axis=1)
    follows = np.exp(kept[:, lag:] - kept[:, :-lag]) * np.sqrt(path[:, :-lag] / path[:, lag:])
    believed = behaviour.variance.mean(axis=0), path.mean(axis=0)
    real = _by_minute(square.mean(axis=0), minute), _by_minute(path.mean(axis=0), minute)
    return Fit(
        explained_believed=_explained(*believed),
        explained_real=_explained(*real),
        off_believed=_off(*believed),
        off_real=_off(*real),
        nees_estimator=float(np.mean(square / claimed)),
        nees_model=float(np.mean(square / path)),
        inside_estimator=float(np.mean(square <= 4.0 * claimed)),
        inside_model=float(np.mean(square <= 4.0 * path)),
        step_ratio=_ratio(np.mean(np.square(steps)), np.mean(said)),
        minute_ratio=_ratio(np.mean(np.square(sums)), minute * np.mean(np.square(steps))),
        moved_ratio=_ratio(
            np.mean(np.square(_moves(behaviour, pack))), np.mean(learnt[:, lag:] - learnt[:, :-lag])
        ),
        correlation=_ratio(
            np.sum(first * later), math.sqrt(np.sum(np.square(first)) * np.sum(np.square(later)))
        ),
        correlation_model=float(follows.mean()),
    )


class _Search:
    """The quasi-likelihood of one behaviour, and its minimum."""

    def __init__(self, behaviour: Behaviour, pack: Pack, error_weight: float) -> None:
        self.known = _unit_filter(pack)
        self.soc, self.current_A, self.start = _own(behaviour)
        self.step_s = behaviour.step_s
        level = error_weight * np.square(behaviour.error) + (1.0 - error_weight) * behaviour.variance
        self.level = np.ascontiguousarray(level, dtype=np.float64)
        self.moved = np.square(_moves(behaviour, pack))

    def mean_path(self) -> _Search:
        """The mean over realizations as a single one: where to start, at a small part of the price."""
        twin = copy.copy(self)
        for name in ("soc", "level", "moved"):
            setattr(twin, name, getattr(self, name).mean(axis=0)[None])
        twin.current_A, twin.start = np.abs(self.current_A).mean(axis=0)[None], self.start.mean(keepdims=True)
        return twin

    def best_of(self, starts: Sequence[Sequence[float]]) -> Array:
        """The best minimum from several starts."""
        found = [self.minimise(np.array(start)) for start in starts]
        return min(found, key=lambda theta: float(self.score(theta)[0].sum()))

    def minimise(self, start: Array) -> Array:
        """Gauss-Newton with Levenberg's damping on the logarithms, from a start."""
        theta = np.clip(start, LOWEST, HIGHEST)
        loss, slope, curvature = (part.sum(axis=0) for part in self.score(theta))
        damping = 1e-3
        for _ in range(ITERATIONS):
            move = np.clip(-_solve(curvature, slope, damping), -2.0, 2.0)
            trial = np.clip(theta * np.exp(move), LOWEST, HIGHEST)
            found = tuple(part.sum(axis=0) for part in self.score(trial))
            if found[0] < loss:
                gained, theta = float(loss - found[0]), trial
                loss, slope, curvature = found
                damping = max(damping / 5.0, 1e-9)
                if gained < SETTLED * self.current_A.size:
                    break
            else:
                damping *= 6.0
                if damping > 1e6:
                    break
        return theta

    def resample(self, theta: Array, resamples: int, generator: np.random.Generator) -> Array:
        """Logarithms of theta in bootstrap samples, less their own: a Gauss-Newton step from the minimum."""
        _, slope, curvature = self.score(theta)
        free = (theta > AT_BOUND * LOWEST) & (AT_BOUND * theta < HIGHEST)
        n, moves = slope.shape[0], np.zeros((resamples, 3))
        if not np.any(free):
            return moves
        for b in range(resamples):
            weights = np.bincount(generator.integers(n, size=n), minlength=n).astype(float)
            square = np.tensordot(weights, curvature, axes=1)[np.ix_(free, free)]
            moves[b, free] = -_solve(square, (weights @ slope)[free], 0.0)
        return moves

    def score(self, theta: Array) -> tuple[Array, Array, Array]:
        """Loss of every realization, its slopes and expected curvatures over the logarithms."""
        n = self.current_A.shape[0]
        loss, slope, curvature = np.empty(n), np.empty((n, 3)), np.empty((n, 3, 3))
        _uncertainty_fit.score(
            self.known,
            self.soc,
            self.current_A,
            self.step_s,
            self.level,
            self.moved,
            self.start,
            theta,
            loss,
            slope,
            curvature,
        )
        return loss, slope, curvature


def _solve(curvature: Array, slope: Array, damping: float) -> Array:
    """Solve for a Gauss-Newton step; directions without any curvature stay where they are."""
    ridge = damping * np.diag(curvature) + 1e-12 * np.trace(curvature) + 1e-300
    return np.asarray(np.linalg.solve(curvature + np.diag(ridge), slope))


def _moves(behaviour: Behaviour, pack: Pack) -> Array:
    """What the estimate moves over the lag, beside the charge that passes."""
    lag = _lag(behaviour)
    charge = np.cumsum(behaviour.current_A, axis=1) * (behaviour.step_s / pack.capacity_C)
    beside = behaviour.soc - np.concatenate([np.zeros((charge.shape[0], 1)), charge], axis=1)
    return np.ascontiguousarray(beside[:, lag:] - beside[:, :-lag])


def _lag(behaviour: Behaviour) -> int:
    """Steps between two errors that are compared: five minutes, or half the trip if it is short."""
    return int(min(max(round(APART_S / behaviour.step_s), 1), behaviour.current_A.shape[1] // 2))


def _unit_filter(pack: Pack) -> Filter:
    return tabulate_filter(pack, UncertaintyModel(mu=1.0))


def _own(behaviour: Behaviour) -> tuple[Array, Array, Array]:
    """Estimates, currents and first variances, as the kernels were compiled for them."""
    soc = np.require(behaviour.soc, np.float64, ["C", "W"])
    current_A = np.require(behaviour.current_A, np.float64, ["C", "W"])
    return soc, current_A, np.array(behaviour.variance[:, 0], dtype=np.float64)


def _as_model(theta: Array) -> UncertaintyModel:
    # Five digits are more than any fit is worth, and read well.
    return UncertaintyModel(
        **{name: float(f"{value:.4e}") for name, value in zip(NAMES, theta.tolist(), strict=True)}
    )


def _explained(seen: Array, said: Array) -> float:
    """Share of the changes of a standard deviation that a model explains."""
    root = np.sqrt(seen)
    spread = float(np.sum(np.square(root - root.mean())))
    return 1.0 - float(np.sum(np.square(root - np.sqrt(said)))) / spread if spread > 0.0 else math.nan


def _off(seen: Array, said: Array) -> float:
    """Distance of two standard deviations along a trip, as a share of the first one's mean."""
    root = np.sqrt(seen)
    return _ratio(np.sqrt(np.mean(np.square(root - np.sqrt(said)))), root.mean())


def _by_minute(values: Array, minute: int) -> Array:
    return np.asarray(values[: values.size // minute * minute].reshape(-1, minute).mean(axis=1))


def _ratio(above: np.floating[Any], below: np.floating[Any] | float) -> float:
    return float(above) / float(below) if below > 0.0 else math.nan


def _notes(theta: Array, spread: Array, correlation: Array) -> tuple[str, ...]:
    """Say what the data do not tell."""
    notes = []
    for name, value, low, high, sd in zip(NAMES, theta, LOWEST, HIGHEST, spread, strict=True):
        if value <= AT_BOUND * low:
            notes.append(f"{name} is at its lower bound: the data show nothing of it")
        elif AT_BOUND * value >= high:
            what = "what the estimator learns from the voltage does not show" if name == "mu" else "too large"
            notes.append(f"{name} is at its upper bound: {what}")
        elif sd > VAGUE:
            notes.append(f"{name} is known to a factor of {math.exp(min(sd, 20.0)):.1f} only")
    for i, j in ((0, 1), (0, 2), (1, 2)):
        if abs(correlation[i, j]) > TOGETHER:
            notes.append(
                f"{NAMES[i]} and {NAMES[j]} cannot be told apart (correlation {correlation[i, j]:.2f})"
            )
    return tuple(notes)

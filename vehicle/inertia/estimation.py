"""Estimate mass, inertias and centre of gravity from a log, with one of six methods on one of three models.

``gpc`` is the filter to use: a germ for every parameter, noise carried beside the chaos (`gpc.ekf`). Beside
it, on the same log and from the same prior: ``gpc-report``, the regression filter of [M] Tables 3-4
literally, whose standard deviation means nothing; ``ekf`` and ``ukf``; and recursive least squares in two
forms, which hardly believe the prior: ``rls-force`` (biased by noisy accelerations) and ``rls-acceleration``
(`vehicle.inertia.rls`).

The noise of the outputs is given, or taken from the residuals of a first pass. Errors that do not average
out, the gain of a strut or the bias of an accelerometer, are considered where `SensorErrors` are given: the
estimate is repeated with each of them in turn, and the change added to the covariance.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vehicle.errors import VehicleError
from vehicle.inertia import load_transfer, ride
from vehicle.inertia.consider import disturbed
from vehicle.inertia.defender import DEFENDER, Geometry
from vehicle.inertia.filters import (
    Prior,
    Run,
    noise_of,
    outputs_at,
    prior_of,
    residual_noise,
    run_filter,
)
from vehicle.inertia.log import Log, Model, check_model, check_name
from vehicle.inertia.record import InertiaEstimate
from vehicle.inertia.regression import Regression, propagate
from vehicle.inertia.rls import least_squares
from vehicle.inertia.sensors import SensorErrors
from vehicle.inertia.synthetic import synthetic

__all__ = ["Log", "Method", "Model", "Prior", "estimate", "predict", "prior_of", "synthetic"]

Array = NDArray[np.float64]

Method = Literal["gpc", "gpc-report", "ekf", "ukf", "rls-force", "rls-acceleration"]

UNLEARNT = 0.5
"""A parameter whose standard deviation stays above this share of the prior's is not identified."""

_AX, _AY = "ax (> 0 accelerates)", "ay (> 0 is a left-hand bend)"
_SIGN = {
    "cg_height_m": f"{_AX} and of {_AY}",
    "cg_over_roll_centre_m": _AY,
    "cg_over_pitch_centre_m": _AX,
}
"""Whose sign is wrong, where a height is."""


@dataclass(frozen=True, eq=False)
class _Recipe:
    """How to get from a log to an estimate."""

    model: Model
    method: Method
    geometry: Geometry
    prior: Prior
    noise: Array
    average_s: float | None
    order: int

    @property
    def names(self) -> tuple[str, ...]:
        return ride.NAMES if self.model == "ride" else load_transfer.NAMES

    @property
    def form(self) -> str:
        """Form of the least squares, nothing for a filter."""
        return self.method.removeprefix("rls-") if self.method.startswith("rls-") else ""

    def prepare(self, log: Log) -> Regression:
        if self.model == "ride":
            return ride.prepare(log, self.geometry, self.average_s or 0.0)
        block = load_transfer.AVERAGE_S if self.average_s is None else self.average_s
        return load_transfer.prepare(log, self.geometry, self.model, block)

    def run(self, problem: Regression) -> Run:
        """Estimate the method's own parameters."""
        if not self.form:
            return run_filter(problem, self.prior, self.method, self.noise, self.order)
        module = ride if self.model == "ride" else load_transfer
        centre = np.array([centre for centre, _ in self.prior.values()])
        rows, targets = module.as_rows(problem, self.form)
        mean, covariance = least_squares(rows, targets, module.coefficients_of(centre, self.form))
        return Run(mean, covariance, np.full(1, np.nan))

    def finish(self, problem: Regression, found: Run) -> tuple[Array, Array]:
        """Turn the method's own parameters into those of ``names``."""
        form, lengths = self.form, problem.lengths_m

        def wanted(rows: Array) -> Array:
            if self.model == "ride":
                return ride.from_coefficients(rows, form) if form else rows
            if form:
                return load_transfer.from_coefficients(rows, form, lengths)
            if self.model == "mltm":
                return load_transfer.from_corners(rows, lengths)
            return load_transfer.from_own(rows)

        values, covariance = propagate(wanted, found.mean, found.covariance)
        if self.model != "ride":
            covariance = load_transfer.add_doubt(values, covariance, problem.noise_share)
        return values, covariance

    def shifts(self, log: Log, errors: SensorErrors, final: Array) -> Array:
        """Give the change of the final estimate by each systematic error in turn, shape (k, p)."""
        rows = [final]
        for changed in disturbed(log, errors):
            problem = self.prepare(changed)
            rows.append(self.finish(problem, self.run(problem))[0][-1])
        return np.array(rows[1:]).reshape(-1, final.size) - final


def estimate(
    model: Model,
    log: Log,
    method: Method = "gpc",
    *,
    geometry: Geometry | None = None,
    prior: Prior | None = None,
    noise_sd: ArrayLike | None = None,
    average_s: float | None = None,
    consider: SensorErrors | None = None,
    order: int = 2,
) -> InertiaEstimate:
    """Estimate a vehicle's parameters over a log.

    Parameters
    ----------
    model : {"ride", "ltm", "mltm"}
    log : Log
    method : {"gpc", "gpc-report", "ekf", "ukf", "rls-force", "rls-acceleration"}
    geometry : Geometry, optional
        Default: that of the Defender.
    prior : mapping, optional
        As in `prior_of`; least squares only start from it.
    noise_sd : array_like, shape () or (m,), optional
        Standard deviation of the outputs, as they come out of averaging: (heave, pitch, roll) in m/s^2 and
        rad/s^2, or the four forces in N. Default: the covariance of the residuals of a first pass.
    average_s : float, optional
        Length of the blocks that are averaged; default 0 for ``ride``, 1 s for load transfer.
    consider : SensorErrors, optional
        Gains, biases and misalignment to allow for in the covariance; its noise is not looked at.
    order : int
        Of the expansions.

    Returns
    -------
    InertiaEstimate
        Of `ride.NAMES` or `load_transfer.NAMES`.

    Raises
    ------
    VehicleError
        When a name is unknown, a column is missing, or a filter breaks down.
    """
    check_model(model)
    check_name("method", method, get_args(Method))
    known = geometry or DEFENDER.geometry
    recipe = _Recipe(model, method, known, prior_of(model, prior), np.empty(0), average_s, order)
    problem = recipe.prepare(log)
    if noise_sd is not None:
        recipe = replace(recipe, noise=noise_of(problem, noise_sd))
    elif not recipe.form:
        recipe = replace(recipe, noise=residual_noise(problem, recipe.prior, method, order))
    found = recipe.run(problem)
    values, covariance = recipe.finish(problem, found)
    last = covariance[-1].copy()
    variance = np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0)
    if consider is not None:
        shifts = recipe.shifts(log, consider, values[-1])
        last = last + shifts.T @ shifts
        variance = variance + np.sum(shifts**2, axis=0)
    seen = found.nis[np.isfinite(found.nis)]
    nis = float(np.mean(seen)) / problem.outputs.shape[1] if seen.size else np.nan
    sds = np.sqrt(variance)
    notes = (*problem.notes, *_notes(recipe, values[-1], sds[-1]))
    return InertiaEstimate(method, problem.time_s.copy(), recipe.names, values, sds, last, nis, notes)


def predict(
    model: Model, log: Log, parameters: Mapping[str, float], geometry: Geometry | None = None
) -> Array:
    """Give a model's outputs for parameters of the kernel, sample by sample; shape (n, m).

    Parameters
    ----------
    model : {"ride", "ltm", "mltm"}
    log : Log
    parameters : mapping
        A value for each name of `prior_of`.
    geometry : Geometry, optional
        Default: that of the Defender.

    Raises
    ------
    VehicleError
        When a parameter is missing.
    """
    prior = prior_of(model)
    missing = [name for name in prior if name not in parameters]
    if missing:
        raise VehicleError(f"the model {model!r} needs {', '.join(prior)}; missing: {', '.join(missing)}")
    recipe = _Recipe(model, "gpc", geometry or DEFENDER.geometry, prior, np.empty(0), 0.0, 2)
    return outputs_at(recipe.prepare(log), np.array([parameters[name] for name in prior]))


def _notes(recipe: _Recipe, final: Array, sds: Array) -> tuple[str, ...]:
    """Say what a reader should know of an estimate."""
    notes = [load_transfer.DRAG_NOTE] if recipe.model != "ride" else []
    for name, sd, value in zip(recipe.names, sds, final, strict=True):
        known = recipe.prior.get(name)
        before = known[1] / np.sqrt(3.0) if known else 0.3 * abs(value)
        if name != "drag_kgpm" and not sd <= UNLEARNT * before:
            notes.append(f"{name} is not identified by this log: its standard deviation is {sd:.3g}")
        if name in _SIGN and value < -2.0 * sd:
            notes.append(f"{name} is negative: check the sign of {_SIGN[name]}")
    if recipe.method == "rls-force" and recipe.model == "ride":
        notes.append("biased: noise on the accelerations shrinks mass and inertias, and lifts the height")
    if recipe.method == "gpc-report":
        notes.append("the covariance contracts without regard to noise, and is widened at each step")
    return tuple(notes)

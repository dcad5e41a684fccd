"""Vehicle mass and inertia: one update of the regression filters, and that filter and array code agree."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from benchmarks.battery import require_equal
from benchmarks.timing import Task
from gpc import GpcEkf, _ekf
from vehicle.inertia import _regression, load_transfer, ride
from vehicle.inertia.defender import DEFENDER
from vehicle.inertia.filters import make_filter, prior_of
from vehicle.inertia.regression import Regression
from vehicle.inertia.synthetic import synthetic

Array = NDArray[np.float64]

SAME = 1e-6
"""Largest difference of an estimate between kernel and array code, over the prior's half-range."""


def update_tasks(model: Literal["ride", "mltm"], samples: int, few: int) -> list[Task]:
    """Prepare the compiled filter of 4 (``ride``) or 7 (``mltm``) parameters against `gpc.GpcEkf`.

    Both see the columns of a synthetic rural log at its own rate, 100 Hz, and keep mean, covariance and
    normalised innovation of every sample. The extended and the unscented filter, compiled too, stand beside.

    Parameters
    ----------
    model : {"ride", "mltm"}
    samples : int
        How many the kernels take, over and over the log.
    few : int
        How many the array code takes.

    Raises
    ------
    DisagreementError
        Kernel and array code find different parameters.
    """
    problem, noise = _problem(model)
    half = np.array([half for _, half in prior_of(model).values()])
    ours = _compiled(model, problem, noise, few)()
    theirs = _arrays(model, problem, noise, few)
    what = f"parameters of {model} (over the half-ranges of their priors) by kernel and arrays"
    require_equal(what, ours / half, theirs() / half, SAME)
    count = half.size
    return [
        Task(f"gpc, {count} parameters", _compiled(model, problem, noise, samples), samples),
        Task("ekf", _compiled(model, problem, noise, samples, "ekf"), samples),
        Task("ukf", _unscented(model, problem, noise, samples), samples),
        Task("gpc, NumPy", theirs, few),
    ]


def _problem(model: Literal["ride", "mltm"]) -> tuple[Regression, Array]:
    """Give a model on a synthetic log, sample by sample, and the covariance of its outputs."""
    log, _ = synthetic("rural", seed=0, duration_s=60.0)
    if model == "ride":
        return ride.prepare(log, DEFENDER.geometry), 0.1 * np.eye(3)
    problem = load_transfer.prepare(log, DEFENDER.geometry, model, 0.0)
    return problem, 200.0**2 * np.eye(4)


def _samples(problem: Regression, noise: Array, count: int) -> _regression.Samples:
    rows = np.arange(count) % problem.time_s.size
    inputs, outputs = problem.inputs[rows], problem.outputs[rows]
    return _regression.Samples(problem.kind, inputs, outputs, noise, problem.lengths_m)


def _room(count: int, parameters: int) -> tuple[Array, Array, Array]:
    return np.empty((count, parameters)), np.empty((count, parameters, parameters)), np.empty(count)


def _compiled(
    model: str, problem: Regression, noise: Array, count: int, method: str = "gpc"
) -> Callable[[], Array]:
    samples, prior = _samples(problem, noise, count), prior_of(model)
    reach = _ekf.SHORT_REACH if method == "ekf" else _ekf.REACH
    settings, room = make_filter(prior, method), _room(count, len(prior))

    def run() -> Array:
        known = settings._replace(chaos=settings.chaos.copy(), remainder=settings.remainder.copy())
        _regression.run_chaos(known, reach, samples, *room)
        return room[0]

    return run


def _unscented(model: str, problem: Regression, noise: Array, count: int) -> Callable[[], Array]:
    samples, prior = _samples(problem, noise, count), prior_of(model)
    centre, half = np.array(list(prior.values())).T
    bounds, room = make_filter(prior)[8:10], _room(count, len(prior))

    def run() -> Array:
        start = (centre.copy(), np.diag(half**2 / 3.0))
        _regression.run_unscented(*start, *bounds, 1.0, samples, *room)
        return room[0]

    return run


def _arrays(model: str, problem: Regression, noise: Array, count: int) -> Callable[[], Array]:
    """Run the same filter as array operations over nodes, with the model compiled."""
    samples, known = _samples(problem, noise, count), make_filter(prior_of(model))
    centre, half = np.array(list(prior_of(model).values())).T
    outputs = samples.outputs.shape[1]

    def run() -> Array:
        gpc, belief = GpcEkf.full_germ(centre, half, lower=known.lower, upper=known.upper)
        means = np.empty((count, centre.size))
        for k in range(count):

            def measure(states: Array, k: int = k) -> Array:
                values = np.empty((outputs, states.shape[0]))
                points = np.ascontiguousarray(states.T)
                _regression.evaluate(problem.kind, samples.inputs[k], samples.lengths, points, values)
                return values.T

            belief, _ = gpc.update(belief, samples.outputs[k], noise, measure)
            means[k] = belief.mean
        return means

    return run

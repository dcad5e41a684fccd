"""The filters on a regression: polynomial chaos, extended and unscented Kalman, from one prior.

A parameter is uniform within a half-range of a centre; the Kalman filters start from the mean and variance of
that. Masses, inertias and distances from an axle are kept positive at nodes and sigma points.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpc import _ekf
from gpc.basis import Legendre
from gpc.collocation import collocate, regression
from gpc.compiled import FilterArrays, as_arrays
from gpc.ekf import GpcEkf
from gpc.errors import ChaosError
from gpc.expansion import affine_coefficients
from gpc.index_set import total_order
from gpc.inflation import Inflation
from vehicle.errors import VehicleError
from vehicle.inertia import _kernels as _kernels
from vehicle.inertia import _regression, load_transfer, ride
from vehicle.inertia.log import check_model, check_name
from vehicle.inertia.regression import Regression

Array = NDArray[np.float64]

Prior = Mapping[str, tuple[float, float]]
"""Centre and half-range by name."""

WIDENING = (1 / 2000, 1 / 2000, 1 / 1000, 1 / 2000)
"""c_1 ... c_4 of [M] Tables 3-4."""
ALPHA = 1.0
"""Spread of the unscented filter's points."""
_POSITIVE = ("mass", "pitch_inertia", "roll_inertia", "cg_from")


@dataclass(frozen=True, eq=False)
class Run:
    """Beliefs about a method's own parameters after each of n samples.

    Attributes
    ----------
    mean, covariance : ndarray, shapes (n, p) and (n, p, p)
    nis : ndarray, shape (n,)
        NaN where nothing was weighed.
    """

    mean: Array
    covariance: Array
    nis: Array


def prior_of(model: str, given: Prior | None = None) -> dict[str, tuple[float, float]]:
    """Give centre and half-range of every parameter before anything is measured.

    Parameters
    ----------
    model : {"ride", "ltm", "mltm"}
    given : mapping, optional
        Centre and half-range by name, in place of the default's. For the corner masses of ``mltm``,
        ``mass_kg`` stands for four quarters.

    Raises
    ------
    VehicleError
        When a name is unknown, or a range does not leave the centre positive.
    """
    check_model(model)
    prior = dict(ride.PRIOR if model == "ride" else load_transfer.PRIOR[model])
    for name, (centre, half) in (given or {}).items():
        if not (0.0 < half <= centre < np.inf):
            raise VehicleError(
                f"the prior of {name} is a positive centre and a half-range up to it, got {centre} and {half}"
            )
        if model == "mltm" and name == "mass_kg":
            prior.update(
                dict.fromkeys(load_transfer.CORNER_NAMES[:4], (0.25 * centre, min(0.5 * half, 0.24 * centre)))
            )
            continue
        check_name("parameter", name, tuple(prior))
        prior[name] = (float(centre), float(half))
    return prior


def make_filter(prior: Prior, method: str = "gpc", order: int = 2) -> FilterArrays:
    """Lay a filter out for `vehicle.inertia._regression.run_chaos`, for use outside `run_filter`.

    Raises
    ------
    VehicleError
        When the method has no filter on chaos coefficients, or the order does not fit.
    """
    centre, half = np.array(list(prior.values())).T
    lower, upper = _bounds(prior)
    p = centre.size
    try:
        if method == "gpc":
            return as_arrays(*GpcEkf.full_germ(centre, half, order=order, lower=lower, upper=upper))
        if method == "ekf":
            point = regression((Legendre(),), total_order(1, 0), np.zeros((1, 1)))
            gpc = GpcEkf(point, lower=lower, upper=upper)
            return as_arrays(gpc, gpc.start(centre[np.newaxis], np.diag(half**2 / 3.0)))
        check_name("method", method, ("gpc", "ekf", "gpc-report"))
        families, indices = (Legendre(),) * p, total_order(p, order)
        start = affine_coefficients(families, indices, centre, half, list(range(p)))
        widening = np.resize(WIDENING, p)
        inflation = Inflation("additive", widening, start)
        gpc = GpcEkf.report(collocate(families, indices), inflation=inflation, lower=lower, upper=upper)
        return as_arrays(gpc, gpc.start(start))
    except ChaosError as error:
        raise VehicleError(f"the filter of {p} parameters at order {order}: {error}") from None


def run_filter(
    problem: Regression,
    prior: Prior,
    method: str,
    noise: Array,
    order: int,
) -> Run:
    """Run one of the filters, ``gpc``, ``gpc-report``, ``ekf`` or ``ukf``, over a regression.

    Parameters
    ----------
    problem : Regression
    prior : mapping
        From `prior_of`.
    method : str
    noise : ndarray, shape (m, m)
        Covariance of the outputs' noise.
    order : int
        Of the expansions.

    Raises
    ------
    VehicleError
        When the filter breaks down.
    """
    samples = _regression.Samples(
        problem.kind,
        np.ascontiguousarray(problem.inputs),
        np.ascontiguousarray(problem.outputs),
        np.ascontiguousarray(noise),
        problem.lengths_m,
    )
    n, p = problem.time_s.size, len(prior)
    mean, covariance, nis = np.empty((n, p)), np.empty((n, p, p)), np.empty(n)
    if method == "ukf":
        centre, half = np.array(list(prior.values())).T
        lower, upper = _bounds(prior)
        start = (centre.copy(), np.diag(half**2 / 3.0), lower, upper, ALPHA)
        _regression.run_unscented(*start, samples, mean, covariance, nis)
    else:
        reach = _ekf.SHORT_REACH if method == "ekf" else _ekf.REACH
        _regression.run_chaos(make_filter(prior, method, order), reach, samples, mean, covariance, nis)
    if not (np.all(np.isfinite(mean)) and np.all(np.isfinite(covariance))):
        raise VehicleError(
            f"the filter {method!r} broke down: its covariance lost its definiteness; narrow the prior or"
            " raise noise_sd"
        )
    return Run(mean, covariance, nis)


def noise_of(problem: Regression, noise_sd: ArrayLike) -> Array:
    """Give the covariance of the outputs' noise for standard deviations, shape (m, m).

    Load transfer has a fifth source, the warp of the four forces, see `load_transfer.WARP_SD_N`.

    Raises
    ------
    VehicleError
        When there is not one positive number, or one for each output.
    """
    m = problem.outputs.shape[1]
    sd = np.asarray(noise_sd, dtype=np.float64)
    if sd.shape not in ((), (m,)) or not np.all((sd > 0.0) & (sd < np.inf)):
        raise VehicleError(f"noise_sd is a positive number, or one for each of {m} outputs, got {noise_sd!r}")
    noise: Array = np.diag(np.broadcast_to(sd**2, (m,)))
    if problem.model == "ride":
        return noise
    return noise + load_transfer.WARP_SD_N**2 * np.outer(load_transfer.WARP, load_transfer.WARP)


def residual_noise(problem: Regression, prior: Prior, method: str, order: int) -> Array:
    """Take the covariance of the noise from the residuals of a first pass with a guess, shape (m, m)."""
    guess = ride.NOISE_GUESS if problem.model == "ride" else load_transfer.NOISE_GUESS
    final = run_filter(problem, prior, method, noise_of(problem, guess), order).mean[-1]
    residual = problem.outputs - outputs_at(problem, final)
    residual = residual[np.isfinite(residual).all(axis=1)]
    covariance = residual.T @ residual / residual.shape[0]
    if problem.model == "ride":
        covariance = np.diag(np.diagonal(covariance))
    # A noiseless log must not ask for a division by zero.
    least = 1e-4 * np.nanmax(np.abs(problem.outputs))
    noise: Array = covariance + least**2 * np.eye(residual.shape[1])
    return noise


def outputs_at(problem: Regression, parameters: Array) -> Array:
    """Evaluate a model at one set of parameters for every sample, shape (n, m)."""
    out = np.empty_like(problem.outputs)
    inputs = np.ascontiguousarray(problem.inputs)
    _regression.run_model(problem.kind, inputs, problem.lengths_m, parameters, out)
    return out


def _bounds(prior: Prior) -> tuple[Array, Array]:
    """Keep nodes where a model makes sense: masses, inertias and distances from an axle are positive.

    Nothing else is bounded, since sigma points that are clipped lose covariance.
    """
    lower = [0.05 * centre if name.startswith(_POSITIVE) else -np.inf for name, (centre, _) in prior.items()]
    return np.array(lower), np.full(len(prior), np.inf)

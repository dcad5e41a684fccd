r"""The driven mass-spring system of [M] eq 28: a mass, found from noisy positions or not.

.. math:: \dot x = v, \qquad \dot v = -\frac{k}{m}\,x + \sin t, \qquad \dot m = 0,

with the stiffness k known and z = x + N(0, R) measured; sin t is an acceleration in m/s^2 (ERRATA). The truth
is simulated by the closed form

.. math:: x = (x_0 \cos \omega t + \tfrac{v_0 - p}{\omega} \sin \omega t) + p \sin t, \qquad
          \omega^2 = k / m, \quad p = 1 / (\omega^2 - 1),

the filters step by the classical Runge-Kutta rule. Five of them, over the same log:

- ``unmodified``: the report's filter (eqs 20-23, Table 1), with one germ for the mass. It has no spread in
  position and velocity of their own, so a wrong initial position is blamed on the mass;
- ``report``: the modified filter (eqs 24-26, Table 2 with what ERRATA adds to it): the same germ, initial
  states scattered at the nodes, the mass widened at each step. It finds the mass from far away; the price is
  an estimate that keeps wandering, by some 2 %, and a standard deviation that the widening sets;
- ``full_germ``: a germ for each of position, velocity and mass, and the noise carried beside the chaos
  (`gpc.ekf`). The one to use;
- ``ekf`` and ``ukf``: extended and unscented Kalman filters that start from the mean and variance of the
  same prior.

All take their derivatives within the same bounds on the mass. What tells the last three apart is the wide
prior (15 +- 20 m, 15 +- 20 m/s, 1000 +- 900 kg; the truth is 0, 0, 250). Logs of 100 s that had no part in
choosing a setting say:

- ``ekf``: the mass is more than 5 % off in 56 of 400;
- ``report``: within 2.5 % in 396 of 400, 3.4 % at most;
- ``full_germ``: within 0.1 % in 1600 of 1600. Mean NEES per state 1.03 (three batches: 1.10, 1.03 and 1.00);
  an honest filter lies in 0.96 to 1.04. Without restarts 1.20 in the first batch;
- ``ukf``: within 0.1 % in 1200 of 1200; mean NEES 1.13, a little over-confident.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from gpc import _ekf
from gpc.basis import Legendre
from gpc.belief import ChaosBelief
from gpc.collocation import regression
from gpc.compiled import as_arrays
from gpc.ekf import GpcEkf
from gpc.errors import ChaosError
from gpc.expansion import affine_coefficients
from gpc.index_set import total_order
from gpc.inflation import Inflation, Kind, scatter
from vehicle.errors import VehicleError
from vehicle.inertia import _kernels as _kernels
from vehicle.inertia import _mass_spring
from vehicle.inertia.record import InertiaEstimate

Array = NDArray[np.float64]

Mode = Literal["unmodified", "report", "full_germ", "ekf", "ukf"]

NAMES = ("position_m", "velocity_mps", "mass_kg")

STIFFNESS_NPM = 1000.0
MASS_KG = 250.0
NOISE_SD_M = 0.05
"""What [M] leaves out (ERRATA)."""
DURATION_S = 100.0
"""Our choice; after 40 s the report's filter is still within 2.5 % in few runs only."""
STEP_S = 0.01
OSCILLATION = 0.1
"""Longest step of the Runge-Kutta rule, in radians of the lightest mass: off by 1e-7 of its amplitude."""


@dataclass(frozen=True, eq=False)
class MassSpringLog:
    """Positions of a mass on a spring.

    Parameters
    ----------
    time_s, position_m : ndarray, shape (n,)
        Times, and measured positions; NaN where there is none.
    stiffness_Npm : float
    truth : ndarray, shape (n, 3), optional
        Position, velocity and mass, where they are known.
    """

    time_s: Array
    position_m: Array
    stiffness_Npm: float = STIFFNESS_NPM
    truth: Array | None = None

    def __post_init__(self) -> None:
        shape = self.time_s.shape
        if len(shape) != 1 or shape[0] < 2 or not np.all(np.diff(self.time_s) > 0.0):
            raise VehicleError("a log needs two times or more, increasing")
        if self.position_m.shape != shape:
            raise VehicleError(f"{shape[0]} times need as many positions, got {self.position_m.shape}")
        if not 0.0 < self.stiffness_Npm < np.inf:
            raise VehicleError(f"the stiffness must be positive and finite, got {self.stiffness_Npm}")
        if np.count_nonzero(np.isfinite(self.position_m)) < 2:
            raise VehicleError("a log needs two measured positions or more")

    @property
    def final_truth(self) -> dict[str, float]:
        """True state at the end, by name; empty where it is not known."""
        return {} if self.truth is None else dict(zip(NAMES, self.truth[-1].tolist(), strict=True))


class Settings(BaseModel):
    """What a filter starts from and how it is tuned; masses in kg, positions in m, velocities in m/s.

    A filter without germs for the initial states (``unmodified``, ``report``) starts them at their centres.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    position_m: float = Field(default=15.0, description="centre of the initial position")
    velocity_mps: float = Field(default=15.0, description="centre of the initial velocity")
    mass_kg: float = Field(default=1000.0, gt=0.0, description="centre of the mass, m^1 of [M]")
    position_half_range_m: float = Field(default=20.0, gt=0.0, description="uniform about its centre")
    velocity_half_range_mps: float = Field(default=20.0, gt=0.0, description="uniform about its centre")
    mass_half_range_kg: float = Field(default=900.0, gt=0.0, description="uniform about its centre, m^2")
    noise_variance_m2: float = Field(default=NOISE_SD_M**2, gt=0.0, description="R")
    order: int = Field(default=2, ge=1, le=5, description="total order of the expansions")
    nodes: int = Field(default=4, ge=2, description="Q, of the filters with a germ for the mass only")
    diagonal: float = Field(default=0.0, ge=0.0, description="c of eq 24, on position and velocity")
    widening: float = Field(default=0.0, ge=0.0, description="c_1 of eq 25, on the mass")
    inflation: Kind = Field(default="additive", description="widen by the initial or the current spread")
    scatter: float = Field(default=0.0, ge=0.0, description="N of eq 26, in m and m/s")
    mass_min_kg: float = Field(default=50.0, gt=0.0, description="bound at the nodes")
    mass_max_kg: float = Field(default=2000.0, gt=0.0, description="bound at the nodes")
    restarts_at: float = Field(
        default=0.7, gt=0.0, le=1.0, description="share of variance beside the chaos to restart at; 1: never"
    )
    alpha: float = Field(default=1.0, gt=0.0, le=1.0, description="spread of the unscented filter's points")

    @model_validator(mode="after")
    def _check(self) -> Settings:
        if not self.mass_min_kg < self.mass_kg < self.mass_max_kg:
            raise ValueError(
                f"the mass must lie between its bounds {self.mass_min_kg} and {self.mass_max_kg} kg, got"
                f" {self.mass_kg}"
            )
        return self


TABLE_1: Mapping[str, Any] = {
    "position_m": 0.0,
    "velocity_mps": 0.0,
    "mass_kg": 200.0,
    "mass_half_range_kg": 30.0,
    "nodes": 6,
}
TABLE_2: Mapping[str, Any] = {
    "mass_half_range_kg": 50.0,
    "diagonal": 0.001,
    "widening": 0.01,
    "scatter": 15.0,
    "noise_variance_m2": 0.1,
}
DEFAULTS: Mapping[str, Mapping[str, Any]] = {"unmodified": TABLE_1, "report": TABLE_2}
"""Where a mode starts from something else than the defaults of `Settings`."""

NOTES: Mapping[str, str] = {
    "unmodified": "over-confident: the covariance contracts without regard to noise",
    "report": "the standard deviation of the mass is that of its widening, not what the log tells",
}


def settings_for(mode: Mode, **changes: Any) -> Settings:
    """Give the settings of a mode, with changes by name.

    Raises
    ------
    VehicleError
        When the mode is unknown or a value not allowed.
    """
    _check_mode(mode)
    try:
        return Settings(**{**DEFAULTS.get(mode, {}), **changes})
    except ValueError as error:
        raise VehicleError(f"mass-spring settings: {error}") from None


def simulate(
    *,
    seed: int = 0,
    duration_s: float = DURATION_S,
    step_s: float = STEP_S,
    position_m: float = 0.0,
    velocity_mps: float = 0.0,
    mass_kg: float = MASS_KG,
    stiffness_Npm: float = STIFFNESS_NPM,
    noise_sd_m: float = NOISE_SD_M,
) -> MassSpringLog:
    """Simulate the system exactly, and measure its position with white noise.

    Raises
    ------
    VehicleError
        When a number is out of range, or k / m = 1 1/s^2: the drive is in resonance then.
    """
    numbers = {"duration_s": duration_s, "step_s": step_s, "mass_kg": mass_kg, "stiffness_Npm": stiffness_Npm}
    for name, value in numbers.items():
        if not 0.0 < value < np.inf:
            raise VehicleError(f"{name} must be positive and finite, got {value}")
    if not noise_sd_m >= 0.0:
        raise VehicleError(f"noise_sd_m must be 0 or more, got {noise_sd_m}")
    square = stiffness_Npm / mass_kg
    if abs(square - 1.0) < 1e-6:
        raise VehicleError("the closed form has no k / m = 1 1/s^2, where the drive is in resonance")
    time: Array = step_s * np.arange(round(duration_s / step_s) + 1, dtype=np.float64)
    omega, driven = np.sqrt(square), 1.0 / (square - 1.0)
    sine, cosine, beside = np.sin(omega * time), np.cos(omega * time), (velocity_mps - driven) / omega
    x = position_m * cosine + beside * sine + driven * np.sin(time)
    v = omega * (beside * cosine - position_m * sine) + driven * np.cos(time)
    noise = _generator(seed, 0).standard_normal(time.size)
    truth = np.column_stack([x, v, np.full_like(time, mass_kg)])
    return MassSpringLog(time, np.asarray(x + noise_sd_m * noise, dtype=np.float64), stiffness_Npm, truth)


def estimate(
    log: MassSpringLog, mode: Mode = "full_germ", settings: Settings | None = None, *, seed: int = 0
) -> InertiaEstimate:
    """Estimate position, velocity and mass over a log.

    Parameters
    ----------
    log : MassSpringLog
    mode : {"full_germ", "report", "unmodified", "ekf", "ukf"}
    settings : Settings, optional
        Default: `settings_for` the mode.
    seed : int
        Of the scattered initial states, in the modes of the report.

    Returns
    -------
    InertiaEstimate
        Of `NAMES`; sample 0 is the prior, and the measurement there is not used.

    Raises
    ------
    VehicleError
        When the mode is unknown, or a filter breaks down.
    """
    _check_mode(mode)
    chosen = settings or settings_for(mode)
    n = log.time_s.size
    mean, covariance, nis = np.empty((n, 3)), np.empty((n, 3, 3)), np.empty(n)
    noise, quiet = np.array([[chosen.noise_variance_m2]]), np.zeros((3, 3))
    longest_s = OSCILLATION * np.sqrt(chosen.mass_min_kg / log.stiffness_Npm)
    seen = (log.stiffness_Npm, longest_s, log.time_s, log.position_m)
    if mode == "ukf":
        centre, variance = _prior(chosen)
        lower, upper = _bounds(chosen)
        _mass_spring.run_unscented(
            centre,
            np.diag(variance),
            quiet,
            noise,
            lower,
            upper,
            chosen.alpha,
            *seen,
            mean,
            covariance,
            nis,
        )
    else:
        known = as_arrays(*make_filter(chosen, mode, seed))
        reach = _ekf.SHORT_REACH if mode == "ekf" else _ekf.REACH
        _mass_spring.run_chaos(known, quiet, noise, reach, *seen, mean, covariance, nis)
    if not np.all(np.isfinite(mean)) or not np.all(np.isfinite(covariance)):
        raise VehicleError(
            f"the filter {mode!r} broke down: its covariance lost its definiteness; narrow the prior or raise"
            " noise_variance_m2"
        )
    sds = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))
    notes = (NOTES[mode],) if mode in NOTES else ()
    return InertiaEstimate(
        mode, log.time_s.copy(), NAMES, mean, sds, covariance[-1].copy(), float(np.nanmean(nis)), notes
    )


def make_filter(settings: Settings, mode: Mode, seed: int = 0) -> tuple[GpcEkf, ChaosBelief]:
    """Set up the filter of a mode and what it starts from, for use outside the compiled loop.

    Of mode ``ekf`` it has order 0: everything is in the remainder. There is none of mode ``ukf``.

    Raises
    ------
    VehicleError
        When the mode has no filter on chaos coefficients.
    """
    lower, upper = _bounds(settings)
    centre, variance = _prior(settings)
    if mode == "full_germ":
        half = np.sqrt(3.0 * variance)
        return GpcEkf.full_germ(
            centre, half, order=settings.order, lower=lower, upper=upper, restarts_at=settings.restarts_at
        )
    if mode == "ekf":
        alone = regression((Legendre(),), total_order(1, 0), np.zeros((1, 1)))
        gpc = GpcEkf(alone, lower=lower, upper=upper)
        return gpc, gpc.start(centre[np.newaxis], variance)
    if mode not in DEFAULTS:
        raise VehicleError(f"mode {mode!r} has no filter on chaos coefficients")
    return _report_filter(settings, centre, seed)


def _report_filter(settings: Settings, centre: Array, seed: int) -> tuple[GpcEkf, ChaosBelief]:
    """Set up the filter of [M] eqs 20-26, with a germ for the mass alone."""
    family, indices = (Legendre(),), total_order(1, settings.order)
    nodes = Legendre().gauss(settings.nodes)[0][:, np.newaxis]
    try:
        collocation = regression(family, indices, nodes)
    except ChaosError as error:
        raise VehicleError(f"mass-spring settings: {error}") from None
    spread = [0.0, 0.0, settings.mass_half_range_kg]
    start = affine_coefficients(family, indices, centre, spread, [0, 0, 0])
    inflation = Inflation(settings.inflation, np.array([0.0, 0.0, settings.widening]), start)
    if settings.scatter > 0.0:
        half = np.array([settings.scatter, settings.scatter, 0.0])
        start = scatter(collocation, start, half, _generator(seed, 1))
    diagonal = [settings.diagonal, settings.diagonal, 0.0]
    lower, upper = _bounds(settings)
    gpc = GpcEkf.report(collocation, diagonal=diagonal, inflation=inflation, lower=lower, upper=upper)
    return gpc, gpc.start(start)


def _prior(settings: Settings) -> tuple[Array, Array]:
    """Give mean and variance of each initial state."""
    centre = np.array([settings.position_m, settings.velocity_mps, settings.mass_kg])
    half = np.array(
        [settings.position_half_range_m, settings.velocity_half_range_mps, settings.mass_half_range_kg]
    )
    return centre, half**2 / 3.0


def _bounds(settings: Settings) -> tuple[Array, Array]:
    lower = np.array([-np.inf, -np.inf, settings.mass_min_kg])
    return lower, np.array([np.inf, np.inf, settings.mass_max_kg])


def _generator(seed: int, purpose: int) -> np.random.Generator:
    """Give the generator of the log's noise (purpose 0) or of a filter's scatter (1)."""
    return np.random.default_rng(np.random.SeedSequence(seed).spawn(2)[purpose])


def _check_mode(mode: str) -> None:
    if mode not in get_args(Mode):
        near = difflib.get_close_matches(str(mode), get_args(Mode), n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise VehicleError(f"unknown mode {mode!r}: allowed are {', '.join(get_args(Mode))}{hint}")

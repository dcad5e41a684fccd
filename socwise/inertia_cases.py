"""Logs of the mass-spring system and of vehicles, run through methods: what ``socwise inertia`` does."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from socwise.inertia import InertiaRun

if TYPE_CHECKING:
    from vehicle.inertia.defender import Geometry
    from vehicle.inertia.log import Log
    from vehicle.inertia.mass_spring import MassSpringLog
    from vehicle.inertia.record import InertiaEstimate
    from vehicle.inertia.sensors import SensorErrors

IDENTIFIED = 0.3
"""A prior is only called wrong by an estimate whose standard deviation is below this share of it."""
CORNERS = ("fl", "fr", "rl", "rr")
MASS_SPRING = "mass-spring"
MODES = ("full_germ", "report", "unmodified", "ekf", "ukf")
METHODS = ("gpc", "gpc-report", "rls-force", "rls-acceleration", "ekf", "ukf")
QUICK = ("gpc", "ekf", "rls-force")
"""Where there are several models and drives, not every method of each."""


def run_mass_spring(
    log: MassSpringLog,
    modes: Sequence[str],
    *,
    seed: int | None = None,
    changes: Mapping[str, Any] | None = None,
) -> list[InertiaRun]:
    """Run filters over a log of the mass-spring system.

    Parameters
    ----------
    log : MassSpringLog
        With the truth where it is known.
    modes : sequence of str
        Names of filters, of `MODES`.
    seed : int, optional
        Of the log; also of the filters' scatter.
    changes : mapping, optional
        Settings that every filter starts from, see `vehicle.inertia.mass_spring.Settings`.
    """
    from vehicle.inertia.mass_spring import NAMES, estimate, settings_for

    runs = []
    for mode in modes:
        began = time.perf_counter()
        settings = settings_for(mode, **dict(changes or {}))  # type: ignore[arg-type]
        found = estimate(log, mode, settings, seed=seed or 0)  # type: ignore[arg-type]
        spent = time.perf_counter() - began
        course = {} if log.truth is None else dict(zip(NAMES[:2], log.truth.T[:2], strict=True))
        runs.append(InertiaRun(MASS_SPRING, "", seed, found, log.final_truth, spent, course))
    return runs


def run_vehicle(
    model: str,
    log: Log,
    methods: Sequence[str],
    *,
    scenario: str = "",
    seed: int | None = None,
    truth: Mapping[str, float] | None = None,
    **known: Any,
) -> list[InertiaRun]:
    """Run methods over a vehicle's log.

    Parameters
    ----------
    model : {"ride", "ltm", "mltm"}
    log : Log
    methods : sequence of str
        Of `METHODS`.
    scenario : str
        Of a synthetic log.
    seed : int, optional
        Of a synthetic log.
    truth : mapping of str to float, optional
        Where it is known.
    known
        What `vehicle.inertia.estimation.estimate` takes besides: geometry, prior, consider.
    """
    from vehicle.inertia.estimation import estimate

    runs = []
    for method in methods:
        began = time.perf_counter()
        found = estimate(model, log, method, **known)  # type: ignore[arg-type]
        found = replace(found, notes=(*found.notes, *_surprises(model, found, known.get("prior"))))
        spent = time.perf_counter() - began
        of_it = {name: value for name, value in (truth or {}).items() if name in found.names}
        runs.append(InertiaRun(model, scenario, seed, found, of_it, spent))
    return runs


def run_synthetic(
    models: Sequence[str],
    scenario: str,
    seed: int,
    methods: Sequence[str],
    sensors: SensorErrors,
    *,
    geometry: Geometry | None = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
    noise_sd: float | None = None,
    **options: Any,
) -> list[InertiaRun]:
    """Drive the synthetic vehicle once and run models and methods over the log; see `run_vehicle`.

    Gains, biases and misalignment of the sensors are allowed for in the standard deviations. ``options`` are
    those of `vehicle.inertia.synthetic.synthetic`.
    """
    from vehicle.inertia.synthetic import synthetic

    log, truth = synthetic(scenario, seed=seed, sensors=sensors, **options)
    known = {
        "geometry": geometry,
        "prior": prior,
        "noise_sd": noise_sd,
        "consider": allowed_for(sensors),
    }
    found = []
    for model in models:
        found += run_vehicle(model, log, methods, scenario=scenario, seed=seed, truth=truth, **known)
    return found


def _surprises(
    model: str, found: InertiaEstimate, prior: Mapping[str, tuple[float, float]] | None
) -> list[str]:
    """Say where a filter ended outside of what it was told to believe: it then clings to its prior."""
    from vehicle.inertia.filters import prior_of

    if found.method.startswith("rls"):
        return []
    believed = prior_of(model, prior)
    corners = [believed[f"mass_{corner}_kg"] for corner in CORNERS if f"mass_{corner}_kg" in believed]
    if corners:
        believed["mass_kg"] = (sum(c for c, _ in corners), sum(h for _, h in corners))
    outside = [
        name
        for name, value in found.final.items()
        if name in believed
        and name != "drag_kgpm"
        and abs(value - believed[name][0]) > believed[name][1]
        and found.final_sd[name] < IDENTIFIED * value
    ]
    if not outside:
        return []
    asked = [f"--prior {n}={_rounded(found.final[n])},{_rounded(0.5 * found.final[n])}" for n in outside]
    return [
        f"{', '.join(outside)} ended outside the prior, which pulls back: run again with {' '.join(asked)}"
    ]


def _rounded(value: float) -> str:
    """Two digits, without an exponent, so that methods which agree say the same."""
    return f"{float(f'{value:.2g}'):.10g}"


def allowed_for(sensors: SensorErrors) -> SensorErrors | None:
    """Give the errors that do not average out, if there are any: a filter has to be told of them."""
    lasting = (sensors.strut_gain_sd, sensors.bias_sd_mps2, sensors.misalignment_sd_rad)
    return sensors if any(size > 0.0 for size in lasting) else None

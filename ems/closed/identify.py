"""Identify [L]'s gamma, beta and mu from what an estimator does on a training trip (`bms.uncertainty_fit`).

The training trip is driven by the rules, which need no model of uncertainty, on realizations of their own. By
default it is another trip than the one of the comparison, so that nothing is judged on what it was fitted to.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from bms.uncertainty_fit import NAMES, Behaviour, Fit, FittedUncertainty, fit_uncertainty
from drivecycles import DriveCycle
from ems._rollout import Tracks
from ems.closed.battery import Battery, ClosedLoop, battery_for
from ems.closed.run import run_ensemble
from ems.closed.scatter import TRAINING
from ems.concept import Concept
from ems.errors import EmsError
from ems.policies import build_policy
from ems.problem import build_problem

TRIP, OTHER_TRIP = "wltc-3b+artemis-rural+wltc-3b", "larsson"
"""What is driven to identify, and what where that is the trip of the comparison; the PHEV empties on both."""
REALIZATIONS = 40
ERROR_WEIGHT = 0.5
RULES = "rule_based"


@dataclass(frozen=True, eq=False)
class Identified:
    """The uncertainty of one concept's estimator, identified.

    Parameters
    ----------
    concept : str
        Whose.
    estimator, plant, trip : str
        Which estimator, on which plant and training trip.
    fitted : FittedUncertainty
        gamma, beta, mu, their standard errors, and how well they fit.
    behaviour : Behaviour
        What they were fitted to.
    dropped : mapping of int to str
        Realizations that broke off, and why.
    """

    concept: str
    estimator: str
    plant: str
    trip: str
    fitted: FittedUncertainty
    behaviour: Behaviour
    dropped: dict[int, str]

    def to_json(self) -> dict[str, Any]:
        """JSON-serialisable: values with standard errors, fit, notes, and where they come from."""
        model, errors = self.fitted.model, self.fitted.standard_errors
        return {
            **{name: {"value": getattr(model, name), "se": getattr(errors, name)} for name in NAMES},
            "fit": fit_json(self.fitted.fit),
            "notes": list(self.fitted.notes),
            "error_weight": self.fitted.error_weight,
            "trip": self.trip,
            "realizations": int(self.behaviour.current_A.shape[0]),
            "dropped": [{"realization": n, "reason": why} for n, why in self.dropped.items()],
        }


def training_trip(cycle_name: str) -> str:
    """Choose a training trip that is not the one of the comparison."""
    return OTHER_TRIP if "wltc" in cycle_name.lower() else TRIP


def identify(
    concept: Concept,
    loop: ClosedLoop,
    trip: DriveCycle,
    *,
    realizations: int = REALIZATIONS,
    seed: int = 0,
    error_weight: float = ERROR_WEIGHT,
    jobs: int = 1,
    battery: Battery | None = None,
    progress: Callable[[int], None] | None = None,
) -> Identified:
    """Drive a training trip and fit [L]'s model to the estimator.

    Parameters
    ----------
    concept : Concept
        The car.
    loop : ClosedLoop
        Plant, sensors and estimator.
    trip : DriveCycle
        What is driven, as well as the car can.
    realizations, seed : int
        How many realizations, at least 2, and which.
    error_weight : float
        Weight of the real errors against the claimed variances.
    jobs : int
        Processes.
    battery : Battery, optional
        Cell and pack, where they are known already.
    progress : callable, optional
        Called with the number of realizations that are done.

    Raises
    ------
    EmsError
        When fewer than two realizations are left.
    BatteryError
        When plant or estimator cannot be used as asked.
    """
    if realizations < 2:
        raise EmsError(
            f"{realizations} training realizations show no scatter; give at least 2 (40 by default)"
        )
    battery = battery or battery_for(concept, loop)
    problem = build_problem(concept, trip, on_infeasible="limit", pack=battery.pack)
    ensemble = run_ensemble(
        problem,
        {RULES: build_policy(RULES, problem)},
        loop,
        battery.cell,
        seed=seed,
        realizations=realizations,
        stream=TRAINING,
        jobs=jobs,
        progress=progress,
    )
    behaviour = behaviour_of(ensemble.tracks[RULES], problem.step_s)
    return Identified(
        concept=concept.name,
        estimator=loop.estimator_name,
        plant=loop.plant_name,
        trip=trip.name,
        fitted=fit_uncertainty(behaviour, battery.pack, error_weight=error_weight, seed=seed),
        behaviour=behaviour,
        dropped=dict(ensemble.dropped),
    )


def behaviour_of(tracks: Tracks, step_s: float) -> Behaviour:
    """Take from a rollout what an estimator did.

    Raises
    ------
    EmsError
        When there is one realization only.
    """
    if tracks.soc.shape[0] < 2:
        raise EmsError("one realization is too few to see how an estimator scatters; take more")
    return Behaviour(
        step_s=step_s,
        soc=np.array(tracks.estimate),
        error=tracks.soc - tracks.estimate,
        variance=np.array(tracks.variance),
        current_A=np.array(tracks.current_A),
    )


def fit_json(fit: Fit) -> dict[str, float]:
    """The figures of a fit by name."""
    return {name: float(getattr(fit, name)) for name in Fit.__dataclass_fields__}

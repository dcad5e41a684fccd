"""What the commands of ``socwise traffic`` compute: runs, spreads, estimates and cycles, and their JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivecycles.traffic.detectors import Readings, observe
from drivecycles.traffic.diagrams import Diagram, make_diagram
from drivecycles.traffic.ensemble import CycleEnsemble
from drivecycles.traffic.errors import TrafficError
from drivecycles.traffic.estimation import WALK_PER_M, TrafficEstimate, estimate
from drivecycles.traffic.field import TrafficField
from drivecycles.traffic.lwr import simulate_members
from drivecycles.traffic.sampling import design
from drivecycles.traffic.scenario import Scenario
from drivecycles.traffic.scenario_parts import PER_KM, UNITS
from drivecycles.traffic.uncertainty import Spread, propagate
from gpc.belief import normalised_square
from gpc.consistency import Consistency, consistency

Array = NDArray[np.float64]
Json = dict[str, Any]

FIRST_GUESS = (0.8, 1.2)
"""What parameters are guessed at, in turn, as a share of the scenario's, where the file names no guess."""
CORRELATED = (
    "no Sobol indices: the uncertain parameters are correlated, and what they share belongs to none alone"
)
"""Why a spread has none."""
REFERENCE_RUNS = 16_384
CURVE_RUNS = {
    "mc": (10, 30, 100, 300, 1000),
    "antithetic": (10, 30, 100, 300, 1000),
    "lhs": (16, 32, 96, 304, 1000),
    "sobol": (16, 32, 128, 512, 1024),
    "gpc": (4, 9, 16, 25),
}
"""Model runs at which errors are drawn; of the chaos the powers that a grid in two parameters takes."""


def run_json(scenario: Scenario, field: TrafficField) -> Json:
    """Summarise one run."""
    diagram = scenario.diagram.build()
    return {
        "schema": 1,
        "scenario": scenario.name,
        "model": scenario.run.model,
        "scheme": field.scheme,
        "duration_s": float(field.time_s[-1]),
        "step_s": field.step_s,
        "courant": field.courant,
        "capacity_per_s": diagram.capacity_per_s,
        "demand_per_s": {"mean": float(field.demand_per_s.mean()), "most": float(field.demand_per_s.max())},
        "vehicles": {"start": float(field.vehicles[0]), "end": float(field.vehicles[-1])},
        "refused_veh": field.refused_veh,
        "imbalance_veh": field.imbalance_veh,
        "locations": [
            {
                "position_m": place,
                "speed_mps": {
                    "start": float(speed[0]),
                    "mean": float(speed.mean()),
                    "least": float(speed.min()),
                    "end": float(speed[-1]),
                },
            }
            for place in scenario.locations_m
            for speed in [field.speed_at(place)]
        ],
    }


def spread(scenario: Scenario, method: str, runs: int, seed: int, order: int | None = None) -> Spread:
    """Propagate the scenario's uncertainty to the speed at its locations.

    Raises
    ------
    TrafficError
        When nothing is uncertain, or method and runs do not go together.
    """
    scenario.require_lwr("uncertainty")
    uncertain = scenario.build_uncertain()
    return propagate(
        scenario.build_road(),
        uncertain.diagram,
        uncertain.distributions,
        demand=scenario.build_demand(),
        duration_s=scenario.run.duration_s,
        correlation=uncertain.correlation,
        initial=scenario.initial_per_m,
        scheme=scenario.run.scheme,
        step_s=scenario.run.step_s,
        method=method,
        runs=runs,
        order=order,
        seed=seed,
        position_m=scenario.locations_m,
    )


def spread_json(scenario: Scenario, spreads: Sequence[Spread], seed: int) -> Json:
    """Summarise spreads of one scenario by several methods: at the end, and the largest over time."""
    return {
        "schema": 1,
        "scenario": scenario.name,
        "seed": seed,
        "parameters": list(spreads[0].names),
        "notes": [CORRELATED] if scenario.build_uncertain().correlated else [],
        "results": [
            {
                "method": one.method,
                "runs": one.runs,
                "congested": one.congested,
                "cut": one.cut,
                "locations": [_place_json(scenario, one, place) for place in range(one.position_m.size)],
            }
            for one in spreads
        ],
    }


def _place_json(scenario: Scenario, one: Spread, place: int) -> Json:
    sobol = None
    if one.first_order is not None and one.total is not None:
        sobol = {
            name: {"first": float(one.first_order[at, -1, place]), "total": float(one.total[at, -1, place])}
            for at, name in enumerate(one.names)
        }
    return {
        "position_m": scenario.locations_m[place],
        "mean_mps": float(one.mean[-1, place]),
        "sd_mps": float(one.sd[-1, place]),
        "error_mps": float(one.error[-1, place]),
        "largest_sd_mps": float(one.sd[:, place].max()),
        "largest_error_mps": float(one.error[:, place].max()),
        "quantiles_mps": {
            f"{level:g}": float(value)
            for level, value in zip(one.quantile_levels, one.quantiles[:, -1, place], strict=True)
        },
        "sobol": sobol,
    }


def error_curves(scenario: Scenario, methods: Sequence[str], seed: int) -> dict[str, tuple[Array, Array]]:
    """Errors of the mean speed against model runs: root mean square over time and places.

    Against Sobol' points, 16,384 of them with a seed of their own; of what draws at random, the root mean
    square over eight seeds.

    Returns
    -------
    dict of str to (ndarray, ndarray)
        Runs and errors in km/h, by method.
    """
    reference = _mean(scenario, "sobol", REFERENCE_RUNS, seed + 1_000_003)[1]
    curves = {}
    for method in methods:
        runs, errors = [], []
        for count in CURVE_RUNS[method]:
            seeds = range(seed, seed + (1 if method == "gpc" else 8))
            try:
                found = [_mean(scenario, method, count, each) for each in seeds]
            except TrafficError:
                # Too few for the number of uncertain parameters: the curve begins later.
                continue
            square = np.mean([np.mean((mean - reference) ** 2) for _, mean in found])
            runs.append(found[0][0])
            errors.append(3.6 * float(np.sqrt(square)))
        curves[method] = (np.array(runs, dtype=np.float64), np.array(errors))
    return curves


def _mean(scenario: Scenario, method: str, runs: int, seed: int) -> tuple[int, Array]:
    """Give the number of runs and the mean speed, without all else that a spread holds."""
    if method == "gpc":
        found = spread(scenario, method, runs, seed)
        return found.runs, found.mean
    uncertain = scenario.build_uncertain()
    plan = design(method, runs, len(uncertain.names), np.random.default_rng(seed))
    members = simulate_members(
        scenario.build_road(),
        uncertain.diagrams(uncertain.values(uncertain.germs(plan.share))),
        demand=scenario.build_demand(),
        duration_s=scenario.run.duration_s,
        initial=scenario.initial_per_m,
        scheme=scenario.run.scheme,
        step_s=scenario.run.step_s,
        position_m=scenario.locations_m,
    )
    return plan.share.shape[0], members.speed_mps.mean(axis=-1)


@dataclass(frozen=True, eq=False)
class TrafficEstimateRun:
    """One estimate, and the truth where it is synthetic.

    Parameters
    ----------
    estimate : TrafficEstimate
    readings : Readings
        What it was made from.
    guess : Diagram
        What it started from.
    truth : Diagram or None
        Of a synthetic log.
    field : TrafficField or None
        The true traffic of a synthetic log.
    seed : int
        Of its noise.
    """

    estimate: TrafficEstimate
    readings: Readings
    guess: Diagram
    truth: Diagram | None
    field: TrafficField | None
    seed: int

    @property
    def nees(self) -> float | None:
        """Normalised square of the parameters' error at the end; None without a truth."""
        if self.truth is None:
            return None
        true = self.truth.parameters()
        error = self.estimate.mean[-1] - np.array([true[name] for name in self.estimate.names])
        return normalised_square(error, self.estimate.covariance)


def first_guess(scenario: Scenario) -> Diagram:
    """Give the diagram that an estimate starts from: that of the file, or one that is 20 % off.

    Raises
    ------
    TrafficError
        When the file's guess names something that the diagram has not.
    """
    diagram, given = scenario.diagram.build(), {} if scenario.detectors is None else scenario.detectors.guess
    known = diagram.parameters()
    for name in given:
        if name not in UNITS or UNITS[name][0] not in known:
            allowed = ", ".join(key for key, (field, _) in UNITS.items() if field in known)
            raise TrafficError(f"detectors.guess names {name!r}; known are {allowed}")
    if given:
        values = known | {UNITS[n][0]: UNITS[n][1] * v for n, v in given.items()}
        return _guessed(diagram.kind, values, "detectors.guess")
    unknown = _unknown(scenario, diagram)
    off = {name: known[name] * FIRST_GUESS[at % 2] for at, name in enumerate(unknown)}
    return _guessed(diagram.kind, known | off, "the first guess, 20 % off the scenario's values")


def _guessed(kind: str, values: Mapping[str, float], what: str) -> Diagram:
    try:
        return make_diagram(kind, **values)
    except TrafficError as error:
        keys = {field: (key, unit) for key, (field, unit) in UNITS.items()}
        named = ", ".join(f"{keys[f][0]} = {value / keys[f][1]:g}" for f, value in values.items())
        raise TrafficError(
            f"{what} ({named}) makes no diagram: {error}; give detectors.guess other values"
        ) from None


def _unknown(scenario: Scenario, diagram: Diagram) -> tuple[str, ...]:
    """Parameters to estimate: those that the file guesses at, else the uncertain ones, else all."""
    guessed = () if scenario.detectors is None else tuple(scenario.detectors.guess)
    named = guessed or tuple(scenario.uncertain)
    return tuple(UNITS[name][0] for name in named) or diagram.parameter_names()


def estimate_scenario(
    scenario: Scenario, readings: Readings | None = None, seed: int = 0, field: TrafficField | None = None
) -> TrafficEstimateRun:
    """Estimate from readings, or from synthetic ones of the scenario.

    Parameters
    ----------
    scenario : Scenario
        With detectors, unless readings are given.
    readings : Readings, optional
        The user's log.
    seed : int
        Of synthetic noise.
    field : TrafficField, optional
        The true traffic, if it is at hand.

    Raises
    ------
    TrafficError
        When there is no detector, one stands outside the road, or the readings cannot be used.
    """
    scenario.require_lwr("the estimate")
    guess, diagram, truth = first_guess(scenario), scenario.diagram.build(), None
    if readings is None:
        field, truth = field or scenario.simulate(), diagram
        readings = observe(field, scenario.build_detectors(), np.random.default_rng(seed))
    else:
        field = None
    found = estimate(
        readings,
        scenario.build_road(),
        guess,
        demand=scenario.build_demand(),
        unknown=_unknown(scenario, diagram),
        initial=scenario.initial_per_m,
        walk_per_m=WALK_PER_M if scenario.detectors is None else PER_KM * scenario.detectors.walk_per_km,
    )
    return TrafficEstimateRun(found, readings, guess, truth, field, seed)


def estimate_json(scenario: Scenario, runs: Sequence[TrafficEstimateRun], source: str | None) -> Json:
    """Summarise estimates that differ in their seed alone; what is not known is None."""
    innovations = _innovations(runs)
    squares = [run.nees for run in runs]
    judged = None
    if all(square is not None for square in squares):
        judged = consistency([s for s in squares if s is not None], len(runs[0].estimate.names))
    return {
        "schema": 1,
        "scenario": scenario.name,
        "source": source,
        "estimates": [_estimate_json(run) for run in runs],
        "nis": {**vars(innovations), "verdict": innovations.verdict},
        "notes": _doubts(innovations),
        "nees": None if judged is None else {**vars(judged), "verdict": judged.verdict},
    }


def _innovations(runs: Sequence[TrafficEstimateRun]) -> Consistency:
    """Judge all innovations of all runs together: the sum of the squares over the number of readings."""
    squares = sum(float(np.nansum(run.estimate.nis)) for run in runs)
    return consistency([squares], sum(int(run.estimate.read.sum()) for run in runs))


def _doubts(innovations: Consistency) -> list[str]:
    # A filter is told to doubt its model, so that innovations smaller than claimed are no surprise.
    if innovations.verdict != "over-confident":
        return []
    return [
        f"NIS {innovations.mean:.3g}, an honest filter's lies in {innovations.low:.2f} to"
        f" {innovations.high:.2f}: the readings are farther from the forecasts than the filter claims, and so"
        " may the truth be from the estimate; start from another detectors.guess, raise"
        " detectors.walk_per_km, or check demand, bottlenecks, diagram and detectors.noise_kmh"
    ]


def _estimate_json(run: TrafficEstimateRun) -> Json:
    one, guess = run.estimate, run.guess.parameters()
    truth: Mapping[str, float] = {} if run.truth is None else run.truth.parameters()
    speed_rmse = None
    if run.field is not None:
        true = run.field.at(one.time_s)
        late = one.time_s.size // 2
        speed_rmse = float(np.sqrt(np.mean((one.speed_mps - true)[late:] ** 2)))
    return {
        "seed": run.seed,
        "readings": int(one.read.sum()),
        "parameters": {
            name: {
                "guess": guess[name],
                "value": float(one.mean[-1, at]),
                "sd": float(one.sd[-1, at]),
                "truth": truth.get(name),
                "error": None if name not in truth else float(one.mean[-1, at] / truth[name] - 1.0),
            }
            for at, name in enumerate(one.names)
        },
        "nis": float(np.nansum(one.nis) / max(int(one.read.sum()), 1)),
        "nees": run.nees,
        "speed_rmse_mps": speed_rmse,
        "speed_sd_mps": float(np.sqrt(np.mean(one.speed_sd_mps[one.time_s.size // 2 :] ** 2))),
    }


def cycles_json(scenario: Scenario, ensemble: CycleEnsemble, seed: int) -> Json:
    """Summarise an ensemble of cycles."""

    def described(cycle: Any) -> Json:
        numbers = cycle.statistics()
        return {
            "name": cycle.name,
            "duration_s": numbers.duration_s,
            "distance_km": numbers.distance_m / 1e3,
            "mean_speed_mps": numbers.mean_speed_mps,
            "max_acceleration_mps2": numbers.max_acceleration_mps2,
            "min_acceleration_mps2": numbers.min_acceleration_mps2,
            "stops": numbers.stops,
        }

    return {
        "schema": 1,
        "scenario": scenario.name,
        "seed": seed,
        "plan": scenario.ensemble.plan,
        "planned": described(ensemble.planned),
        "members": [
            {**described(cycle), "parameters": dict(zip(ensemble.names, row, strict=True))}
            for cycle, row in zip(ensemble.members, ensemble.values.tolist(), strict=True)
        ],
    }

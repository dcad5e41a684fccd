"""From a study to the cases that have to be computed: values resolved, files read, keys taken.

The key of a case is a SHA-256 over everything that decides its result: the car with all values in place,
content of vehicle, pack, cycle or traffic scenario, policies, seed, realizations, grids, what becomes of an
infeasible step, the closed loop with the bytes of its FMU, the versions of socwise, numpy, scipy, numba and
llvmlite, and the source of the packages that compute. Not in it: paths, the study's name, other cases, the
number of workers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from bms.errors import BatteryError
from ems import Concept
from ems.closed import ClosedLoop, FmuSource, Training
from ems.closed.identify import training_trip
from ems.errors import EmsError
from ems.grid import GridSettings
from socwise.study.car import StudyConcept, car_of
from socwise.study.design import Point, points
from socwise.study.digest import code_digest, digest, file_digest, numeric_versions
from socwise.study.errors import StudyError
from socwise.study.layout import SCHEMA
from socwise.study.loading import LoadedStudy
from socwise.study.names import (
    CIRCUIT,
    MODEL,
    find_cell,
    find_concept,
    find_cycle,
    find_scenario,
    is_traffic,
)
from socwise.study.schema import Loop
from socwise.study.task import PlannedCase, absolute

KEY_DIGITS = 24
MOST_PROBLEMS = 20
PER_MEMBER = 2


@dataclass(frozen=True)
class Plan:
    """Everything that a study computes.

    Parameters
    ----------
    loaded : LoadedStudy
        The study and its text.
    cases : tuple of PlannedCase
        In the order of the study.
    trips : mapping
        Cycles and traffic scenarios by their digest.
    """

    loaded: LoadedStudy
    cases: tuple[PlannedCase, ...]
    trips: Mapping[str, Any]


def make_plan(loaded: LoadedStudy) -> Plan:
    """Resolve every case of a study.

    Parameters
    ----------
    loaded : LoadedStudy
        From `socwise.study.loading.load_study`.

    Raises
    ------
    StudyError
        When values do not go together; all cases that are wrong are named, the first twenty in full.
    """
    builder = _Builder(loaded)
    cases, problems = [], []
    laid_out = points(loaded.study)
    for point in laid_out:
        try:
            cases.append(builder.case(point))
        except (EmsError, BatteryError) as error:
            lines = error.problems if isinstance(error, StudyError) else (str(error),)
            said = ", ".join(f"{name} = {value}" for name, value in point.items())
            problems += [f"{said}: {line}" for line in lines]
    if problems:
        more = len(problems) - MOST_PROBLEMS
        shown = problems[:MOST_PROBLEMS] + ([f"and {more} more"] if more > 0 else [])
        raise StudyError(
            f"the study {loaded.study.name!r} cannot be run, cases of its {len(laid_out)} make no sense:",
            shown,
        )
    return Plan(loaded, tuple(cases), builder.trips)


class _Builder:
    """Makes cases; everything that is read from files is read once."""

    def __init__(self, loaded: LoadedStudy) -> None:
        self.study, self.folder = loaded.study, loaded.folder
        self.trips: dict[str, Any] = {}
        self._concepts: dict[str, Concept] = {}
        self._trip_keys: dict[str, str] = {}
        self._content: dict[str, str] = {}

    def case(self, point: Point) -> PlannedCase:
        study = self.study
        name = str(point["concept"])
        concept = self._concepts.setdefault(name, find_concept(name, self.folder))
        car, trip = car_of(concept, point), self._trip(str(point["cycle"]))
        loop, training = self._closed(point, str(point["cycle"]), car)
        case = PlannedCase(
            key="",
            factors=point,
            concept=car,
            trip=trip,
            policies=tuple(study.policies),
            seed=int(point.get("seed", study.seed)),
            realizations=study.realizations,
            settings=self._settings(point),
            on_infeasible=study.on_infeasible,
            loop=loop,
            training=training,
            given_mu="mu" in point,
            trajectories=study.keep_trajectories,
        )
        return replace(case, key=self._key(case)[:KEY_DIGITS])

    def _trip(self, name: str) -> str:
        if name not in self._trip_keys:
            trip: Any
            if is_traffic(name):
                count = self.study.realizations
                if count % PER_MEMBER or count < 2 * PER_MEMBER:
                    raise StudyError(
                        "",
                        [
                            f"realizations = {count}: each cycle of an ensemble is driven by a pair of"
                            " them; give an even number, 4 or more"
                        ],
                    )
                trip = find_scenario(name, self.folder)
            else:
                trip = find_cycle(name, self.folder)
            key = digest(trip)
            self.trips[key], self._trip_keys[name] = trip, key
        return self._trip_keys[name]

    def _settings(self, point: Point) -> GridSettings:
        given = {
            name.removeprefix("grid."): value for name, value in point.items() if name.startswith("grid.")
        }
        data: dict[str, Any] = self.study.grid.model_dump()
        for name, value in given.items():
            data[name] = int(value) if isinstance(data[name], int) and value == int(value) else value
        try:
            return GridSettings.model_validate(data)
        except ValidationError as error:
            lines = [f"grid.{item['loc'][0]} = {item['input']}: {item['msg']}" for item in error.errors()]
            raise StudyError("", lines) from error

    def _closed(
        self, point: Point, cycle: str, car: StudyConcept
    ) -> tuple[ClosedLoop | None, Training | None]:
        plant, estimator = plant_and_estimator(point)
        if plant == MODEL:
            return None, None
        if is_traffic(cycle):
            raise StudyError("", [f"plant = {plant}: an ensemble of traffic takes the plant {MODEL!r}"])
        for name in ("gamma", "beta"):
            if name in point:
                raise StudyError("", [f"{name} = {point[name]}: a closed loop identifies it; leave it out"])
        given = self.study.closed_loop
        loop = _loop(plant, estimator, given, self.folder)
        from ems.closed import battery_for

        battery = battery_for(car, loop)
        loop.make_estimator(battery.cell, car.initial_soc, car.initial_soc_sd)
        trip = find_cycle(given.training or training_trip(cycle), self.folder)
        return loop, Training(trip=trip, realizations=given.training_realizations)

    def _key(self, case: PlannedCase) -> str:
        loop = case.loop
        return digest(
            {
                "schema": SCHEMA,
                "versions": numeric_versions(),
                "code": code_digest(),
                "concept": _without_paths(case.concept),
                "vehicle": self._vehicle(case.concept),
                "pack": case.concept.load_pack(),
                "trip": case.trip,
                "policies": list(case.policies),
                "seed": case.seed,
                "realizations": case.realizations,
                "grid": case.settings,
                "on_infeasible": case.on_infeasible,
                "loop": None if loop is None else {**_loop_content(loop), "given_mu": case.given_mu},
                "training": case.training,
                "trajectories": case.trajectories,
            }
        )

    def _vehicle(self, car: StudyConcept) -> str:
        where = f"{car._folder}\0{car.vehicle}\0{car.mass_kg}\0{car.mass_sd_kg}"
        if where not in self._content:
            self._content[where] = digest(car.load_vehicle())
        return self._content[where]


def plant_and_estimator(point: Mapping[str, Any]) -> tuple[str, str]:
    """Fill in the one of plant and estimator that was left out.

    Raises
    ------
    StudyError
        If the two do not go together.
    """
    believes = point.get("estimator")
    plant = point.get("plant") or (MODEL if believes in (None, MODEL) else CIRCUIT)
    believes = believes or (MODEL if plant == MODEL else "ekf")
    if (plant == MODEL) != (believes == MODEL):
        raise StudyError(
            "",
            [
                f"plant {plant!r} and estimator {believes!r} do not go together: the plant {MODEL!r}"
                f" reports a noisy SOC, which the estimator {MODEL!r} takes; every other plant measures a"
                " voltage, which every other estimator takes. Pair them in a [[together]] table"
            ],
        )
    return str(plant), str(believes)


def _loop(plant: str, estimator: str, given: Loop, folder: Path) -> ClosedLoop:
    source: Any = CIRCUIT
    if plant != CIRCUIT:
        if given.mapping is None:
            raise StudyError("", [f"plant = {plant}: an FMU needs closed_loop.mapping"])
        source = FmuSource(absolute(folder, plant), absolute(folder, given.mapping), given.isolate)
    return ClosedLoop(
        plant=source,
        estimator=estimator,
        options=given.options.get(estimator, {}),
        cell=None if given.cell is None else find_cell(given.cell, folder),
        scatter=given.scatter,
        sensors=given.sensors,
    )


def _loop_content(loop: ClosedLoop) -> dict[str, Any]:
    plant: Any = loop.plant
    if isinstance(plant, FmuSource):
        from importlib import metadata

        plant = {
            "fmu": file_digest(plant.path),
            "mapping": file_digest(plant.mapping),
            "isolate": plant.isolate,
            "fmpy": metadata.version("fmpy"),
        }
    return {
        "plant": plant,
        "estimator": loop.estimator,
        "options": dict(loop.options),
        "cell": loop.cell,
        "scatter": loop.scatter,
        "sensors": loop.sensors,
        "ambient_C": loop.ambient_C,
    }


def _without_paths(car: StudyConcept) -> dict[str, Any]:
    """The concept without the names of its files, whose content counts."""
    return {name: value for name, value in car.model_dump().items() if name not in ("vehicle", "pack")}


def missing(plan: Plan, done: Sequence[str]) -> list[PlannedCase]:
    """Return the cases that are still to be computed, each key once, in the order of the study."""
    found: dict[str, PlannedCase] = {}
    for case in plan.cases:
        if case.key not in done:
            found.setdefault(case.key, case)
    return list(found.values())

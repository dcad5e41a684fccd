"""Check that every rival finds the same values, time all of them, print one table."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

from rich.console import Console

from benchmarks.accuracy import accuracy_table
from benchmarks.battery import (
    filter_tasks,
    gradient_tasks,
    member_tasks,
    other_estimator_tasks,
    simulation_tasks,
)
from benchmarks.battery_log import phev_log
from benchmarks.cases import Case, certain_case, hev_problem, stochastic_case
from benchmarks.driving import rollout_tasks, table_tasks
from benchmarks.errors import UnavailableError
from benchmarks.fmu import fmu_tasks
from benchmarks.inertia import update_tasks
from benchmarks.rivals import CERTAIN, STOCHASTIC, Rival
from benchmarks.scaling import scaling_table
from benchmarks.table import Section, build_table
from benchmarks.timing import Task, interleave
from benchmarks.traffic import road_tasks
from ems import GridSettings, Problem

STEPS = 300
FULL_STEPS = 2134
FMU_STEPS = 2134
ROUNDS = 5
REALIZATIONS = 50
SLOW_SAMPLES, DAY, HOUR, MEMBERS = 2000, 86_400, 3600, 1000
UPDATES, SLOW_UPDATES = 20_000, 1000
ROADS, ROAD_STEPS = 1000, 300
SETTINGS = GridSettings(soc_step=0.0025, variance_rows=15, torque_levels=39)
WIDTH = 120


def solver_section(
    name: str, make: Callable[[Problem], Case], rivals: Sequence[Rival], console: Console
) -> Section:
    """Check the rivals on the start of the cycle, then time them and the kernel on half of it."""
    short, full = make(hev_problem(STEPS, SETTINGS)), make(hev_problem(FULL_STEPS, SETTINGS))
    rows, nodes = full.penalty_kg.shape
    steps, controls = full.stages.power_W.shape
    ours = short.solve()
    tasks = [Task("socwise", full.solve, full.evaluations)]
    for rival in rivals:
        try:
            found = rival.require_agreement(short, ours)
        except UnavailableError as reason:
            console.print(f"{name}, {rival.name}: left out, {reason}")
            continue
        console.print(f"{name}, {rival.name}: values differ by {found:.1e}, allowed {rival.tolerance:.0e}")
        tasks.append(rival.task(full))
    title = f"{name}, {nodes} x {rows} x 2 states"
    return Section(
        title, f"state x control x step ({controls} controls, {steps} steps)", interleave(tasks, ROUNDS)
    )


def driving_sections(problem: Problem) -> list[Section]:
    """Time rollouts and tables."""
    paired, others = rollout_tasks(problem, REALIZATIONS)
    controls, known = table_tasks(problem)
    step = "realization x step"
    return [
        Section(f"{REALIZATIONS} rollouts, stochastic policy", step, interleave(paired, ROUNDS)),
        Section(f"{REALIZATIONS} rollouts, other policies", step, interleave(others, ROUNDS), compared=False),
        Section(
            "All controls on the whole cycle", "step x control", interleave(controls, ROUNDS), compared=False
        ),
        Section("Expected measurement variance", "SOC x variance", interleave(known, ROUNDS), compared=False),
    ]


def battery_sections() -> list[Section]:
    """Time cells and estimators on ten days at 1 s."""
    log = phev_log()
    paired, others = simulation_tasks(log, SLOW_SAMPLES)
    cells, estimators = member_tasks(log.first(HOUR), MEMBERS)
    hour = f"{MEMBERS:,} in one call, an hour each"
    compared = [
        ("Cell simulation, lfp-2ah", "step", paired),
        (f"Cells, {hour}", "cell x step", cells),
        ("Report's estimator", "sample", gradient_tasks(log, SLOW_SAMPLES)),
        ("Extended Kalman filter, 2 states", "sample", filter_tasks(log, SLOW_SAMPLES, joint=False)),
        ("Extended Kalman filter, 5 states", "sample", filter_tasks(log, SLOW_SAMPLES, joint=True)),
        (f"gpc_gradient, {hour}", "estimator x sample", estimators),
    ]
    alone = [
        ("Cell simulation, further", "step", others),
        ("Estimators, further", "sample", other_estimator_tasks(log, DAY)),
    ]
    return [
        *(Section(title, unit, interleave(tasks, ROUNDS)) for title, unit, tasks in compared),
        *(Section(title, unit, interleave(tasks, ROUNDS), compared=False) for title, unit, tasks in alone),
    ]


def inertia_sections() -> list[Section]:
    """Time one update of the filters that estimate a vehicle's mass and inertia."""
    ride, corners = (update_tasks(model, UPDATES, SLOW_UPDATES) for model in ("ride", "mltm"))
    return [
        Section(
            "Ride regression, 4 parameters", "update (100 Hz allow 10,000,000)", interleave(ride, ROUNDS)
        ),
        Section(
            "Load transfer, 7 parameters", "update (100 Hz allow 10,000,000)", interleave(corners, ROUNDS)
        ),
    ]


def traffic_sections() -> list[Section]:
    """Time 1,000 roads of 50 cells over 300 s in one call."""
    tasks = road_tasks(ROADS, ROAD_STEPS)
    title = f"{ROADS:,} roads of 50 cells, {ROAD_STEPS} steps, in one call"
    return [Section(title, "road x cell x step (100 ms allow 6.7)", interleave(tasks, ROUNDS))]


def fmu_sections() -> list[Section]:
    """Time the test suite's battery as an FMU."""
    with fmu_tasks(FMU_STEPS, REALIZATIONS) as (two, three, further, restarts):
        return [
            Section("FMU 2.0, co-simulation", "step", interleave(two, ROUNDS)),
            Section("FMU 3.0, co-simulation", "step", interleave(three, ROUNDS)),
            Section("FMU 2.0, further", "step", interleave(further, ROUNDS), compared=False),
            Section("FMU 2.0, a fresh worker", "start", interleave(restarts, ROUNDS), compared=False),
        ]


def everything(console: Console) -> None:
    """Time everything, and print one table."""
    sections = [
        solver_section("Stochastic solve", stochastic_case, STOCHASTIC, console),
        solver_section("Certainty-equivalent solve", certain_case, CERTAIN, console),
        *driving_sections(hev_problem(STEPS, SETTINGS)),
        *battery_sections(),
        *inertia_sections(),
        *traffic_sections(),
        *fmu_sections(),
    ]
    console.print(build_table(sections, ROUNDS))


def solvers(console: Console) -> None:
    """Time the two solves alone."""
    sections = [
        solver_section("Stochastic solve", stochastic_case, STOCHASTIC, console),
        solver_section("Certainty-equivalent solve", certain_case, CERTAIN, console),
    ]
    console.print(build_table(sections, ROUNDS))


def scaling(console: Console) -> None:
    """Time the stochastic solve over the size of everything it depends on."""
    console.print(scaling_table())


def accuracy(console: Console) -> None:
    """Judge grids by the error of their value."""
    console.print(accuracy_table())


COMMANDS = {"all": everything, "solve": solvers, "scaling": scaling, "accuracy": accuracy}


def main(arguments: Sequence[str]) -> int:
    """Run what is asked for: all (or nothing said), solve, scaling, accuracy."""
    name = arguments[0] if arguments else "all"
    if len(arguments) > 1 or name not in COMMANDS:
        print(f"python -m benchmarks [{'|'.join(COMMANDS)}]; {' '.join(arguments)!r} is not", file=sys.stderr)
        return 2
    console = Console()
    console.width = max(console.width, WIDTH)
    COMMANDS[name](console)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

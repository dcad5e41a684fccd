"""``socwise solve``: one problem, one policy, one file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from socwise.commands.errors import CommandError
from socwise.commands.files import check_file, staged_file
from socwise.commands.options import (
    CycleOption,
    JsonOption,
    OnInfeasibleOption,
    one_concept,
    variances,
)
from socwise.commands.screen import new_table, progress, show, show_json

if TYPE_CHECKING:
    from ems import Concept, GridSettings, Problem
    from ems.accuracy import GridChoice
    from ems.policies import CostToGoPolicy


def solve(
    concept: Annotated[
        str, typer.Option(metavar="NAME", help="hev, phev, or the path of a .toml file.")
    ] = "hev",
    cycle: CycleOption = "larsson",
    mu: Annotated[
        str | None,
        typer.Option(
            metavar="V", help="Variance of the measured SOC.", show_default="what the concept's file says"
        ),
    ] = None,
    policy: Annotated[str, typer.Option(metavar="NAME", help="Which policy to compute.")] = "stochastic",
    out: Annotated[Path, typer.Option(metavar="FILE", help="Policy file to write, NetCDF: .nc.")] = Path(
        "results/policy.nc"
    ),
    accuracy: Annotated[
        float | None,
        typer.Option(
            metavar="SHARE",
            help="Choose the grid so that the value is right to this share, such as 0.003.",
            show_default="the default grid",
        ),
    ] = None,
    on_infeasible: OnInfeasibleOption = "error",
    as_json: JsonOption = False,
) -> None:
    """Compute one policy on one cycle and write it to a file that others can act with.

    Exit code 1 if the accuracy asked for was not reached; the finest grid's policy is written then.
    """
    from drivecycles import load_cycle
    from ems import build_problem
    from ems.policies import CostToGoPolicy, find_policy

    module = find_policy(policy)
    car = one_concept(concept)
    trip = load_cycle(cycle)
    variance = _one_variance(mu, car)
    _check_out(out)

    def problem(settings: GridSettings | None = None) -> Problem:
        return build_problem(car, trip, settings=settings, on_infeasible=on_infeasible).with_mu(variance)

    choice = None
    if accuracy is None:
        given = problem()
        with progress(f"solving {car.name}, {module.NAME}{_memory(given, module.NAME)}"):
            solved = module.build(given)
    else:
        from ems.accuracy import choose_grid

        with progress(f"choosing a grid for {car.name}, {module.NAME}") as advance:
            choice = choose_grid(problem, module.NAME, accuracy, advance)
            solved = choice.policy
    if not isinstance(solved, CostToGoPolicy):
        raise CommandError(
            f"the policy {module.NAME!r} has nothing to solve: it follows thresholds in the concept's file; "
            "choose stochastic, certainty_equivalent or perfect_information"
        )
    from socwise.commands.policy_file import write_policy

    with staged_file(out) as path:
        write_policy(solved, path)
    summary = _summary(solved, cycle_name=trip.name, out=out)
    if choice is not None:
        summary["accuracy"] = _accuracy(choice)
    if as_json:
        show_json(summary)
    else:
        _show(summary)
    if choice is not None and not choice.reached:
        raise typer.Exit(1)


def _memory(problem: Problem, policy: str) -> str:
    """Say what solving and writing will take; refuse what would not fit."""
    from ems.accuracy import DIMENSIONS
    from ems.footprint import footprint, require_room

    if policy not in DIMENSIONS:
        return ""
    size = footprint(problem, policy)
    require_room(size)
    return f" ({size.file_bytes / 1e6:,.0f} MB of memory)"


def _one_variance(mu: str | None, concept: Concept) -> float:
    if mu is None:
        return concept.uncertainty.mu
    values = variances(mu)
    if len(values) > 1:
        raise CommandError(f"--mu is {mu!r}; this command takes one value, such as 0.002")
    return values[0]


def _check_out(out: Path) -> None:
    check_file(out, ".nc")
    if out.exists():
        from socwise.commands.policy_file import is_policy

        if not is_policy(out):
            raise CommandError(f"{out} exists and is no policy file of socwise; choose another --out")


def _summary(policy: CostToGoPolicy, *, cycle_name: str, out: Path) -> dict[str, Any]:
    from ems.footprint import footprint
    from ems.memory import solve_bytes

    problem = policy.problem
    stages, engine_states, rows, nodes = policy.solution.shape
    return {
        "schema": 1,
        "concept": problem.concept.name,
        "cycle": {
            "name": cycle_name,
            "duration_s": problem.cycle.duration_s,
            "distance_km": problem.demand.distance_m / 1e3,
        },
        "mu": problem.uncertainty.mu,
        "policy": policy.name,
        "value_kg": policy.value_kg,
        "grid": {
            "stages": stages,
            "engine_states": engine_states,
            "variance_rows": rows,
            "soc_nodes": nodes,
            "controls": problem.stages.power_W.shape[1],
        },
        "memory_MB": solve_bytes(stages - 1, rows, nodes) / 1e6,
        "expected_peak_memory_MB": footprint(problem, policy.name).file_bytes / 1e6,
        "solve_s": policy.solve_s,
        "file": str(out),
    }


def _accuracy(choice: GridChoice) -> dict[str, Any]:
    return {
        "asked": choice.asked,
        "estimated_error": choice.estimated_error,
        "reached": choice.reached,
        "parts": choice.parts,
        "settings": choice.settings.model_dump(),
        "solves": choice.solves,
    }


def _show(summary: dict[str, Any]) -> None:
    cycle, grid = summary["cycle"], summary["grid"]
    table = new_table("policy", summary["policy"], left=2)
    table.add_row("concept", summary["concept"])
    table.add_row("cycle", f"{cycle['name']}, {cycle['distance_km']:.1f} km in {cycle['duration_s']:.0f} s")
    table.add_row("mu", f"{summary['mu']:g}")
    table.add_row("expected cost", f"{summary['value_kg']:.4f} kg of fuel and penalties")
    table.add_row(
        "grid",
        f"{grid['stages']} stages × {grid['engine_states']} engine states "
        f"× {grid['variance_rows']} variances × {grid['soc_nodes']} SOC, {grid['controls']} controls",
    )
    table.add_row(
        "memory",
        f"{summary['memory_MB']:.0f} MB for the cost-to-go, "
        f"{summary['expected_peak_memory_MB']:.0f} MB with all else and the file",
    )
    table.add_row("solved in", f"{summary['solve_s']:.1f} s")
    if "accuracy" in summary:
        found = summary["accuracy"]
        parts = ", ".join(f"{name} {share:.2%}" for name, share in found["parts"].items())
        word = "reached" if found["reached"] else "NOT reached, this is the finest grid tried"
        table.add_row("asked for", f"{found['asked']:.2%} of the value: {word}")
        table.add_row("estimated error", f"{found['estimated_error']:.2%} ({parts})")
        table.add_row("grids tried", str(found["solves"]))
    show(table, "", f"The policy is in {summary['file']}")

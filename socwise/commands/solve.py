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
    from ems import Concept
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
    on_infeasible: OnInfeasibleOption = "error",
    as_json: JsonOption = False,
) -> None:
    """Compute one policy on one cycle and write it to a file that others can act with."""
    from drivecycles import load_cycle
    from ems import build_problem
    from ems.policies import CostToGoPolicy, find_policy

    module = find_policy(policy)
    car = one_concept(concept)
    trip = load_cycle(cycle)
    variance = _one_variance(mu, car)
    _check_out(out)
    problem = build_problem(car, trip, on_infeasible=on_infeasible).with_mu(variance)
    with progress(f"solving {car.name}, {module.NAME}"):
        solved = module.build(problem)
    if not isinstance(solved, CostToGoPolicy):
        raise CommandError(
            f"the policy {module.NAME!r} has nothing to solve: it follows thresholds in the concept's file; "
            "choose stochastic, certainty_equivalent or perfect_information"
        )
    from socwise.commands.policy_file import write_policy

    with staged_file(out) as path:
        write_policy(solved, path)
    summary = _summary(solved, cycle_name=trip.name, out=out)
    if as_json:
        show_json(summary)
    else:
        _show(summary)


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
        "solve_s": policy.solve_s,
        "file": str(out),
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
    table.add_row("solved in", f"{summary['solve_s']:.1f} s")
    show(table, "", f"The policy is in {summary['file']}")

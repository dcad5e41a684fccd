"""``socwise traffic``: simulate a road, spread its uncertainty, estimate it, and make drive cycles of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from socwise.commands.errors import CommandError
from socwise.commands.options import JsonOption, split
from socwise.commands.screen import progress, show, show_json

if TYPE_CHECKING:
    from drivecycles.traffic.scenario import Scenario

traffic = typer.Typer(
    no_args_is_help=True, help="Traffic on a road: run it, spread its uncertainty, estimate it, drive in it."
)

ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="report, commute, or the path of a .toml file.")
]
OutOption = Annotated[Path, typer.Option(metavar="DIR", help="Folder for results and figures.")]
SeedOption = Annotated[int, typer.Option(metavar="S", min=0, help="Seed.")]
DEFAULT_OUT = Path("results/traffic")
MOST_SEEDS = 1000


@traffic.command("run")
def run(scenario: ScenarioArgument, out: OutOption = DEFAULT_OUT, as_json: JsonOption = False) -> None:
    """Simulate a road once: speed at places, time-space diagram, vehicles counted."""
    found = _load(scenario, out)
    from socwise.commands.traffic_table import run_table
    from socwise.figures.traffic import run_figures
    from socwise.traffic import run_json
    from socwise.traffic_store import write_field, write_traffic

    with progress("simulating (the first run also compiles)"):
        field = found.simulate()
        result = run_json(found, field)
        write_traffic(
            result,
            _settings(found),
            out,
            lambda: run_figures(found, field),
            lambda folder: write_field(field, folder / "field.nc"),
        )
    if as_json:
        show_json(result)
        return
    show(*run_table(result), _where(out))


@traffic.command("uncertainty")
def uncertainty(
    scenario: ScenarioArgument,
    method: Annotated[
        str, typer.Option(metavar="NAME[,NAME...]", help="mc, antithetic, lhs, sobol, gpc.")
    ] = "gpc",
    runs: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, help="Most model runs.", show_default="1024; 25 for gpc"),
    ] = None,
    order: Annotated[int | None, typer.Option(metavar="P", min=1, help="Order of the chaos.")] = None,
    errors: Annotated[
        bool, typer.Option("--errors", metavar="", help="Draw errors against runs, of all methods named.")
    ] = False,
    seed: SeedOption = 0,
    out: OutOption = DEFAULT_OUT,
    as_json: JsonOption = False,
) -> None:
    """Spread uncertain parameters: mean, sd, quantiles, Sobol indices and error of the speed at places."""
    found = _load(scenario, out)
    from drivecycles.traffic.errors import TrafficError
    from drivecycles.traffic.naming import suggest
    from drivecycles.traffic.uncertainty import METHODS
    from socwise.commands.traffic_table import spread_tables
    from socwise.figures.traffic import spread_figures
    from socwise.traffic import error_curves, spread, spread_json
    from socwise.traffic_store import write_spread, write_table, write_traffic

    methods = [name.lower() for name in split(method, "--method")]
    for name in methods:
        if name not in METHODS:
            raise TrafficError(
                f"--method names {name!r}; known are {', '.join(METHODS)}{suggest(name, METHODS)}"
            )
    if len(set(methods)) < len(methods):
        raise CommandError("--method names a method twice; name each once")
    if order is not None and methods != ["gpc"]:
        raise CommandError("--order is for --method gpc alone")
    dimension = max(len(found.uncertain), 1)
    with progress("propagating (the first run also compiles)"):
        most = {name: runs or (_chaos_runs(order, dimension) if name == "gpc" else 1024) for name in methods}
        spreads = [
            spread(found, name, most[name], seed, order if name == "gpc" else None) for name in methods
        ]
        curves = error_curves(found, methods, seed) if errors else {}
        result = spread_json(found, spreads, seed)
        if errors:
            result["errors"] = {
                name: {"runs": count.tolist(), "rms_error_kmh": off.tolist()}
                for name, (count, off) in curves.items()
            }

        def files(folder: Path) -> None:
            for one in spreads:
                write_spread(one, folder / f"{one.method}.nc")
                values = dict(zip(one.names, one.values.T, strict=True))
                write_table(folder / f"{one.method}_members.csv", values)

        settings = {**_settings(found), "methods": methods, "runs": runs, "order": order, "seed": seed}
        write_traffic(result, settings, out, lambda: spread_figures(spreads, curves), files)
    if as_json:
        show_json(result)
        return
    show(*spread_tables(result), _where(out))


@traffic.command("estimate")
def estimate(
    scenario: ScenarioArgument,
    data: Annotated[
        Path | None,
        typer.Option(
            metavar="READINGS.csv", help="Your detectors' log; a synthetic one is made if left out."
        ),
    ] = None,
    seeds: Annotated[
        int, typer.Option(metavar="N", min=1, max=MOST_SEEDS, help="Synthetic logs, each with its own noise.")
    ] = 1,
    seed: SeedOption = 0,
    out: OutOption = DEFAULT_OUT,
    as_json: JsonOption = False,
) -> None:
    """Estimate the diagram's parameters and the traffic between detectors from their noisy speeds."""
    found = _load(scenario, out)
    if data is not None and seeds > 1:
        raise CommandError("--seeds is for synthetic logs, and --data names one of yours; leave one out")
    from drivecycles.traffic.detectors import read_readings, write_readings
    from drivecycles.traffic.scenario_parts import KMH
    from socwise.commands.traffic_table import estimate_tables
    from socwise.figures.traffic import estimate_figures
    from socwise.traffic import estimate_json, estimate_scenario
    from socwise.traffic_store import write_traffic

    readings = None
    if data is not None:
        noise_kmh = 1.609344 if found.detectors is None else found.detectors.noise_kmh
        readings = read_readings(data, KMH * noise_kmh)
    with progress("estimating (the first run also compiles)") as advance:
        estimates: list[Any] = []
        field = None
        for number in range(seeds):
            estimates.append(estimate_scenario(found, readings, seed + number, field))
            field = estimates[0].field
            if advance is not None:
                advance(number + 1, seeds)
        result = estimate_json(found, estimates, None if data is None else str(data))
        write_traffic(
            result,
            {**_settings(found), "seeds": list(range(seed, seed + seeds)), "data": result["source"]},
            out,
            lambda: estimate_figures(estimates[0]),
            lambda folder: write_readings(estimates[0].readings, folder / "readings.csv"),
        )
    if as_json:
        show_json(result)
        return
    show(*estimate_tables(result), _where(out))


@traffic.command("cycles")
def cycles(
    scenario: ScenarioArgument,
    number: Annotated[
        int | None,
        typer.Option("--cycles", metavar="N", help="Number of cycles.", show_default="the scenario's"),
    ] = None,
    seed: SeedOption = 0,
    out: OutOption = DEFAULT_OUT,
    as_json: JsonOption = False,
) -> None:
    """Drive a probe vehicle through uncertain traffic: an ensemble of drive cycles, and the planned one."""
    found = _load(scenario, out)
    from drivecycles.traffic.ensemble import draw_cycles
    from socwise.commands.traffic_table import cycles_table
    from socwise.figures.traffic import cycle_figures
    from socwise.traffic import cycles_json
    from socwise.traffic_store import write_cycle, write_traffic

    with progress("driving (the first run also compiles)") as advance:
        ensemble = draw_cycles(found, cycles=number, seed=seed, progress=advance)
        result = cycles_json(found, ensemble, seed)

        def files(folder: Path) -> None:
            (folder / "cycles").mkdir()
            for cycle in (ensemble.planned, *ensemble.members):
                planned = cycle is ensemble.planned
                write_cycle(
                    cycle, folder / "cycles" / ("planned.csv" if planned else f"{_safe(cycle.name)}.csv")
                )

        field = found.simulate()
        settings = {**_settings(found), "cycles": number, "seed": seed}
        write_traffic(result, settings, out, lambda: cycle_figures(found, field, ensemble), files)
    if as_json:
        show_json(result)
        return
    show(*cycles_table(result), _where(out))


def _load(scenario: str, out: Path) -> Scenario:
    from drivecycles.traffic.scenario_file import load_scenario
    from socwise.results.staging import check_writable
    from socwise.traffic_store import TRAFFIC_FORMAT

    found = load_scenario(scenario)
    check_writable(out, TRAFFIC_FORMAT)
    return found


def _chaos_runs(order: int | None, dimension: int) -> int:
    """Give the size of the grid of an order; of the highest up to 4 that 125 nodes allow by default."""
    if order is not None:
        return int((order + 1) ** dimension)
    return int(max(2**dimension, min(5**dimension, 125)))


def _settings(scenario: Scenario) -> dict[str, Any]:
    return {"scenario": scenario.model_dump(mode="json", exclude_none=True)}


def _where(out: Path) -> str:
    return f"Results are in {out}, figures in {out / 'figures'}"


def _safe(name: str) -> str:
    import re

    return re.sub(r"[^A-Za-z0-9_.-]+", "-", name).strip("-.") or "cycle"

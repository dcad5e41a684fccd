"""``socwise inertia``: mass, inertia and centre of gravity of a vehicle, estimated while it is driven."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from socwise.commands.errors import CommandError
from socwise.commands.inertia_options import (
    DEFAULT_OUT,
    ColumnOption,
    DataOption,
    DurationOption,
    OutOption,
    SeedOption,
    SeedsOption,
    columns_of,
    filled,
    geometry_from,
    names_of,
    only_synthetic,
    prior_from,
)
from socwise.commands.options import JsonOption, key_values
from socwise.commands.screen import complain, progress, show, show_json

if TYPE_CHECKING:
    from socwise.inertia import InertiaRun
    from vehicle.inertia.log_file import LogTable

_METHODS_HELP = "gpc, gpc-report, rls-force, rls-acceleration, ekf, ukf."
_SensorsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--sensors",
        metavar="KEY=VALUE",
        help="Error of the sensors, such as strut_gain_sd=0.01, allowed for in the standard deviations.",
    ),
]
_GeometryOption = Annotated[
    list[str] | None,
    typer.Option("--geometry", metavar="KEY=VALUE", help="A length of your vehicle; may be repeated."),
]
_PriorOption = Annotated[
    list[str] | None,
    typer.Option(
        "--prior",
        metavar="NAME=CENTRE,HALF",
        help="What is believed before, such as mass_kg=8000,4000; may be repeated.",
    ),
]
_RoadOption = Annotated[
    str | None, typer.Option(metavar="A|B|C|D|E", help="Class of the synthetic road, ISO 8608.")
]
_MethodOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME[,NAME...]", help=_METHODS_HELP, show_default="all; of load-transfer gpc, ekf, rls-force"
    ),
]

inertia = typer.Typer(
    no_args_is_help=True, help="Estimate mass, inertia and centre of gravity from a log, each with its sd."
)


@inertia.command("mass-spring")
def mass_spring(
    data: DataOption = None,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="NAME[,NAME...]",
            help="full-germ, report, unmodified, ekf, ukf.",
            show_default="all",
        ),
    ] = None,
    seeds: SeedsOption = 1,
    seed: SeedOption = 0,
    duration: DurationOption = None,
    position: Annotated[float, typer.Option(metavar="M", help="True initial position.")] = 0.2,
    stiffness: Annotated[float, typer.Option(metavar="N/M", help="Stiffness of the spring.")] = 1000.0,
    setting: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="A setting of the filters, such as mass_kg=1000."),
    ] = None,
    column: ColumnOption = None,
    out: OutOption = DEFAULT_OUT,
    as_json: JsonOption = False,
) -> None:
    """A driven mass on a spring: find the mass from noisy positions."""
    from socwise.inertia_cases import MODES, run_mass_spring
    from vehicle.inertia.mass_spring import DURATION_S, Settings, simulate
    from vehicle.inertia.read_log import read_mass_spring

    modes = names_of(method, "--method", MODES, MODES)
    changes = key_values(setting, "--set")
    filled(Settings, changes, "--set")
    _check(data, out, {"--seeds": seeds > 1, "--duration": duration is not None})
    columns = columns_of(column, data)
    settings = {"model": "mass-spring", "methods": modes, "stiffness_Npm": stiffness, "set": changes}
    if data is not None:
        log, table = read_mass_spring(data, columns, stiffness)
        _finish([table], lambda _: run_mass_spring(log, modes, changes=changes), None, settings, out, as_json)
        return

    length_s = DURATION_S if duration is None else duration

    def one(number: int) -> list[InertiaRun]:
        made = simulate(seed=number, duration_s=length_s, position_m=position, stiffness_Npm=stiffness)
        return run_mass_spring(made, modes, seed=number, changes=changes)

    settings |= {"duration_s": length_s, "position_m": position}
    _finish([], one, range(seed, seed + seeds), settings, out, as_json)


@inertia.command("ride")
def ride(
    data: DataOption = None,
    method: _MethodOption = None,
    scenario: Annotated[str, typer.Option(metavar="urban|rural", help="Synthetic drive.")] = "rural",
    seeds: SeedsOption = 1,
    seed: SeedOption = 0,
    duration: DurationOption = None,
    road: _RoadOption = None,
    sensors: _SensorsOption = None,
    geometry: _GeometryOption = None,
    prior: _PriorOption = None,
    column: ColumnOption = None,
    out: OutOption = DEFAULT_OUT,
    as_json: JsonOption = False,
) -> None:
    """Mass, pitch and roll inertia and height of the CG from bounce, pitch and roll."""
    _vehicle(
        "ride", ["ride"], data, method, scenario, seeds, seed, duration, road, sensors, geometry, prior,
        column, out, as_json,
    )  # fmt: skip


@inertia.command("load-transfer")
def load_transfer(
    data: DataOption = None,
    model: Annotated[
        str | None,
        typer.Option(
            metavar="ltm,mltm", help="Which of the two models.", show_default="both; mltm of --data"
        ),
    ] = None,
    method: _MethodOption = None,
    scenario: Annotated[
        str | None,
        typer.Option(metavar="urban,rural", help="Synthetic drives.", show_default="both"),
    ] = None,
    seeds: SeedsOption = 1,
    seed: SeedOption = 0,
    duration: DurationOption = None,
    road: _RoadOption = None,
    sensors: _SensorsOption = None,
    geometry: _GeometryOption = None,
    prior: _PriorOption = None,
    column: ColumnOption = None,
    out: OutOption = DEFAULT_OUT,
    as_json: JsonOption = False,
) -> None:
    """Mass and position of the CG from the loads of the four struts."""
    known = ("ltm", "mltm")
    models = names_of(model, "--model", known, known if data is None else ("mltm",))
    _vehicle(
        "load-transfer", models, data, method, scenario, seeds, seed, duration, road, sensors, geometry,
        prior, column, out, as_json,
    )  # fmt: skip


def _vehicle(
    command: str,
    models: list[str],
    data: Path | None,
    method: str | None,
    scenario: str | None,
    seeds: int,
    seed: int,
    duration: float | None,
    road: str | None,
    sensors: list[str] | None,
    geometry: list[str] | None,
    prior: list[str] | None,
    column: list[str] | None,
    out: Path,
    as_json: bool,
) -> None:
    from socwise.inertia_cases import METHODS, QUICK, allowed_for, run_synthetic, run_vehicle
    from vehicle.inertia.read_log import read_log
    from vehicle.inertia.sensors import RIDE_SENSORS, ROAD_SENSORS_GAIN, SensorErrors

    _check(data, out, {"--seeds": seeds > 1, "--duration": duration is not None, "--road": road is not None})
    methods = names_of(method, "--method", METHODS, METHODS if command == "ride" else QUICK)
    scenarios = names_of(scenario, "--scenario", ("urban", "rural"), ("urban", "rural"))
    columns, believed = columns_of(column, data), prior_from(prior)
    lengths = geometry_from(geometry, data, centre_known=command == "ride")
    usual = RIDE_SENSORS if command == "ride" and data is None else ROAD_SENSORS_GAIN
    errors = filled(SensorErrors, key_values(sensors, "--sensors"), "--sensors", usual)
    known: dict[str, Any] = {"geometry": lengths, "prior": believed}
    settings: dict[str, Any] = {
        "model": command,
        "models": models,
        "methods": methods,
        "sensors": errors.model_dump(),
    }
    settings |= {"geometry": None if lengths is None else lengths.model_dump(), "prior": believed}
    if data is not None:
        logs = {model: read_log(data, model, columns) for model in models}

        def mine(_: int) -> list[InertiaRun]:
            allowed = allowed_for(errors)
            ran = (run_vehicle(m, log, methods, consider=allowed, **known) for m, (log, _) in logs.items())
            return [run for several in ran for run in several]

        _finish([table for _, table in logs.values()], mine, None, settings, out, as_json)
        return
    options: dict[str, Any] = {} if duration is None else {"duration_s": duration}
    if road is not None:
        options["road"] = road.upper()

    def one(number: int) -> list[InertiaRun]:
        found = (run_synthetic(models, s, number, methods, errors, **known, **options) for s in scenarios)
        return [run for several in found for run in several]

    settings |= {"scenarios": scenarios, **options}
    _finish([], one, range(seed, seed + seeds), settings, out, as_json)


def _check(data: Path | None, out: Path, synthetic: dict[str, bool]) -> None:
    from socwise.results.staging import INERTIA_FORMAT, check_writable

    only_synthetic(data, synthetic)
    check_writable(out, INERTIA_FORMAT)


def _finish(
    tables: list[LogTable],
    run: Callable[[int], list[InertiaRun]],
    seeds: range | None,
    settings: dict[str, Any],
    out: Path,
    as_json: bool,
) -> None:
    """Run, write and show."""
    from socwise.inertia import runs_over, to_json
    from socwise.inertia_store import write_inertia

    for doubt in dict.fromkeys(doubt for table in tables for doubt in table.doubts):
        complain(f"warning: {doubt}")
    with progress("estimating (the first run also compiles)") as advance:
        runs = run(0) if seeds is None else runs_over(seeds, run, advance)
    if not runs:
        raise CommandError("there is nothing to run; name a method")
    data = _described(tables, seeds)
    result = to_json(runs, data)
    with progress("drawing figures and writing results"):
        write_inertia(runs, result, {**settings, "data": data}, out)
    if as_json:
        show_json(result)
        return
    _show(result, out)


def _described(tables: list[LogTable], seeds: range | None) -> dict[str, Any]:
    if seeds is not None:
        return {"source": None, "seeds": list(seeds)}
    time_s = tables[0].channels["time"]
    return {
        "source": tables[0].source,
        "samples": int(time_s.size),
        "duration_s": float(time_s[-1] - time_s[0]),
        "columns": {name: header for table in tables for name, header in table.headers.items()},
        "notes": list(dict.fromkeys(note for table in tables for note in table.notes)),
        "doubts": list(dict.fromkeys(doubt for table in tables for doubt in table.doubts)),
    }


def _show(result: dict[str, Any], out: Path) -> None:
    from socwise.commands.inertia_table import described, remarks, tables

    show(*described(result))
    for title, table in tables(result):
        show("", title, table)
    show("", *remarks(result))
    show("±: one standard deviation, as the method believes it; settled: within 2 % of its end for good")
    show(f"Results are in {out}, figures in {out / 'figures'}")

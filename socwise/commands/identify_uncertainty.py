"""``socwise identify-uncertainty``: [L]'s gamma, beta and mu from what an estimator does."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from socwise.commands.errors import CommandError
from socwise.commands.loop_options import (
    CIRCUIT,
    MODEL,
    CellOption,
    IsolateOption,
    MappingOption,
    ScatterOption,
    SensorsOption,
    SetOption,
    closed_loop,
    names_of,
)
from socwise.commands.options import DEFAULT_JOBS, JobsOption, JsonOption, concepts
from socwise.commands.screen import progress, show, show_json

if TYPE_CHECKING:
    from ems import Concept
    from ems.closed import ClosedLoop, Identified


def identify_uncertainty(
    concept: Annotated[
        str, typer.Option(metavar="NAME[,NAME...]", help="hev, phev, both, or the path of a .toml file.")
    ] = "both",
    estimator: Annotated[
        str,
        typer.Option(metavar="NAME", help="ekf, ukf, gpc-ekf, gpc-gradient, gpc-gauss-newton, coulomb."),
    ] = "ekf",
    plant: Annotated[
        str, typer.Option(metavar="ecm|FILE.fmu", help="What the battery really does.")
    ] = CIRCUIT,
    mapping: MappingOption = None,
    isolate: IsolateOption = None,
    cell: CellOption = None,
    option: SetOption = None,
    sensors: SensorsOption = None,
    scatter: ScatterOption = None,
    cycle: Annotated[
        str | None,
        typer.Option(
            metavar="NAME[+NAME...]",
            help="Trip to identify on.",
            show_default="wltc-3b+artemis-rural+wltc-3b",
        ),
    ] = None,
    realizations: Annotated[int, typer.Option(metavar="N", min=2, help="Realizations of the trip.")] = 40,
    error_weight: Annotated[
        float,
        typer.Option(metavar="W", min=0.0, max=1.0, help="1 fits the real errors, 0 the claimed variances."),
    ] = 0.5,
    seed: Annotated[int, typer.Option(metavar="S", min=0, help="Seed of the noise.")] = 0,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the files.")] = Path(
        "results/uncertainty"
    ),
    jobs: JobsOption = DEFAULT_JOBS,
    as_json: JsonOption = False,
) -> None:
    """Fit the uncertainty model that the stochastic policy needs to an estimator, and say how well it fits.

    Writes to --out, for each concept, a table [uncertainty] for its file, and a picture.
    """
    if plant == MODEL:
        raise CommandError("--plant is 'model', whose gamma, beta and mu are known; choose ecm or an FMU")
    names_of(plant, estimator)
    loop = closed_loop(
        plant,
        estimator,
        mapping=mapping,
        isolate=isolate,
        cell=cell,
        options=option,
        sensors=sensors,
        scatter=scatter,
    )
    cars = concepts(concept)
    found = _identify(cars, loop, cycle, realizations, error_weight, seed, jobs)
    result = {
        "schema": 1,
        "seed": seed,
        "plant": loop.plant_name,
        "estimator": loop.estimator_name,
        "identified": {one.concept: one.to_json() for one in found},
    }
    files = _write(found, cars, loop, result, out)
    if as_json:
        show_json(result)
        return
    from socwise.commands.identified_table import fit_table, parameter_table, remarks

    show(parameter_table(found), "", fit_table(found), "")
    show(*remarks(found))
    show(f"Files are in {out}: {', '.join(files)}")


def _identify(
    cars: list[Concept],
    loop: ClosedLoop,
    cycle: str | None,
    realizations: int,
    error_weight: float,
    seed: int,
    jobs: int,
) -> list[Identified]:
    from drivecycles import load_cycle
    from ems.closed import battery_for, identify
    from ems.closed.identify import TRIP
    from ems.closed.plants import check_plant

    trip, found = load_cycle(cycle or TRIP), []
    with progress("driving the training trip (the first run also compiles)") as advance:
        for at, car in enumerate(cars):
            battery = battery_for(car, loop)
            loop.make_estimator(battery.cell, car.initial_soc, car.initial_soc_sd)
            check_plant(loop, battery.cell)

            def tell(done: int, before: int = at * realizations) -> None:
                if advance is not None:
                    advance(before + done, len(cars) * realizations)

            found.append(
                identify(
                    car,
                    loop,
                    trip,
                    realizations=realizations,
                    seed=seed,
                    error_weight=error_weight,
                    jobs=jobs,
                    battery=battery,
                    progress=tell,
                )
            )
    return found


def _write(
    found: list[Identified], cars: list[Concept], loop: ClosedLoop, result: dict[str, Any], out: Path
) -> list[str]:
    """Write a TOML and a picture for each concept, and the object; give their names."""
    from ems.closed import battery_for
    from socwise.commands.files import check_file, staged_file
    from socwise.figures.identified import new_figure, plot_identified
    from socwise.results.plain import finite, write_json

    written = []
    for one, car in zip(found, cars, strict=True):
        stem = re.sub(r"[^A-Za-z0-9_.-]+", "-", one.concept).strip("-.") or "concept"
        check_file(out / f"{stem}.toml")
        with staged_file(out / f"{stem}.toml") as path:
            path.write_text(_toml(one, loop), encoding="utf-8", newline="\n")
        figure = new_figure()
        ax = plot_identified(one.behaviour, battery_for(car, loop).pack, one.fitted.model, figure.subplots())
        ax.set_title(f"{one.concept}: {one.estimator} on {one.plant}, {one.trip}")
        ax.legend(loc="upper left", frameon=False)
        with staged_file(out / f"{stem}.png") as path:
            figure.savefig(path, dpi=150)
        written += [f"{stem}.toml", f"{stem}.png"]
    with staged_file(out / "uncertainty.json") as path:
        write_json(path, finite(result))
    return [*written, "uncertainty.json"]


def _toml(one: Identified, loop: ClosedLoop) -> str:
    """The table for a concept's file."""
    model, errors = one.fitted.model, one.fitted.standard_errors
    lines = [
        f"# {one.concept}: identified from {loop.estimator_name} on {loop.plant_name}, {one.trip},"
        f" {one.behaviour.current_A.shape[0]} realizations.",
        *(f"# {note}" for note in one.fitted.notes),
        "[uncertainty]",
        *(
            f"{name} = {getattr(model, name)!r}  # ± {getattr(errors, name):.1g}"
            for name in ("gamma", "beta", "mu")
        ),
    ]
    return "\n".join(lines) + "\n"

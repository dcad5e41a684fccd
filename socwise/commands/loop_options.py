"""Options of the commands that close the loop: plant, estimator, cell, sensors, scatter, training trip."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from socwise.commands.errors import CommandError
from socwise.commands.options import key_values

if TYPE_CHECKING:
    from pydantic import BaseModel

    from ems.closed import ClosedLoop, FmuSource

MODEL, CIRCUIT = "model", "ecm"

PlantOption = Annotated[
    str | None,
    typer.Option(metavar="model|ecm|FILE.fmu", help="What the battery really does.", show_default="model"),
]
EstimatorOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="What believes the SOC: model; ekf, ukf, gpc-ekf, gpc-gradient, gpc-gauss-newton, coulomb.",
        show_default="model, or ekf",
    ),
]
MappingOption = Annotated[
    Path | None, typer.Option(metavar="M.toml", help="What the variables of an FMU mean.")
]
IsolateOption = Annotated[
    Literal["yes", "no"] | None,
    typer.Option(help="Run an FMU in a process of its own.", show_default="yes"),
]
CellOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|FILE.toml", help="Cell that fills the pack.", show_default="the concept's own pack"
    ),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--option", metavar="KEY=VALUE", help="Option of the estimator; may be repeated."),
]
SensorsOption = Annotated[
    list[str] | None,
    typer.Option("--sensors", metavar="KEY=VALUE", help="Sensor errors, such as current_bias_sd_A=0.1."),
]
ScatterOption = Annotated[
    list[str] | None,
    typer.Option("--scatter", metavar="KEY=VALUE", help="Batteries differ, such as capacity_sd=0.03."),
]
TrainingOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME[+NAME...]",
        help="Trip on which the uncertainty model is identified.",
        show_default="another one than --cycle",
    ),
]
TrainingCountOption = Annotated[
    int | None,
    typer.Option(metavar="N", min=2, help="Realizations of that trip.", show_default="40"),
]


def names_of(plant: str | None, estimator: str | None) -> tuple[str, str]:
    """Fill in the one of plant and estimator that was left out.

    Raises
    ------
    CommandError
        If the two do not go together.
    """
    real = estimator is not None and estimator != MODEL
    chosen = plant or (CIRCUIT if real else MODEL)
    believes = estimator or (MODEL if chosen == MODEL else "ekf")
    if chosen == MODEL and believes != MODEL:
        raise CommandError(
            f"--estimator {believes} takes a voltage, and --plant model reports a noisy SOC; choose"
            " --plant ecm or an FMU"
        )
    if chosen != MODEL and believes == MODEL:
        raise CommandError(
            f"--plant {chosen} measures a voltage, and --estimator model takes a noisy SOC; choose an"
            " estimator that a car could have, such as ekf"
        )
    return chosen, believes


def only_in_the_loop(given: Mapping[str, object]) -> None:
    """Refuse options of the closed loop where plant and estimator are the model.

    Raises
    ------
    CommandError
        If one was given.
    """
    named = [option for option, value in given.items() if value is not None]
    if named:
        raise CommandError(
            f"{named[0]} is for a closed loop; choose --plant ecm or an FMU, and an estimator such as ekf"
        )


def closed_loop(
    plant: str,
    estimator: str,
    *,
    mapping: Path | None,
    isolate: str | None,
    cell: str | None,
    options: list[str] | None,
    sensors: list[str] | None,
    scatter: list[str] | None,
) -> ClosedLoop:
    """Put a closed loop together.

    Raises
    ------
    CommandError
        If an option is malformed or does not go with the plant.
    BatteryError
        If cell, mapping or estimator are unknown, or a value is out of range.
    """
    from bms.cells import load_cell
    from bms.estimators.catalogue import estimator_names
    from bms.plants.sensed import SensorNoise
    from bms.toml_file import suggestion
    from ems.closed import ClosedLoop, Scatter

    key = estimator.strip().lower().replace("-", "_")
    if key not in estimator_names():
        known = [MODEL, *estimator_names()]
        raise CommandError(
            f"no estimator is called {estimator!r}{suggestion(key, known)}; known are {', '.join(known)}"
        )
    source = _plant(plant, mapping, isolate)
    if not isinstance(source, str) and scatter:
        raise CommandError("--scatter is for --plant ecm; an FMU is the same in every realization")
    return ClosedLoop(
        plant=source,
        estimator=key,
        options=key_values(options, "--option"),
        cell=None if cell is None else load_cell(cell),
        scatter=_model(Scatter, scatter, "--scatter"),
        sensors=_model(SensorNoise, sensors, "--sensors"),
    )


def _plant(plant: str, mapping: Path | None, isolate: str | None) -> Any:
    from ems.closed import FmuSource

    if plant == CIRCUIT:
        for option, value in (("--mapping", mapping), ("--isolate", isolate)):
            if value is not None:
                raise CommandError(f"{option} is for a plant that comes as an FMU, and --plant is ecm")
        return CIRCUIT
    path = Path(plant)
    if path.suffix.lower() != ".fmu":
        raise CommandError(f"--plant is {plant!r}; give model, ecm, or the path of an .fmu file")
    if not path.is_file():
        raise CommandError(f"there is no file {plant}; --plant takes model, ecm, or the path of an .fmu file")
    if mapping is None:
        raise CommandError(
            f"--plant {plant} needs --mapping; `socwise cosim inspect {plant}` writes a first one"
        )
    source: FmuSource = FmuSource(path.absolute(), mapping.absolute(), isolate != "no")
    return source


def _model(model: type[BaseModel], texts: list[str] | None, option: str) -> Any:
    from pydantic import ValidationError

    from bms.toml_file import complaint

    try:
        return model(**key_values(texts, option))
    except ValidationError as error:
        raise complaint(error, model, f"{option} does not fit") from error

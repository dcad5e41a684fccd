"""``--mass``: mass of the vehicle and its standard deviation, as numbers or from ``socwise inertia``."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from socwise.commands.errors import CommandError

if TYPE_CHECKING:
    from ems import Concept

MassOption = Annotated[
    str | None,
    typer.Option(
        metavar="KG[,SD]|RESULT.json[+KG]",
        help="Mass in place of the vehicle's own; result.json of `socwise inertia`, plus what its struts do"
        " not carry.",
        show_default="the vehicle's own",
    ),
]
_MODELS = ("mltm", "ltm", "ride")
_FILE = re.compile(r"^(?P<path>.*?)(?:\+(?P<more>[0-9.eE]+))?$")


def weighed(cars: Sequence[Concept], text: str | None) -> list[Concept]:
    """Give concepts the mass of ``--mass``, if there is one.

    Raises
    ------
    CommandError
        If the text is neither a mass nor the path of results with one.
    """
    if text is None:
        return list(cars)
    mass_kg, sd_kg = read_mass(text)
    return [car.with_mass(mass_kg, sd_kg) for car in cars]


def read_mass(text: str) -> tuple[float, float]:
    """Read a mass and its standard deviation, in kg.

    Raises
    ------
    CommandError
        As `weighed`.
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        return _of_results(text)
    if len(numbers) > 2 or not (0.0 < numbers[0] < math.inf and 0.0 <= numbers[-1] < math.inf):
        raise CommandError(
            f"--mass is {text!r}; give kg, or kg and their standard deviation, such as 1873,12"
        )
    mass_kg, sd_kg = numbers[0], numbers[1] if len(numbers) == 2 else 0.0
    _check(text, mass_kg, sd_kg)
    return mass_kg, sd_kg


def mass_effects(cars: Sequence[Concept], cycle: str) -> dict[str, Any]:
    """Return ``{"mass": [...]}`` for cars whose mass is given or uncertain; empty where there is none."""
    from drivecycles import load_cycle
    from vehicle.mass import mass_effect

    driven, found = load_cycle(cycle), []
    if not driven.is_uniform:
        driven = driven.resample(1.0)
    for car in cars:
        vehicle = car.load_vehicle()
        if car.mass_kg is None and not vehicle.chassis.mass_sd_kg:
            continue
        effect = mass_effect(vehicle, driven)
        found.append(
            {
                "concept": car.name,
                "mass_kg": effect.mass_kg,
                "sd_kg": effect.sd_kg,
                "wheel_energy_MJ": {"value": 1e-6 * effect.energy_J, "sd": 1e-6 * effect.energy_sd_J},
            }
        )
    return {"mass": found} if found else {}


def mass_sentences(result: Mapping[str, Any]) -> list[str]:
    """Say for each car what its mass is, and what its standard deviation means for the energy of the trip."""
    said = []
    for one in result.get("mass", ()):
        energy = one["wheel_energy_MJ"]
        text = f"{one['concept']} weighs {one['mass_kg']:.5g} kg"
        if one["sd_kg"]:
            share = 100.0 * energy["sd"] / energy["value"] if energy["value"] else 0.0
            text += (
                f" ± {one['sd_kg']:.2g}, so the energy that the trip takes at the wheels,"
                f" {energy['value']:.4g} MJ, is"
                f" uncertain by {share:.2g} %"
            )
        said.append(f"{text}.")
    return said


def _of_results(text: str) -> tuple[float, float]:
    match = _FILE.match(text)
    path = Path(match["path"] if match and not Path(text).is_file() else text)
    more = float(match["more"]) if match and match["more"] and path != Path(text) else 0.0
    if path.is_dir():
        path = path / "result.json"
    try:
        estimates = json.loads(path.read_text(encoding="utf-8"))["estimates"]
        masses = {
            (one["model"], one["method"]): one["parameters"]["mass_kg"]
            for one in reversed(estimates)
            if "mass_kg" in one["parameters"]
        }
        best = next((masses[model, "gpc"] for model in _MODELS if (model, "gpc") in masses), None)
        if best is None:
            raise CommandError(
                f"--mass: {path} holds no mass of a vehicle by the method gpc; write one with"
                " `socwise inertia load-transfer --data LOG.csv --method gpc`"
            )
        mass_kg, sd_kg = float(best["value"]) + more, float(best["sd"])
    except FileNotFoundError:
        raise CommandError(
            f"--mass is {text!r}, which is neither a number nor a file; give kg, or kg and their standard"
            " deviation,"
            " such as 1873,12, or the result.json of `socwise inertia`"
        ) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        if isinstance(error, CommandError):
            raise
        raise CommandError(f"--mass: {path} is not a result of `socwise inertia` ({error})") from error
    _check(text, mass_kg, sd_kg)
    return mass_kg, sd_kg


def _check(text: str, mass_kg: float, sd_kg: float) -> None:
    if not (0.0 < mass_kg < math.inf and 0.0 <= sd_kg < mass_kg):
        raise CommandError(
            f"--mass is {text!r}: {mass_kg:g} kg ± {sd_kg:g}; the standard deviation must be below the mass"
        )

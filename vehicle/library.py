"""Vehicles by name or from the user's TOML file."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from vehicle.chassis import Chassis
from vehicle.engine import Engine, EngineParameters
from vehicle.errors import VehicleError
from vehicle.gearbox import Gearbox
from vehicle.motor import Motor, MotorParameters
from vehicle.powertrain import Vehicle

_PRESETS = Path(__file__).parent / "presets"


class VehicleParameters(BaseModel):
    """A vehicle file: TOML with these keys and tables."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: str = Field(min_length=1, description="What to call the vehicle")
    auxiliary_W: float = Field(ge=0.0, description="Constant auxiliary load on the battery's bus, W")
    chassis: Chassis
    gearbox: Gearbox
    engine: EngineParameters
    motor: MotorParameters


def vehicle_names() -> tuple[str, ...]:
    """Names of the presets."""
    return tuple(sorted(path.stem for path in _PRESETS.glob("*.toml")))


def load_vehicle(name_or_path: str | Path) -> Vehicle:
    """Build a preset or a user's vehicle.

    Parameters
    ----------
    name_or_path : str or Path
        A preset's name (`vehicle_names`), or the path of a TOML file. Paths of maps start from its folder.

    Returns
    -------
    Vehicle
        Ready to be asked for `demand` and `controls`.

    Raises
    ------
    VehicleError
        The name is unknown, or the file or one of its maps is not valid; says which key, the value given and
        what is allowed.
    """
    path = _resolve(name_or_path)
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise VehicleError(f"cannot read the vehicle file {path}: {error}") from error
    except tomllib.TOMLDecodeError as error:
        raise VehicleError(f"{path} is not valid TOML: {error}") from error
    try:
        parameters = VehicleParameters.model_validate(data)
    except ValidationError as error:
        raise VehicleError("\n".join(f"{path}: {_explain(dict(e))}" for e in error.errors())) from error
    return Vehicle(
        name=parameters.name,
        chassis=parameters.chassis,
        gearbox=parameters.gearbox,
        engine=Engine.load(parameters.engine, path.parent),
        motor=Motor.load(parameters.motor, path.parent),
        auxiliary_W=parameters.auxiliary_W,
    )


def _resolve(name_or_path: str | Path) -> Path:
    names = vehicle_names()
    if str(name_or_path).lower() in names:
        return _PRESETS / f"{str(name_or_path).lower()}.toml"
    path = Path(name_or_path)
    if path.suffix == ".toml" or path.exists():
        return path
    raise VehicleError(
        f"unknown vehicle {str(name_or_path)!r}{_suggestion(str(name_or_path), names)}; "
        f"choose one of {', '.join(names)} or give the path of a .toml file"
    )


def _explain(error: dict[str, Any]) -> str:
    location = ".".join(str(part) for part in error["loc"])
    if error["type"] == "extra_forbidden":
        allowed = _keys_at(error["loc"][:-1])
        suggestion = _suggestion(str(error["loc"][-1]), allowed)
        return f"unknown key {location}{suggestion}; allowed are {', '.join(allowed)}"
    if error["type"] == "missing":
        return f"the key {location} is missing{_description(error['loc'])}"
    detail = str(error["msg"]).removeprefix("Value error, ")
    given = "" if isinstance(error["input"], dict) else f" = {error['input']!r}"
    return f"{location}{given}: {detail}{_description(error['loc'])}"


def _model_at(location: tuple[int | str, ...]) -> type[BaseModel] | None:
    model: type[BaseModel] = VehicleParameters
    for part in location:
        annotation = model.model_fields[str(part)].annotation if str(part) in model.model_fields else None
        if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
            return None
        model = annotation
    return model


def _keys_at(location: tuple[int | str, ...]) -> tuple[str, ...]:
    model = _model_at(location)
    return tuple(model.model_fields) if model else ()


def _description(location: tuple[int | str, ...]) -> str:
    named = tuple(part for part in location if isinstance(part, str))
    model = _model_at(named[:-1])
    if model is None or not named or named[-1] not in model.model_fields:
        return ""
    description = model.model_fields[named[-1]].description
    return f" ({description})" if description else ""


def _suggestion(given: str, allowed: tuple[str, ...]) -> str:
    close = difflib.get_close_matches(
        given.lower(), {name.lower(): name for name in allowed}, n=1, cutoff=0.5
    )
    return f" (did you mean {next(n for n in allowed if n.lower() == close[0])!r}?)" if close else ""

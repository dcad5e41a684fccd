"""A traffic scenario as a TOML file.

The file speaks of km, km/h, veh/km and veh/h, as its keys say. A preset is known by its name, any other file
by a path that ends in ``.toml``.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from drivecycles.traffic import scenario_parts
from drivecycles.traffic.errors import TrafficError
from drivecycles.traffic.naming import suggest
from drivecycles.traffic.probe import Probe
from drivecycles.traffic.scenario import Scenario

PRESETS = Path(__file__).parent / "presets"
MOST_COMPLAINTS = 5


def scenario_names() -> list[str]:
    """Names of the scenarios that come with the package."""
    return sorted(path.stem for path in PRESETS.glob("*.toml"))


def load_scenario(name_or_path: str | Path) -> Scenario:
    """Load a preset by name, or a TOML file by path.

    Raises
    ------
    TrafficError
        When there is none, or the file is not a scenario; says which key, what was given and what is allowed.
    """
    path = Path(name_or_path)
    if path.suffix != ".toml":
        name, names = str(name_or_path).strip().lower(), scenario_names()
        if name not in names:
            raise TrafficError(
                f"no traffic scenario is called {str(name_or_path)!r}; known are {', '.join(names)},"
                f" or give the path of a .toml file{suggest(name, names)}"
            )
        path = PRESETS / f"{name}.toml"
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise TrafficError(f"cannot read the scenario {path}: {error.strerror or error}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise TrafficError(f"{path} is not valid TOML: {error}") from error
    return parse_scenario(data, str(path))


def parse_scenario(data: dict[str, Any], origin: str) -> Scenario:
    """Validate the content of a scenario file; ``origin`` names it in errors."""
    try:
        scenario = Scenario.model_validate(data)
    except ValidationError as error:
        lines = [_explained(dict(one)) for one in error.errors()[:MOST_COMPLAINTS]]
        raise TrafficError(f"{origin} does not describe traffic:\n" + "\n".join(lines)) from error
    scenario._origin = origin
    try:
        return scenario.check()
    except TrafficError as error:
        said = str(error)
        raise TrafficError(said if said.startswith(origin) else f"{origin}: {said}") from None


def _explained(error: dict[str, Any]) -> str:
    where = ".".join(str(part) for part in error["loc"]) or "scenario"
    message = str(error["msg"]).removeprefix("Value error, ")
    if error["type"] == "extra_forbidden":
        known = _keys_at(error["loc"][:-1])
        message = f"there is no such key{suggest(str(error['loc'][-1]), known)}; known are {', '.join(known)}"
    return f"  {where}: {message} (given: {error['input']!r:.60})"


def _keys_at(place: tuple[int | str, ...]) -> list[str]:
    """Give the keys of the table at a place: that of the scenario's own field, or the scenario's."""
    if not place:
        return list(Scenario.model_fields)
    found = getattr(scenario_parts, f"{str(place[0]).capitalize()}Part", None)
    table = Probe if place[0] == "probe" else found
    return [] if table is None else list(table.model_fields)

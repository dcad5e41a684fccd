"""The cycles that come with the package, and how a cycle is named on the command line.

A name is a cycle of the library, the path of a CSV file, or several of these joined by "+".
"""

import difflib
import re
import tomllib
from functools import cache
from importlib import resources
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from drivecycles.cycle import DriveCycle, join
from drivecycles.errors import CycleError
from drivecycles.io import parse_csv, read_csv
from drivecycles.larsson import larsson_altitude_m

LARSSON_LAPS = 2


class CycleInfo(BaseModel):
    """What the library knows about one of its cycles."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(description="canonical name")
    title: str = Field(description="short title for tables and figures")
    description: str = Field(description="what the cycle stands for, one sentence")
    source: str = Field(description="where the values come from")
    aliases: tuple[str, ...] = Field(default=(), description="other accepted names")
    file: str | None = Field(default=None, description="CSV in the data folder; None for a composed cycle")


def cycle_names() -> list[str]:
    """Return the canonical names of all cycles in the library, in the order of the registry."""
    return list(_registry())


def cycle_info(name: str) -> CycleInfo:
    """Return title, description and source of a cycle in the library.

    Raises
    ------
    CycleError
        If there is no such cycle.
    """
    key = _lookup().get(_normalize(name))
    if key is None:
        raise CycleError(_unknown(name))
    return _registry()[key]


def load_cycle(spec: str | Path) -> DriveCycle:
    """Load a cycle by name, from a CSV file, or several joined by "+".

    Parameters
    ----------
    spec : str or Path
        For instance ``"udds"``, ``"hwfet+ftp72"`` or ``"logs/trip.csv"``. Names ignore case, blanks, hyphens
        and underscores, and come before files of the same name.

    Raises
    ------
    CycleError
        If a name is unknown (the message suggests the nearest), a file is missing or bad (see `read_csv`), or
        cycles do not meet at the same speed (see `join`).
    """
    if isinstance(spec, Path):
        return read_csv(spec)
    # A file's own name may hold a "+": only what is no file is taken apart.
    if _looks_like_path(spec) and _is_file(spec):
        return read_csv(spec)
    parts = [part.strip() for part in spec.split("+")]
    if not all(parts):
        raise CycleError(f"the cycle {spec!r} has an empty part; write a name, or NAME+NAME to join two")
    return join([_load_one(part) for part in parts])


def _load_one(part: str) -> DriveCycle:
    key = _lookup().get(_normalize(part))
    if key is not None:
        return _load_builtin(key)
    if _looks_like_path(part) or _is_file(part):
        return read_csv(part)
    raise CycleError(_unknown(part))


@cache
def _load_builtin(name: str) -> DriveCycle:
    info = _registry()[name]
    if info.file is None:
        return _larsson()
    text = resources.files("drivecycles").joinpath("data", info.file).read_text(encoding="utf-8")
    return parse_csv(text, name=name, source=info.file)


def _larsson() -> DriveCycle:
    lap = join([_load_builtin("hwfet"), _load_builtin("ftp72")])
    laps = lap.repeat(LARSSON_LAPS)
    altitude_m = larsson_altitude_m(laps.position_m, lap.distance_m)
    return DriveCycle("larsson", laps.time_s, laps.speed_mps, altitude_m)


@cache
def _registry() -> dict[str, CycleInfo]:
    text = resources.files("drivecycles").joinpath("data", "cycles.toml").read_text(encoding="utf-8")
    infos = [CycleInfo.model_validate(entry) for entry in tomllib.loads(text)["cycle"]]
    return {info.name: info for info in infos}


@cache
def _lookup() -> dict[str, str]:
    return {
        _normalize(known): info.name for info in _registry().values() for known in (info.name, *info.aliases)
    }


def _normalize(name: str) -> str:
    return re.sub(r"[\s_-]", "", name.lower())


def _looks_like_path(spec: str) -> bool:
    return "/" in spec or "\\" in spec or Path(spec).suffix.lower() in {".csv", ".txt", ".tsv"}


def _is_file(spec: str) -> bool:
    try:
        return Path(spec).is_file()
    except (OSError, ValueError):  # a name too long or with a NUL is no file
        return False


def _unknown(name: str) -> str:
    near = difflib.get_close_matches(_normalize(name), list(_lookup()), n=1, cutoff=0.5)
    hint = f"did you mean {_lookup()[near[0]]!r}? " if near else ""
    return (
        f"there is no cycle {name!r}; {hint}Known cycles: {', '.join(cycle_names())}; "
        "or give the path of a CSV file, or join several with '+'"
    )

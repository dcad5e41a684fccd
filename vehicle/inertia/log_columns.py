"""Find the channels of a vehicle's log by their header, which must carry the units.

``force_fl_N``, ``Force FL [kN]`` and ``SF front left / N`` mean the same: a name, then a unit. A column whose
name means nothing here is named by the user, with a unit behind a colon where the header has none.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from vehicle.errors import VehicleError

CORNERS = ("fl", "fr", "rl", "rr")
_FORCE = ("force", "suspension force", "strut force", "sf", "f")
_VERTICAL = ("az", "a z", "vertical acceleration", "acceleration z", "acc z", "corner acceleration")
G_MPS2 = 9.80665

CHANNELS: dict[str, tuple[str, tuple[str, ...]]] = {
    "time": ("time", ("time", "elapsed time", "t")),
    **{f"force_{c}": ("force", tuple(f"{name} {c}" for name in _FORCE)) for c in CORNERS},
    "ax": ("acceleration", ("ax", "a x", "longitudinal acceleration", "acceleration x", "acc x")),
    "ay": ("acceleration", ("ay", "a y", "lateral acceleration", "acceleration y", "acc y")),
    "az": ("acceleration", _VERTICAL[:-1]),
    **{f"az_{c}": ("acceleration", tuple(f"{name} {c}" for name in _VERTICAL)) for c in CORNERS},
    "heave": ("acceleration", ("heave", "heave acceleration", "bounce acceleration")),
    "pitch": ("angular acceleration", ("pitch", "pitch acceleration")),
    "roll": ("angular acceleration", ("roll", "roll acceleration")),
    "speed": ("speed", ("speed", "vehicle speed", "velocity", "vx", "v")),
    "position": ("position", ("position", "displacement", "x")),
}
"""Kind of each channel, and the names under which it may appear; a corner may also stand before the name."""

UNITS: dict[str, dict[str, float]] = {
    "time": {
        **dict.fromkeys(("s", "sec", "second", "seconds"), 1.0),
        **{"ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0},
    },
    "force": {"N": 1.0, "kN": 1e3},
    "acceleration": {
        **dict.fromkeys(("m/s2", "m/s^2", "m/s²", "mps2", "m/s/s", "ms-2"), 1.0),
        "g": G_MPS2,
    },
    "angular acceleration": {
        **dict.fromkeys(("rad/s2", "rad/s^2", "rad/s²", "radps2"), 1.0),
        **dict.fromkeys(("deg/s2", "deg/s^2", "deg/s²", "°/s²", "degps2"), 0.017453292519943295),
    },
    "speed": {"m/s": 1.0, "mps": 1.0, "km/h": 1.0 / 3.6, "kmh": 1.0 / 3.6, "kph": 1.0 / 3.6, "mph": 0.44704},
    "position": {"m": 1.0, "mm": 1e-3, "cm": 1e-2},
}
"""Factor from each accepted unit to SI."""

_BRACKET = re.compile(r"^(.*?)\s*[\[({]\s*([^\])}]*)[\])}]\s*$")
_TAIL = re.compile(r"^(.*\S)[\s_]+(\S+)$")
_DIVIDED = re.compile(r"^([^/]+?)\s*/\s*(\S.*)$")
_SPELLED = {"front left": "fl", "front right": "fr", "rear left": "rl", "rear right": "rr"}
_SIMILAR = 0.7


@dataclass(frozen=True)
class Column:
    """Where a channel stands in a row, what the file calls it, and its factor to SI."""

    channel: str
    header: str
    index: int
    factor: float


def find_columns(
    header: Sequence[str],
    required: Iterable[str],
    optional: Iterable[str] = (),
    given: Mapping[str, str] | None = None,
) -> dict[str, Column]:
    """Find channels in a header; other columns are ignored.

    Parameters
    ----------
    header : sequence of str
        Cells of the header row.
    required, optional : iterable of str
        Channels, keys of `CHANNELS`.
    given : mapping of str to str, optional
        The user's own names by channel: ``NAME`` or ``NAME:UNIT``.

    Returns
    -------
    dict of str to Column
        By channel.

    Raises
    ------
    VehicleError
        A channel is missing or there twice, has no unit or an unknown one, or its name is not known.
    """
    cells = [cell.strip() for cell in header]
    named, required = dict(given or {}), tuple(required)
    wanted = (*required, *optional)
    for channel in named:
        if channel not in CHANNELS:
            raise VehicleError(
                f"no channel is called {channel!r}{_hint(channel, wanted)}; known are {', '.join(wanted)}"
            )
    found = {}
    for channel in wanted:
        own = named.get(channel)
        pick = _pick_known(cells, channel) if own is None else _pick_given(cells, channel, own)
        if pick is not None:
            index, unit = pick
            found[channel] = Column(channel, cells[index], index, _factor(cells[index], channel, unit))
        elif channel in required:
            raise VehicleError(_missing(cells, channel))
    return found


def split_header(cell: str, kind: str) -> tuple[str, str]:
    """Take a header cell apart into a plain name and the unit's text, "" for none."""
    text = cell.strip()
    for form, sure in ((_BRACKET, True), (_TAIL, False), (_DIVIDED, True)):
        match = form.match(text)
        if match and (sure or find_unit(match[2], kind) is not None):
            return _plain(match[1]), match[2].strip()
    return _plain(text), ""


def find_unit(text: str, kind: str) -> float | None:
    """Return the factor of a unit of this kind, or None; case does not matter."""
    unit = text.replace(" ", "").casefold()
    return next((factor for known, factor in UNITS[kind].items() if known.casefold() == unit), None)


def _plain(name: str) -> str:
    plain = re.sub(r"[\s_\-./]+", " ", name).strip().casefold()
    for long, short in _SPELLED.items():
        plain = plain.replace(long, short)
    head, _, rest = plain.partition(" ")
    return f"{rest} {head}" if head in CORNERS and rest else plain


def _pick_known(cells: Sequence[str], channel: str) -> tuple[int, str] | None:
    kind, names = CHANNELS[channel]
    ranked = []
    for place, cell in enumerate(cells):
        name, unit = split_header(cell, kind)
        if name in names:
            ranked.append((find_unit(unit, kind) is None, names.index(name), place, unit))
    ranked.sort()
    if len(ranked) > 1 and ranked[0][:2] == ranked[1][:2]:
        raise VehicleError(
            f"the columns {cells[ranked[0][2]]!r} and {cells[ranked[1][2]]!r} both hold {channel}; keep one,"
            " or"
            f" say which: --column {channel}=NAME"
        )
    return ranked[0][2:] if ranked else None


def _pick_given(cells: Sequence[str], channel: str, text: str) -> tuple[int, str]:
    name, unit = text.strip(), ""
    kind = CHANNELS[channel][0]
    places = _places(cells, name, kind)
    if not places and ":" in name:
        name, _, unit = (part.strip() for part in name.rpartition(":"))
        places = _places(cells, name, kind)
    if len(places) != 1:
        many = f"is there {len(places)} times" if places else "is not there"
        raise VehicleError(
            f"the column {name!r} for {channel} {many}{_hint(name, cells)}; the columns are {_quoted(cells)}"
        )
    return places[0], unit or split_header(cells[places[0]], kind)[1]


def _places(cells: Sequence[str], name: str, kind: str) -> list[int]:
    exact = [place for place, cell in enumerate(cells) if cell == name]
    return exact or [p for p, cell in enumerate(cells) if split_header(cell, kind)[0] == _plain(name)]


def _factor(cell: str, channel: str, unit: str) -> float:
    kind = CHANNELS[channel][0]
    factor = find_unit(unit, kind)
    if factor is None:
        allowed = ", ".join(known for known in UNITS[kind] if known.isascii())
        has = (
            f"has the unit {unit!r}, which is none of {allowed}"
            if unit
            else f"has no unit (known: {allowed})"
        )
        raise VehicleError(
            f"the column {cell!r} for {channel} {has}{_hint(unit, UNITS[kind])}; write it into the header, or"
            " give"
            f" it behind a colon: --column {channel}={cell!r}:{next(iter(UNITS[kind]))}"
        )
    return factor


def _missing(cells: Sequence[str], channel: str) -> str:
    kind, names = CHANNELS[channel]
    scores = {
        cell: max(difflib.SequenceMatcher(None, split_header(cell, kind)[0], name).ratio() for name in names)
        for cell in cells
        if cell
    }
    best = max(scores, key=lambda cell: scores[cell], default="")
    hint = f" (is it {best!r}?)" if best and scores[best] >= _SIMILAR else ""
    unit = next(iter(UNITS[kind]))
    return (
        f"there is no column for {channel} among {_quoted(cells)}{hint}; name it {names[0]!r} with its unit,"
        " or say"
        f" which it is: --column {channel}=NAME:{unit}"
    )


def _hint(given: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(given, list(known), n=1, cutoff=0.5) if given else []
    return f"; did you mean {near[0]!r}?" if near else ""


def _quoted(cells: Sequence[str]) -> str:
    shown = ", ".join(repr(cell) for cell in cells[:24])
    return f"{shown} and {len(cells) - 24} more" if len(cells) > 24 else shown

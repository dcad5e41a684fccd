"""What a guess says of one role, and what is added to it: the unit and the sign where the FMU gives none."""

from __future__ import annotations

from dataclasses import dataclass, replace

from bms.plants.fmu.description import Description
from bms.plants.fmu.guess_words import CHARGING, DISCHARGING, joined, parts, plain, suffix

_SI = {"current": "A", "voltage": "V", "power": "W", "capacity": "Ah"}
_KELVIN_FROM = 150.0
_OPPOSITE = {"charge": "discharge", "discharge": "charge"}


@dataclass(frozen=True, slots=True)
class Candidate:
    """A variable that may have a role, and why."""

    name: str
    points: int
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class RoleGuess:
    """The guess for one role.

    Parameters
    ----------
    role : str
        Of the mapping: drive, voltage, current, temperature, soc, initial_soc; or capacity.
    quantity : str
        What it measures; for the drive one of `DRIVES`.
    best : Candidate or None
        The variable; None when nothing looks like it.
    unit : str or None
        Unit that is to stand in the mapping; None where the FMU gives it.
    positive : str or None
        "charge" or "discharge", for current and power.
    doubts : tuple of str
        What was assumed.
    alternatives : tuple of Candidate
        Others, the likeliest first.
    """

    role: str
    quantity: str
    best: Candidate | None
    unit: str | None = None
    positive: str | None = None
    doubts: tuple[str, ...] = ()
    alternatives: tuple[Candidate, ...] = ()


def in_unit(one: RoleGuess, description: Description, found: dict[str, RoleGuess]) -> RoleGuess:
    """Add the unit where the FMU gives none.

    Parameters
    ----------
    one : RoleGuess
        The guess.
    description : Description
        Of the FMU.
    found : dict of str to RoleGuess
        All guesses; the start value of one SOC tells the unit of the other.
    """
    if one.best is None:
        return one
    variable = description.variables[one.best.name]
    # A unit of one, as the FMU calls it, hides per cent too often to be taken for granted without a look.
    if variable.unit is not None:
        return one
    ending = suffix(one.best.name)
    if ending is not None and ending[0] == one.quantity:
        return replace(one, unit=ending[1], doubts=(*one.doubts, "the unit is told by the name alone"))
    if one.quantity == "temperature":
        start = variable.start_number
        unit = "degC" if start is not None and 0.0 < abs(start) < _KELVIN_FROM else "K"
        return replace(one, unit=unit, doubts=(*one.doubts, "the unit is not told"))
    if one.quantity == "soc":
        unit, why = _soc_unit(description, found)
        return replace(one, unit=unit, doubts=(*one.doubts, why))
    return replace(one, unit=_SI[one.quantity], doubts=(*one.doubts, "the unit is not told"))


def _soc_unit(description: Description, found: dict[str, RoleGuess]) -> tuple[str, str]:
    """Fraction or per cent, as the start values of both SOCs have it."""
    for role in ("initial_soc", "soc"):
        best = found[role].best if role in found else None
        start = description.variables[best.name].start_number if best else None
        if start is not None and start > 1.0:
            return "%", f"the unit is not told; {best.name if best else ''} starts at {start:g}"
    return "1", "the unit is not told"


def signed(one: RoleGuess, description: Description, found: dict[str, RoleGuess]) -> RoleGuess:
    """Add the sign, from words such as *discharge* or from Modelica's pins.

    Parameters
    ----------
    one : RoleGuess
        The guess; one of a current or a power.
    description : Description
        Of the FMU.
    found : dict of str to RoleGuess
        All guesses; an output's sign is that of the input unless it is told.
    """
    if one.best is None:
        return one
    variable = description.variables[one.best.name]
    told = _told(joined(plain(variable.description or "").replace("-", " ").split()))
    told = told or _named(set(joined(parts(variable.name))))
    if told is not None:
        return replace(one, positive=told)
    pieces = [piece.lower() for piece in variable.name.replace("[", ".").split(".")]
    if pieces[-1] == "i" and len(pieces) > 1 and pieces[-2] in ("p", "pin_p", "pin", "pos", "positive"):
        return replace(one, positive="charge", doubts=(*one.doubts, "a pin counts what flows into it"))
    drive = found["drive"]
    if one.role == "current" and drive.quantity == "current" and drive.positive:
        return replace(one, positive=drive.positive, doubts=(*one.doubts, "the sign is taken from the input"))
    doubt = "the sign is not told; most battery models count what they give"
    return replace(one, positive="discharge", doubts=(*one.doubts, doubt))


def _named(words: set[str]) -> str | None:
    if words & DISCHARGING:
        return "discharge"
    return "charge" if words & CHARGING else None


def _told(words: list[str]) -> str | None:
    """Sign of a text such as *load current, positive when discharging*."""
    words = [word.strip(".,;:()[]<>=\"'") for word in words]
    for at, word in enumerate(words):
        if word in ("positive", "pos", "positiv", "negative", "neg", "negativ"):
            near = [sign for other in words[at + 1 : at + 5] if (sign := _named({other}))]
            near += [sign for other in reversed(words[max(at - 3, 0) : at]) if (sign := _named({other}))]
            if near:
                return near[0] if word.startswith("pos") else _OPPOSITE[near[0]]
    return _named(set(words))

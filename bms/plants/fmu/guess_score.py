"""How likely a variable of an FMU is a current, a voltage, a SOC: points for its name, unit and description.

A unit that the FMU gives decides alone whether a variable can be it at all. Of the names a whole word such as
*Strom* counts more than a symbol such as *i*, and a symbol counts only where it ends the name or nothing but
words without meaning follow it: ``pin_p.i`` is a current, ``p`` of it is no power.
"""

from __future__ import annotations

from dataclasses import dataclass

from bms.plants.fmu.description import BaseUnit, Description, Variable
from bms.plants.fmu.guess_words import AGAINST, NEUTRAL, SYMBOLS, WORDS, joined, parts, plain, suffix

QUANTITIES = ("current", "voltage", "power", "temperature", "soc", "capacity")

_OF_EXPONENTS = {
    (0, 0, 0, 1): "current",
    (1, 2, -3, -1): "voltage",
    (1, 2, -3, 0): "power",
    (0, 0, 1, 1): "capacity",
}
_OF_NAME = {
    "current": ("a", "ma", "ka", "ua", "ampere", "amp"),
    "voltage": ("v", "mv", "kv", "volt"),
    "power": ("w", "mw", "kw", "watt"),
    "temperature": ("k", "degc", "°c", "celsius", "kelvin", "degf"),
    "soc": ("1", "%", "percent", "pct", "-"),
    "capacity": ("ah", "mah", "a.h", "a.s", "as", "c", "coulomb"),
}
_WORD, _SYMBOL, _UNIT, _SUFFIX, _DESCRIBED, _AGAINST = 6, 4, 4, 3, 2, -6


@dataclass(frozen=True, slots=True)
class Score:
    """Points of a variable as a quantity, and what they are for."""

    points: int
    reasons: tuple[str, ...]


NOTHING = Score(0, ())


def quantity_of(description: Description, unit: str | None) -> str | None:
    """Quantity that a unit measures, by its definition in SI or else by its name.

    Parameters
    ----------
    description : Description
        Gives the definitions.
    unit : str or None
        As the FMU calls it.

    Returns
    -------
    str or None
        One of `QUANTITIES`, "other", or None without a unit.
    """
    if unit is None:
        return None
    for quantity, names in _OF_NAME.items():
        if unit.strip().lower() in names:
            return quantity
    base = description.units.get(unit)
    return "other" if base is None else _of_base(base)


def _of_base(base: BaseUnit) -> str:
    first, rest = base.exponents[:4], base.exponents[4:]
    if not any(rest):
        return _OF_EXPONENTS.get(first, "soc" if not any(first) else "other")
    return "temperature" if base.exponents == (0, 0, 0, 0, 1, 0, 0, 0) else "other"


def score(
    description: Description, variable: Variable, quantity: str, but: frozenset[str] = frozenset()
) -> Score:
    """Points of a variable as a quantity; `NOTHING` when its unit is of another.

    Parameters
    ----------
    description : Description
        Of the FMU.
    variable : Variable
        The variable.
    quantity : str
        One of `QUANTITIES`.
    but : frozenset of str
        Words that do not speak against it this time.
    """
    measured = quantity_of(description, variable.unit)
    if measured not in (None, quantity):
        return NOTHING
    if variable.name == "u" and variable.causality == "input" and measured is None:
        return NOTHING  # what block diagrams call every input
    found = _of_words(variable.name, quantity, but)
    # A number without a dimension may be anything: that 1 or % fits a SOC says little.
    if measured is not None:
        found.append((1 if quantity == "soc" else _UNIT, f"its unit is {variable.unit}"))
    ending = suffix(variable.name)
    if ending is not None and measured is None:
        if ending[0] == quantity:
            found.append((_SUFFIX, f"its name ends in the unit {ending[1]}"))
        elif not _whole_word(variable.name, quantity):
            return NOTHING
    if variable.description:
        found += _of_description(variable.description, quantity)
    points = sum(value for value, _ in found)
    return Score(points, tuple(reason for value, reason in found if value > 0)) if points > 0 else NOTHING


def _whole_word(name: str, quantity: str) -> bool:
    return any(word in WORDS[quantity] for word in joined(parts(name)))


def _of_words(name: str, quantity: str, but: frozenset[str]) -> list[tuple[int, str]]:
    pieces = parts(name)
    words = joined(pieces)
    found = []
    hit = next((word for word in words if word in WORDS[quantity]), None)
    glued = None if hit else next((word for word in words if _holds(word, quantity)), None)
    symbol = _symbol(pieces, quantity)
    if hit:
        found.append((_WORD, f"its name says {hit!r}"))
    elif symbol:
        found.append((_SYMBOL, f"{symbol!r} is the usual symbol"))
    elif glued:
        found.append((_SYMBOL, f"its name holds {glued!r}"))
    found += [
        (_AGAINST, f"but its name says {word!r}") for word in words if word in AGAINST[quantity] - {hit, *but}
    ]
    if found:
        # Of two names that say the same, the shorter is the terminal's and the other some part's.
        found.append((-min(sum(word not in NEUTRAL for word in words) - 1, 3), "and other words"))
    return found


def _holds(word: str, quantity: str) -> bool:
    """Whether a longer word is put together with one of the quantity's, as *Batteriestrom* is."""
    return any(len(part) >= 5 and word.endswith(part) for part in WORDS[quantity])


def _symbol(pieces: list[str], quantity: str) -> str | None:
    """The symbol, where nothing but words without meaning, numbers or a unit follow it."""
    for at in range(len(pieces) - 1, -1, -1):
        piece = pieces[at]
        if piece in SYMBOLS[quantity]:
            return piece
        if not (piece.lower() in NEUTRAL or piece.isdigit() or piece in ("A", "V", "W", "K")):
            return None
    return None


def _of_description(text: str, quantity: str) -> list[tuple[int, str]]:
    words = joined([word for word in plain(text).replace("-", " ").split() if word])
    words = [word.strip(".,;:()[]\"'") for word in words]
    hit = next((word for word in words if word in WORDS[quantity] or _holds(word, quantity)), None)
    if hit is None:
        return []
    found = [(_DESCRIBED, f"its description says {hit!r}")]
    against = next((word for word in words if word in AGAINST[quantity]), None)
    return [*found, (-4, f"but also {against!r}")] if against else found

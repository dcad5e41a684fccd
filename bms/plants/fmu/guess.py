"""Which variable of an FMU is what: a first guess, with its reasons and the other candidates.

Every role is guessed from causality, unit, name and description (`bms.plants.fmu.guess_score`); units and
signs that the FMU does not give are guessed as well, each with a doubt. A guess is for a person to check and
for `bms.plants.fmu.probe` to try out.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from bms.plants.fmu.description import NUMBERS, Description, Variable
from bms.plants.fmu.guess_role import Candidate, RoleGuess, in_unit, signed
from bms.plants.fmu.guess_score import Score, quantity_of, score
from bms.plants.fmu.guess_words import INITIAL, joined, parts

DRIVES = ("current", "power", "voltage")
_LEAST = 4
"""Fewer points than a usual symbol has are no guess."""
_OUTPUT_BONUS = 3
_MOST_ALTERNATIVES = 4
_ASKED = frozenset({"set", "setpoint", "ref", "demand"})


@dataclass(frozen=True, slots=True)
class Guess:
    """All roles, and the inputs that have none and keep a constant value."""

    roles: dict[str, RoleGuess]
    other_inputs: tuple[Variable, ...]


def guess(description: Description) -> Guess:
    """Guess the role of the variables.

    Parameters
    ----------
    description : Description
        Of the FMU.
    """
    numbers = [v for v in description.variables.values() if v.type in NUMBERS and v.scalar]
    inputs = [v for v in numbers if v.causality == "input"]
    found = {"drive": _drive(description, inputs)}
    seen = {one.best.name for one in found.values() if one.best}
    for role in ("voltage", "current", "temperature", "soc"):
        if role == "voltage" and found["drive"].quantity == "voltage":
            continue
        readable = [v for v in numbers if v.causality in ("output", "local") and v.name not in seen]
        found[role] = _role(role, role, _candidates(description, readable, role), description)
        if found[role].best is not None:
            seen.add(found[role].best.name)  # type: ignore[union-attr]
    soc = found["soc"].best
    # The true SOC may be a state whose own start value is set.
    settable = [
        v for v in numbers if _is_settable(v) and (v.name not in seen or (soc and v.name == soc.name))
    ]
    found["initial_soc"] = _role("initial_soc", "soc", _starts(description, settable), description)
    parameters = [v for v in numbers if v.causality == "parameter"]
    found["capacity"] = _role(
        "capacity", "capacity", _candidates(description, parameters, "capacity"), description
    )
    found = {role: in_unit(one, description, found) for role, one in found.items()}
    for role in ("drive", "current"):
        if found[role].quantity != "voltage":
            found[role] = signed(found[role], description, found)
    others = tuple(v for v in inputs if v.name not in seen)
    return Guess(found, others)


def _is_settable(variable: Variable) -> bool:
    return variable.causality == "parameter" or (
        variable.causality in ("local", "output")
        and variable.start is not None
        and variable.initial in ("exact", "approx")
    )


def _drive(description: Description, inputs: list[Variable]) -> RoleGuess:
    """The input that loads the battery: a current, a power, or a voltage."""
    ranked = [(quantity, _candidates(description, inputs, quantity)) for quantity in DRIVES]
    known = [(quantity, found) for quantity, found in ranked if found]
    if known:
        quantity, found = max(known, key=lambda one: one[1][0].points)
        rest = [c for other, others in known if other != quantity for c in others]
        return _role("drive", quantity, [*found, *rest], description)
    if len(inputs) == 1:
        only = Candidate(inputs[0].name, 0, ("it is the only input",))
        return replace(
            _role("drive", "current", [only], description), doubts=("that it is a current is not told",)
        )
    listed = tuple(Candidate(v.name, 0, ("it is an input",)) for v in inputs[:_MOST_ALTERNATIVES])
    return RoleGuess("drive", "current", None, alternatives=listed)


def _candidates(description: Description, variables: Iterable[Variable], quantity: str) -> list[Candidate]:
    found = [_candidate(v, score(description, v, quantity, _fine(v))) for v in variables]
    return sorted((c for c in found if c.points >= _LEAST), key=lambda c: -c.points)


def _fine(variable: Variable) -> frozenset[str]:
    """An input may well be called a set point, an output hardly."""
    return _ASKED if variable.causality == "input" else frozenset()


def _candidate(variable: Variable, points: Score) -> Candidate:
    reasons = points.reasons
    total = points.points
    if total and variable.causality in ("output", "input", "parameter"):
        total += _OUTPUT_BONUS
        reasons = (f"it is {'an' if variable.causality[0] in 'oi' else 'a'} {variable.causality}", *reasons)
    return Candidate(variable.name, total, reasons)


def _starts(description: Description, variables: Iterable[Variable]) -> list[Candidate]:
    """Candidates for the SOC at the start."""
    found = []
    for variable in variables:
        points = score(description, variable, "soc", INITIAL)
        words = joined(parts(variable.name))
        begins = bool(set(words) & INITIAL) or words[-1] == "0"
        if points.points:
            extra = 3 if begins else 0
            named = (*points.reasons, "it is a start value")
            reasons = named if begins or variable.causality != "parameter" else points.reasons
            found.append(_candidate(variable, Score(points.points + extra, reasons)))
        elif words in (["x", "0"], ["x", "init"]) and quantity_of(description, variable.unit) in (
            None,
            "soc",
        ):
            found.append(Candidate(variable.name, _LEAST, ("it may be the start of the only state",)))
    return sorted((c for c in found if c.points >= _LEAST), key=lambda c: -c.points)


def _role(role: str, quantity: str, found: list[Candidate], description: Description) -> RoleGuess:
    if not found:
        return RoleGuess(role, quantity, None)
    doubts: tuple[str, ...] = ()
    if len(found) > 1 and found[1].points == found[0].points:
        doubts = (f"{found[1].name} looks as likely",)
    return RoleGuess(
        role, quantity, found[0], doubts=doubts, alternatives=tuple(found[1 : 1 + _MOST_ALTERNATIVES])
    )

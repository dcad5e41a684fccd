"""A first mapping for an FMU, as text: every guess is marked, with its reason and the other candidates."""

from __future__ import annotations

import json
import re

from bms.plants.fmu.description import Description, Variable
from bms.plants.fmu.guess import Guess
from bms.plants.fmu.guess_role import Candidate, RoleGuess

STEP_S = 1.0
MISSING = "?"
"""Name in the place of a variable that could not be guessed; no mapping with it can be used."""
_COMMENT_COLUMN = 34
_MOST_PARAMETERS = 30
_ANY_OHM = 0.01
_AMPERE_HOURS = {
    "Ah": 1.0,
    "A.h": 1.0,
    "mAh": 1e-3,
    "As": 1.0 / 3600.0,
    "A.s": 1.0 / 3600.0,
    "C": 1.0 / 3600.0,
}
_REQUIRED = ("drive", "voltage")


def first_mapping(description: Description, guess: Guess, source: str = "") -> str:
    """Write a mapping from a guess.

    Parameters
    ----------
    description : Description
        Of the FMU.
    guess : Guess
        What `bms.plants.fmu.guess.guess` made of it.
    source : str
        Name of the file, for the heading.

    Returns
    -------
    str
        TOML. What could not be guessed but is needed has the name "?".
    """
    lines = _heading(description, source)
    for role in ("drive", "voltage", "current", "temperature", "soc", "initial_soc"):
        one = guess.roles.get(role)
        if one is None or (role == "current" and _drives_by_voltage(guess) and one.best is None):
            lines += _needed(role) if one is not None else []
        elif one.best is not None or role in _REQUIRED:
            known = None if one.best is None else description.variables[one.best.name].unit
            lines += ["", *_table(one, known)]
        else:
            lines += ["", f"# [{role}]", f"# Nothing looks like the {_words(role)}."]
    lines += ["", *_pack(description, guess), "", *_scale(), *_inputs(guess.other_inputs)]
    return "\n".join([*lines, *_parameters(description, guess)]) + "\n"


def _drives_by_voltage(guess: Guess) -> bool:
    return guess.roles["drive"].quantity == "voltage"


def _needed(role: str) -> list[str]:
    return ["", f"[{role}]", _line("variable", MISSING, "nothing looks like it, and it is needed here")]


def _heading(description: Description, source: str) -> list[str]:
    tool = f", {description.tool}" if description.tool else ""
    interface = description.interface()
    others = [kind for kind in description.interfaces if kind != interface.kind]
    offers = f"the FMU offers {others[0]} as well" if others else "what the FMU offers"
    return [
        f"# A first mapping of {source or description.name} (FMI {description.version}.0{tool}).",
        '# Lines marked "guess" want a look; then let the FMU be tried: socwise cosim probe',
        "schema = 1",
        _line("kind", interface.kind, offers),
        _line("step_s", _step_s(description), _step_reason(description)),
    ]


def _step_s(description: Description) -> float:
    interface = description.interface()
    fixed = interface.fixed_step_s or (None if interface.variable_step else description.step_s)
    return fixed or STEP_S


def _step_reason(description: Description) -> str:
    interface = description.interface()
    if interface.fixed_step_s:
        return "the FMU's own fixed step"
    if not interface.variable_step:
        return "the FMU's step cannot be changed while it runs"
    own = "" if description.step_s is None else f"; its author's is {description.step_s:g}"
    return f"communication step; the loop's step is a multiple of it{own}"


def _words(role: str) -> str:
    return {"soc": "true SOC", "initial_soc": "SOC at the start"}.get(role, role)


def _table(one: RoleGuess, unit: str | None) -> list[str]:
    lines = [f"[{one.role}]"]
    if one.role == "drive":
        lines.append(_line("role", one.quantity, "guess"))
    if one.best is None:
        lines.append(_line("variable", MISSING, "nothing looks like it, and it is needed"))
    else:
        lines.append(_line("variable", one.best.name, f"guess: {', '.join(one.best.reasons)}"))
    doubts = list(one.doubts)
    if one.unit is not None:
        lines.append(_line("unit", one.unit, f"guess: {_taken(doubts, 'unit')}"))
    elif unit is not None:
        lines.append(f"# its unit is the FMU's own, {unit}")
    if one.positive is not None:
        why = _taken(doubts, "sign", "pin") or "so its name or description says"
        lines.append(_line("positive", one.positive, f"guess: {why}"))
    lines += [f"# {doubt}" for doubt in doubts]
    return [*lines, *(f"# or {_candidate(other)}" for other in one.alternatives)]


def _taken(doubts: list[str], *words: str) -> str:
    """Take the doubt that is about one of the words from the list."""
    for doubt in doubts:
        if any(word in doubt for word in words):
            doubts.remove(doubt)
            return doubt
    return ""


def _candidate(one: Candidate) -> str:
    return f"{_value(one.name)}: {', '.join(one.reasons)}"


def _pack(description: Description, guess: Guess) -> list[str]:
    best = guess.roles["capacity"].best
    lines = ["[pack]"]
    known = None if best is None else capacity_Ah(description, description.variables[best.name], guess)
    if best is None or known is None:
        lines.append("# capacity_Ah =     what the SOC is counted with where the FMU tells none")
    else:
        lines.append(_line("capacity_Ah", known, f"guess: start value of {best.name}"))
    if _drives_by_voltage(guess):
        # The table has to have one; the probe gets by with any.
        return [*lines, _line("resistance_ohm", _ANY_OHM, "guess: `socwise cosim probe --write` measures it")]
    return [*lines, "# resistance_ohm =     `socwise cosim probe --write` measures it"]


def capacity_Ah(description: Description, variable: Variable, guess: Guess) -> float | None:
    """Start value of a capacity in ampere hours; None without a value or a unit that is known.

    Parameters
    ----------
    description : Description
        Gives the units.
    variable : Variable
        The capacity.
    guess : Guess
        Gives the unit where the FMU has none.
    """
    start = variable.start_number
    unit = variable.unit or guess.roles["capacity"].unit
    if start is None or start <= 0.0 or unit is None:
        return None
    base = description.units.get(unit)
    if unit in _AMPERE_HOURS:
        factor = _AMPERE_HOURS[unit]
    elif base is not None:
        factor = base.factor / 3600.0
    else:
        return None
    return float(f"{factor * start:.9g}")


def _scale() -> list[str]:
    return [
        "# Where the FMU is one cell and the loop is to see a pack:",
        "[scale]",
        "series = 1",
        "parallel = 1",
    ]


def _inputs(variables: tuple[Variable, ...]) -> list[str]:
    if not variables:
        return []
    lines = ["", "# Inputs without a role here; they keep these values.", "[inputs]"]
    for variable in variables:
        start = variable.start_number
        told = "its start value" if start is not None else "guess: the FMU gives no start value"
        unit = f", in {variable.unit}" if variable.unit else ""
        lines.append(_line(variable.name, 0.0 if start is None else start, f"{told}{unit}"))
    return lines


def _parameters(description: Description, guess: Guess) -> list[str]:
    used = {one.best.name for one in guess.roles.values() if one.best is not None and one.role != "capacity"}
    found = [
        v
        for v in description.variables.values()
        if v.causality == "parameter" and v.name not in used and v.scalar
    ]
    if not found:
        return []
    lines = ["", "# Parameters that can be set; take away the # of a line to do so.", "[parameters]"]
    for variable in found[:_MOST_PARAMETERS]:
        unit = f"in {variable.unit}" if variable.unit else ""
        start = variable.start_number
        lines.append("# " + _line(variable.name, 0.0 if start is None else start, unit))
    rest = len(found) - _MOST_PARAMETERS
    return [*lines, f"# and {rest} more"] if rest > 0 else lines


def _line(key: str, value: str | float, comment: str) -> str:
    name = key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _value(key)
    text = f"{name} = {_value(value)}"
    return f"{text:<{_COMMENT_COLUMN}}  # {_one_line(comment)}" if comment else text


def _value(value: str | float) -> str:
    # A TOML string takes the same escapes as one of JSON.
    return json.dumps(value, ensure_ascii=False)


def _one_line(text: str) -> str:
    return " ".join(text.split())

"""The car of a case: a concept with the values that the study's factors give it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any, get_args

from pydantic import BaseModel, Field, ValidationError

from bms import Pack
from ems import Concept
from socwise.study.errors import StudyError

DIGITS = 12
_TAKEN = frozenset(
    {
        "uncertainty",
        "mass_kg",
        "mass_sd_kg",
        "initial_soc",
        "initial_soc_sd",
        "terminal.target_soc",
        "window.low",
        "window.high",
    }
)
"""What has a factor of its own, or follows from one."""


class StudyConcept(Concept):
    """A concept whose pack has parallel strings more, or less, than the one that it names.

    Everything that a string carries is shared: the capacity grows by the factor, the resistance falls by it,
    and the current limits grow by it, at the same voltage. The mass of the car stays (``mass_kg`` is a factor
    of its own), and the factor need not be whole.
    """

    capacity_factor: float = Field(default=1.0, gt=0.0, description="strings in parallel, per string")

    def load_pack(self) -> Pack:
        """Load the pack that the concept names, with its parallel strings."""
        return scaled(super().load_pack(), self.capacity_factor)


def scaled(pack: Pack, factor: float) -> Pack:
    """Return a pack with ``factor`` times as many parallel strings."""
    if factor == 1.0:
        return pack
    charge_ohm = pack.charge_resistance_ohm
    return pack.model_copy(
        update={
            "name": f"{pack.name} x{factor:g}",
            "capacity_Ah": pack.capacity_Ah * factor,
            "resistance_ohm": tuple(ohm / factor for ohm in pack.resistance_ohm),
            "charge_resistance_ohm": None
            if charge_ohm is None
            else tuple(ohm / factor for ohm in charge_ohm),
            "discharge_limit_A": pack.discharge_limit_A * factor,
            "charge_limit_A": pack.charge_limit_A * factor,
        }
    )


def car_of(concept: Concept, point: Mapping[str, Any]) -> StudyConcept:
    """Give a concept the values of a point of the study.

    Where the window moves, what lies in it moves along unless the point says otherwise: the SOC at the start
    and the target keep their relative place in the window, and the rule-based policy its distance to the
    target.

    Parameters
    ----------
    concept : Concept
        As it was loaded.
    point : mapping
        Values by factor; those that are no concern of the concept's are left alone.

    Raises
    ------
    StudyError
        When the values do not make a concept; the problems are in plain words.
    """
    data = concept.model_dump()
    _move_window(data, point)
    for name in ("mu", "gamma", "beta"):
        if name in point:
            data["uncertainty"][name] = point[name]
    _scale_penalties(data, point)
    if "mass_kg" in point:
        data |= {"mass_kg": point["mass_kg"], "mass_sd_kg": 0.0}
    if "initial_soc_sd" in point:
        data["initial_soc_sd"] = point["initial_soc_sd"]
    if "capacity_factor" in point:
        data["capacity_factor"] = point["capacity_factor"]
    if "capacity_Ah" in point:
        data["capacity_factor"] = float(point["capacity_Ah"]) / concept.load_pack().capacity_Ah
    for path in settable():
        if path in point:
            _put(data, path, point[path])
    try:
        car = StudyConcept.model_validate(data)
    except ValidationError as error:
        raise StudyError("the values do not make a car", [_said(item) for item in error.errors()]) from error
    car._folder = concept._folder
    return car


@cache
def settable() -> list[str]:
    """Paths of the concept's numbers that no factor of its own sets."""
    return [path for path in _numbers(Concept) if path not in _TAKEN and path.split(".")[0] not in _TAKEN]


def _numbers(model: type[BaseModel], prefix: str = "") -> list[str]:
    found = []
    for name, field in model.model_fields.items():
        kind = field.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            found += _numbers(kind, f"{prefix}{name}.")
        elif kind is float or float in get_args(kind):
            found.append(f"{prefix}{name}")
    return found


def _move_window(data: dict[str, Any], point: Mapping[str, Any]) -> None:
    window, terminal = data["window"], data["terminal"]
    old_low, old_width = window["low"], window["high"] - window["low"]
    low, high = point.get("window_low", window["low"]), point.get("window_high", window["high"])
    width = point.get("window_width", old_width * point.get("window_scale", 1.0))
    if "window_width" in point or "window_scale" in point:
        centre = old_low + 0.5 * old_width
        low, high = centre - 0.5 * width, centre + 0.5 * width
    target, start = terminal["target_soc"], data["initial_soc"]
    if (low, high) != (window["low"], window["high"]):
        window["low"], window["high"] = round(low, DIGITS), round(high, DIGITS)

        def moved(soc: float) -> float:
            return float(round(low + (soc - old_low) / old_width * (high - low), DIGITS))

        terminal["target_soc"], data["initial_soc"] = moved(target), moved(start)
    if "initial_soc" in point:
        data["initial_soc"] = point["initial_soc"]
    if "target_soc" in point:
        terminal["target_soc"] = point["target_soc"]
    if terminal["target_soc"] != target:
        rules = data["rule_based"]
        rules["sustain_soc"] = round(rules["sustain_soc"] + terminal["target_soc"] - target, DIGITS)


def _scale_penalties(data: dict[str, Any], point: Mapping[str, Any]) -> None:
    steepness, slope = point.get("penalty_steepness", 1.0), point.get("penalty_slope", 1.0)
    window, terminal = data["window"], data["terminal"]
    for name in window:
        if name.startswith("jump"):
            window[name] *= steepness
        elif name.startswith("slope"):
            window[name] *= steepness * slope
    for name in terminal:
        if name.startswith(("jump", "slope")):
            terminal[name] *= point.get("terminal_penalty", 1.0)


def _put(data: dict[str, Any], path: str, value: Any) -> None:
    *outer, last = path.split(".")
    for name in outer:
        data = data[name]
    data[last] = value


def _said(item: Any) -> str:
    where = ".".join(str(part) for part in item["loc"])
    reason = item["msg"].removeprefix("Value error, ")
    return f"{where} = {item['input']!r}: {reason}" if where and item["type"] != "value_error" else reason

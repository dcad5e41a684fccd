"""A vehicle concept: car, battery pack, SOC window and costs, as data ([L] Table 1 and Fig 4)."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, ValidationError, model_validator

from bms import Pack, UncertaintyModel, load_pack
from ems.errors import EmsError
from ems.penalty import Terminal, Window
from vehicle import Vehicle, load_vehicle

PRESETS = Path(__file__).parent / "presets"


class RuleParameters(BaseModel):
    """Thresholds of the rule-based policy (`ems.policies.rule_based`)."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    sustain_soc: float = Field(gt=0.0, lt=1.0, description="SOC held once the battery is depleted to it")
    band: float = Field(gt=0.0, lt=0.5, description="half-width over which the rules change over")
    start_power_W: float = Field(gt=0.0, description="wheel power that starts the engine at that SOC, W")
    deplete_power_W: float = Field(gt=0.0, description="wheel power that starts it above the band, W")
    charge_power_W: float = Field(ge=0.0, description="battery power asked of it at the band's low end, W")


class Concept(BaseModel):
    """Everything about a concept that does not depend on the trip.

    Raises
    ------
    pydantic.ValidationError
        When a value is missing, unknown or out of range; `load_concept` turns it into an `EmsError`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: str = Field(min_length=1, description="short name, used in tables and file names")
    vehicle: str = Field(description="preset name, or path of a vehicle TOML relative to this file")
    pack: str = Field(description="preset name, or path of a pack TOML relative to this file")
    mass_kg: float | None = Field(default=None, gt=0.0, description="mass in place of the vehicle's own, kg")
    mass_sd_kg: float = Field(default=0.0, ge=0.0, description="standard deviation of that mass, kg")
    initial_soc: float = Field(gt=0.0, lt=1.0, description="SOC estimate at the start")
    initial_soc_sd: float = Field(ge=0.0, lt=0.3, description="standard deviation of its error")
    start_fuel_kg: float = Field(default=0.35e-3, ge=0.0, description="fuel of an engine start, kg")
    shortfall_kg_per_MJ: float = Field(
        default=1.0, gt=0.0, description="price of energy that was demanded but not delivered, kg/MJ"
    )
    window: Window
    terminal: Terminal
    uncertainty: UncertaintyModel = Field(default=UncertaintyModel(), description="gamma, beta, mu")
    rule_based: RuleParameters
    _folder: Path = PrivateAttr(default=PRESETS)

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if not self.window.low <= self.initial_soc <= self.window.high:
            raise ValueError(
                f"initial_soc {self.initial_soc:g} is outside the window"
                f" {self.window.low:g} to {self.window.high:g}"
            )
        if self.initial_soc_sd**2 >= self.initial_soc * (1.0 - self.initial_soc):
            raise ValueError(
                f"initial_soc_sd {self.initial_soc_sd:g} is more than a belief in [0, 1] can have"
            )
        if self.mass_kg is None and self.mass_sd_kg:
            raise ValueError("mass_sd_kg belongs to mass_kg; give both, or put it into the vehicle's file")
        return self

    def load_vehicle(self) -> Vehicle:
        """Load the vehicle that the concept names, with the mass that the concept gives."""
        vehicle = load_vehicle(self._resolve(self.vehicle))
        return vehicle if self.mass_kg is None else vehicle.with_mass(self.mass_kg, self.mass_sd_kg)

    def with_mass(self, mass_kg: float, sd_kg: float = 0.0) -> Self:
        """Return the concept with another mass of its vehicle; see `vehicle.Vehicle.with_mass`."""
        return self.model_copy(update={"mass_kg": mass_kg, "mass_sd_kg": sd_kg})

    def load_pack(self) -> Pack:
        """Load the pack that the concept names."""
        return load_pack(self._resolve(self.pack))

    def _resolve(self, name: str) -> str | Path:
        return self._folder / name if name.endswith(".toml") else name


def concept_names() -> list[str]:
    """Names of the concepts that come with socwise."""
    return sorted(path.stem for path in PRESETS.glob("*.toml"))


def load_concept(name_or_path: str | Path) -> Concept:
    """Load a preset by name, or a TOML file by path.

    Parameters
    ----------
    name_or_path : str or Path
        One of `concept_names`, or the path of a ``.toml`` file.

    Raises
    ------
    EmsError
        Unknown name (with the nearest known one), unreadable file, unknown key, value out of range.
    """
    path = Path(name_or_path)
    if path.suffix != ".toml":
        path = PRESETS / f"{str(name_or_path).lower()}.toml"
        if not path.is_file():
            near = difflib.get_close_matches(str(name_or_path).lower(), concept_names(), n=1, cutoff=0.4)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise EmsError(
                f"no concept is called {str(name_or_path)!r}; known are {', '.join(concept_names())},"
                f" or give the path of a .toml file{hint}"
            )
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise EmsError(f"cannot read the concept file {path}: {error.strerror or error}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise EmsError(f"{path} is not valid TOML: {error}") from error
    concept = parse_concept(data, str(path))
    concept._folder = path.parent
    return concept


def parse_concept(data: dict[str, Any], origin: str) -> Concept:
    """Validate the content of a concept file; ``origin`` names it in errors."""
    try:
        return Concept(**data)
    except ValidationError as error:
        lines = [
            f"  {'.'.join(str(part) for part in item['loc']) or 'concept'}: {item['msg']}"
            f" (given: {item['input']!r:.60})"
            for item in error.errors()
        ]
        raise EmsError(f"{origin} does not describe a concept:\n" + "\n".join(lines)) from error

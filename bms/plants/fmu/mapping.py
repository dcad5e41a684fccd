"""``MAPPING.toml``: which of an FMU's variables is what, in which unit and with which sign."""

from __future__ import annotations

import json
from collections.abc import Mapping as Dictionary
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from bms.errors import BatteryError
from bms.plants.fmu.channel import Kind
from bms.toml_file import complaint, read_toml, suggestion

SCHEMA = 1
"""The version of the format."""

STRICT = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)

Sign = Literal["charge", "discharge"]
Value = float | bool


class Drive(BaseModel):
    """What the FMU is driven by."""

    model_config = STRICT

    role: Literal["current", "power", "voltage"] = Field(description="what the input is")
    variable: str = Field(min_length=1, description="name of the input")
    unit: str | None = Field(default=None, description="its unit; left out: the FMU's own")
    positive: Sign | None = Field(
        default=None, description='what a positive current or power does, "charge" or "discharge"'
    )
    start: float | None = Field(
        default=None, description="the input before the first step, in its unit; left out: as the FMU has it"
    )

    @model_validator(mode="after")
    def _has_a_sign(self) -> Self:
        if self.role == "voltage" and self.positive is not None:
            raise ValueError("a voltage has no sign; take positive out")
        if self.role != "voltage" and self.positive is None:
            raise ValueError(f'a {self.role} needs positive = "charge" or "discharge"; FMUs disagree on it')
        return self


class Output(BaseModel):
    """A variable that is read, or a start value that is set."""

    model_config = STRICT

    variable: str = Field(min_length=1, description="name of the variable")
    unit: str | None = Field(default=None, description="its unit; left out: the FMU's own")


class CurrentOutput(Output):
    """The current that the FMU says has flowed."""

    positive: Sign = Field(description='what a positive current does, "charge" or "discharge"')


class Scale(BaseModel):
    """The FMU is one cell or module, the loop sees a pack of them."""

    model_config = STRICT

    series: float = Field(default=1.0, gt=0.0, description="how many in series; voltage grows with it")
    parallel: float = Field(default=1.0, gt=0.0, description="how many in parallel; current grows with it")


class PackFigures(BaseModel):
    """What is known of the pack, after scaling."""

    model_config = STRICT

    capacity_Ah: float | None = Field(
        default=None, gt=0.0, description="capacity, Ah; counts the SOC where the FMU has no output for it"
    )
    resistance_ohm: float = Field(
        default=0.0, ge=0.0, description="series resistance, ohm; finds the current that gives a power"
    )


class Mapping(BaseModel):
    """Content of a mapping file.

    Raises
    ------
    pydantic.ValidationError
        When a value is missing, unknown, or out of range; `load_mapping` turns it into a `BatteryError`.
    """

    model_config = STRICT

    kind: Kind | None = Field(
        default=None,
        description='"co-simulation" or "model-exchange"; left out: what the FMU has, co-simulation first',
    )
    step_s: float = Field(default=1.0, gt=0.0, description="communication step, s")
    tolerance: float = Field(
        default=1e-8, gt=0.0, lt=0.1, description="relative tolerance of the solver (model exchange)"
    )
    drive: Drive = Field(description="what the FMU is driven by")
    voltage: Output | None = Field(default=None, description="terminal voltage")
    current: CurrentOutput | None = Field(default=None, description="current, where the FMU gives it")
    temperature: Output | None = Field(default=None, description="temperature, where the FMU gives it")
    soc: Output | None = Field(default=None, description="true SOC, where the FMU gives it")
    initial_soc: Output | None = Field(default=None, description="start value of the SOC")
    scale: Scale = Field(default=Scale(), description="cells or modules of the pack")
    pack: PackFigures = Field(default=PackFigures(), description="figures of the pack")
    parameters: dict[str, Value] = Field(default={}, description="other parameters and start values")
    inputs: dict[str, Value] = Field(default={}, description="other inputs, constant")

    @model_validator(mode="after")
    def _is_complete(self) -> Self:
        if self.drive.role == "voltage":
            if self.current is None:
                raise ValueError(
                    "an FMU that is driven by a voltage needs [current], the output that answers"
                )
            if self.pack.resistance_ohm == 0.0:
                raise ValueError(
                    "an FMU that is driven by a voltage needs resistance_ohm in [pack], to find the voltage"
                    " that gives a power"
                )
        elif self.voltage is None:
            raise ValueError("the table [voltage] is missing: which output is the terminal voltage")
        if self.soc is None and self.pack.capacity_Ah is None:
            raise ValueError(
                "there is neither [soc], the output of the true SOC, nor capacity_Ah in [pack] to count it"
                " with"
            )
        return self

    def to_toml(self, comments: Dictionary[str, str] | None = None) -> str:
        """Write the mapping as a file that `load_mapping` reads.

        Parameters
        ----------
        comments : mapping of str to str, optional
            Put above a key (``"drive.variable"``), a table (``"drive"``), a table that is not there
            (``"temperature"``, as a comment of its own), or the whole (``""``); may have several lines.
        """
        waiting = dict(comments or {})
        data = self.model_dump(exclude_none=True, exclude_defaults=True) | {"step_s": self.step_s}
        lines = _comment(waiting.pop("", ""))
        for key, value in {"schema": SCHEMA, **_plain(data)}.items():
            lines += [*_comment(waiting.pop(key, "")), f"{key} = {_toml(value)}"]
        for table in type(self).model_fields:
            above = _comment(waiting.pop(table, ""))
            content = data.get(table)
            if isinstance(content, dict):
                lines += ["", *above, f"[{table}]"]
                for key, value in content.items():
                    note = _comment(waiting.pop(f"{table}.{key}", ""))
                    lines += [*note, f"{_key(key)} = {_toml(value)}"]
            elif above:
                lines += ["", *above]
        for rest in waiting.values():
            lines += ["", *_comment(rest)]
        return "\n".join(lines) + "\n"


def load_mapping(path: str | Path) -> Mapping:
    """Read a mapping file.

    Raises
    ------
    BatteryError
        Unreadable file, unknown key (with the nearest known one), value out of range.
    """
    path = Path(path)
    return parse_mapping(read_toml(path, "mapping"), path)


def parse_mapping(data: dict[str, Any], path: Path) -> Mapping:
    """Validate the content of a mapping file; ``path`` names it in errors."""
    content = dict(data)
    if "schema" not in content:
        raise BatteryError(f"{path} does not say which format it has; put schema = {SCHEMA} at its top")
    schema = content.pop("schema")
    if schema != SCHEMA or isinstance(schema, bool):
        raise BatteryError(f"{path} has schema = {schema!r}; this version reads schema = {SCHEMA}")
    try:
        return Mapping(**content)
    except ValidationError as error:
        headline = f"{path} does not map an FMU{_nearest(error)}"
        raise complaint(error, Mapping, headline, ("schema",)) from error


def _nearest(error: ValidationError) -> str:
    """The suggestion for an unknown key inside a table."""
    tables: dict[str, type[BaseModel]] = {
        "drive": Drive,
        "current": CurrentOutput,
        "scale": Scale,
        "pack": PackFigures,
    }
    for item in error.errors():
        where = item["loc"]
        if item["type"] == "extra_forbidden" and len(where) == 2:
            model = tables.get(str(where[0]), Output)
            near = suggestion(str(where[1]), list(model.model_fields))
            return near or f"; [{where[0]}] knows {', '.join(model.model_fields)}"
    return ""


def _plain(data: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in data.items() if not isinstance(value, dict)}


def _comment(text: str) -> list[str]:
    return [f"# {line}".rstrip() for line in text.splitlines()]


def _key(key: str) -> str:
    bare = key.isascii() and key.replace("_", "a").replace("-", "a").isalnum()
    return key if bare else _toml(key)


def _toml(value: Any) -> str:
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value)

"""What an FMU says of itself: its interfaces, platforms, variables and units.

Reads the unpacked ``modelDescription.xml`` by fmpy's reader, after `bms.plants.fmu.xml_guard` has looked at
it. The schema is not enforced, because working FMUs break it in harmless ways; where the reader stumbles,
what the schema has to say is put into the error.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bms.plants.fmu.archive import DESCRIPTION
from bms.plants.fmu.channel import Kind
from bms.plants.fmu.errors import FmuError
from bms.plants.fmu.xml_guard import check_xml
from bms.toml_file import suggestion

SUPPORTED = "FMI 2.0 and 3.0"

NUMBERS = {
    "Real", "Float64", "Float32", "Integer", "Enumeration", "Boolean",
    "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64",
}  # fmt: skip
"""Types of variables that are numbers."""


@dataclass(frozen=True, slots=True)
class BaseUnit:
    """A unit in terms of SI: ``SI value = factor * value + offset``, of the dimension of the exponents."""

    exponents: tuple[int, int, int, int, int, int, int, int]
    """Of kg, m, s, A, K, mol, cd, rad."""
    factor: float
    offset: float


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable of the FMU."""

    name: str
    reference: int
    type: str
    causality: str
    variability: str
    initial: str | None
    start: str | None
    unit: str | None
    description: str | None
    scalar: bool

    @property
    def start_number(self) -> float | None:
        """Its start value, as far as there is one and it is a number."""
        if self.start is None:
            return None
        text = {"true": "1", "false": "0"}.get(self.start.strip().lower(), self.start)
        try:
            number = float(text)
        except ValueError:
            return None
        return number if math.isfinite(number) else None


@dataclass(frozen=True, slots=True)
class Interface:
    """One of the ways to run the FMU."""

    kind: Kind
    identifier: str
    state: bool
    """Whether its state can be taken and set."""
    needs_tool: bool
    """Whether it needs the program that exported it."""
    once_per_process: bool
    variable_step: bool
    fixed_step_s: float | None
    completed_step: bool
    """Model exchange: whether it wants to hear of every step of the solver."""


@dataclass(frozen=True, slots=True)
class Description:
    """What an FMU says of itself.

    Parameters
    ----------
    version : {2, 3}
        Major version of FMI.
    name, tool, description : str or None
        Name of the model, the program that exported it, what its author says of it.
    token : str
        What ties the description to the library (GUID or instantiation token).
    interfaces : dict
        Those that are supported here, by kind.
    platforms : tuple of str
        Folders below ``binaries`` that hold something.
    variables : dict
        By name, in the order of the file.
    units : dict
        Units that the FMU defines; None for one without a definition in SI.
    states, indicators : int
        Continuous states and event indicators (FMI 2.0).
    step_s, start_s : float or None
        Of its default experiment.
    log_categories : tuple of str
        What it can be asked to log.
    """

    version: int
    name: str
    tool: str | None
    description: str | None
    token: str
    interfaces: Mapping[Kind, Interface]
    platforms: tuple[str, ...]
    variables: Mapping[str, Variable]
    units: Mapping[str, BaseUnit | None]
    states: int
    indicators: int
    step_s: float | None
    start_s: float | None
    log_categories: tuple[str, ...]

    def variable(self, name: str, what: str = "") -> Variable:
        """Find a variable.

        Raises
        ------
        FmuError
            Unknown name, with the nearest known one.
        """
        found = self.variables.get(name)
        if found is None:
            raise FmuError(
                f"the FMU {self.name} has no variable {name!r}{f' ({what})' if what else ''}"
                f"{suggestion(name, list(self.variables))}; `socwise cosim inspect` lists them"
            )
        return found

    def interface(self, kind: Kind | None = None) -> Interface:
        """The interface of a kind; None for co-simulation where there is one, else model exchange.

        Raises
        ------
        FmuError
            When the FMU does not offer it.
        """
        if kind is None:
            kind = "co-simulation" if "co-simulation" in self.interfaces else "model-exchange"
        if kind not in self.interfaces:
            offered = " and ".join(self.interfaces)
            raise FmuError(
                f"the FMU {self.name} offers {offered} only, the mapping asks for {kind}; set kind ="
                f' "{offered}"'
                " or leave it out"
            )
        return self.interfaces[kind]

    @property
    def platform(self) -> str:
        """Name of this platform in FMI's words for the FMU's version, such as linux64 or x86_64-linux."""
        return platform_name(self.version)

    def check_platform(self) -> None:
        """Hold that there is something to run here.

        Raises
        ------
        FmuError
            When the FMU has no library for this platform; names those that it has.
        """
        if self.platform in self.platforms:
            return
        has = f"it has {', '.join(self.platforms)}" if self.platforms else "it has none at all, only sources"
        raise FmuError(
            f"the FMU {self.name} has no library for this platform, {self.platform}; {has}. Export it for"
            f" {self.platform}, or run where it fits"
        )


def platform_name(version: int) -> str:
    """Name of this platform in the words of a version of FMI."""
    import fmpy

    return str(fmpy.platform if version == 2 else fmpy.platform_tuple)


def read_description(folder: Path) -> Description:
    """Read the description of an unpacked FMU.

    Parameters
    ----------
    folder : Path
        What `bms.plants.fmu.archive.unpack` gave.

    Raises
    ------
    FmuError
        When it is malformed, too large, of another FMI version, or offers nothing that can be run here.
    """
    root, attributes = check_xml(folder / DESCRIPTION)
    version = attributes.get("fmiVersion", "")
    if root != "fmiModelDescription" or not version:
        raise FmuError(f"{DESCRIPTION} does not describe an FMU: its root is <{root}> without an fmiVersion")
    if version != "2.0" and not re.match(r"3\.\d", version):
        raise FmuError(
            f"the FMU is of FMI {version}; supported are {SUPPORTED}. Export it again in one of these"
        )
    raw = _read(folder)
    interfaces = _interfaces(raw)
    if not interfaces:
        raise FmuError(
            f"the FMU {raw.modelName} offers neither co-simulation nor model exchange (scheduled execution"
            " is not supported); export it as a co-simulation FMU"
        )
    experiment = raw.defaultExperiment
    return Description(
        version=int(version[0]),
        name=raw.modelName or "without a name",
        tool=raw.generationTool,
        description=raw.description,
        token=raw.guid or "",
        interfaces=interfaces,
        platforms=_platforms(folder),
        variables={variable.name: _variable(variable) for variable in raw.modelVariables},
        units={unit.name: _unit(unit.baseUnit) for unit in raw.unitDefinitions},
        states=raw.numberOfContinuousStates,
        indicators=raw.numberOfEventIndicators,
        step_s=_number(experiment.stepSize) if experiment else None,
        start_s=_number(experiment.startTime) if experiment else None,
        log_categories=tuple(category.name for category in raw.logCategories if category.name),
    )


def _read(folder: Path) -> Any:
    from fmpy.model_description import read_model_description

    try:
        return read_model_description(str(folder / DESCRIPTION), validate=False)
    except Exception as error:
        raise FmuError(
            f"{DESCRIPTION} cannot be understood: {_findings(folder, error)}; export the FMU again"
        ) from error


def _findings(folder: Path, error: Exception) -> str:
    """What the schema says is wrong, or else what the reader said."""
    from fmpy.model_description import ValidationError, read_model_description

    try:
        read_model_description(str(folder / DESCRIPTION), validate=True)
    except ValidationError as found:
        return "; ".join(str(problem) for problem in found.problems[:3])
    except Exception as other:
        return str(other) or type(other).__name__
    return str(error) or type(error).__name__


def _interfaces(raw: Any) -> dict[Kind, Interface]:
    found: dict[Kind, Interface] = {}
    if raw.coSimulation is not None:
        found["co-simulation"] = _interface("co-simulation", raw.coSimulation)
    if raw.modelExchange is not None:
        found["model-exchange"] = _interface("model-exchange", raw.modelExchange)
    return found


def _interface(kind: Kind, raw: Any) -> Interface:
    identifier = raw.modelIdentifier or ""
    if not re.fullmatch(r"\w[\w.\-]*", identifier) or ".." in identifier:
        raise FmuError(
            f"the FMU's modelIdentifier is {identifier!r}; it names a file in the FMU's own folder and has"
            " to be a plain name of letters, digits and underscores. Nothing was loaded"
        )
    return Interface(
        kind=kind,
        identifier=identifier,
        state=bool(raw.canGetAndSetFMUstate),
        needs_tool=bool(raw.needsExecutionTool),
        once_per_process=bool(raw.canBeInstantiatedOnlyOncePerProcess),
        variable_step=bool(getattr(raw, "canHandleVariableCommunicationStepSize", True)),
        fixed_step_s=_number(getattr(raw, "fixedInternalStepSize", None)),
        completed_step=bool(getattr(raw, "needsCompletedIntegratorStep", False)),
    )


def _number(text: Any) -> float | None:
    try:
        number = float(text)
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None


def _platforms(folder: Path) -> tuple[str, ...]:
    binaries = folder / "binaries"
    if not binaries.is_dir():
        return ()
    return tuple(sorted(each.name for each in binaries.iterdir() if each.is_dir() and any(each.iterdir())))


def _variable(raw: Any) -> Variable:
    declared = raw.declaredType
    return Variable(
        name=raw.name,
        reference=raw.valueReference,
        type=raw.type,
        causality=raw.causality or "local",
        variability=raw.variability or "continuous",
        initial=raw.initial,
        start=raw.start,
        unit=raw.unit or (declared.unit if declared is not None else None) or None,
        description=raw.description,
        scalar=not raw.dimensions,
    )


def _unit(raw: Any) -> BaseUnit | None:
    if raw is None:
        return None
    return BaseUnit(
        (raw.kg, raw.m, raw.s, raw.A, raw.K, raw.mol, raw.cd, raw.rad), float(raw.factor), float(raw.offset)
    )

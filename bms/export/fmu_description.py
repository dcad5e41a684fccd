"""The XML of an FMU: modelDescription.xml of FMI 2.0 and 3.0, and buildDescription.xml of 3.0.

Parameters are fixed, inputs continuous, outputs discrete: a block computes at communication points and holds
what it computed. FMI 2.0 counts variables from one where 3.0 uses value references.
"""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree import ElementTree

from bms.errors import BatteryError
from bms.export.block import CSource
from bms.export.fmu_glue import Variable, variables
from bms.export.units import find_unit

TOOL = "socwise"

_VARIABILITY = {
    "parameter": "fixed",
    "input": "continuous",
    "output": "discrete",
    "independent": "continuous",
}
_TYPES = {
    2: {"real": "Real", "integer": "Integer", "boolean": "Boolean"},
    3: {"real": "Float64", "integer": "Int32", "boolean": "Boolean"},
}


@dataclass(frozen=True, slots=True)
class Timing:
    """How an FMU is to be stepped.

    Parameters
    ----------
    step_s : float
        The communication step that suits it.
    fixed : bool
        Whether it wants this step and no other.
    stop_s : float, optional
        The end of what it knows.
    """

    step_s: float = 1.0
    fixed: bool = False
    stop_s: float | None = None


def model_description(block: CSource, version: int, token: str, timing: Timing, sources: list[str]) -> bytes:
    """Write modelDescription.xml.

    Parameters
    ----------
    block : CSource
        The block; its name is the model identifier.
    version : {2, 3}
        FMI 2.0 or 3.0.
    token : str
        GUID or instantiation token.
    timing : Timing
        How it is to be stepped.
    sources : list of str
        C files to be compiled; FMI 3.0 has them in `build_description`.

    Raises
    ------
    BatteryError
        When a port has an unknown unit or a start value that is no number.
    """
    root = ElementTree.Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{version}.0",
            "modelName": block.name,
            "guid" if version == 2 else "instantiationToken": token,
            "description": block.description,
            "generationTool": TOOL,
            "variableNamingConvention": "structured",
        },
    )
    _interface(root, block, version, timing, sources)
    every = variables(block)
    _units(root, every)
    categories = ElementTree.SubElement(root, "LogCategories")
    ElementTree.SubElement(
        categories, "Category", name="logStatusError", description="what went wrong, and where"
    )
    _experiment(root, timing)
    listed = ElementTree.SubElement(root, "ModelVariables")
    structure = ElementTree.SubElement(root, "ModelStructure")
    for reference, variable in enumerate(every):
        (_variable_2 if version == 2 else _variable_3)(listed, reference, variable)
    _structure(structure, version, [r for r, v in enumerate(every) if v.causality == "output"])
    return _as_bytes(root)


def build_description(block: CSource, sources: list[str]) -> bytes:
    """Write sources/buildDescription.xml of FMI 3.0: how to compile the FMU for another platform."""
    root = ElementTree.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ElementTree.SubElement(root, "BuildConfiguration", modelIdentifier=block.name)
    # Contracted products would give other bits than the ones that the tests compare.
    files = ElementTree.SubElement(
        build, "SourceFileSet", language="C99", compilerOptions="-ffp-contract=off -fvisibility=hidden"
    )
    for name in sources:
        ElementTree.SubElement(files, "SourceFile", name=name)
    ElementTree.SubElement(build, "Library", name="m", external="true")
    return _as_bytes(root)


def _interface(
    root: ElementTree.Element, block: CSource, version: int, timing: Timing, sources: list[str]
) -> None:
    spelling = "FMUstate" if version == 2 else "FMUState"
    element = ElementTree.SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": block.name,
            "canHandleVariableCommunicationStepSize": str(not timing.fixed).lower(),
            f"canGetAndSet{spelling}": "true",
            f"canSerialize{spelling}": "true",
        },
    )
    if version == 2:
        element.set("canNotUseMemoryManagementFunctions", "true")
        files = ElementTree.SubElement(element, "SourceFiles")
        for name in sources:
            ElementTree.SubElement(files, "File", name=name)
    elif timing.fixed:
        element.set("fixedInternalStepSize", repr(timing.step_s))


def _units(root: ElementTree.Element, every: tuple[Variable, ...]) -> None:
    element = ElementTree.SubElement(root, "UnitDefinitions")
    for name in dict.fromkeys(v.port.unit for v in every if v.port.kind == "real"):
        unit = find_unit(name)
        base = {symbol: str(exponent) for symbol, exponent in unit.exponents.items()}
        if unit.factor != 1.0:
            base["factor"] = repr(unit.factor)
        if unit.offset != 0.0:
            base["offset"] = repr(unit.offset)
        ElementTree.SubElement(ElementTree.SubElement(element, "Unit", name=name), "BaseUnit", base)


def _experiment(root: ElementTree.Element, timing: Timing) -> None:
    element = ElementTree.SubElement(root, "DefaultExperiment", startTime="0.0")
    if timing.stop_s is not None:
        element.set("stopTime", repr(timing.stop_s))
    element.set("stepSize", repr(timing.step_s))


def _start(variable: Variable) -> str:
    port = variable.port
    # x - x is zero for numbers and NaN for everything else.
    if port.start - port.start != 0.0:
        raise BatteryError(f"the start value of {port.name!r} is {port.start!r}; give a number")
    if port.kind == "boolean":
        return str(port.start != 0.0).lower()
    return str(round(port.start)) if port.kind == "integer" else repr(float(port.start))


def _variable_2(parent: ElementTree.Element, reference: int, variable: Variable) -> None:
    port = variable.port
    element = ElementTree.SubElement(
        parent,
        "ScalarVariable",
        name=port.name,
        valueReference=str(reference),
        description=port.description,
        causality=variable.causality,
        variability=_variability(variable),
    )
    value = ElementTree.SubElement(element, _TYPES[2][port.kind])
    if port.kind == "real":
        value.set("unit", port.unit)
    if variable.causality in ("parameter", "input"):
        value.set("start", _start(variable))
    if variable.causality in ("parameter", "output"):
        element.set("initial", "exact" if variable.causality == "parameter" else "calculated")


def _variable_3(parent: ElementTree.Element, reference: int, variable: Variable) -> None:
    port = variable.port
    element = ElementTree.SubElement(
        parent,
        _TYPES[3][port.kind],
        name=port.name,
        valueReference=str(reference),
        description=port.description,
        causality=variable.causality,
        variability=_variability(variable),
    )
    if port.kind == "real":
        element.set("unit", port.unit)
    if variable.causality in ("parameter", "input"):
        element.set("start", _start(variable))
    if variable.causality in ("parameter", "output"):
        element.set("initial", "exact" if variable.causality == "parameter" else "calculated")


def _variability(variable: Variable) -> str:
    if variable.causality == "input" and variable.port.kind != "real":
        return "discrete"
    return _VARIABILITY[variable.causality]


def _structure(parent: ElementTree.Element, version: int, outputs: list[int]) -> None:
    if version == 2:
        for name in ("Outputs", "InitialUnknowns"):
            element = ElementTree.SubElement(parent, name)
            for reference in outputs:
                ElementTree.SubElement(element, "Unknown", index=str(reference + 1))
        return
    for name in ("Output", "InitialUnknown"):
        for reference in outputs:
            ElementTree.SubElement(parent, name, valueReference=str(reference))


def _as_bytes(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return text + b"\n"

"""Names and files in a study: looked up while it is read, relative to the folder of the study file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, ValidationInfo

from bms.errors import BatteryError
from drivecycles import CycleError, DriveCycle, join, load_cycle, read_csv
from ems import Concept, load_concept
from ems.errors import EmsError
from ems.policies import find_policy

MODEL, CIRCUIT = "model", "ecm"
TRAFFIC = "traffic:"
_TABLES = (".csv", ".txt", ".tsv")
_REFUSALS = (EmsError, BatteryError, CycleError, OSError)


def folder_of(info: ValidationInfo) -> Path:
    """Return the folder that relative paths start from."""
    context: dict[str, Any] = info.context or {}
    return Path(context.get("folder", "."))


def is_traffic(cycle: str) -> bool:
    """Whether a cycle is an ensemble of cycles through traffic."""
    return cycle.strip().lower().startswith(TRAFFIC)


def find_concept(name: str, folder: Path) -> Concept:
    """Load a concept by name, or from a file relative to a folder.

    Raises
    ------
    EmsError
        Unknown name, or a file that is no concept.
    """
    if Path(name).suffix == ".toml" and not (folder / name).is_file():
        raise EmsError(f"there is no file {folder / name}; give the name of a concept or an existing file")
    return load_concept(folder / name if Path(name).suffix == ".toml" else name)


def find_cycle(name: str, folder: Path) -> DriveCycle:
    """Load a cycle by name, from a file relative to a folder, or several joined by '+'.

    Raises
    ------
    CycleError
        Unknown name, bad file, or cycles that do not meet at the same speed.
    """
    if Path(name).suffix.lower() in _TABLES and (folder / name).is_file():
        return read_csv(folder / name)
    parts = [part.strip() for part in name.split("+")]
    if not all(parts):
        raise CycleError(f"{name!r} has an empty part; write a name, or NAME+NAME to join two")
    return join([_one_cycle(part, folder) for part in parts])


def _one_cycle(part: str, folder: Path) -> DriveCycle:
    if Path(part).suffix.lower() not in _TABLES:
        return load_cycle(part)
    path = folder / part
    if not path.is_file():
        raise CycleError(f"there is no file {path}; give the name of a cycle or an existing file")
    return read_csv(path)


def find_scenario(name: str, folder: Path) -> Any:
    """Load the traffic scenario behind ``traffic:``.

    Raises
    ------
    TrafficError
        Unknown name, or a file that is no scenario.
    """
    from drivecycles.traffic.scenario_file import load_scenario

    what = name.strip()[len(TRAFFIC) :].strip()
    return load_scenario(folder / what if what.endswith(".toml") else what)


def _concept(name: str, info: ValidationInfo) -> str:
    try:
        find_concept(name, folder_of(info))
    except _REFUSALS as error:
        raise ValueError(str(error)) from error
    return name


def _cycle(name: str, info: ValidationInfo) -> str:
    try:
        if is_traffic(name):
            find_scenario(name, folder_of(info))
        else:
            find_cycle(name, folder_of(info))
    except (*_REFUSALS, ValueError) as error:
        raise ValueError(str(error)) from error
    return name


def _single_cycle(name: str, info: ValidationInfo) -> str:
    if is_traffic(name):
        raise ValueError("is an ensemble of traffic; give one cycle")
    return _cycle(name, info)


def _policy(name: str) -> str:
    try:
        return str(find_policy(name).NAME)
    except EmsError as error:
        raise ValueError(str(error)) from error


def _estimator(name: str) -> str:
    from bms.estimators.catalogue import estimator_names
    from bms.toml_file import suggestion

    key, known = name.strip().lower().replace("-", "_"), [MODEL, *estimator_names()]
    if key not in known:
        raise ValueError(
            f"no estimator is called {name!r}{suggestion(key, known)}; known are {', '.join(known)}"
        )
    return key


def _plant(name: str, info: ValidationInfo) -> str:
    if name in (MODEL, CIRCUIT):
        return name
    if Path(name).suffix.lower() != ".fmu":
        raise ValueError(f"a plant is {MODEL!r}, {CIRCUIT!r}, or the path of an .fmu file")
    if not (folder_of(info) / name).is_file():
        raise ValueError(
            f"there is no file {folder_of(info) / name}; a plant is {MODEL!r}, {CIRCUIT!r}, or an .fmu file"
        )
    return name


def _file(name: str, info: ValidationInfo) -> str:
    if not (folder_of(info) / name).is_file():
        raise ValueError(f"there is no file {folder_of(info) / name}")
    return name


def _cell(name: str, info: ValidationInfo) -> str:
    try:
        find_cell(name, folder_of(info))
    except _REFUSALS as error:
        raise ValueError(str(error)) from error
    return name


def find_cell(name: str, folder: Path) -> Any:
    """Load a cell by name, or from a file relative to a folder.

    Raises
    ------
    BatteryError
        Unknown name, or a file that is no cell.
    """
    from bms.cells import load_cell

    return load_cell(folder / name if Path(name).suffix == ".toml" else name)


ConceptName = Annotated[str, AfterValidator(_concept)]
CycleName = Annotated[str, AfterValidator(_cycle)]
SingleCycleName = Annotated[str, AfterValidator(_single_cycle)]
PolicyName = Annotated[str, AfterValidator(_policy)]
EstimatorName = Annotated[str, AfterValidator(_estimator)]
PlantName = Annotated[str, AfterValidator(_plant)]
CellName = Annotated[str, AfterValidator(_cell)]
FileName = Annotated[str, AfterValidator(_file)]

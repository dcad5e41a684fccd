"""Battery FMUs for tests: the C sources in `fmu/`, compiled here, with a cell and habits of choice.

The library is the same for every variant of one FMI version; what differs stands in
``resources/battery.txt``.
"""

import os
import re
import shutil
import subprocess
import tempfile
import zipfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest

from bms.cell import Cell
from bms.circuit import tabulate

SOURCES = Path(__file__).parent / "fmu"
COMMON = ("battery.c", "settings.c", "faults.c", "calls.c")
OWN = {"2.0": ("fmi2.c",), "3.0": ("fmi3.c", "fmi3_rest.c")}
TOKEN = "{6f1c1f5e-0a52-4f0c-9a52-5b7f3c1d0e42}"

COMPILER = shutil.which("cc")
REQUIRED = bool(os.environ.get("SOCWISE_REQUIRE_COMPILER"))
needs_compiler = pytest.mark.skipif(
    COMPILER is None and not REQUIRED, reason="there is no C compiler called cc to build an FMU with"
)

UNITS = {
    "A": ('A="1"', 1.0, 0.0),
    "mA": ('A="1" factor="0.001"', 1e-3, 0.0),
    "V": ('kg="1" m="2" s="-3" A="-1"', 1.0, 0.0),
    "mV": ('kg="1" m="2" s="-3" A="-1" factor="0.001"', 1e-3, 0.0),
    "W": ('kg="1" m="2" s="-3"', 1.0, 0.0),
    "kW": ('kg="1" m="2" s="-3" factor="1000"', 1e3, 0.0),
    "1": ("", 1.0, 0.0),
    "%": ('factor="0.01"', 1e-2, 0.0),
    "K": ('K="1"', 1.0, -273.15),
    "degC": ('K="1" offset="273.15"', 1.0, 0.0),
    "s": ('s="1"', 1.0, 0.0),
}
"""Exponents of the base unit, then factor and offset to SI and degrees Celsius."""

USUAL = {"drive": "A", "voltage": "V", "current": "A", "soc": "1", "temperature": "K"}
DRIVES = {"current": ("current", "A"), "power": ("power", "W"), "voltage": ("voltage_set", "V")}
"""Default name and unit of the input by its role."""

NAMES = {
    "ambient": "ambient_temperature",
    "voltage": "voltage",
    "current": "current_out",
    "soc": "soc",
    "temperature": "temperature",
}
STARTS = {
    "initial_soc": 0.7,
    "capacity_factor": 1.0,
    "resistance_factor": 1.0,
    "event_time": -1.0,
    "kick": 0.0,
    "event_soc": 0.5,
    "fault": 0,
    "fault_time": 0.0,
    "fault_below_soc": 2.0,
    "fault_size": 0.0,
}
STATES = ("soc", "v1", "v2", "h", "T")


def enumerated(prefix):
    """Names and values of an enumeration in battery.h."""
    text = (SOURCES / "battery.h").read_text(encoding="utf-8")
    found = re.findall(rf"\b{prefix}_(\w+) = (\d+)", text)
    return {name.lower(): int(value) for name, value in found}


FAULTS = enumerated("FAULT")
REFERENCES = enumerated("VR")


def fmu_cell(**changes):
    """A cell with two relaxation pairs and hysteresis, the same at every SOC: model exchange can meet it."""
    soc = np.linspace(0.0, 1.0, 11)
    ocv_V = 3.1 + 0.7 * soc + 0.15 * np.tanh((soc - 0.15) * 9.0) + 0.05 * np.sin(7.0 * soc)
    values = {
        "name": "fmu",
        "source": "test",
        "capacity_Ah": 2.5,
        "soc": tuple(soc),
        "ocv_V": tuple(ocv_V),
        "resistance_ohm": 0.012,
        "relaxation": (
            {"resistance_ohm": 0.008, "time_constant_s": 9.0},
            {"resistance_ohm": 0.011, "time_constant_s": 140.0},
        ),
        "hysteresis": {"voltage_V": 0.015, "rate": 60.0},
        "voltage_min_V": 2.0,
        "voltage_max_V": 4.6,
        "discharge_limit_A": 50.0,
        "charge_limit_A": 50.0,
    }
    return Cell(**(values | changes))


@cache
def library(fmi):
    """Compile the shared library for one FMI version; its bytes, nothing stays on the disk."""
    import fmpy

    headers = Path(fmpy.__file__).parent / "c-code"
    with tempfile.TemporaryDirectory(prefix="battery-fmu-") as folder:
        target = Path(folder) / f"battery{fmpy.sharedLibraryExtension}"
        command = [COMPILER or "cc", "-std=c11", "-O2", "-Wall", "-Wextra", "-Werror", "-fPIC", "-shared"]
        command += ["-fvisibility=hidden", f"-I{headers}", f"-I{SOURCES}", "-o", str(target)]
        command += [str(SOURCES / name) for name in (*COMMON, *OWN[fmi])]
        done = subprocess.run([*command, "-lm"], capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(f"the test FMU does not compile:\n{done.stderr}")
        return target.read_bytes()


@dataclass(frozen=True)
class Variant:
    """What an FMU is to be like; see `build_fmu`."""

    fmi: str
    kind: str
    cell: Cell
    drive: str
    positive: str
    units: dict
    declare: str
    names: dict
    outputs: tuple
    starts: dict
    zeros_first: bool
    fixed_step_s: float
    state_access: bool
    identifier: str
    loads_max: int

    def start(self, key):
        """Start value as the FMU's own unit has it."""
        value = self.starts[key]
        return value / UNITS[self.units["soc"]][1] if key == "initial_soc" else value


def build_fmu(
    folder,
    *,
    fmi="2.0",
    kind="both",
    cell=None,
    drive="current",
    positive="charge",
    units=None,
    declare="full",
    names=None,
    outputs=None,
    zeros_first=False,
    fixed_step_s=0.0,
    state_access=True,
    identifier="battery",
    file="battery.fmu",
    platforms=None,
    loads_max=0,
    fault=None,
    **starts,
):
    """Build a battery FMU.

    Parameters
    ----------
    folder : Path
        Where to put it.
    fmi : {"2.0", "3.0"}
        Version.
    kind : {"cs", "me", "both"}
        Interfaces it offers.
    cell : Cell, optional
        The battery; `fmu_cell` when left out.
    drive : {"current", "power", "voltage"}
        What its input is; held over a step, the current found at the start of the step.
    positive : {"charge", "discharge"}
        Sign of current and power.
    units : dict, optional
        Unit by role ("drive", "voltage", "current", "soc", "temperature") where it is not the usual one.
    declare : {"full", "names", "no"}
        Whether the description tells the units: with base units, by name only, not at all.
    names : dict, optional
        Other names of variables, by role or by default name.
    outputs : tuple of str, optional
        Roles of the outputs that there are.
    zeros_first : bool
        Outputs are zero until the first step.
    fixed_step_s : float
        The only communication step it takes; 0 for any.
    state_access : bool
        Whether it says that its state can be got and set.
    identifier, file : str
        modelIdentifier, and name of the file.
    platforms : tuple of str, optional
        Folders of the binary; this platform's when left out.
    loads_max : int
        Abort when the library was loaded into a process more often; 0 for never.
    fault : str, optional
        One of `FAULTS`.
    **starts : float
        Start values, see `STARTS`.

    Returns
    -------
    Path
        The file.
    """
    import fmpy

    if outputs is None:
        outputs = ("current", "soc", "temperature") if drive == "voltage" else tuple(NAMES)[1:]
    own = {"drive": DRIVES[drive][0]} | NAMES | {key: key for key in STARTS}
    if drive == "voltage":
        own["current"] = "current"
    variant = Variant(
        fmi=fmi,
        kind=kind,
        cell=cell or fmu_cell(),
        drive=drive,
        positive=positive,
        units=USUAL | {"drive": DRIVES[drive][1]} | (units or {}),
        declare=declare,
        names=own | {"crossings": "crossings"} | (names or {}),
        outputs=tuple(outputs),
        starts=STARTS | {"fault": FAULTS[fault or "none"]} | starts,
        zeros_first=zeros_first,
        fixed_step_s=fixed_step_s,
        state_access=state_access,
        identifier=identifier,
        loads_max=loads_max,
    )
    if platforms is None:
        platforms = (fmpy.platform if fmi == "2.0" else fmpy.platform_tuple,)
    entries = {"modelDescription.xml": description(variant), "resources/battery.txt": resource(variant)}
    for platform in platforms:
        entries[f"binaries/{platform}/{identifier}{fmpy.sharedLibraryExtension}"] = library(fmi)
    return write_zip(Path(folder) / file, entries)


def write_zip(path, entries):
    """Write an archive of names and contents."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in entries.items():
            archive.writestr(name, content)
    return path


def resource(v):
    """What the library reads when it is instantiated."""
    circuit = tabulate(v.cell)
    lines = [
        f"token {TOKEN}",
        f"drive {list(DRIVES).index(v.drive)}",
        f"zeros_first {int(v.zeros_first)}",
        f"loads_max {v.loads_max}",
        f"fault {v.starts['fault']}",
    ]
    singles = {"sign": 1.0 if v.positive == "charge" else -1.0, "fixed_step_s": v.fixed_step_s}
    for role in USUAL:
        singles[f"{role}_factor"] = UNITS[v.units[role]][1]
    singles |= {
        "temperature_offset": UNITS[v.units["temperature"]][2],
        "capacity_C": circuit.capacity_C,
        "activation_K": circuit.activation_K,
        "reference_K": circuit.reference_K,
        "hysteresis_rate": circuit.hysteresis_rate,
        "heat_capacity": circuit.heat_capacity_J_per_K,
        "thermal_resistance": circuit.thermal_resistance_K_per_W,
        "ambient_C": 25.0,
    }
    singles |= {("kick_V" if key == "kick" else key): v.starts[key] for key in STARTS if key != "fault"}
    lines += [f"{key} {float(value).hex()}" for key, value in singles.items()]
    tables = {
        "knot": circuit.knot,
        "cubic": circuit.cubic,
        "node_C": circuit.temperature_C,
        "table": circuit.table,
    }
    for key, values in tables.items():
        lines.append(" ".join([key, *(float(value).hex() for value in np.ravel(values))]))
    return "\n".join(lines) + "\n"


def description(v):
    """Text of modelDescription.xml."""
    three = v.fmi == "3.0"
    token = "instantiationToken" if three else "guid"
    access = "canGetAndSetFMUState" if three else "canGetAndSetFMUstate"
    head = f'modelIdentifier="{v.identifier}" {access}="{str(v.state_access).lower()}"'
    varies = str(v.fixed_step_s == 0.0).lower()
    step = f'canHandleVariableCommunicationStepSize="{varies}"'
    if three and v.fixed_step_s:
        step += f' fixedInternalStepSize="{v.fixed_step_s}"'
    kinds = []
    if v.kind in ("me", "both"):
        told = ' needsCompletedIntegratorStep="false"' if three else ""
        kinds.append(f"<ModelExchange {head}{told}/>")
    if v.kind in ("cs", "both"):
        kinds.append(f"<CoSimulation {head} {step}/>")
    experiment = f' stepSize="{v.fixed_step_s}"' if v.fixed_step_s else ""
    indicators = "" if three else ' numberOfEventIndicators="1"'
    variables = [variable for variable in _variables(v) if three or variable[0] != "time"]
    parts = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<fmiModelDescription fmiVersion="{v.fmi}" modelName="Battery" {token}="{TOKEN}"{indicators}>',
        *kinds,
        *_unit_definitions(v),
        f'<DefaultExperiment startTime="0" stopTime="100"{experiment}/>',
        "<ModelVariables>",
        *(_written(v, variables, variable) for variable in variables),
        "</ModelVariables>",
        "<ModelStructure>",
        *_structure(v, variables),
        "</ModelStructure>",
        "</fmiModelDescription>",
    ]
    return "\n".join(parts) + "\n"


def _unit_definitions(v):
    if v.declare == "no":
        return []
    used = dict.fromkeys([*v.units.values(), "s"])
    full = v.declare == "full"
    units = [
        f"<Unit name={quoteattr(name)}>" + (f"<BaseUnit {UNITS[name][0]}/>" if full else "") + "</Unit>"
        for name in used
    ]
    return ["<UnitDefinitions>", *units, "</UnitDefinitions>"]


def _variables(v):
    """Key, name, reference, causality, variability, start and unit of every variable."""
    at = REFERENCES
    found = [
        ("time", "time", at["time"], "independent", "continuous", None, "s"),
        ("drive", v.names["drive"], at["drive"], "input", "continuous", _first_drive(v), v.units["drive"]),
        ("ambient", v.names["ambient"], at["ambient"], "input", "continuous", None, v.units["temperature"]),
    ]
    factor, offset = UNITS[v.units["temperature"]][1:]
    found[2] = (*found[2][:5], (25.0 - offset) / factor, found[2][6])
    found += [
        (role, v.names[role], at[role], "output", "continuous", None, v.units[role]) for role in v.outputs
    ]
    found.append(("crossings", v.names["crossings"], at["crossings"], "output", "discrete", None, None))
    for key in STARTS:
        unit = {"initial_soc": v.units["soc"], "event_time": "s", "fault_time": "s"}.get(key)
        found.append((key, v.names[key], at[key], "parameter", "fixed", v.start(key), unit))
    if v.kind != "cs":
        for i, state in enumerate(STATES):
            found.append((f"x{i}", f"state.{state}", at["state"] + i, "local", "continuous", None, None))
            name = f"der(state.{state})"
            found.append((f"dx{i}", name, at["derivative"] + i, "local", "continuous", None, None))
        if v.fmi == "3.0":
            found.append(("z", "indicator", at["indicator"], "local", "continuous", None, None))
    return found


def _first_drive(v):
    """Start value of the input: no load."""
    return 3.6 / UNITS[v.units["drive"]][1] if v.drive == "voltage" else 0.0


def _written(v, variables, variable):
    key, name, reference, causality, variability, start, unit = variable
    whole = key in ("fault", "crossings")
    attributes = {
        "name": name,
        "valueReference": reference,
        "causality": causality,
        "variability": variability,
    }
    inner = {}
    if causality in ("output", "local"):
        attributes["initial"] = "calculated"
    if start is not None:
        inner["start"] = int(start) if whole else repr(float(start))
    if unit is not None and v.declare != "no":
        inner["unit"] = unit
    if key.startswith("dx"):
        keys = [other[0] for other in variables]
        at = keys.index(key[1:])
        inner["derivative"] = variables[at][2] if v.fmi == "3.0" else at + 1
    if v.fmi == "3.0":
        return f"<{'Int32' if whole else 'Float64'} {_attributes(attributes | inner)}/>"
    kind = "Integer" if whole else "Real"
    return f"<ScalarVariable {_attributes(attributes)}><{kind} {_attributes(inner)}/></ScalarVariable>"


def _attributes(values):
    return " ".join(f"{name}={quoteattr(str(value))}" for name, value in values.items())


def _structure(v, variables):
    three = v.fmi == "3.0"
    at = {variable[0]: variable[2] if three else i + 1 for i, variable in enumerate(variables)}
    attribute = "valueReference" if three else "index"
    outputs = [at[variable[0]] for variable in variables if variable[3] == "output"]
    derivatives = [at[key] for key in at if key.startswith("dx")]
    states = [at[key] for key in at if key.startswith("x")]
    unknowns = sorted(outputs + derivatives + states)
    if three:
        lines = [f'<Output {attribute}="{index}"/>' for index in outputs]
        lines += [f'<ContinuousStateDerivative {attribute}="{index}"/>' for index in derivatives]
        lines += [f'<InitialUnknown {attribute}="{index}"/>' for index in unknowns]
        return lines + [f'<EventIndicator {attribute}="{at[key]}"/>' for key in at if key == "z"]
    lines = []
    groups = {"Outputs": outputs, "Derivatives": derivatives, "InitialUnknowns": unknowns}
    for group, indices in groups.items():
        if indices:
            lines.append(f"<{group}>")
            lines += [f'<Unknown {attribute}="{index}"/>' for index in indices]
            lines.append(f"</{group}>")
    return lines


def mapping_text(role="current", positive="charge", *, names=None, units=None, cell=None, **top):
    """MAPPING.toml of an FMU built with the same arguments; other keys of the file are written on top.

    ``units`` gives units by role; tables in ``top`` replace or add tables, None leaves one out.
    """
    own = NAMES | {"drive": DRIVES[role][0], "initial_soc": "initial_soc"}
    if role == "voltage":
        own["current"] = "current"
    own |= names or {}
    battery, units = cell or fmu_cell(), units or {}
    tables = {
        "drive": {"role": role, "variable": own["drive"], "positive": positive},
        "voltage": {"variable": own["voltage"]},
        "current": {"variable": own["current"], "positive": positive},
        "temperature": {"variable": own["temperature"]},
        "soc": {"variable": own["soc"]},
        "initial_soc": {"variable": own["initial_soc"]},
        "pack": {"capacity_Ah": battery.capacity_Ah, "resistance_ohm": battery.resistance_ohm},
    }
    if role == "voltage":
        del tables["voltage"], tables["drive"]["positive"]
    for table, unit in units.items():
        if table in tables:
            tables[table]["unit"] = unit
    tables |= {key: value for key, value in top.items() if isinstance(value, dict) or value is None}
    plain = {key: value for key, value in top.items() if not isinstance(value, dict) and value is not None}
    lines = [f"{key} = {_toml(value)}" for key, value in ({"schema": 1, "step_s": 1.0} | plain).items()]
    for table, values in tables.items():
        if values is not None:
            lines += ["", f"[{table}]", *(f"{key} = {_toml(value)}" for key, value in values.items())]
    return "\n".join(lines) + "\n"


def _toml(value):
    return f'"{value}"' if isinstance(value, str) else str(value).lower() if value is True else repr(value)

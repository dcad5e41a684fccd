"""What a BPX file (Battery Parameter eXchange) tells about a cell.

BPX describes the electrodes of a physical model and has no equivalent circuit. Read are the capacity, the
voltage limits, the initial state, the lumped thermal node, and the open-circuit voltage between the
stoichiometry limits (`bms.bpx_potentials`); resistances have to be given. The `bpx` package checks the file
against its schema. It would run the expressions of the potentials as Python code, so it is shown tables in
their place.
"""

from __future__ import annotations

import copy
import json
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from bms.bpx_expression import evaluate
from bms.bpx_potentials import ELECTRODES, NODES, POTENTIALS, held_Ah, open_circuit
from bms.cell import Cell, Quantity, RelaxationPair
from bms.errors import BatteryError, BatteryWarning
from bms.toml_file import complaint

CAPACITY_MISMATCH = 0.05
BEYOND_V = 5e-3

ZERO_CELSIUS_K = 273.15


@dataclass(frozen=True)
class BpxCell:
    """A cell from a BPX file.

    Parameters
    ----------
    cell : Cell
        The cell.
    soc, temperature_C, ambient_C : float or None
        Initial state of charge and temperature, and temperature of the surroundings, where the file has them.
    electrode_capacity_Ah : tuple of float
        Charge between the stoichiometry limits of the negative and of the positive electrode.
    """

    cell: Cell
    soc: float | None
    temperature_C: float | None
    ambient_C: float | None
    electrode_capacity_Ah: tuple[float, float]


def read_bpx(
    path: str | Path,
    *,
    resistance_ohm: Quantity | None = None,
    relaxation: Sequence[RelaxationPair] = (),
    hysteresis_rate: float | None = None,
    discharge_limit_A: float | None = None,
    charge_limit_A: float | None = None,
    heat_transfer_W_per_m2_K: float | None = None,
) -> BpxCell:
    """Read a BPX file (JSON; BPX 1.x, and 0.x as far as the `bpx` package converts it).

    Parameters
    ----------
    path : str or Path
        The file.
    resistance_ohm : float or table over `NODES`
        Series resistance, which BPX does not have; `bms.identify` finds it from a pulse test.
    relaxation : sequence of RelaxationPair
        Relaxation pairs, which BPX does not have either.
    hysteresis_rate : float, optional
        Rate of the hysteresis, to use the file's lithiation and delithiation branches; without it the plain
        potential is used.
    discharge_limit_A, charge_limit_A : float, optional
        Limits of the current; 1 C when left out.
    heat_transfer_W_per_m2_K : float, optional
        Heat transfer to the surroundings, over the file's own.

    Returns
    -------
    BpxCell
        Without thermal node unless the file has density, specific heat, volume and external area, and a heat
        transfer coefficient is known. With a `BatteryWarning` when the file was converted from 0.x, its
        hysteresis is not used, or its electrodes do not hold the nominal capacity.

    Raises
    ------
    BatteryError
        No resistance, file not readable or not BPX, blended electrodes, potentials without a rising
        open-circuit voltage, or the `bpx` package missing.
    """
    file = Path(path)
    if resistance_ohm is None:
        raise BatteryError(
            f"{file}: BPX has no equivalent circuit, so resistance_ohm must be given (and relaxation, if"
            " wanted); identify_pulse finds both from a pulse test"
        )
    raw = _read_json(file)
    model, legacy = _validate(raw, file)
    part = model.parameterisation
    if part.cell is None:
        raise BatteryError(f"{file} has no section Cell, which the capacity and the voltage limits need")
    windows = [part.negative_electrode, part.positive_electrode]
    electrodes = [raw["Parameterisation"][name] for name in ELECTRODES]
    ocv_V, half_V = open_circuit(electrodes, windows, file)
    initial = getattr(model.state, "initial_conditions", None)
    around = getattr(model.state, "thermal_environment", None)
    given = _fields(model, file) | {
        "ocv_V": tuple(ocv_V.tolist()),
        "resistance_ohm": resistance_ohm,
        "relaxation": tuple(relaxation),
        "thermal": _thermal(part.cell, around, heat_transfer_W_per_m2_K),
    }
    for name, limit in (("discharge_limit_A", discharge_limit_A), ("charge_limit_A", charge_limit_A)):
        given[name] = limit if limit is not None else given["capacity_Ah"]
    if half_V is not None and hysteresis_rate is not None:
        given["hysteresis"] = {"voltage_V": tuple(half_V.tolist()), "rate": hysteresis_rate}
    try:
        cell = Cell(**given)
    except ValidationError as error:
        raise complaint(error, Cell, f"{file} does not describe a battery cell") from error
    held = (held_Ah(part.cell, windows[0]), held_Ah(part.cell, windows[1]))
    _remark(cell, held, half_V is not None and hysteresis_rate is None, file)
    return BpxCell(
        cell,
        None if legacy else getattr(initial, "initial_soc", None),
        _celsius(getattr(initial, "initial_temperature", None)),
        _celsius(getattr(around, "ambient_temperature", None)),
        held,
    )


def _fields(model: Any, file: Path) -> dict[str, Any]:
    """Fields of the cell that BPX has as they are."""
    cell, header = model.parameterisation.cell, model.header
    said = [text for text in (header.title, header.references) if text]
    found = {
        "name": file.stem,
        "source": "; ".join([*said, f"BPX file {file.name}"]),
        "capacity_Ah": cell.nominal_cell_capacity,
        "soc": tuple(NODES.tolist()),
        "voltage_min_V": cell.lower_voltage_cutoff,
        "voltage_max_V": cell.upper_voltage_cutoff,
    }
    if cell.reference_temperature is not None:
        found["reference_temperature_C"] = cell.reference_temperature - ZERO_CELSIUS_K
    return found


def _read_json(file: Path) -> dict[str, Any]:
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise BatteryError(f"cannot read the BPX file {file}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise BatteryError(f"{file} is not UTF-8 text; save it with UTF-8 encoding") from error
    except (json.JSONDecodeError, RecursionError) as error:
        raise BatteryError(
            f"{file} is not valid JSON: {error}; BPX files in YAML have to be converted"
        ) from error
    if not isinstance(data, dict) or not isinstance(data.get("Parameterisation"), dict):
        raise BatteryError(f"{file} is no BPX file: it has no section Parameterisation")
    for name in ELECTRODES:
        electrode = data["Parameterisation"].get(name)
        if not isinstance(electrode, dict):
            raise BatteryError(f"{file} has no section {name}, which the open-circuit voltage needs")
        if "Particle" in electrode:
            raise BatteryError(
                f"{file}: the {name.lower()} is a blend; only electrodes of one material have a stoichiometry"
                " that follows the SOC"
            )
    return data


def _validate(raw: dict[str, Any], file: Path) -> tuple[Any, bool]:
    """Let the `bpx` package check the file, with the potentials as tables; say whether it is BPX 0.x."""
    tabulated = copy.deepcopy(raw)
    for name in ELECTRODES:
        electrode = tabulated["Parameterisation"][name]
        for key in POTENTIALS:
            if isinstance(electrode.get(key), str):
                evaluate(electrode[key], 0.5)
                electrode[key] = {"x": [0.0, 1.0], "y": [0.0, 0.0]}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            import bpx
        except ImportError as error:
            raise BatteryError(
                "reading BPX files needs the package bpx, which is not installed; pip install 'socwise[bpx]'"
            ) from error
        try:
            model = bpx.parse_bpx_obj(tabulated)
        except ValidationError as error:
            lines = [
                f"  {'.'.join(str(part) for part in item['loc'])}: {item['msg']}"
                for item in error.errors()[:5]
            ]
            raise BatteryError("\n".join([f"{file} is not valid BPX:", *lines])) from error
        except (ValueError, TypeError, AttributeError, KeyError) as error:
            raise BatteryError(f"{file} is not valid BPX: {error}") from error
    legacy = any("legacy BPX" in str(entry.message) for entry in caught)
    if legacy:
        warnings.warn(
            f"{file} is BPX 0.x; the package bpx converted it, initial state of charge and heat transfer are"
            " not known",
            BatteryWarning,
            stacklevel=3,
        )
    return model, legacy


def _thermal(cell: Any, around: Any, coefficient: float | None) -> dict[str, float] | None:
    """Thermal node, where everything that it takes is known."""
    if coefficient is None:
        coefficient = getattr(around, "heat_transfer_coefficient", None)
    parts = (cell.density, cell.specific_heat_capacity, cell.volume, cell.external_surface_area, coefficient)
    if any(part is None for part in parts):
        return None
    leaving = parts[3] * parts[4]
    return {
        "heat_capacity_J_per_K": parts[0] * parts[1] * parts[2],
        "resistance_K_per_W": 1.0 / leaving if leaving != 0.0 else float("inf"),
    }


def _remark(cell: Cell, held: tuple[float, float], unused: bool, file: Path) -> None:
    """Warn of what in the file does not fit together, or is left out."""
    remarks = []
    if unused:
        remarks.append("it has lithiation and delithiation branches; give hysteresis_rate to use them")
    if max(abs(charge / cell.capacity_Ah - 1.0) for charge in held) > CAPACITY_MISMATCH:
        remarks.append(
            f"its electrodes hold {held[0]:.4g} and {held[1]:.4g} Ah between their stoichiometry limits, its"
            f" nominal capacity, which is used, is {cell.capacity_Ah:.4g} Ah"
        )
    if cell.ocv_V[0] < cell.voltage_min_V - BEYOND_V or cell.ocv_V[-1] > cell.voltage_max_V + BEYOND_V:
        remarks.append(
            f"its open-circuit voltage, {cell.ocv_V[0]:.4g} to {cell.ocv_V[-1]:.4g} V, goes beyond its"
            f" limits, {cell.voltage_min_V:g} to {cell.voltage_max_V:g} V"
        )
    for remark in remarks:
        warnings.warn(f"{file}: {remark}", BatteryWarning, stacklevel=3)


def _celsius(temperature_K: float | None) -> float | None:
    return None if temperature_K is None else temperature_K - ZERO_CELSIUS_K

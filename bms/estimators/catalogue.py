"""Estimators by name."""

from __future__ import annotations

import difflib
from importlib import import_module
from typing import Any

from pydantic import BaseModel, ValidationError

from bms.belief import SocBelief
from bms.cell import Cell
from bms.errors import BatteryError
from bms.estimators.base import KernelEstimator
from bms.estimators.gate import Sensors
from bms.toml_file import complaint

_WHERE = {
    "coulomb": ("bms.estimators.coulomb", "Coulomb", "CoulombOptions"),
    "ekf": ("bms.estimators.ekf", "Ekf", "EkfOptions"),
    "ukf": ("bms.estimators.ukf", "Ukf", "UkfOptions"),
    "gpc_gradient": ("bms.estimators.gpc_gradient", "GpcGradient", "GpcGradientOptions"),
    "gpc_gauss_newton": ("bms.estimators.gpc_gradient", "GpcGaussNewton", "GpcGradientOptions"),
    "gpc_ekf": ("bms.estimators.gpc_ekf", "GpcEkf", "GpcEkfOptions"),
}


def estimator_names() -> list[str]:
    """Names of the estimators."""
    return list(_WHERE)


def make_estimator(
    name: str,
    cell: Cell,
    *,
    soc: float = 0.5,
    soc_sd: float = 0.3,
    sensors: Sensors | None = None,
    **options: Any,
) -> KernelEstimator:
    """Make an estimator.

    Parameters
    ----------
    name : str
        One of `estimator_names`; a hyphen serves as well as an underscore.
    cell : Cell
        Nominal cell.
    soc, soc_sd : float
        Belief about the SOC at the start: mean and standard deviation.
    sensors : Sensors, optional
        Noise and limits of the sensors.
    **options
        Options of that estimator.

    Raises
    ------
    BatteryError
        Unknown name or option, or a value out of range.
    """
    key = name.strip().lower().replace("-", "_")
    if key not in _WHERE:
        near = difflib.get_close_matches(key, _WHERE, n=1)
        hint = f", did you mean {near[0]!r}?" if near else ""
        raise BatteryError(f"no estimator is called {name!r}{hint}; known are {', '.join(_WHERE)}")
    if not isinstance(cell, Cell):
        raise BatteryError(f"the cell is {cell!r}; give a Cell, such as bms.cells.load_cell({cell!r})")
    if not 0.0 <= soc_sd <= 1.0:
        raise BatteryError(f"the standard deviation of the SOC is {soc_sd!r}; give one between 0 and 1")
    belief = SocBelief(soc, soc_sd**2)
    module, estimator, model = _WHERE[key]
    found = import_module(module)
    options_model: type[BaseModel] = getattr(found, model)
    try:
        chosen = options_model(**options)
    except ValidationError as error:
        raise complaint(error, options_model, f"the options of {key} do not fit") from error
    try:
        made: KernelEstimator = getattr(found, estimator)(cell, belief, chosen, sensors)
    except OverflowError as error:
        raise BatteryError(
            f"a value of the cell, its sensors or the options of {key} is too large to reckon with;"
            " check the units"
        ) from error
    return made

"""One case as a NetCDF file (classic format with 64-bit offsets), which xarray and MATLAB open as it is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike
from scipy.io import netcdf_file

from ems.records import Case, Rollout
from socwise.results.staging import StoreError

_SAMPLES = ("realization", "time")
_STEPS = ("realization", "step")
_TOTALS = ("realization",)
_WIDE_OFFSETS = 2
CONVENTIONS = "CF-1.8"
"""What names, units and coordinates of our files follow."""


@dataclass(frozen=True)
class Variable:
    """How one array of a case is stored: dimensions, type on disk and in memory, meaning."""

    dimensions: tuple[str, ...]
    on_disk: str
    in_memory: DTypeLike
    units: str
    long_name: str


VARIABLES: dict[str, Variable] = {
    "time_s": Variable(("time",), "f8", np.float64, "s", "time of the samples; step k begins at sample k"),
    "soc": Variable(_SAMPLES, "f4", np.float32, "1", "true state of charge"),
    "soc_estimate": Variable(_SAMPLES, "f4", np.float32, "1", "estimated state of charge"),
    "variance": Variable(_SAMPLES, "f4", np.float32, "1", "variance of the error of the estimate"),
    "engine_on": Variable(_SAMPLES, "i1", np.bool_, "1", "engine state, 1 is on"),
    "current_A": Variable(_STEPS, "f4", np.float32, "A", "battery current, positive charges"),
    "engine_torque_Nm": Variable(_STEPS, "f4", np.float32, "N m", "engine torque at the crank"),
    "fuel_kgps": Variable(_STEPS, "f4", np.float32, "kg/s", "fuel rate without the fuel of engine starts"),
    "fuel_kg": Variable(_TOTALS, "f8", np.float64, "kg", "fuel with engine starts"),
    "penalty_kg": Variable(
        _TOTALS, "f8", np.float64, "kg", "running and terminal penalties at the true state of charge"
    ),
    "shortfall_kg": Variable(_TOTALS, "f8", np.float64, "kg", "price of power demanded but not delivered"),
    "cost_kg": Variable(_TOTALS, "f8", np.float64, "kg", "realised cost: fuel, penalties and shortfall"),
    "fuel_l_per_100km": Variable(_TOTALS, "f8", np.float64, "l/(100 km)", "fuel consumption"),
    "mean_abs_current_A": Variable(_TOTALS, "f8", np.float64, "A", "mean absolute battery current"),
    "engine_starts": Variable(_TOTALS, "i4", np.int64, "1", "number of engine starts"),
    "outside_window": Variable(
        _TOTALS, "f8", np.float64, "1", "share of samples with the true state of charge outside the window"
    ),
}

_OF_CASE = frozenset({"cost_kg", "fuel_l_per_100km"})


def write_case(case: Case, seed: int, path: Path) -> None:
    """Write one case; the same case gives the same bytes.

    Parameters
    ----------
    case : Case
        What to write. Its ``solve_s`` is left out: a timing would make equal results differ.
    seed : int
        Seed of the comparison.
    path : Path
        File to create.
    """
    realizations, samples = case.rollout.soc.shape
    with netcdf_file(path, "w", version=_WIDE_OFFSETS) as opened:
        # Attributes of the file and its variables are set at run time, which no type can say.
        file: Any = opened
        file.title = "socwise: one policy in one setting"
        file.Conventions = CONVENTIONS
        file.concept, file.policy = case.concept.encode(), case.policy.encode()
        file.mu = np.float64(case.mu)
        file.seed = str(seed).encode()
        file.window_low, file.window_high = np.float64(case.window[0]), np.float64(case.window[1])
        file.target_soc = np.float64(case.target_soc)
        # The classic format has no "absent": a policy that promises nothing gets NaN.
        file.value_kg = np.float64(math.nan if case.value_kg is None else case.value_kg)
        file.createDimension("realization", realizations)
        file.createDimension("time", samples)
        file.createDimension("step", samples - 1)
        for name, form in VARIABLES.items():
            stored = file.createVariable(name, form.on_disk, form.dimensions)
            stored.units, stored.long_name = form.units, form.long_name
            if form.dimensions == _SAMPLES:
                stored.coordinates = "time_s"
            stored[:] = _array(case, name)


def read_case(path: Path, solve_s: float = 0.0) -> Case:
    """Read a case that `write_case` wrote.

    Parameters
    ----------
    path : Path
        The file.
    solve_s : float
        Time of the solver, which the file does not hold.

    Returns
    -------
    Case
        With arrays in memory; the file is closed.

    Raises
    ------
    StoreError
        If the file is missing, damaged or not one of ours.
    """
    try:
        # scipy leaves a file that it opened itself open when its header is bad.
        with path.open("rb") as raw, netcdf_file(raw, "r", mmap=False) as file:
            return _case(file, solve_s)
    except (OSError, TypeError, ValueError, LookupError, AttributeError) as error:
        raise StoreError(f"{path} is missing or damaged ({error}); compute it again") from error


def _case(file: Any, solve_s: float) -> Case:
    arrays = {
        name: np.array(file.variables[name][:], dtype=form.in_memory) for name, form in VARIABLES.items()
    }
    value_kg = float(file.value_kg)
    return Case(
        concept=file.concept.decode(),
        mu=float(file.mu),
        policy=file.policy.decode(),
        rollout=Rollout(**{name: array for name, array in arrays.items() if name not in _OF_CASE}),
        value_kg=None if math.isnan(value_kg) else value_kg,
        fuel_l_per_100km=arrays["fuel_l_per_100km"],
        solve_s=solve_s,
        window=(float(file.window_low), float(file.window_high)),
        target_soc=float(file.target_soc),
    )


def _array(case: Case, name: str) -> object:
    return case.fuel_l_per_100km if name == "fuel_l_per_100km" else getattr(case.rollout, name)

"""The trajectories of a comparison as one xarray Dataset."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ems.records import Case
from socwise.results.netcdf import VARIABLES
from socwise.results.optional import optional

if TYPE_CHECKING:
    import xarray as xr

    from socwise.results.reading import StoredComparison

_KEYS = ("concept", "mu", "policy")
_PER_CASE = {
    "value_kg": ("kg", "expected cost that the policy's own model promises at the start"),
    "window_low": ("1", "lowest allowed state of charge"),
    "window_high": ("1", "highest allowed state of charge"),
    "target_soc": ("1", "state of charge that the terminal penalty asks for"),
}
_CYCLE = {
    "speed_mps": ("m/s", "speed of the cycle"),
    "altitude_m": ("m", "altitude of the cycle"),
}


def comparison_dataset(stored: StoredComparison) -> xr.Dataset:
    """Return every trajectory of a comparison.

    Parameters
    ----------
    stored : StoredComparison
        Cases are read one after another.

    Returns
    -------
    xarray.Dataset
        Dimensions ``concept``, ``mu``, ``policy``, ``realization``, ``time`` (samples, s) and ``step`` (the
        time, s, at which a step begins). What a combination lacks is NaN, in variables of floating point.
    """
    xarray = optional("xarray")
    keys = stored.keys()
    axes: dict[str, list[Any]] = {
        "concept": list(dict.fromkeys(key[0] for key in keys)),
        "mu": sorted({key[1] for key in keys}),
        "policy": list(dict.fromkeys(key[2] for key in keys)),
    }
    full = len(keys) == math.prod(map(len, axes.values()))
    arrays: dict[str, NDArray[Any]] = {}
    counts = [int(row["realizations"]) for row in stored.result["cases"]]
    for key in keys:
        case = stored.case(*key)
        place: tuple[int, ...] = tuple(
            axes[name].index(value) for name, value in zip(_KEYS, key, strict=True)
        )
        _put(
            arrays,
            case,
            place,
            tuple(map(len, axes.values())),
            max(counts),
            full and min(counts) == max(counts),
        )
    variables = {name: _variable(name, array) for name, array in arrays.items()}
    variables |= {
        name: (("time",), getattr(stored, name), {"units": units, "long_name": words})
        for name, (units, words) in _CYCLE.items()
    }
    coordinates = {
        **{name: (name, values) for name, values in axes.items()},
        "realization": ("realization", np.arange(max(counts)), {"long_name": "number of the realization"}),
        "time": ("time", stored.time_s, {"units": "s", "long_name": VARIABLES["time_s"].long_name}),
        "step": ("step", stored.time_s[:-1], {"units": "s", "long_name": "time at which the step begins"}),
    }
    attributes = {
        "title": "socwise: comparison of policies",
        "cycle": stored.result["cycle"]["name"],
        "seed": str(stored.result["seed"]),
        "settings_sha256": stored.manifest["settings_sha256"],
        "socwise": stored.manifest["packages"]["socwise"],
    }
    dataset: xr.Dataset = xarray.Dataset(variables, coordinates, attributes)
    return dataset


def _put(
    arrays: dict[str, NDArray[Any]],
    case: Case,
    place: tuple[int, ...],
    grid: tuple[int, ...],
    realizations: int,
    full: bool,
) -> None:
    for name, form in VARIABLES.items():
        if name == "time_s":
            continue
        values = case.fuel_l_per_100km if name == "fuel_l_per_100km" else getattr(case.rollout, name)
        if name not in arrays:
            shape = (*grid, realizations, *values.shape[1:])
            kind = np.dtype(form.on_disk if values.dtype == np.bool_ else values.dtype)
            exact = full or kind.kind == "f"
            arrays[name] = np.zeros(shape, kind) if full else np.full(shape, np.nan, kind if exact else "f4")
        at: tuple[Any, ...] = (*place, slice(values.shape[0]))
        arrays[name][at] = values
    found = {
        "value_kg": np.nan if case.value_kg is None else case.value_kg,
        "window_low": case.window[0],
        "window_high": case.window[1],
        "target_soc": case.target_soc,
    }
    for name, value in found.items():
        arrays.setdefault(name, np.full(grid, np.nan))[place] = value


def _variable(name: str, array: NDArray[Any]) -> tuple[tuple[str, ...], NDArray[Any], dict[str, str]]:
    if name in _PER_CASE:
        units, words = _PER_CASE[name]
        return _KEYS, array, {"units": units, "long_name": words}
    form = VARIABLES[name]
    return (*_KEYS, *form.dimensions), array, {"units": form.units, "long_name": form.long_name}

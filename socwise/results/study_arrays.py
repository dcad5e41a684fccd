"""What came out of a study, over its factors, as an xarray Dataset."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from socwise.report.study_judge import loss
from socwise.results.optional import optional
from socwise.results.plain import flatten
from socwise.study.reading import StoredStudy

if TYPE_CHECKING:
    import xarray as xr

_UNITS = {
    "kg": "kg",
    "km": "l/(100 km)",
    "A": "A",
    "s": "s",
}
_LOSS = ("loss_percent", "loss_percent_low", "loss_percent_high")
_WORDS = (
    "cost of certainty equivalence over the stochastic policy's, in per cent of the latter",
    "low end of its 95 % interval",
    "high end of its 95 % interval",
)
_NO_NUMBERS = frozenset({"concept", "policy", "cycle"})


def study_dataset(study: StoredStudy) -> xr.Dataset:
    """Return means and standard errors of every policy, and the loss of certainty equivalence.

    Parameters
    ----------
    study : StoredStudy
        The study, finished or not.

    Returns
    -------
    xarray.Dataset
        Over the factors that vary where they are a full grid, else over ``case`` with the factors as
        coordinates; and over ``policy``. Failed and missing cases are NaN.
    """
    xarray = optional("xarray")
    policies = list(study.manifest["policies"])
    varied = study.varied
    grid: dict[str, list[Any]] = {name: _ordered(values) for name, values in varied.items()}
    points = [tuple(case.factors.get(name) for name in varied) for case in study.cases]
    full = bool(varied) and len(set(points)) == len(points) == math.prod(map(len, grid.values()))
    shape = tuple(len(values) for values in grid.values()) if full else (len(points),)
    dimensions = tuple(grid) if full else ("case",)
    arrays: dict[str, NDArray[np.float64]] = {}
    for number, (case, point) in enumerate(zip(study.cases, points, strict=True)):
        place: tuple[int, ...] = (number,)
        if full:
            place = tuple(grid[name].index(value) for name, value in zip(grid, point, strict=True))
        for row in (case.result or {}).get("cases", ()):
            at = (*place, policies.index(row["policy"]))
            for name, value in flatten(row).items():
                if name not in _NO_NUMBERS and name not in varied and isinstance(value, int | float):
                    arrays.setdefault(name, np.full((*shape, len(policies)), np.nan))[at] = value
        for name, found in zip(_LOSS, loss(case), strict=True):
            arrays.setdefault(name, np.full(shape, np.nan))[place] = np.nan if found is None else found
    variables = {
        name: ((*dimensions, *(() if name in _LOSS else ("policy",))), array, _attributes(name))
        for name, array in arrays.items()
    }
    coordinates: dict[str, Any] = {"policy": ("policy", policies)}
    if full:
        coordinates |= {name: (name, values) for name, values in grid.items()}
    else:
        coordinates["case"] = ("case", [case.number for case in study.cases])
        coordinates |= {
            name: ("case", _column([point[place] for point in points])) for place, name in enumerate(varied)
        }
    attributes = {
        "title": f"socwise: study {study.name}",
        "seed": str(study.manifest["seed"]),
        "realizations": int(study.manifest["realizations"]),
    }
    dataset: xr.Dataset = xarray.Dataset(variables, coordinates, attributes)
    return dataset


def _ordered(values: list[Any]) -> list[Any]:
    return sorted(values) if all(isinstance(value, int | float) for value in values) else values


def _column(values: list[Any]) -> NDArray[Any]:
    if all(isinstance(value, int | float) or value is None for value in values):
        return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
    return np.array(["" if value is None else str(value) for value in values])


def _attributes(name: str) -> dict[str, str]:
    if name in _LOSS:
        return {"units": "percent", "long_name": _WORDS[_LOSS.index(name)]}
    stem = name.removesuffix("_mean").removesuffix("_se")
    units = _UNITS.get("km" if stem.endswith("100km") else stem.rpartition("_")[2], "1")
    words = stem.replace("_", " ")
    kind = "standard error of the mean" if name.endswith("_se") else "mean over the realizations"
    return {"units": units, "long_name": f"{words}: {kind}" if stem != name else words}

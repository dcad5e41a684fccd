"""Write estimates: numbers, traces and figures, in one folder."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bms.cell import Cell, Quantity
from socwise.estimation import EstimateRun
from socwise.figures.estimate_files import write_estimate_figures
from socwise.results.estimate import write_run
from socwise.results.plain import finite, versions, write_json, write_rows
from socwise.results.staging import ESTIMATE_FORMAT, MANIFEST, files_below, staged

TIMING = "run_s"


def write_estimates(
    runs: Sequence[EstimateRun],
    cell: Cell,
    result: Mapping[str, Any],
    settings: Mapping[str, Any],
    out: Path,
    *,
    also: Callable[[Path], None] | None = None,
    truth: str = "log",
) -> None:
    """Write estimates to a folder, as a whole or not at all.

    Only ``result.json`` holds timings; of the same log and settings every other file has the same bytes.

    Parameters
    ----------
    runs : sequence of EstimateRun
        One for each estimator.
    cell : Cell
        The nominal cell.
    result : mapping
        The object that ``socwise estimate --json`` prints.
    settings : mapping
        What was asked for, for the manifest.
    out : Path
        The folder. Earlier estimates in it are replaced once the new ones are complete.
    also : callable, optional
        Writes further files into the folder that it is given.
    truth : str
        What the figures call the SOC that is taken for true.

    Raises
    ------
    StoreError
        If the folder holds something else or cannot be written.
    """
    with staged(out, ESTIMATE_FORMAT) as folder:
        write_json(folder / "result.json", result)
        write_rows(folder / "summary.csv", result["estimators"], without=(TIMING,))
        for run in runs:
            write_run(run, cell.name, folder / f"{run.name}.nc")
        write_estimate_figures(runs, nominal_parameters(cell), folder / "figures", truth)
        if also is not None:
            also(folder)
        write_json(folder / MANIFEST, _manifest(runs, cell, settings, files_below(folder)))


def nominal_parameters(cell: Cell) -> dict[str, float]:
    """Return the parameters that estimators estimate, by name, at 50 % SOC and the reference temperature.

    Parameters
    ----------
    cell : Cell
        The nominal cell.
    """
    found = {"capacity_Ah": cell.capacity_Ah, "resistance_ohm": _at_half(cell, cell.resistance_ohm)}
    if cell.relaxation:
        pair = cell.relaxation[0]
        ohm = _at_half(cell, pair.resistance_ohm)
        found["relaxation_resistance_ohm"] = ohm
        if pair.capacitance_F is not None:
            found["relaxation_capacitance_F"] = pair.capacitance_F
        elif pair.time_constant_s is not None:
            found["relaxation_capacitance_F"] = _at_half(cell, pair.time_constant_s) / ohm
    return found


def _at_half(cell: Cell, quantity: Quantity) -> float:
    table = np.asarray(quantity, dtype=np.float64)
    if table.ndim == 0:
        return float(table)
    values = [float(np.interp(0.5, cell.soc, row)) for row in np.atleast_2d(table)]
    if len(values) == 1 or cell.temperature_C is None:
        return values[0]
    return float(np.interp(cell.reference_temperature_C, cell.temperature_C, values))


def _manifest(
    runs: Sequence[EstimateRun], cell: Cell, settings: Mapping[str, Any], written: list[str]
) -> dict[str, Any]:
    content = finite({**settings, "cell": cell.model_dump()})
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return {
        "format": ESTIMATE_FORMAT,
        "schema": 1,
        "python": platform.python_version(),
        "packages": versions(),
        "settings_sha256": hashlib.sha256(canonical.encode()).hexdigest(),
        "settings": content,
        "estimators": [{"name": run.name, "file": f"{run.name}.nc"} for run in runs],
        "files": sorted([*written, MANIFEST]),
    }

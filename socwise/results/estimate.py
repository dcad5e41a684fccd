"""One estimator's run as a NetCDF file, with units, and back."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import netcdf_file

from bms.flags import MEANINGS, Flag
from socwise.estimation import EstimateRun
from socwise.results.netcdf import CONVENTIONS
from socwise.results.staging import StoreError

_WIDE_OFFSETS = 2
_UNITS = {"Ah": "Ah", "ohm": "ohm", "F": "F", "A": "A", "s": "s"}


@dataclass(frozen=True)
class Series:
    """How one array is stored."""

    values: NDArray[Any]
    on_disk: str
    units: str
    long_name: str


def write_run(run: EstimateRun, cell: str, path: Path) -> None:
    """Write one run; the same run gives the same bytes.

    Parameters
    ----------
    run : EstimateRun
        What to write. Its ``run_s`` is left out: a timing would make equal results differ.
    cell : str
        Name of the cell.
    path : Path
        File to create.
    """
    with netcdf_file(path, "w", version=_WIDE_OFFSETS) as opened:
        # Attributes of the file and its variables are set at run time, which no type can say.
        file: Any = opened
        file.title = "socwise: one estimator over one log"
        file.Conventions = CONVENTIONS
        file.estimator, file.cell = run.name.encode(), cell.encode()
        file.createDimension("time", run.trace.time_s.size)
        for name, one in series(run).items():
            stored = file.createVariable(name, one.on_disk, ("time",))
            stored.units, stored.long_name = one.units, one.long_name
            if name != "time_s":
                stored.coordinates = "time_s"
            stored[:] = one.values
        flags = file.variables["flags"]
        flags.flag_masks = np.array([flag.value for flag in Flag], dtype=">i4")
        flags.flag_meanings = " ".join(str(flag.name).lower() for flag in Flag)
        flags.explanation = "; ".join(f"{str(flag.name).lower()}: {MEANINGS[flag]}" for flag in Flag)


def read_series(path: Path) -> dict[str, NDArray[Any]]:
    """Read the arrays of a file that `write_run` wrote, by name.

    Raises
    ------
    StoreError
        If the file is missing or damaged.
    """
    try:
        # scipy leaves a file that it opened itself open when its header is bad.
        with path.open("rb") as raw, netcdf_file(raw, "r", mmap=False) as file:
            return {
                name: np.array(variable[:], dtype=variable[:].dtype.newbyteorder("="))
                for name, variable in file.variables.items()
            }
    except (OSError, TypeError, ValueError, LookupError, AttributeError) as error:
        raise StoreError(f"{path} is missing or damaged ({error}); compute it again") from error


def series(run: EstimateRun) -> dict[str, Series]:
    """Return what is stored of a run, by name on disk."""
    trace = run.trace
    found = {
        "time_s": Series(trace.time_s, "f8", "s", "time of the sample after which the row holds"),
        "soc": Series(trace.soc, "f4", "1", "estimated state of charge"),
        "soc_sd": Series(np.sqrt(trace.variance), "f4", "1", "standard deviation of its error, as believed"),
        "residual_V": Series(trace.residual_V, "f4", "V", "measured minus expected voltage"),
        "flags": Series(trace.flags.astype(np.int32), "i4", "1", "all flags raised since the row before"),
    }
    for name, values in trace.parameters.items():
        units, words = _UNITS.get(name.rpartition("_")[2], "1"), name.rpartition("_")[0].replace("_", " ")
        found[name] = Series(values, "f4", units, f"estimated {words}")
        found[f"{name}_sd"] = Series(
            trace.deviations[name], "f4", units, f"standard deviation of the {words}"
        )
    if run.soc_true is not None:
        found["soc_true"] = Series(run.soc_true, "f4", "1", "state of charge that the log takes for true")
    return found

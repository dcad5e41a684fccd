"""One method's run on one vehicle log as a NetCDF file, with units, and back by `estimate.read_series`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scipy.io import netcdf_file

from socwise.figures.inertia import QUANTITIES
from socwise.inertia import InertiaRun
from socwise.results.netcdf import CONVENTIONS
from socwise.thinning import stride_for

_WIDE_OFFSETS = 2
MOST_ROWS = 100_000


def write_inertia_run(run: InertiaRun, path: Path) -> None:
    """Write a run, at most 100,000 rows of it, the last among them; the same run gives the same bytes.

    Parameters
    ----------
    run : InertiaRun
        What to write; not its ``run_s``, which would make equal results differ.
    path : Path
        File to create.
    """
    one = run.estimate
    every = stride_for(one.time_s.size, MOST_ROWS)
    rows = slice((one.time_s.size - 1) % every, None, every)
    with netcdf_file(path, "w", version=_WIDE_OFFSETS) as opened:
        # Attributes of the file and its variables are set at run time, which no type can say.
        file: Any = opened
        file.title = "socwise: mass, inertia and centre of gravity over one log"
        file.Conventions = CONVENTIONS
        file.model, file.method = run.model.encode(), one.method.encode()
        file.scenario = run.scenario.encode() or b"-"
        file.createDimension("time", one.time_s[rows].size)
        time = file.createVariable("time_s", "f8", ("time",))
        time.units, time.long_name = "s", "time of the sample after which the row holds"
        time[:] = one.time_s[rows]
        for name in one.names:
            values, sds = one.column(name)
            words, unit = QUANTITIES.get(name, (name, ""))
            spread = f"standard deviation of the {words}"
            for key, what, series in ((name, f"estimated {words}", values), (f"{name}_sd", spread, sds)):
                stored = file.createVariable(key, "f8", ("time",))
                stored.units, stored.long_name = unit.replace("²", "2") or "1", what
                stored.coordinates = "time_s"
                if name in run.truth and key == name:
                    stored.truth = float(run.truth[name])
                stored[:] = series[rows]

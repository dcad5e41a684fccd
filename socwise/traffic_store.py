"""Write what ``socwise traffic`` computes: numbers, fields and figures, in one folder."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import netcdf_file

from drivecycles import DriveCycle
from drivecycles.traffic.field import TrafficField
from drivecycles.traffic.uncertainty import Spread
from socwise.results.plain import finite, versions, write_json
from socwise.results.staging import MANIFEST, files_below, staged

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TRAFFIC_FORMAT = "socwise traffic"
_WIDE_OFFSETS = 2
_DPI = 150

Figures = Iterable[tuple[str, "Figure"]]


def write_traffic(
    result: Mapping[str, Any],
    settings: Mapping[str, Any],
    out: Path,
    figures: Callable[[], Figures],
    files: Callable[[Path], None],
) -> None:
    """Write results to a folder, as a whole or not at all; the same input gives the same bytes.

    Parameters
    ----------
    result : mapping
        The object that the command prints with ``--json``.
    settings : mapping
        What was asked for, for the manifest.
    out : Path
        The folder. Earlier results in it are replaced once the new ones are complete.
    figures : callable
        Gives names and figures.
    files : callable
        Writes what else belongs to the result into a folder.

    Raises
    ------
    StoreError
        If the folder holds something else or cannot be written.
    """
    import matplotlib

    with staged(out, TRAFFIC_FORMAT) as folder:
        write_json(folder / "result.json", finite(result))
        files(folder)
        (folder / "figures").mkdir()
        with matplotlib.rc_context({"font.size": 9.0}):
            for name, figure in figures():
                figure.savefig(folder / "figures" / f"{name}.png", dpi=_DPI)
        manifest = {
            "format": TRAFFIC_FORMAT,
            "schema": 1,
            "packages": versions(),
            "settings": finite(settings),
            "files": sorted([*files_below(folder), MANIFEST]),
        }
        write_json(folder / MANIFEST, manifest)


def write_field(field: TrafficField, path: Path) -> None:
    """Write density and speed over time and road as NetCDF."""
    with netcdf_file(path, "w", version=_WIDE_OFFSETS) as opened:
        # Attributes of the file and its variables are set at run time, which no type can say.
        file: Any = opened
        file.title, file.scheme = "socwise: one run of a traffic model", field.scheme.encode()
        _put(file, "time_s", ("time",), field.time_s, "s", "time")
        _put(file, "position_m", ("cell",), field.position_m, "m", "middle of the cell")
        _put(file, "density_per_m", ("time", "cell"), field.density_per_m, "1/m", "vehicles per metre")
        _put(file, "speed_mps", ("time", "cell"), field.speed_mps, "m/s", "speed")


def write_spread(one: Spread, path: Path) -> None:
    """Write mean, standard deviation, error and quantiles of a spread as NetCDF."""
    over = ("time", "place")
    with netcdf_file(path, "w", version=_WIDE_OFFSETS) as opened:
        file: Any = opened
        file.title, file.method = "socwise: speed of uncertain traffic", one.method.encode()
        file.runs = np.int32(one.runs)
        _put(file, "time_s", ("time",), one.time_s, "s", "time")
        _put(file, "position_m", ("place",), one.position_m, "m", "middle of the cell")
        _put(file, "mean_mps", over, one.mean, "m/s", "mean speed")
        _put(file, "sd_mps", over, one.sd, "m/s", "standard deviation of the speed")
        _put(file, "error_mps", over, one.error, "m/s", "error of the mean")
        levels = np.array(one.quantile_levels)
        _put(file, "level", ("level",), levels, "1", "level of the quantiles")
        _put(file, "quantiles_mps", ("level", *over), one.quantiles, "m/s", "quantiles of the speed")


def write_cycle(cycle: DriveCycle, path: Path) -> None:
    """Write a cycle as a CSV that every ``--cycle`` takes."""
    write_table(path, {"time_s": cycle.time_s, "speed_mps": cycle.speed_mps})


def write_table(path: Path, columns: Mapping[str, Sequence[float] | NDArray[Any]]) -> None:
    """Write columns of numbers as a CSV."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True))


def _put(
    file: Any, name: str, dimensions: tuple[str, ...], values: NDArray[Any], units: str, words: str
) -> None:
    for dimension, size in zip(dimensions, values.shape, strict=True):
        if dimension not in file.dimensions:
            file.createDimension(dimension, size)
    stored = file.createVariable(name, "f8", dimensions)
    stored.units, stored.long_name = units, words
    stored[:] = values

"""Detectors beside the road: where they stand, what they read, and their log.

A detector reads the mean speed of its cell once a period, with an error that is normal and independent. A log
is a CSV: the time in seconds first, then a column for each detector whose name ends with its position in
metres, such as ``speed_kmh_at_1609``; units are ``mps``, ``kmh`` and ``mph``, an empty field is a missing
reading.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from drivecycles.traffic.errors import TrafficError
from drivecycles.traffic.field import TrafficField
from drivecycles.traffic.road import Road

Array = NDArray[np.float64]

MPS_PER = {"mps": 1.0, "kmh": 1.0 / 3.6, "mph": 0.44704}
_COLUMN = re.compile(r"speed_(mps|kmh|mph)_at_([0-9.]+)(?:m)?$")


class Detectors(BaseModel):
    """Where detectors stand, and how good they are."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    position_m: tuple[float, ...] = Field(min_length=1, description="positions along the road, m")
    period_s: float = Field(default=10.0, gt=0.0, description="time between readings, s")
    noise_mps: float = Field(default=0.44704, gt=0.0, description="standard deviation of a reading, m/s")

    def cells(self, road: Road) -> NDArray[np.int64]:
        """Find the cell of each.

        Raises
        ------
        TrafficError
            When one stands outside the road.
        """
        for position in self.position_m:
            road.require_inside(position, "a detector")
        return np.array([road.cell_at(position) for position in self.position_m], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Readings:
    """What detectors read.

    Parameters
    ----------
    time_s : array_like, shape (n,)
        Increasing, from the start of the traffic on.
    speed_mps : array_like, shape (n, m)
        One column per detector; NaN where a reading is missing.
    detectors : Detectors
        The m detectors.

    Raises
    ------
    TrafficError
        When shapes differ, times do not increase, or nothing was read.
    """

    time_s: Array
    speed_mps: Array
    detectors: Detectors

    def __post_init__(self) -> None:
        time_s, speed = np.asarray(self.time_s, float), np.asarray(self.speed_mps, float)
        count = len(self.detectors.position_m)
        if time_s.ndim != 1 or time_s.size < 1 or speed.shape != (time_s.size, count):
            raise TrafficError(
                f"{count} detectors read at {time_s.shape} times need speeds of shape (n, {count}),"
                f" got {speed.shape}"
            )
        if not np.all(np.isfinite(time_s)) or time_s[0] < 0.0 or np.any(np.diff(time_s) <= 0.0):
            raise TrafficError("the times of readings must be 0 s or more and increase")
        if not np.any(np.isfinite(speed)) or np.any(np.isinf(speed)):
            raise TrafficError("readings must hold a finite speed at least once, and no infinite one")
        object.__setattr__(self, "time_s", time_s)
        object.__setattr__(self, "speed_mps", speed)


def observe(field: TrafficField, detectors: Detectors, generator: np.random.Generator) -> Readings:
    """Read a simulated field with noise, from the first full period on.

    Parameters
    ----------
    field : TrafficField
        The truth.
    detectors : Detectors
        Where and how often.
    generator : numpy.random.Generator
        Source of the noise.

    Raises
    ------
    TrafficError
        When a detector stands outside the road, or a period is longer than the field.
    """
    cells = detectors.cells(field.road)
    count = int((field.time_s[-1] - field.time_s[0]) / detectors.period_s * (1.0 + 1e-12))
    if count < 1:
        raise TrafficError(
            f"a period of {detectors.period_s:g} s is longer than the traffic, {field.time_s[-1]:g} s"
        )
    time_s = field.time_s[0] + detectors.period_s * np.arange(1, count + 1)
    true = np.stack([np.interp(time_s, field.time_s, field.speed_mps[:, cell]) for cell in cells], axis=1)
    return Readings(time_s, true + detectors.noise_mps * generator.standard_normal(true.shape), detectors)


def write_readings(readings: Readings, path: Path) -> None:
    """Write readings as a log that `read_readings` reads."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        names = [f"speed_mps_at_{position:.10g}" for position in readings.detectors.position_m]
        writer.writerow(["time_s", *names])
        for time_s, row in zip(readings.time_s, readings.speed_mps, strict=True):
            writer.writerow([f"{time_s:.10g}", *("" if np.isnan(v) else f"{v:.10g}" for v in row)])


def read_readings(path: Path, noise_mps: float = 0.44704) -> Readings:
    """Read a log of detectors.

    Parameters
    ----------
    path : Path
        The CSV.
    noise_mps : float
        Standard deviation of a reading, which a log does not tell.

    Raises
    ------
    TrafficError
        When the file cannot be read, a column's name says no position, or a field is no number.
    """
    try:
        rows = list(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()))
    except (OSError, UnicodeDecodeError) as error:
        raise TrafficError(f"cannot read the readings {path}: {error}") from error
    rows = [[field.strip() for field in row] for row in rows if any(field.strip() for field in row)]
    if len(rows) < 2 or rows[0][0] != "time_s":
        raise TrafficError(
            f"{path} must start with a line time_s,speed_kmh_at_POSITION,... and hold readings"
        )
    places = [_place(path, name) for name in rows[0][1:]]
    if not places:
        raise TrafficError(f"{path} has no column of a detector; name them like speed_kmh_at_1609")
    table = np.array([_numbers(path, line, row, len(rows[0])) for line, row in enumerate(rows[1:], 2)])
    time_s = table[:, 0]
    period_s = float(np.min(np.diff(time_s))) if time_s.size > 1 else 1.0
    if not period_s > 0.0:
        raise TrafficError(f"{path}: the times of readings must increase")
    detectors = Detectors(position_m=tuple(p for _, p in places), period_s=period_s, noise_mps=noise_mps)
    return Readings(time_s, table[:, 1:] * np.array([MPS_PER[unit] for unit, _ in places]), detectors)


def _place(path: Path, name: str) -> tuple[str, float]:
    found = _COLUMN.match(name)
    try:
        if found:
            return found[1], float(found[2])
    except ValueError:
        pass
    raise TrafficError(
        f"{path}: the column {name!r} says no unit and position; name it like speed_kmh_at_1609"
        f" (units {', '.join(MPS_PER)}; metres from the start of the road)"
    )


def _numbers(path: Path, line: int, row: list[str], count: int) -> list[float]:
    if len(row) != count:
        raise TrafficError(f"{path}, line {line}: {len(row)} fields, but the first line has {count}")
    try:
        return [float("nan") if field == "" else float(field) for field in row]
    except ValueError as error:
        raise TrafficError(f"{path}, line {line}: {error}; leave a missing reading empty") from error

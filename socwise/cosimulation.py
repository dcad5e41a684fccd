"""Drive a plant along a load, and log what its sensors see.

The log is one as any other: `socwise.estimation` runs the estimators over it, with the plant's own SOC for
the truth. A sample stands at the end of its step, with the current that has flowed since the sample before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bms.load_profile import LoadProfile
from bms.logged_data import LoggedData
from bms.measurement import Measurement
from bms.plants.fmu.errors import FmuCrash

Array = NDArray[np.float64]

TOLD_EVERY = 500
ALMOST = 1e-6


class Driven(Protocol):
    """What is asked of a plant here; `bms.plants.fmu.plant.FmuPlant` has it."""

    @property
    def soc(self) -> float:
        """True SOC now."""

    @property
    def voltage_V(self) -> float:
        """Voltage now."""

    @property
    def current_A(self) -> float:
        """Current now, > 0 charges."""

    @property
    def temperature_C(self) -> float | None:
        """Temperature now, if the plant tells it."""

    def step(self, power_W: float, current_A: float, step_s: float) -> Measurement:
        """Carry a power over one step."""

    def carry(self, current_A: float, step_s: float) -> Measurement:
        """Carry a current over one step."""


@dataclass(frozen=True, eq=False)
class Drive:
    """What a plant answered: arrays of the shape (n + 1,), the first row before the first step.

    Parameters
    ----------
    time_s, current_A, voltage_V, soc : ndarray
        At the end of each step, with the current that flowed in it.
    temperature_C : ndarray or None
        None where the plant gives none.
    withheld_W : float
        The largest part of a demanded power that the plant did not carry.
    """

    time_s: Array
    current_A: Array
    voltage_V: Array
    soc: Array
    temperature_C: Array | None
    withheld_W: float

    def ranges(self) -> dict[str, list[float]]:
        """First and last SOC; least and greatest current, voltage and temperature."""
        found = {"soc": [float(self.soc[0]), float(self.soc[-1])]}
        for name in ("current_A", "voltage_V", "temperature_C"):
            values = getattr(self, name)
            if values is not None:
                found[name] = [float(values.min()), float(values.max())]
        return found


@dataclass(frozen=True, slots=True)
class SensorFaults:
    """How far the measured values are off the true ones: white noise and a constant offset of the current."""

    current_sd_A: float = 0.0
    voltage_sd_V: float = 0.0
    current_offset_A: float = 0.0


def drive_plant(
    plant: Driven, profile: LoadProfile, progress: Callable[[int, int], None] | None = None
) -> Drive:
    """Drive a plant along a load.

    Parameters
    ----------
    plant : Driven
        At its start.
    profile : LoadProfile
        Load of each step.
    progress : callable, optional
        Called with steps done and steps in all.

    Raises
    ------
    FmuCrash
        When the plant does not survive it; says at which step.
    """
    load, step_s = profile.load.tolist(), profile.step_s
    rows = np.empty((len(load) + 1, 4))
    rows[0] = plant.current_A, plant.voltage_V, plant.soc, _or_nan(plant.temperature_C)
    withheld_W = 0.0
    for k, value in enumerate(load):
        try:
            seen = plant.step(value, 0.0, step_s) if profile.is_power else plant.carry(value, step_s)
        except FmuCrash as crash:
            raise FmuCrash(f"{crash} (in step {k + 1} of {len(load)}, at {k * step_s:g} s)") from crash
        rows[k + 1] = seen.current_A, plant.voltage_V, plant.soc, _or_nan(seen.temperature_C)
        withheld_W = max(withheld_W, abs(seen.withheld_W or 0.0))
        if progress is not None and k % TOLD_EVERY == 0:
            progress(k, len(load))
    celsius = rows[:, 3]
    return Drive(
        time_s=step_s * np.arange(len(load) + 1, dtype=np.float64),
        current_A=rows[:, 0].copy(),
        voltage_V=rows[:, 1].copy(),
        soc=rows[:, 2].copy(),
        temperature_C=celsius.copy() if np.all(np.isfinite(celsius)) else None,
        withheld_W=withheld_W,
    )


def measured(
    drive: Drive, faults: SensorFaults, rng: np.random.Generator, source: str, notes: tuple[str, ...] = ()
) -> LoggedData:
    """Look at a drive through sensors.

    Parameters
    ----------
    drive : Drive
        What was true.
    faults : SensorFaults
        How far the sensors are off.
    rng : numpy.random.Generator
        Draws the noise.
    source : str
        What messages call it.
    notes : tuple of str
        What was done to the load.

    Returns
    -------
    LoggedData
        With the plant's SOC for the truth.
    """
    noise = rng.standard_normal((2, drive.time_s.size))
    current_A = drive.current_A + faults.current_offset_A + faults.current_sd_A * noise[0]
    return LoggedData(
        time_s=drive.time_s,
        current_A=current_A,
        voltage_V=drive.voltage_V + faults.voltage_sd_V * noise[1],
        temperature_C=drive.temperature_C,
        soc_true=drive.soc,
        source=source,
        notes=(*notes, *_notes(drive)),
        headers={"time": "time_s", "current": "current_A", "voltage": "voltage_V", "soc": "soc"},
    )


def write_log(log: LoggedData, path: Path) -> None:
    """Write a log as CSV, with the headers that `bms.logged_data.read_log` knows.

    Parameters
    ----------
    log : LoggedData
        What to write.
    path : Path
        The file.
    """
    columns = {
        "time_s": log.time_s,
        "current_A": log.current_A,
        "voltage_V": log.voltage_V,
        "temperature_C": log.temperature_C,
        "soc": log.soc_true,
    }
    known = {name: values for name, values in columns.items() if values is not None}
    table = np.stack(list(known.values()), axis=1)
    np.savetxt(path, table, fmt="%.9g", delimiter=",", header=",".join(known), comments="", encoding="utf-8")


def _notes(drive: Drive) -> list[str]:
    notes = []
    low, high = float(drive.soc.min()), float(drive.soc.max())
    if low < -ALMOST or high > 1.0 + ALMOST:
        notes.append(f"the plant's SOC leaves 0 to 1: it goes from {low:.4g} to {high:.4g}")
    elif low <= ALMOST or high >= 1.0 - ALMOST:
        notes.append(
            f"the plant was {'empty' if low <= ALMOST else 'full'} on the way; the load was too much"
        )
    if drive.withheld_W > 0.0:
        notes.append(f"up to {drive.withheld_W:.3g} W of the power were beyond what the plant can carry")
    return notes


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value

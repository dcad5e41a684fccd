"""The user's log of a drive, or of a mass on a spring, as the record that an estimator takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from vehicle.errors import VehicleError
from vehicle.inertia.defender import GRAVITY_MPS2
from vehicle.inertia.log import CORNERS, Log, check_model
from vehicle.inertia.log_columns import G_MPS2
from vehicle.inertia.log_file import LogTable, constant, read_table
from vehicle.inertia.mass_spring import STIFFNESS_NPM, MassSpringLog

FORCES = tuple(f"force_{corner}" for corner in CORNERS)
CORNER_AZ = tuple(f"az_{corner}" for corner in CORNERS)
REQUIRED: dict[str, tuple[str, ...]] = {
    "ride": ("time", *FORCES, "ax", "ay", "heave", "pitch", "roll"),
    "ltm": ("time", *FORCES, "ax", "ay", "az", "speed"),
    "mltm": ("time", *FORCES, "ax", "ay", *CORNER_AZ, "speed"),
}
"""Channels that a model reads."""
OPTIONAL: dict[str, tuple[str, ...]] = {"ride": ("speed",), "ltm": (), "mltm": ()}
ESSENTIAL: dict[str, tuple[str, ...]] = {
    "ride": (*FORCES, "heave", "pitch", "roll"),
    "ltm": (*FORCES, "az"),
    "mltm": (*FORCES, *CORNER_AZ),
}
"""Channels without whose changes nothing is identified."""
UPRIGHT_G = (0.75, 1.25)
"""Mean of a vertical accelerometer that feels gravity and stands upright."""
_TRANSFER: dict[tuple[str, ...], str] = {
    ("ax",): "ax does not change: the height of the centre of gravity over the pitch centre stays a guess",
    ("ay",): "ay does not change: the height of the centre of gravity over the roll centre stays a guess",
    ("speed",): "the speed does not change: the drag term C stays a guess",
}
_SILENT: dict[str, dict[tuple[str, ...], str]] = {
    "ride": {("ax", "ay"): "ax and ay do not change: the height of the centre of gravity stays a guess"},
    "ltm": _TRANSFER,
    "mltm": _TRANSFER,
}


def read_log(path: str | Path, model: str, columns: Mapping[str, str] | None = None) -> tuple[Log, LogTable]:
    """Read a drive for one of the models.

    Parameters
    ----------
    path : str or Path
        CSV file, see `vehicle.inertia.log_file.read_table`.
    model : {"ride", "ltm", "mltm"}
    columns : mapping of str to str, optional
        The user's own names by channel.

    Returns
    -------
    tuple of Log and LogTable
        What the estimators take; and what was read, with notes and doubts.

    Raises
    ------
    VehicleError
        As `read_table`; a signal without which nothing is identified must change; a vertical accelerometer
        must feel gravity, and a strut carry its corner.
    """
    check_model(model)
    table = read_table(path, REQUIRED[model], OPTIONAL[model], columns=columns, varying=ESSENTIAL[model])
    known = table.channels
    if model != "ride":
        _check_gravity(table)
        _check_load(table)
    still = tuple(name for name in ("ax", "ay", "speed") if name in REQUIRED[model] and constant(known[name]))
    # The ride model has one height for both directions.
    quiet = [text for names, text in _SILENT[model].items() if set(names) <= set(still)]
    table = replace(table, doubts=(*table.doubts, *quiet))
    corners = np.column_stack([known[name] for name in CORNER_AZ]) if model == "mltm" else None
    log = Log(
        time_s=known["time"],
        forces_N=np.column_stack([known[name] for name in FORCES]),
        ax_mps2=known["ax"],
        ay_mps2=known["ay"],
        az_mps2=known.get("az"),
        corner_az_mps2=corners,
        heave_mps2=known.get("heave"),
        pitch_radps2=known.get("pitch"),
        roll_radps2=known.get("roll"),
        speed_mps=known.get("speed"),
    )
    return log, table


def _check_gravity(table: LogTable) -> None:
    """Refuse a vertical accelerometer upside down, without gravity or in another unit."""
    for name in ("az", *CORNER_AZ):
        if name not in table.channels:
            continue
        mean = float(table.channels[name].mean())
        size = abs(mean) / GRAVITY_MPS2
        if UPRIGHT_G[0] <= mean / GRAVITY_MPS2 <= UPRIGHT_G[1]:
            continue
        if UPRIGHT_G[0] <= size <= UPRIGHT_G[1]:
            why = "z points down: turn the sign of the column"
        elif UPRIGHT_G[0] <= abs(mean) <= UPRIGHT_G[1]:
            turn = "" if mean > 0.0 else ", and turn its sign: z points up"
            why = f"that is 1 g, so the unit is g: --column {name}={table.headers[name]!r}:g{turn}"
        elif UPRIGHT_G[0] <= size / G_MPS2 <= UPRIGHT_G[1]:
            why = f"the column is in m/s2 and not in g: --column {name}={table.headers[name]!r}:m/s2"
        elif size < 1.0 - UPRIGHT_G[0]:
            why = "gravity was taken off: add 9.81 m/s2 to the column"
        else:
            why = "check its unit, its offset and how the sensor is mounted"
        raise VehicleError(
            f"{table.source}: {name} ({table.headers[name]!r}) is {mean:.3g} m/s2 in the mean, where an"
            f" accelerometer whose z points up reads 9.81 m/s2 at rest; {why}"
        )


def _check_load(table: LogTable) -> None:
    """Refuse strut forces of the other sign, or without their static load."""
    for name in FORCES:
        force = table.channels[name]
        mean, sd = float(force.mean()), float(force.std())
        if mean > sd:
            continue
        why = (
            "force on the body is positive when the strut pushes it up: turn the sign of the column"
            if mean < -sd
            else "the static load was taken off: add it to the column"
        )
        raise VehicleError(
            f"{table.source}: {name} ({table.headers[name]!r}) is {mean:.3g} N in the mean, with a standard"
            f" deviation of {sd:.3g} N, but a strut carries its corner; {why}"
        )


def read_mass_spring(
    path: str | Path,
    columns: Mapping[str, str] | None = None,
    stiffness_Npm: float = STIFFNESS_NPM,
) -> tuple[MassSpringLog, LogTable]:
    """Read the positions of a mass on a spring that is driven by sin t; see `read_log`."""
    table = read_table(path, ("time", "position"), columns=columns, varying=("position",))
    return MassSpringLog(table.channels["time"], table.channels["position"], stiffness_Npm), table

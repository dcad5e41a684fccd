"""The user's log of a drive, or of a mass on a spring, as the record that an estimator takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from vehicle.inertia.log import CORNERS, Log, check_model
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
        As `read_table`; a signal without which nothing is identified must change.
    """
    check_model(model)
    table = read_table(path, REQUIRED[model], OPTIONAL[model], columns=columns, varying=ESSENTIAL[model])
    known = table.channels
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


def read_mass_spring(
    path: str | Path,
    columns: Mapping[str, str] | None = None,
    stiffness_Npm: float = STIFFNESS_NPM,
) -> tuple[MassSpringLog, LogTable]:
    """Read the positions of a mass on a spring that is driven by sin t; see `read_log`."""
    table = read_table(path, ("time", "position"), columns=columns, varying=("position",))
    return MassSpringLog(table.channels["time"], table.channels["position"], stiffness_Npm), table

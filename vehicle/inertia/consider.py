"""Errors that do not average out: what an estimate would be, had a sensor one of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vehicle.inertia.defender import GRAVITY_MPS2
from vehicle.inertia.log import Log
from vehicle.inertia.sensors import SensorErrors


def disturbed(log: Log, errors: SensorErrors) -> list[Log]:
    """Give the log with each systematic error in turn, one standard deviation large."""
    logs = []
    if errors.strut_gain_sd > 0.0:
        for gain in 1.0 + errors.strut_gain_sd * np.eye(4):
            static = None if log.static_N is None else log.static_N * gain
            logs.append(replace(log, forces_N=log.forces_N * gain, static_N=static))
    if errors.bias_sd_mps2 > 0.0:
        for name in ("ax_mps2", "ay_mps2", "az_mps2", "heave_mps2"):
            column = getattr(log, name)
            if column is not None:
                logs.append(replace(log, **{name: column + errors.bias_sd_mps2}))
        if log.corner_az_mps2 is not None:
            corner = log.corner_az_mps2
            logs += [replace(log, corner_az_mps2=corner + errors.bias_sd_mps2 * one) for one in np.eye(4)]
    if errors.misalignment_sd_rad > 0.0:
        tilt = GRAVITY_MPS2 * errors.misalignment_sd_rad
        logs.append(replace(log, ax_mps2=log.ax_mps2 - tilt))
        logs.append(replace(log, ay_mps2=log.ay_mps2 + tilt))
    return logs

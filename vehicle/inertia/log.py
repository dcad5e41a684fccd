"""What a vehicle logs while it is driven: strut forces, accelerations, speed.

Axes: x forward, y to the left, z up. Accelerometers feel gravity, so a vehicle at rest on level ground reads
9.81 m/s^2 upwards, and one that stands uphill reads a positive ``ax``. So ``ax_mps2 > 0`` accelerates and
``ay_mps2 > 0`` is a left-hand bend, which loads the right ([M] eqs 35-38); in [M] eq 33 a positive A_x
brakes, and `vehicle.inertia.ride` turns the sign. Pitch is positive nose down, roll is positive right side
down. Corners are ordered front left, front right, rear left, rear right.
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass, fields
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from vehicle.errors import VehicleError

Array = NDArray[np.float64]

Model = Literal["ride", "ltm", "mltm"]

CORNERS = ("fl", "fr", "rl", "rr")

NEEDS: dict[str, tuple[str, ...]] = {
    "ride": ("forces_N", "ax_mps2", "ay_mps2", "heave_mps2", "pitch_radps2", "roll_radps2"),
    "ltm": ("forces_N", "ax_mps2", "ay_mps2", "az_mps2", "speed_mps"),
    "mltm": ("forces_N", "ax_mps2", "ay_mps2", "corner_az_mps2", "speed_mps"),
}
"""Columns that a model reads."""


@dataclass(frozen=True, eq=False)
class Log:
    """Logged columns; those that a model does not read may be None, a missing value is NaN.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Increasing.
    forces_N : ndarray, shape (n, 4)
        Force of each strut on the body, the static load included unless ``static_N`` is zero.
    ax_mps2, ay_mps2, az_mps2 : ndarray, shape (n,)
        Accelerometer at the centre of gravity.
    corner_az_mps2 : ndarray, shape (n, 4)
        Vertical accelerometer on the body at each strut.
    heave_mps2 : ndarray, shape (n,)
        Vertical acceleration of the centre of gravity without gravity.
    pitch_radps2, roll_radps2 : ndarray, shape (n,)
        Angular accelerations of the body.
    speed_mps : ndarray, shape (n,)
    static_N : ndarray, shape (4,)
        Force of each strut at rest on level ground. Without it the ride model takes the mean of every column
        off.

    Raises
    ------
    VehicleError
        When times do not increase, or a column has the wrong shape, no value or an infinite one.
    """

    time_s: Array
    forces_N: Array
    ax_mps2: Array
    ay_mps2: Array
    az_mps2: Array | None = None
    corner_az_mps2: Array | None = None
    heave_mps2: Array | None = None
    pitch_radps2: Array | None = None
    roll_radps2: Array | None = None
    speed_mps: Array | None = None
    static_N: Array | None = None

    def __post_init__(self) -> None:
        for item in fields(self):
            given = getattr(self, item.name)
            if given is not None:
                array = np.array(given, dtype=np.float64)
                array.setflags(write=False)
                object.__setattr__(self, item.name, array)
        if self.time_s.ndim != 1 or self.time_s.size < 2 or not np.all(np.diff(self.time_s) > 0.0):
            raise VehicleError(
                "a log needs two times or more, increasing; sort the rows and drop repeated ones"
            )
        n = self.time_s.size
        for item in fields(self):
            array = getattr(self, item.name)
            if array is None:
                continue
            corners = item.name in ("forces_N", "corner_az_mps2")
            shape = (4,) if item.name == "static_N" else (n, 4) if corners else (n,)
            if array.shape != shape:
                raise VehicleError(f"the column {item.name} must have shape {shape}, got {array.shape}")
            if np.any(np.isinf(array)) or not np.any(np.isfinite(array)):
                raise VehicleError(f"the column {item.name} holds inf, or nothing but NaN; leave it out")

    def column(self, name: str, model: str) -> Array:
        """Give a column that a model reads.

        Raises
        ------
        VehicleError
            When the log does not have it.
        """
        array = getattr(self, name)
        if array is None:
            raise VehicleError(f"the model {model!r} reads {', '.join(NEEDS[model])}; this log has no {name}")
        return np.asarray(array, dtype=np.float64)


def check_name(what: str, given: str, allowed: tuple[str, ...]) -> None:
    """Refuse a name that is not allowed, with a suggestion.

    Raises
    ------
    VehicleError
        When ``given`` is none of ``allowed``.
    """
    if given not in allowed:
        near = difflib.get_close_matches(str(given), allowed, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise VehicleError(f"unknown {what} {given!r}: allowed are {', '.join(allowed)}{hint}")


def check_model(model: str) -> None:
    """Refuse an unknown model.

    Raises
    ------
    VehicleError
        With a suggestion.
    """
    check_name("model", model, get_args(Model))

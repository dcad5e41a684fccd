"""Steady-state measurements on a grid of speed and torque, with bilinear interpolation ([L] section 3.1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vehicle.errors import VehicleError
from vehicle.tables import SPEED, TORQUE, FloatArray, frozen, read_table

# Torques computed as fractions of a limit land on a map's edge up to rounding.
_EDGE = 1e-9


@dataclass(frozen=True, eq=False)
class SpeedTorqueMap:
    """A non-negative quantity over speed and torque.

    Parameters
    ----------
    name : str
        What the map is called in error messages.
    speed_radps : ndarray, shape (S,)
        Strictly increasing speeds, S >= 2.
    torque_Nm : ndarray, shape (T,)
        Strictly increasing torques, T >= 2.
    values : ndarray, shape (S, T)
        Finite, non-negative values at the grid points.

    Raises
    ------
    VehicleError
        An axis is not increasing, shapes disagree, or a value is negative or not finite.
    """

    name: str
    speed_radps: FloatArray
    torque_Nm: FloatArray
    values: FloatArray

    def __post_init__(self) -> None:
        for field in ("speed_radps", "torque_Nm", "values"):
            object.__setattr__(self, field, frozen(getattr(self, field)))
        for axis in ("speed_radps", "torque_Nm"):
            check_axis(f"{self.name}: {axis}", getattr(self, axis))
        expected = (self.speed_radps.size, self.torque_Nm.size)
        if self.values.shape != expected:
            raise VehicleError(
                f"{self.name}: values have shape {self.values.shape}, the axes ask for {expected}"
            )
        bad = ~np.isfinite(self.values) | (self.values < 0.0)
        if bad.any():
            i, j = np.argwhere(bad)[0]
            raise VehicleError(
                f"{self.name}: the value at {self.speed_radps[i]:g} rad/s and {self.torque_Nm[j]:g} Nm "
                f"is {self.values[i, j]:g}, expected a finite number >= 0"
            )

    def __call__(self, speed_radps: FloatArray, torque_Nm: FloatArray) -> FloatArray:
        """Interpolate bilinearly.

        Parameters
        ----------
        speed_radps, torque_Nm : ndarray
            Points, of shapes that broadcast together.

        Returns
        -------
        ndarray
            Values at the points, of the broadcast shape.

        Raises
        ------
        VehicleError
            A point lies outside the grid: maps are not extrapolated.
        """
        i, u = self._locate("rad/s", self.speed_radps, speed_radps)
        j, v = self._locate("Nm", self.torque_Nm, torque_Nm)
        flat = self.values.ravel()
        corner = i * self.torque_Nm.size + j
        above = corner + self.torque_Nm.size
        low = flat[corner] * (1.0 - v) + flat[corner + 1] * v
        high = flat[above] * (1.0 - v) + flat[above + 1] * v
        interpolated: FloatArray = low * (1.0 - u) + high * u
        return interpolated

    def _locate(
        self, unit: str, axis: FloatArray, at: FloatArray
    ) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.intp]], FloatArray]:
        at = np.asarray(at, dtype=np.float64)
        slack = _EDGE * (axis[-1] - axis[0])
        outside = ~((at >= axis[0] - slack) & (at <= axis[-1] + slack))
        if outside.any():
            raise VehicleError(
                f"{self.name}: {at[outside].flat[0]:g} {unit} lies outside the map, "
                f"which covers {axis[0]:g} to {axis[-1]:g} {unit}; supply a map that covers it"
            )
        index = np.clip(np.searchsorted(axis, at, side="right") - 1, 0, axis.size - 2)
        weight = np.clip((at - axis[index]) / (axis[index + 1] - axis[index]), 0.0, 1.0)
        return index, weight


def check_axis(name: str, axis: FloatArray) -> None:
    """Raise VehicleError unless the axis is 1-D, finite, strictly increasing and has two points or more."""
    if axis.ndim != 1 or axis.size < 2:
        raise VehicleError(f"{name} needs at least two grid points in one dimension, got shape {axis.shape}")
    if not np.isfinite(axis).all() or (np.diff(axis) <= 0.0).any():
        raise VehicleError(
            f"{name} must be finite and strictly increasing, got {np.array2string(axis, threshold=8)}"
        )


def read_map(path: Path, quantity: Mapping[str, float]) -> SpeedTorqueMap:
    """Load a map from a CSV file in long form: one row per grid point, in any order.

    Parameters
    ----------
    path : Path
        Columns ``speed_radps`` or ``speed_rpm``, ``torque_Nm`` and the quantity, units in the header.
    quantity : mapping of str to float
        Header names allowed for the quantity, with their factors to the SI unit.

    Returns
    -------
    SpeedTorqueMap
        The map in SI units, named after the file.

    Raises
    ------
    VehicleError
        The file cannot be read, or its points do not fill a rectangular grid exactly once.
    """
    speed, torque, value = read_table(path, SPEED, TORQUE, quantity)
    speeds, i = np.unique(speed, return_inverse=True)
    torques, j = np.unique(torque, return_inverse=True)
    count = np.zeros((speeds.size, torques.size), dtype=np.int64)
    np.add.at(count, (i, j), 1)
    if (count != 1).any():
        m, n = np.argwhere(count != 1)[0]
        raise VehicleError(
            f"{path}: the point {speeds[m]:g} rad/s, {torques[n]:g} Nm occurs {count[m, n]} times, "
            f"expected once; the rows must fill the grid of {speeds.size} speeds and {torques.size} torques"
        )
    grid = np.zeros(count.shape)
    grid[i, j] = value
    return SpeedTorqueMap(str(path), speeds, torques, grid)

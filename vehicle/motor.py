"""Permanent-magnet machine: a loss map and torque limits over speed ([L] section 3.1)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from vehicle.errors import VehicleError
from vehicle.maps import SpeedTorqueMap, check_axis, read_map
from vehicle.tables import LOSS, MAX_TORQUE, MIN_TORQUE, SPEED, FloatArray, frozen, read_table

_BISECTIONS = 48


class MotorParameters(BaseModel):
    """The motor's table in a vehicle file."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    loss_map: str = Field(description="CSV file: losses over speed and torque, path from the vehicle file")
    torque_limit: str = Field(
        description="CSV file: max_torque_Nm and min_torque_Nm over speed, path from the vehicle file"
    )
    converter_efficiency: float = Field(gt=0.0, le=1.0, description="Power electronics, either way, -")


@dataclass(frozen=True, eq=False)
class Motor:
    """An electric machine that drives or generates, and the converter between it and the battery.

    Parameters
    ----------
    loss_map : SpeedTorqueMap
        Losses in W over shaft speed and torque; torque > 0 drives.
    limit_speed_radps, max_torque_Nm_at, min_torque_Nm_at : ndarray, shape (L,)
        Limits >= 0 as a motor and <= 0 as a generator over speed; the last speed is the greatest allowed.
    converter_efficiency : float
        Constant efficiency of the power electronics.

    Raises
    ------
    VehicleError
        The limits are malformed, or the map does not cover them.
    """

    loss_map: SpeedTorqueMap
    limit_speed_radps: FloatArray
    max_torque_Nm_at: FloatArray
    min_torque_Nm_at: FloatArray
    converter_efficiency: float

    def __post_init__(self) -> None:
        for field in ("limit_speed_radps", "max_torque_Nm_at", "min_torque_Nm_at"):
            object.__setattr__(self, field, frozen(getattr(self, field)))
        check_axis("motor torque limit: speed_radps", self.limit_speed_radps)
        if (self.max_torque_Nm_at < 0.0).any() or (self.min_torque_Nm_at > 0.0).any():
            raise VehicleError(
                "motor torque limit: expected max_torque_Nm >= 0 and min_torque_Nm <= 0 at every speed"
            )
        self._check_coverage()

    @classmethod
    def load(cls, parameters: MotorParameters, folder: Path) -> Motor:
        """Read the CSV files that the parameters name, relative to a folder, and build the motor."""
        speed, most, least = read_table(folder / parameters.torque_limit, SPEED, MAX_TORQUE, MIN_TORQUE)
        return cls(
            loss_map=read_map(folder / parameters.loss_map, LOSS),
            limit_speed_radps=speed,
            max_torque_Nm_at=most,
            min_torque_Nm_at=least,
            converter_efficiency=parameters.converter_efficiency,
        )

    @property
    def max_speed_radps(self) -> float:
        """Greatest shaft speed allowed, rad/s."""
        return float(self.limit_speed_radps[-1])

    @property
    def max_power_W(self) -> float:
        """Greatest power at the shaft as a motor, W."""
        return float(np.max(self.limit_speed_radps * self.max_torque_Nm_at))

    def max_torque_Nm(self, speed_radps: FloatArray) -> FloatArray:
        """Greatest torque as a motor at the given speeds, Nm, >= 0."""
        return np.interp(speed_radps, self.limit_speed_radps, self.max_torque_Nm_at)

    def min_torque_Nm(self, speed_radps: FloatArray) -> FloatArray:
        """Least torque, the limit as a generator, at the given speeds, Nm, <= 0."""
        return np.interp(speed_radps, self.limit_speed_radps, self.min_torque_Nm_at)

    def electric_power_W(self, speed_radps: FloatArray, torque_Nm: FloatArray) -> FloatArray:
        """Power on the converter's battery side.

        Parameters
        ----------
        speed_radps, torque_Nm : ndarray
            Shaft speed and torque, of shapes that broadcast.

        Returns
        -------
        ndarray
            Power drawn from the battery's bus, W; negative when generating.
        """
        terminal = speed_radps * torque_Nm + self.loss_map(speed_radps, torque_Nm)
        efficiency = self.converter_efficiency
        power: FloatArray = np.where(terminal >= 0.0, terminal / efficiency, terminal * efficiency)
        return power

    def trim_torque_Nm(
        self, speed_radps: FloatArray, torque_Nm: FloatArray, draw_W: float, feed_W: float
    ) -> FloatArray:
        """Torques moved towards zero until the electric power keeps its limits.

        Parameters
        ----------
        speed_radps, torque_Nm : ndarray
            Shaft speed and wanted torque, of shapes that broadcast.
        draw_W, feed_W : float
            Most power drawn from and fed into the bus. Where no-load losses alone exceed `draw_W` the torque
            becomes zero.

        Returns
        -------
        ndarray
            Torque in Nm of the broadcast shape, unchanged where the limits hold.
        """
        speed_radps, torque_Nm = np.broadcast_arrays(speed_radps, torque_Nm)
        trimmed = np.array(torque_Nm)
        power = self.electric_power_W(speed_radps, torque_Nm)
        over = ((torque_Nm > 0.0) & (power > draw_W)) | ((torque_Nm < 0.0) & (power < -feed_W))
        if over.any():
            speed, bad = speed_radps[over], torque_Nm[over]
            good = np.zeros_like(bad)
            # Losses make electric power convex in torque: between zero and here it meets the limit once.
            for _ in range(_BISECTIONS):
                middle = 0.5 * (good + bad)
                power = self.electric_power_W(speed, middle)
                holds = np.where(middle > 0.0, power <= draw_W, power >= -feed_W)
                good, bad = np.where(holds, middle, good), np.where(holds, bad, middle)
            trimmed[over] = good
        return trimmed

    def _check_coverage(self) -> None:
        speed, torque = self.loss_map.speed_radps, self.loss_map.torque_Nm
        most, least = float(self.max_torque_Nm_at.max()), float(self.min_torque_Nm_at.min())
        covered = speed[0] <= 0.0 and self.limit_speed_radps[0] <= 0.0 and speed[-1] >= self.max_speed_radps
        if not (covered and torque[0] <= least and torque[-1] >= most):
            raise VehicleError(
                f"{self.loss_map.name}: the map covers {speed[0]:g} to {speed[-1]:g} rad/s and "
                f"{torque[0]:g} to {torque[-1]:g} Nm, the limits go from {self.limit_speed_radps[0]:g} to "
                f"{self.max_speed_radps:g} rad/s and {least:g} to {most:g} Nm; limits must start at 0 rad/s "
                f"and the map must cover them"
            )

"""Stepped gearbox and final drive with constant efficiencies, and a shift table over vehicle speed."""

from __future__ import annotations

from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, model_validator

from vehicle.tables import FloatArray


class Gearbox(BaseModel):
    """Gearbox between engine and final drive; the motor sits at the final drive's input ([L] Fig 3, Table 1).

    The gear is chosen by speed alone: up a gear when the vehicle reaches ``upshift_mps`` of the present
    gear, down when it falls below ``downshift_mps``; the gap between the two is the hysteresis.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    ratios: tuple[PositiveFloat, ...] = Field(
        min_length=1, description="Gear ratios r_gb, first gear first, -"
    )
    efficiency: float = Field(gt=0.0, le=1.0, description="Gearbox efficiency, -")
    final_drive_ratio: float = Field(gt=0.0, description="Final drive ratio r_fd, -")
    final_drive_efficiency: float = Field(gt=0.0, le=1.0, description="Final drive efficiency, -")
    upshift_mps: tuple[PositiveFloat, ...] = Field(description="Speeds to leave gears 1, 2, ... upwards, m/s")
    downshift_mps: tuple[PositiveFloat, ...] = Field(
        description="Speeds to fall back to gears 1, 2, ..., m/s"
    )

    @model_validator(mode="after")
    def _check_tables(self) -> Self:
        shifts = len(self.ratios) - 1
        for name in ("upshift_mps", "downshift_mps"):
            table = getattr(self, name)
            if len(table) != shifts:
                raise ValueError(f"{name} has {len(table)} speeds, {len(self.ratios)} gears need {shifts}")
            if any(b <= a for a, b in pairwise(table)):
                raise ValueError(f"{name} must increase from gear to gear, got {list(table)}")
        if any(b >= a for a, b in pairwise(self.ratios)):
            raise ValueError(f"ratios must decrease from gear to gear, got {list(self.ratios)}")
        for gear, (down, up) in enumerate(zip(self.downshift_mps, self.upshift_mps, strict=True), 1):
            if down >= up:
                raise ValueError(
                    f"gear {gear}: downshift_mps {down:g} must lie below upshift_mps {up:g}, else gears hunt"
                )
        return self

    def select_gears(self, speed_mps: FloatArray) -> NDArray[np.int64]:
        """Gears along a speed trace, starting in first gear.

        Parameters
        ----------
        speed_mps : ndarray, shape (N,)
            Vehicle speeds in order of time.

        Returns
        -------
        ndarray of int, shape (N,)
            Gears counted from 0.
        """
        gears = np.empty(len(speed_mps), dtype=np.int64)
        gear = 0
        for k, speed in enumerate(np.asarray(speed_mps, dtype=np.float64).tolist()):
            while gear < len(self.upshift_mps) and speed >= self.upshift_mps[gear]:
                gear += 1
            while gear > 0 and speed < self.downshift_mps[gear - 1]:
                gear -= 1
            gears[k] = gear
        return gears

    def final_drive_input(self, wheel_torque_Nm: FloatArray) -> FloatArray:
        """Torque at the final drive's input for a torque at the wheels ([L] 15, losses follow the flow).

        Parameters
        ----------
        wheel_torque_Nm : ndarray
            Torque at the wheels, negative when the wheels drive the powertrain.

        Returns
        -------
        ndarray
            Torque at the input, Nm, same shape.
        """
        ratio, efficiency = self.final_drive_ratio, self.final_drive_efficiency
        return np.where(
            wheel_torque_Nm >= 0.0,
            wheel_torque_Nm / (ratio * efficiency),
            wheel_torque_Nm * efficiency / ratio,
        )

    def final_drive_output(self, input_torque_Nm: FloatArray) -> FloatArray:
        """Torque at the wheels for one at the final drive's input: the inverse of `final_drive_input`."""
        ratio, efficiency = self.final_drive_ratio, self.final_drive_efficiency
        return np.where(
            input_torque_Nm >= 0.0,
            input_torque_Nm * (ratio * efficiency),
            input_torque_Nm * ratio / efficiency,
        )

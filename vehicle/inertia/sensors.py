"""What sensors make of forces and accelerations: noise, gain error, bias and misalignment.

Noise is white and drawn anew for every sample; gains, biases and the angles by which the accelerometer at the
centre of gravity is mounted askew are drawn once per log, all of them normal.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

Array = NDArray[np.float64]


class SensorErrors(BaseModel):
    """Sizes of errors; by default those of [M] Table 4, noise of variance 0.1 on the ride model's outputs."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    acceleration_variance: float = Field(
        default=0.1, ge=0.0, description="of vertical and angular accelerations, (m/s2)^2 and (rad/s2)^2"
    )
    horizontal_variance: float = Field(default=0.0, ge=0.0, description="of A_x and A_y, (m/s2)^2")
    force_sd_N: float = Field(default=0.0, ge=0.0, description="noise of a strut force")
    strut_gain_sd: float = Field(default=0.0, ge=0.0, lt=0.3, description="relative, one gain per strut")
    bias_sd_mps2: float = Field(default=0.0, ge=0.0, description="offset of every linear accelerometer")
    misalignment_sd_rad: float = Field(
        default=0.0, ge=0.0, lt=0.3, description="angles of the accelerometer at the centre of gravity"
    )


NO_ERRORS = SensorErrors(acceleration_variance=0.0)
RIDE_SENSORS = SensorErrors()
ROAD_SENSORS = SensorErrors(horizontal_variance=0.1, force_sd_N=25.0)
"""For load transfer: noise on every channel, on a strut of about 0.5 % of its load."""
ROAD_SENSORS_GAIN = ROAD_SENSORS.model_copy(update={"strut_gain_sd": 0.01})


def sense(
    errors: SensorErrors, forces_N: Array, linear: Array, angular: Array, generator: np.random.Generator
) -> tuple[Array, Array, Array, Array]:
    """Measure forces, shape (n, 4), linear accelerations, (n, 7), and angular ones, (n, 2).

    Linear are A_x, A_y and A_z at the centre of gravity, then the four vertical ones at the struts. What
    comes back is measured, in the same order; last, the gains of the struts, shape (4,).
    """
    # Drawn whatever the sizes are, so that one error does not change the draws of another.
    gain = 1.0 + errors.strut_gain_sd * generator.standard_normal(4)
    bias = errors.bias_sd_mps2 * generator.standard_normal(7)
    nose, side = errors.misalignment_sd_rad * generator.standard_normal(2)
    n = forces_N.shape[0]
    noise = generator.standard_normal((n, 13))
    forces = forces_N * gain + errors.force_sd_N * noise[:, :4]
    askew = linear.copy()
    askew[:, 0] -= nose * linear[:, 2]
    askew[:, 1] += side * linear[:, 2]
    askew[:, 2] += nose * linear[:, 0] - side * linear[:, 1]
    sd = np.sqrt(np.r_[[errors.horizontal_variance] * 2, [errors.acceleration_variance] * 5])
    turned = angular + np.sqrt(errors.acceleration_variance) * noise[:, 11:]
    return forces, askew + bias + sd * noise[:, 4:11], turned, gain

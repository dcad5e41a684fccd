"""What differs from one realization of a closed loop to the next, drawn before anything runs.

A realization is a specimen of the battery (how far its capacity, resistances and time constants are from the
nominal ones, lognormal), an error of the initial SOC estimate, and the errors of the sensors. Every policy
that drives it meets the same. A realization depends on the seed and its number alone, not on how many there
are or who computes it. In a comparison number ``2 m + 1`` mirrors number ``2 m`` (`ems.noise`); in training,
where squares of errors count, a mirror image would say nothing new.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from bms.plants.ecm import Factors
from bms.plants.sensed import SensorErrors, SensorNoise

Array = NDArray[np.float64]

COMPARISON, TRAINING = 0, 1
"""Streams of draws: an estimator is not identified on the noise that it is judged on."""


class Scatter(BaseModel):
    """How far a specimen of the battery is from the cell that its management system was told of.

    Raises
    ------
    pydantic.ValidationError
        When a value is negative or not finite.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    capacity_sd: float = Field(default=0.02, ge=0.0, lt=0.5, description="relative deviation of the capacity")
    resistance_sd: float = Field(default=0.05, ge=0.0, lt=1.0, description="... of the series resistance")
    relaxation_sd: float = Field(default=0.1, ge=0.0, lt=1.0, description="... of relaxation resistances")
    time_sd: float = Field(default=0.1, ge=0.0, lt=1.0, description="... of relaxation time constants")


@dataclass(frozen=True, eq=False)
class Draws:
    """Standard normal draws of one realization.

    Parameters
    ----------
    initial : float
        Error of the initial estimate.
    specimen : ndarray, shape (4,)
        Capacity, series resistance, relaxation resistances, time constants.
    offset : ndarray, shape (3,)
        Offsets of the sensors of current, voltage and temperature.
    noise : ndarray, shape (3, N)
        Their noise.
    """

    initial: float
    specimen: Array
    offset: Array
    noise: Array

    def factors(self, scatter: Scatter) -> Factors:
        """The specimen."""
        sd = (scatter.capacity_sd, scatter.resistance_sd, scatter.relaxation_sd, scatter.time_sd)
        return Factors(*(float(value) for value in np.exp(np.array(sd) * self.specimen)))

    def sensor_errors(self, sensors: SensorNoise, series: int) -> SensorErrors:
        """The errors of the sensors, those of the voltage for a number of cells in series."""
        offset = np.array(
            [sensors.current_bias_sd_A, series * sensors.voltage_bias_sd_V, sensors.temperature_bias_sd_C]
        )
        sd = np.array([sensors.current_sd_A, series * sensors.voltage_sd_V, sensors.temperature_sd_C])
        current_A, voltage_V, temperature_C = (offset * self.offset)[:, None] + sd[:, None] * self.noise
        return SensorErrors(current_A, voltage_V, temperature_C)


def draw_realization(seed: int, number: int, steps: int, stream: int = COMPARISON) -> Draws:
    """Draw one realization.

    Parameters
    ----------
    seed : int
        Seed of the study, >= 0.
    number : int
        Which realization, from 0 on.
    steps : int
        Steps N of the trip.
    stream : int
        COMPARISON or TRAINING.
    """
    mirrored = stream == COMPARISON
    key = (stream, number // 2 if mirrored else number)
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
    single = generator.standard_normal(8)
    noise = generator.standard_normal((3, steps))
    sign = -1.0 if mirrored and number % 2 else 1.0
    return Draws(sign * float(single[0]), sign * single[1:5], sign * single[5:], sign * noise)

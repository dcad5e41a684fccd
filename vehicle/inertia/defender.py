"""A synthetic Land Rover Defender 110, sprung by struts whose force is measured.

Sprung mass, centre of gravity, wheelbase and track are those that [M] Tables 5-6 imply (ERRATA). The report
refers to measurements of the inertias that it does not print, so all other values are our own choices for a
vehicle of this size: inertias below those of a mass sitting over the wheels (0.79 m a b and 0.58 m l r), body
modes near 1.3 Hz, wheel hop near 10 Hz, a drag area of 1.9 m^2, and drag that acts above the centre of
gravity, in the middle of a tall front. The heights over roll and pitch centre are equal because [M] eqs 30-33
know only one h.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

Array = NDArray[np.float64]

GRAVITY_MPS2 = 9.81
LONGEST_M, WIDEST_M = 30.0, 10.0
"""Wheelbase and track beyond which a length is taken to be in another unit."""


class Geometry(BaseModel):
    """Lengths that are known; the ride model takes the position of the centre of gravity as known, too."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    wheelbase_m: float = Field(default=2.794, gt=0.0, le=LONGEST_M, description="L, in m")
    track_m: float = Field(default=1.790, gt=0.0, le=WIDEST_M, description="B, in m")
    cg_from_front_m: float = Field(default=1.4266, gt=0.0, description="a, from the front axle")
    cg_from_left_m: float = Field(default=0.8867, gt=0.0, description="l, from the left track")
    drag_moment_kg: float = Field(
        default=0.0,
        ge=0.0,
        description="pitching moment of drag over V^2, where it is known: ride model only",
    )

    @model_validator(mode="after")
    def _check(self) -> Geometry:
        if not (self.cg_from_front_m < self.wheelbase_m and self.cg_from_left_m < self.track_m):
            raise ValueError("the centre of gravity must lie between the axles and between the tracks")
        return self

    @property
    def lengths_m(self) -> tuple[float, float, float, float]:
        """The distances a, b, l and r of the centre of gravity from front, rear, left and right."""
        a, left = self.cg_from_front_m, self.cg_from_left_m
        return a, self.wheelbase_m - a, left, self.track_m - left


class SprungVehicle(BaseModel):
    """Body on four struts over four wheels, with values of the Defender by default."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    wheelbase_m: float = Field(default=2.794, gt=0.0, le=LONGEST_M, description="L, in m")
    track_m: float = Field(default=1.790, gt=0.0, le=WIDEST_M, description="B, in m")
    cg_from_front_m: float = Field(default=1.4266, gt=0.0, description="a, from the front axle")
    cg_from_left_m: float = Field(default=0.8867, gt=0.0, description="l, from the left track")
    mass_kg: float = Field(default=1873.0, gt=0.0, description="sprung mass m")
    pitch_inertia_kgm2: float = Field(default=2900.0, gt=0.0, description="about the centre of gravity")
    roll_inertia_kgm2: float = Field(default=870.0, gt=0.0, description="about the centre of gravity")
    cg_over_roll_centre_m: float = Field(default=0.55, gt=0.0, description="h_r")
    cg_over_pitch_centre_m: float = Field(default=0.55, gt=0.0, description="h_p")
    drag_kgpm: float = Field(default=1.14, ge=0.0, description="C = rho cd A / 2")
    drag_over_cg_m: float = Field(default=0.2, description="height at which drag acts, over the cg")
    spring_Npm: float = Field(default=31_000.0, gt=0.0, description="of a strut at its static load")
    gas_exponent: float = Field(default=1.3, gt=0.0, description="of the hydropneumatic spring")
    bump_Nspm: float = Field(default=1_700.0, ge=0.0, description="damping of a strut, compressed")
    rebound_Nspm: float = Field(default=2_900.0, ge=0.0, description="damping of a strut, extended")
    unsprung_kg: float = Field(default=80.0, gt=0.0, description="of a wheel and its part of an axle")
    tyre_Npm: float = Field(default=280_000.0, gt=0.0, description="of a tyre")

    @model_validator(mode="after")
    def _check(self) -> SprungVehicle:
        # Builds what refuses a centre of gravity beside the wheels.
        _ = self.geometry
        return self

    @property
    def geometry(self) -> Geometry:
        """What is taken as known of it."""
        return Geometry(
            wheelbase_m=self.wheelbase_m,
            track_m=self.track_m,
            cg_from_front_m=self.cg_from_front_m,
            cg_from_left_m=self.cg_from_left_m,
            drag_moment_kg=self.drag_kgpm * (self.cg_over_pitch_centre_m + self.drag_over_cg_m),
        )

    @property
    def static_N(self) -> Array:
        """Force of each strut at rest on level ground, shape (4,)."""
        a, b, left, right = self.geometry.lengths_m
        share = np.array([b * right, b * left, a * right, a * left])
        return self.mass_kg * GRAVITY_MPS2 * share / (self.wheelbase_m * self.track_m)

    @property
    def truth(self) -> dict[str, float]:
        """What the estimators look for, by name."""
        return {
            "mass_kg": self.mass_kg,
            "pitch_inertia_kgm2": self.pitch_inertia_kgm2,
            "roll_inertia_kgm2": self.roll_inertia_kgm2,
            "cg_height_m": self.cg_over_roll_centre_m,
            "cg_from_front_m": self.cg_from_front_m,
            "cg_from_left_m": self.cg_from_left_m,
            "cg_over_roll_centre_m": self.cg_over_roll_centre_m,
            "cg_over_pitch_centre_m": self.cg_over_pitch_centre_m,
            "drag_kgpm": self.drag_kgpm,
            "drag_moment_kg": self.geometry.drag_moment_kg,
        }


DEFENDER = SprungVehicle()

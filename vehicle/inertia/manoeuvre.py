r"""How the synthetic vehicle is driven: in town, and on a winding country road ([M] Vehicle data sets).

Speed changes, bends, gradients and banks are drawn, each smooth. A change of speed or of curvature follows

.. math:: s(u) = u - \sin(2 \pi u) / (2 \pi), \qquad 0 \le u \le 1,

whose derivative, the acceleration, starts and ends at zero. In town: stop and go up to 55 km/h on a road of
class B, hardly a bend; in the country: 50 to 90 km/h, bend after bend, gradients and banks, class C. In the
axes of the road an accelerometer at rest in the body reads :math:`dv/dt + g \sin(grade)` and
:math:`v^2 \kappa + g \sin(bank)`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from vehicle.errors import VehicleError
from vehicle.inertia.defender import GRAVITY_MPS2
from vehicle.inertia.log import check_name

Array = NDArray[np.float64]

Scenario = Literal["urban", "rural"]


@dataclass(frozen=True)
class Style:
    """What a scenario draws from; pairs are the ends of a range.

    Parameters
    ----------
    road : str
        Class of ISO 8608.
    speed_mps, accelerate_mps2, brake_mps2, cruise_s : tuple of float
        Speeds to drive at, peak accelerations, and time at a speed.
    stops : float
        Probability that a change of speed is a stop.
    bend_mps2, bend_s, straight_s : tuple of float
        Peak lateral acceleration and length of a bend, and time to the next.
    grade, bank : float
        Largest slopes.
    """

    road: str
    speed_mps: tuple[float, float]
    accelerate_mps2: tuple[float, float]
    brake_mps2: tuple[float, float]
    cruise_s: tuple[float, float]
    stops: float
    bend_mps2: tuple[float, float]
    bend_s: tuple[float, float]
    straight_s: tuple[float, float]
    grade: float
    bank: float


STYLES = {
    "urban": Style(
        road="B",
        speed_mps=(7.0, 15.0),
        accelerate_mps2=(1.2, 2.8),
        brake_mps2=(1.5, 4.0),
        cruise_s=(2.0, 12.0),
        stops=0.4,
        bend_mps2=(1.0, 3.0),
        bend_s=(3.0, 6.0),
        straight_s=(8.0, 30.0),
        grade=0.06,
        bank=0.02,
    ),
    "rural": Style(
        road="C",
        speed_mps=(14.0, 25.0),
        accelerate_mps2=(0.8, 2.2),
        brake_mps2=(1.0, 4.0),
        cruise_s=(2.0, 10.0),
        stops=0.0,
        bend_mps2=(1.0, 3.2),
        bend_s=(3.0, 8.0),
        straight_s=(0.0, 4.0),
        grade=0.08,
        bank=0.05,
    ),
}


@dataclass(frozen=True, eq=False)
class Manoeuvre:
    """Motion along the road, on uniform times.

    Parameters
    ----------
    time_s, speed_mps, distance_m : ndarray, shape (n,)
    ax_mps2, ay_mps2 : ndarray, shape (n,)
        Specific forces in the axes of the road, gravity's part included.
    """

    time_s: Array
    speed_mps: Array
    distance_m: Array
    ax_mps2: Array
    ay_mps2: Array


def drive(scenario: str, duration_s: float, step_s: float, generator: np.random.Generator) -> Manoeuvre:
    """Draw a drive.

    Parameters
    ----------
    scenario : {"urban", "rural"}
    duration_s, step_s : float
    generator : numpy.random.Generator

    Returns
    -------
    Manoeuvre

    Raises
    ------
    VehicleError
        When the scenario is unknown, or a time is not positive.
    """
    check_name("scenario", scenario, get_args(Scenario))
    if not (0.0 < step_s <= 0.1 and 2.0 <= duration_s <= 36_000.0):
        raise VehicleError(
            f"a drive lasts 2 s to 10 h, in steps of up to 0.1 s, got {duration_s} and {step_s} s"
        )
    style = STYLES[scenario]
    time = step_s * np.arange(round(duration_s / step_s) + 1, dtype=np.float64)
    speed, acceleration = _speed(style, time, generator)
    distance = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))])
    curvature = _curvature(style, time, speed, generator)
    grade = _slope(style.grade, distance, (300.0, 1500.0), generator)
    bank = _slope(style.bank, distance, (100.0, 500.0), generator)
    return Manoeuvre(
        time,
        speed,
        distance,
        acceleration + GRAVITY_MPS2 * grade,
        speed**2 * curvature + GRAVITY_MPS2 * bank,
    )


def _speed(style: Style, time: Array, generator: np.random.Generator) -> tuple[Array, Array]:
    """Draw a speed and its derivative."""
    low, high = style.speed_mps
    now = 0.0 if style.stops > 0.0 else generator.uniform(low, high)
    speed, acceleration = np.full_like(time, now), np.zeros_like(time)
    at = generator.uniform(1.0, 3.0)
    while at < time[-1]:
        stop = now > 0.0 and generator.uniform() < style.stops
        target = 0.0 if stop else generator.uniform(low, high)
        change = target - now
        peak = generator.uniform(*(style.accelerate_mps2 if change > 0.0 else style.brake_mps2))
        length = max(2.0 * abs(change) / peak, 1.0)
        u = np.clip((time - at) / length, 0.0, 1.0)
        speed += change * (u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi))
        acceleration += change / length * (1.0 - np.cos(2.0 * np.pi * u))
        now = target
        at += length + generator.uniform(*style.cruise_s)
    return np.maximum(speed, 0.0), acceleration


def _curvature(style: Style, time: Array, speed: Array, generator: np.random.Generator) -> Array:
    """Draw bends; a bend's curvature is that of its peak lateral acceleration at the speed in its middle."""
    curvature = np.zeros_like(time)
    at = generator.uniform(*style.straight_s)
    while at < time[-1]:
        length = generator.uniform(*style.bend_s)
        peak = generator.uniform(*style.bend_mps2) * (1.0 if generator.uniform() < 0.5 else -1.0)
        inside = (time >= at) & (time <= at + length)
        fastest = float(np.max(speed[inside], initial=0.0))
        # No road bends more tightly than over a radius of 8 m.
        tight = float(np.clip(peak / max(fastest, 1.0) ** 2, -0.125, 0.125))
        curvature[inside] += 0.5 * tight * (1.0 - np.cos(2.0 * np.pi * (time[inside] - at) / length))
        at += length + generator.uniform(*style.straight_s)
    return curvature


def _slope(
    largest: float, distance: Array, waves_m: tuple[float, float], generator: np.random.Generator
) -> Array:
    """Draw a slope that undulates with distance, within plus and minus its largest."""
    slope = np.zeros_like(distance)
    for _ in range(4):
        wave, phase = generator.uniform(*waves_m), generator.uniform(0.0, 2.0 * np.pi)
        slope += 0.25 * largest * np.sin(2.0 * np.pi * distance / wave + phase)
    return slope

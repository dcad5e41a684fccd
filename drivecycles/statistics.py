"""What a drive cycle looks like in a few numbers."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

STANDING_MPS = 0.1
"""At and below this speed a vehicle stands: above sensor noise, far below walking."""


@dataclass(frozen=True)
class CycleStatistics:
    """Summary of a cycle; see `summarize` for the definitions."""

    duration_s: float
    distance_m: float
    mean_speed_mps: float
    mean_moving_speed_mps: float
    max_speed_mps: float
    max_acceleration_mps2: float
    min_acceleration_mps2: float
    stops: int
    idle_fraction: float
    ascent_m: float
    max_grade: float
    min_grade: float


def summarize(
    time_s: npt.NDArray[np.float64], speed_mps: npt.NDArray[np.float64], altitude_m: npt.NDArray[np.float64]
) -> CycleStatistics:
    """Summarize a cycle.

    Parameters
    ----------
    time_s, speed_mps, altitude_m : ndarray, shape (n,)
        A valid cycle.

    Returns
    -------
    CycleStatistics
        An interval stands if the speed at both its ends is at most 0.1 m/s; the idle fraction is the share of
        time in such intervals, and the moving speed is the distance over the rest of the time. A stop is a
        standing sample that follows a moving one. Accelerations are means over one interval; grades are
        rise over distance driven.
    """
    step = np.diff(time_s)
    distance = step * 0.5 * (speed_mps[1:] + speed_mps[:-1])
    rise = np.diff(altitude_m)
    grade = np.divide(rise, distance, out=np.zeros_like(distance), where=distance > 0)
    acceleration = np.diff(speed_mps) / step
    standing = speed_mps <= STANDING_MPS
    idle = standing[1:] & standing[:-1]
    duration, moving_s = float(step.sum()), float(step[~idle].sum())
    return CycleStatistics(
        duration_s=duration,
        distance_m=float(distance.sum()),
        mean_speed_mps=float(distance.sum()) / duration,
        mean_moving_speed_mps=float(distance[~idle].sum()) / moving_s if moving_s > 0 else 0.0,
        max_speed_mps=float(speed_mps.max()),
        max_acceleration_mps2=float(acceleration.max()),
        min_acceleration_mps2=float(acceleration.min()),
        stops=int(np.count_nonzero(standing[1:] & ~standing[:-1])),
        idle_fraction=1.0 - moving_s / duration,
        ascent_m=float(np.maximum(rise, 0.0).sum()),
        max_grade=float(grade.max()),
        min_grade=float(grade.min()),
    )

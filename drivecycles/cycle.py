"""The drive cycle record: what the vehicle is asked to do.

A cycle is speed and road altitude at given times. Between samples speed is linear in time, so the distance
of an interval is the trapezoid ``(v[i] + v[i+1]) / 2 * (t[i+1] - t[i])``, and altitude is linear in distance,
so each interval has one grade.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Self

import numpy as np
import numpy.typing as npt

from drivecycles.altitude import altitude_at, smooth_altitude
from drivecycles.errors import CycleError
from drivecycles.statistics import CycleStatistics, summarize
from drivecycles.validation import find_fault, frozen_column

FloatArray = npt.NDArray[np.float64]

MAX_JOIN_STEP_MPS = 0.5
"""Largest speed difference over which two cycles may be joined."""


@dataclass(frozen=True, eq=False, init=False, repr=False)
class DriveCycle:
    """Speed and altitude over time; immutable, every method returns a new cycle.

    Parameters
    ----------
    name : str
        Shown in tables, figures and messages.
    time_s : array_like, shape (n,)
        Strictly increasing, n >= 2; need not be uniform nor start at zero.
    speed_mps : array_like, shape (n,)
        Vehicle speed, >= 0.
    altitude_m : array_like, shape (n,), optional
        Altitude of the road; level road if absent.

    Raises
    ------
    CycleError
        If a sample is not finite, time does not increase, a speed is negative, or lengths differ.

    Notes
    -----
    The three arrays are stored as read-only float64 copies.
    """

    name: str
    time_s: FloatArray
    speed_mps: FloatArray
    altitude_m: FloatArray

    def __init__(
        self,
        name: str,
        time_s: npt.ArrayLike,
        speed_mps: npt.ArrayLike,
        altitude_m: npt.ArrayLike | None = None,
    ) -> None:
        columns = {
            "time_s": frozen_column("time_s", time_s),
            "speed_mps": frozen_column("speed_mps", speed_mps),
        }
        level = np.zeros(columns["time_s"].size)
        columns["altitude_m"] = frozen_column("altitude_m", level if altitude_m is None else altitude_m)
        object.__setattr__(self, "name", name)
        for field, column in columns.items():
            object.__setattr__(self, field, column)
        self._validate()

    def __reduce__(self) -> tuple[type[Self], tuple[str, FloatArray, FloatArray, FloatArray]]:
        # Unpickled arrays would be writeable: rebuild through the constructor.
        return type(self), (self.name, self.time_s, self.speed_mps, self.altitude_m)

    def __repr__(self) -> str:
        return (
            f"DriveCycle({self.name!r}, {len(self)} samples, "
            f"{self.duration_s:g} s, {self.distance_m / 1000:.3f} km)"
        )

    def __len__(self) -> int:
        return int(self.time_s.size)

    def _validate(self) -> None:
        sizes = {len(self.time_s), len(self.speed_mps), len(self.altitude_m)}
        if len(sizes) > 1:
            raise CycleError(
                f"cycle {self.name!r}: time_s has {len(self.time_s)} samples, speed_mps {len(self.speed_mps)}"
                f" and altitude_m {len(self.altitude_m)}; give all three the same length"
            )
        if len(self) < 2:
            raise CycleError(f"cycle {self.name!r} has {len(self)} sample(s); a cycle needs at least 2")
        fault = find_fault(self.time_s, self.speed_mps, self.altitude_m)
        if fault is not None:
            index, message = fault
            raise CycleError(f"cycle {self.name!r}, sample {index} (t = {self.time_s[index]:g} s): {message}")

    @property
    def duration_s(self) -> float:
        """Time from the first sample to the last."""
        return float(self.time_s[-1] - self.time_s[0])

    @property
    def interval_distance_m(self) -> FloatArray:
        """Distance driven in each of the n - 1 intervals."""
        distance: FloatArray = np.diff(self.time_s) * 0.5 * (self.speed_mps[1:] + self.speed_mps[:-1])
        return distance

    @property
    def position_m(self) -> FloatArray:
        """Distance driven since the first sample, shape (n,); starts at zero."""
        return np.concatenate(([0.0], np.cumsum(self.interval_distance_m)))

    @property
    def distance_m(self) -> float:
        """Distance driven from the first sample to the last."""
        return float(self.interval_distance_m.sum())

    @property
    def grade(self) -> FloatArray:
        """Rise over distance driven (sine of the slope) in each of the n - 1 intervals; 0 when standing."""
        distance = self.interval_distance_m
        return np.divide(np.diff(self.altitude_m), distance, out=np.zeros_like(distance), where=distance > 0)

    @property
    def ascent_m(self) -> float:
        """Sum of all climbs."""
        return float(np.maximum(np.diff(self.altitude_m), 0.0).sum())

    @property
    def is_uniform(self) -> bool:
        """Whether all time steps are equal, up to the rounding of the time stamps."""
        steps = np.diff(self.time_s)
        mean = self.duration_s / steps.size
        tolerance = 1e-6 * mean + 4.0 * np.spacing(np.abs(self.time_s).max())
        return bool(np.abs(steps - mean).max() <= tolerance)

    @property
    def step_s(self) -> float:
        """The time step of a uniformly sampled cycle.

        Raises
        ------
        CycleError
            If the time steps differ.
        """
        if not self.is_uniform:
            steps = np.diff(self.time_s)
            raise CycleError(
                f"cycle {self.name!r} has time steps from {steps.min():g} to {steps.max():g} s and so no "
                "single step; make it uniform with resample(1.0)"
            )
        return self.duration_s / (len(self) - 1)

    def statistics(self) -> CycleStatistics:
        """Duration, distance, speeds, accelerations, stops and climbs in one record."""
        return summarize(self.time_s, self.speed_mps, self.altitude_m)

    def renamed(self, name: str) -> "DriveCycle":
        """Return the same cycle under another name."""
        return replace(self, name=name)

    def repeat(self, n: int) -> "DriveCycle":
        """Drive the cycle `n` times in a row; each lap starts at the altitude where the last one ended.

        Raises
        ------
        CycleError
            If `n` is below 1, or the cycle does not end at the speed at which it starts.
        """
        if n < 1:
            raise CycleError(f"cannot repeat cycle {self.name!r} {n} times; give a whole number, 1 or more")
        return self if n == 1 else join([self] * n, name=f"{self.name} x{n}")

    def resample(self, step_s: float) -> "DriveCycle":
        """Sample the cycle every `step_s` seconds from its first time on.

        Speed is linear in time and altitude linear in distance between the old samples. Where `step_s` does
        not divide the duration, the last step is completed by holding the last speed and altitude: the new
        cycle is up to one step longer, never cut short.

        Raises
        ------
        CycleError
            If `step_s` is not positive or exceeds the duration.
        """
        if not (np.isfinite(step_s) and 0 < step_s <= self.duration_s * (1 + 1e-9)):
            raise CycleError(
                f"cannot resample cycle {self.name!r} to a step of {step_s:g} s; "
                f"give a step above 0 and up to its duration, {self.duration_s:g} s"
            )
        steps = int(np.ceil(self.duration_s / step_s - 1e-6))
        time = self.time_s[0] + step_s * np.arange(steps + 1)
        speed = np.interp(time, self.time_s, self.speed_mps)
        altitude = altitude_at(time, self.time_s, self.speed_mps, self.altitude_m)
        return replace(self, time_s=time, speed_mps=speed, altitude_m=altitude)

    def with_altitude(self, position_m: npt.ArrayLike, altitude_m: npt.ArrayLike) -> "DriveCycle":
        """Lay the cycle on a road whose altitude is given over distance, linear between the points.

        Parameters
        ----------
        position_m : array_like, shape (m,)
            Strictly increasing; from 0 or below to the cycle's distance or beyond.
        altitude_m : array_like, shape (m,)
            Altitude at these positions.

        Raises
        ------
        CycleError
            If the profile is not finite, not increasing, or shorter than the cycle.
        """
        x, z = frozen_column("position_m", position_m), frozen_column("altitude_m", altitude_m)
        if x.size != z.size or x.size < 2 or not (np.isfinite(x).all() and np.isfinite(z).all()):
            raise CycleError(
                f"the altitude profile has {x.size} positions and {z.size} altitudes; "
                "give two or more finite values of each, as many of one as of the other"
            )
        if np.any(np.diff(x) <= 0):
            raise CycleError(
                "the positions of an altitude profile must increase; sort them and drop duplicates"
            )
        if x[0] > 1e-6 or x[-1] < self.distance_m * (1 - 1e-9) - 1e-6:
            raise CycleError(
                f"the altitude profile covers {x[0]:g} to {x[-1]:g} m, but cycle {self.name!r} drives "
                f"from 0 to {self.distance_m:g} m; extend the profile"
            )
        return replace(self, altitude_m=np.interp(self.position_m, x, z))

    def smooth_altitude(self, length_m: float) -> "DriveCycle":
        """Average the altitude over `length_m` of road around each sample.

        For logged altitudes, whose noise would make absurd grades over the short distances between samples.
        Beyond both ends the profile is continued as its mirror image through the end, so the altitudes there
        stay; a constant grade stays.

        Raises
        ------
        CycleError
            If `length_m` is not positive.
        """
        if not (np.isfinite(length_m) and length_m > 0):
            raise CycleError(
                f"cannot smooth altitude over {length_m:g} m; give a length above 0, such as 100"
            )
        return replace(self, altitude_m=smooth_altitude(self.position_m, self.altitude_m, length_m))


def join(cycles: Sequence[DriveCycle], name: str | None = None) -> DriveCycle:
    """Drive cycles one after the other.

    The first sample of each cycle coincides with the last one of the cycle before, so durations and distances
    add up; altitude continues from where the last cycle ended.

    Parameters
    ----------
    cycles : sequence of DriveCycle
        One or more, in driving order.
    name : str, optional
        Default: the names joined by "+".

    Raises
    ------
    CycleError
        If there are no cycles, or speeds differ by more than 0.5 m/s where two cycles meet. Up to there the
        speed at which the earlier cycle ends is kept.
    """
    if not cycles:
        raise CycleError("there are no cycles to join; give at least one")
    first = cycles[0]
    time, speed, altitude = [first.time_s], [first.speed_mps], [first.altitude_m]
    for last, cycle in pairwise(cycles):
        end, start = last.speed_mps[-1], cycle.speed_mps[0]
        if abs(end - start) > MAX_JOIN_STEP_MPS:
            raise CycleError(
                f"cannot join {last.name!r}, which ends at {end:g} m/s, and {cycle.name!r}, which starts at "
                f"{start:g} m/s; the speeds may differ by {MAX_JOIN_STEP_MPS} m/s: "
                "let one end where the other starts, for instance both at a stop"
            )
        time.append(cycle.time_s[1:] - cycle.time_s[0] + time[-1][-1])
        speed.append(cycle.speed_mps[1:])
        altitude.append(cycle.altitude_m[1:] - cycle.altitude_m[0] + altitude[-1][-1])
    joined = "+".join(cycle.name for cycle in cycles) if name is None else name
    return DriveCycle(joined, np.concatenate(time), np.concatenate(speed), np.concatenate(altitude))

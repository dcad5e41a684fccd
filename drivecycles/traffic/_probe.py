"""A vehicle in a speed field, compiled: see `drivecycles.traffic.probe` for the law it follows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

ARRIVED, STUCK, BEYOND = 0, 1, 2
"""How a trip ends: at the end of the road; out of samples before it; out of the field's time before it."""

REST_MPS = 0.2
REST_M = 0.5
"""A vehicle slower than this, nearer to where it must stop than this, has stopped."""
LINE_M = 1.0
"""Distance from a closed face at which vehicles stop before it."""
FREE, STOPS, PASSES = 0, 1, 2
"""What a vehicle does at a closed face: nothing yet; it stops; it is too close to stop."""


class Limits(NamedTuple):
    """Most acceleration, deceleration, comfortable one, jerk, specific power, and the time constant."""

    most: float
    least: float
    comfort: float
    jerk: float
    power: float
    lag: float


class Closures(NamedTuple):
    """Faces that are closed for a time: first cell behind, position, start and end, all of shape (g,)."""

    cell: NDArray[np.int64]
    place_m: Array
    start_s: Array
    end_s: Array


@njit(cache=True, inline="always")
def field_at(speed: Array, row: float, column: float, first: float, last: float) -> float:
    """Speed between four samples of the field, the nearest ones beyond its edges or a closed face.

    ``first`` and ``last`` are the outermost columns on this side of closed faces.
    """
    y = min(max(row, 0.0), speed.shape[0] - 1.0)
    x = min(max(column, first), last)
    i, j = min(int(y), speed.shape[0] - 2), min(int(x), speed.shape[1] - 2)
    p, q = y - i, x - j
    before = speed[i, j] + q * (speed[i, j + 1] - speed[i, j])
    after = speed[i + 1, j] + q * (speed[i + 1, j + 1] - speed[i + 1, j])
    return float(before + p * (after - before))


@njit(cache=True, inline="always")
def approach(left_m: float, v: float, limits: Limits) -> float:
    """Highest speed from which a stop is still met with the comfortable deceleration."""
    lead = v * limits.comfort / limits.jerk
    return float(np.sqrt(2.0 * limits.comfort * max(left_m - lead, 0.0)))


@njit(cache=True, inline="always")
def least_braking(left_m: float, v: float, a: float, limits: Limits) -> float:
    """Acceleration that a stop within a distance takes at most; infinite while it is still far.

    Judged where full jerk would have brought the acceleration to the comfortable deceleration; letting go of
    it at full jerk takes a little way of its own at the end.
    """
    turn_s = max(a + limits.comfort, 0.0) / limits.jerk
    later = max(v + 0.5 * (a - limits.comfort) * turn_s, 0.0)
    on_m = v * turn_s + 0.5 * a * turn_s * turn_s - limits.jerk * turn_s * turn_s * turn_s / 6.0
    release_m = limits.comfort**3 / (24.0 * limits.jerk**2)
    room_m = left_m - max(on_m, 0.0) - release_m
    if later * later <= 2.0 * limits.comfort * room_m:
        return float(np.inf)
    return float(-max(limits.comfort, 0.5 * later * later / max(room_m, 0.05)))


@njit(cache=True, inline="always")
def accelerate(target: float, most: float, v: float, a: float, limits: Limits, step_s: float) -> float:
    """Acceleration of the next step towards a speed; the vehicle asks for ``most`` at most."""
    wanted = target - v
    bound = np.sqrt(2.0 * limits.jerk * abs(wanted))
    asked = min(min(max(wanted / limits.lag, -bound), bound), most)
    asked = min(max(asked, -limits.least), min(limits.most, limits.power / max(v, 1e-3)))
    a += min(max(asked - a, -limits.jerk * step_s), limits.jerk * step_s)
    # At full jerk a vehicle that brakes this hard just stops with no deceleration left.
    return float(max(a, -np.sqrt(2.0 * limits.jerk * v)))


@njit(cache=True, nogil=True)
def can_stop(left_m: float, v: float, a: float, traffic_mps: float, limits: Limits, step_s: float) -> bool:
    """Try whether a vehicle in traffic of a speed comes to rest before a closed face, by driving there.

    ``left_m`` is what is left to the place where it would wait.
    """
    x, free = 0.0, max(v, traffic_mps)
    # From twice the way that a comfortable stop takes, every vehicle stops.
    if left_m > free * free / limits.comfort + 2.0 * free * (limits.comfort + max(a, 0.0)) / limits.jerk:
        return True
    while v > REST_MPS or a > 0.0:
        target = min(free, approach(left_m - x, v, limits))
        a = accelerate(target, least_braking(left_m - x, v, a, limits), v, a, limits, step_s)
        x += max(v * step_s + 0.5 * a * step_s * step_s, 0.0)
        v = max(v + a * step_s, 0.0)
        if x > left_m + LINE_M - 0.5 * REST_M:
            return False
    return True


@njit(cache=True, nogil=True)
def drive(
    speed: Array,
    time_step_s: float,
    first_m: float,
    cell_m: float,
    length_m: float,
    depart_s: float,
    start_mps: float,
    stops: bool,
    limits: Limits,
    closures: Closures,
    step_s: float,
    substeps: int,
    track: Array,
) -> tuple[int, int]:
    """Drive the road once.

    Parameters
    ----------
    speed : ndarray, shape (n, cells)
        The field, uniform in time and along the road.
    time_step_s, first_m, cell_m, length_m : float
        Step of its rows, position of its first column, distance of its columns, end of the road.
    depart_s, start_mps : float
        When, in the field's time, and how fast the vehicle starts, at position 0.
    stops : bool
        Whether it comes to rest at the end.
    limits : Limits
        Of the vehicle.
    closures : Closures
        Where it waits; times are the field's.
    step_s : float
        Time step of the integration.
    substeps : int
        Steps to a sample.
    track : ndarray, shape (m, 2)
        Filled with position and speed at the samples.

    Returns
    -------
    tuple of int
        Number of samples filled, and how the trip ended.
    """
    comfort = limits.comfort
    x, v, a = 0.0, start_mps, 0.0
    track[0, 0], track[0, 1] = x, v
    last_s = (speed.shape[0] - 1) * time_step_s
    choice = np.zeros(closures.cell.size, dtype=np.int64)
    for sample in range(1, track.shape[0]):
        for sub in range(substeps):
            t = depart_s + ((sample - 1) * substeps + sub) * step_s
            if t > last_s:
                return sample, BEYOND
            row = t / time_step_s
            first, last, line_m, most = 0.0, speed.shape[1] - 1.0, np.inf, np.inf
            for g in range(closures.cell.size):
                if not closures.start_s[g] <= t < closures.end_s[g]:
                    continue
                if x >= closures.place_m[g]:
                    first = max(first, float(closures.cell[g]))
                    continue
                left_m = closures.place_m[g] - LINE_M - x
                if choice[g] == FREE:
                    near = field_at(speed, row, (x - first_m) / cell_m, 0.0, closures.cell[g] - 1.0)
                    choice[g] = STOPS if can_stop(left_m, v, a, near, limits, step_s) else PASSES
                if choice[g] == STOPS:
                    last = min(last, closures.cell[g] - 1.0)
                    line_m = min(line_m, closures.place_m[g] - LINE_M)
            target = field_at(speed, row, (x - first_m) / cell_m, first, last)
            lead = v * comfort / limits.jerk
            reach = min(min(0.5 * v * v / comfort + lead, length_m - x), line_m - x)
            ahead = 0.0
            while ahead < reach:
                ahead = min(ahead + 0.25 * cell_m, reach)
                seen = field_at(speed, row, (x + ahead - first_m) / cell_m, first, last)
                target = min(target, np.sqrt(seen * seen + 2.0 * comfort * max(ahead - lead, 0.0)))
            if stops:
                target = min(target, approach(length_m - x, v, limits))
            if line_m < np.inf:
                # The lag of the speed ahead would carry a slow driver over the line.
                target = min(target, approach(line_m - x, v, limits))
                most = least_braking(line_m - x, v, a, limits)
            a = accelerate(target, most, v, a, limits, step_s)
            x += max(v * step_s + 0.5 * a * step_s * step_s, 0.0)
            v = max(v + a * step_s, 0.0)
            if (stops and length_m - x < REST_M and v < REST_MPS) or (not stops and x >= length_m):
                track[sample, 0], track[sample, 1] = min(x, length_m), 0.0 if stops else v
                return sample + 1, ARRIVED
        track[sample, 0], track[sample, 1] = x, v
    return track.shape[0], STUCK

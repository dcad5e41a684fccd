"""A vehicle in a speed field, compiled: see `drivecycles.traffic.probe` for the law it follows."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

ARRIVED, STUCK, BEYOND = 0, 1, 2
"""How a trip ends: at the end of the road; out of samples before it; out of the field's time before it."""

REST_MPS = 0.2
REST_M = 0.5
"""A vehicle slower than this, nearer to where it must stop than this, has stopped."""


@njit(cache=True, inline="always")
def field_at(speed: Array, row: float, column: float) -> float:
    """Speed between four samples of the field, the nearest ones beyond its edges."""
    y = min(max(row, 0.0), speed.shape[0] - 1.0)
    x = min(max(column, 0.0), speed.shape[1] - 1.0)
    i, j = min(int(y), speed.shape[0] - 2), min(int(x), speed.shape[1] - 2)
    p, q = y - i, x - j
    before = speed[i, j] + q * (speed[i, j + 1] - speed[i, j])
    after = speed[i + 1, j] + q * (speed[i + 1, j + 1] - speed[i + 1, j])
    return float(before + p * (after - before))


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
    limits: tuple[float, float, float, float, float, float],
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
    limits : tuple of float
        Acceleration, deceleration, comfortable deceleration, jerk, specific power, time constant.
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
    most, least, comfort, jerk, power, lag = limits
    x, v, a = 0.0, start_mps, 0.0
    track[0, 0], track[0, 1] = x, v
    last_s = (speed.shape[0] - 1) * time_step_s
    for sample in range(1, track.shape[0]):
        for sub in range(substeps):
            t = depart_s + ((sample - 1) * substeps + sub) * step_s
            if t > last_s:
                return sample, BEYOND
            row = t / time_step_s
            target = field_at(speed, row, (x - first_m) / cell_m)
            lead = v * comfort / jerk
            reach = min(0.5 * v * v / comfort + lead, length_m - x)
            ahead = 0.0
            while ahead < reach:
                ahead = min(ahead + 0.25 * cell_m, reach)
                seen = field_at(speed, row, (x + ahead - first_m) / cell_m)
                target = min(target, np.sqrt(seen * seen + 2.0 * comfort * max(ahead - lead, 0.0)))
            if stops:
                target = min(target, np.sqrt(2.0 * comfort * max(length_m - x - lead, 0.0)))
            wanted = target - v
            bound = np.sqrt(2.0 * jerk * abs(wanted))
            asked = min(max(wanted / lag, -bound), bound)
            asked = min(max(asked, -least), min(most, power / max(v, 1e-3)))
            a += min(max(asked - a, -jerk * step_s), jerk * step_s)
            # At full jerk a vehicle that brakes this hard just stops with no deceleration left.
            a = max(a, -np.sqrt(2.0 * jerk * v))
            x += max(v * step_s + 0.5 * a * step_s * step_s, 0.0)
            v = max(v + a * step_s, 0.0)
            if (stops and length_m - x < REST_M and v < REST_MPS) or (not stops and x >= length_m):
                track[sample, 0], track[sample, 1] = min(x, length_m), 0.0 if stops else v
                return sample + 1, ARRIVED
        track[sample, 0], track[sample, 1] = x, v
    return track.shape[0], STUCK

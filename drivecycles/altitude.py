"""Road altitude along a cycle: between samples, and smoothed."""

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def altitude_at(
    query_s: FloatArray, time_s: FloatArray, speed_mps: FloatArray, altitude_m: FloatArray
) -> FloatArray:
    """Altitude at any time of a cycle: linear in distance between samples, in time where the vehicle stands.

    Parameters
    ----------
    query_s : ndarray, shape (m,)
        Times; outside the cycle the nearest end counts.
    time_s, speed_mps, altitude_m : ndarray, shape (n,)
        The cycle.

    Returns
    -------
    ndarray, shape (m,)
        Altitude in metres.
    """
    time = np.clip(query_s, time_s[0], time_s[-1])
    i = np.clip(np.searchsorted(time_s, time, side="right") - 1, 0, time_s.size - 2)
    elapsed = time - time_s[i]
    step = time_s[i + 1] - time_s[i]
    fraction = elapsed / step
    # Distance grows with the square of time while accelerating; linear in time would fake steep grades.
    v0, v1 = speed_mps[i], speed_mps[i + 1]
    driven = (v0 + 0.5 * (v1 - v0) * fraction) * elapsed
    distance = 0.5 * (v0 + v1) * step
    np.divide(driven, distance, out=fraction, where=distance > 0)
    altitude: FloatArray = altitude_m[i] + fraction * (altitude_m[i + 1] - altitude_m[i])
    return altitude


def smooth_altitude(position_m: FloatArray, altitude_m: FloatArray, length_m: float) -> FloatArray:
    """Average a profile that is linear between its points over a window that moves along the road.

    Parameters
    ----------
    position_m : ndarray, shape (n,)
        Not decreasing; where it repeats (standing) the mean altitude of the repeats counts.
    altitude_m : ndarray, shape (n,)
        Altitude at these positions.
    length_m : float
        Length of the window, centred on each position. Beyond an end the profile goes on as its mirror image
        through the end's point: the altitude there stays, and so does a constant grade.

    Returns
    -------
    ndarray, shape (n,)
        Smoothed altitude in metres.
    """
    x, group = np.unique(position_m, return_inverse=True)
    z = np.bincount(group, weights=altitude_m) / np.bincount(group)
    if x.size < 2:
        return z[group]
    half = min(0.5 * length_m, float(x[-1] - x[0]))
    wide_x = np.concatenate((2.0 * x[0] - x[:0:-1], x, 2.0 * x[-1] - x[-2::-1]))
    wide_z = np.concatenate((2.0 * z[0] - z[:0:-1], z, 2.0 * z[-1] - z[-2::-1]))
    area = _integral(x + half, wide_x, wide_z) - _integral(x - half, wide_x, wide_z)
    result: FloatArray = (area / (2.0 * half))[group]
    return result


def _integral(query: FloatArray, x: FloatArray, z: FloatArray) -> FloatArray:
    """Integral of the piecewise linear z from x[0] to each query."""
    slope = np.diff(z) / np.diff(x)
    area = np.concatenate(([0.0], np.cumsum(0.5 * np.diff(x) * (z[1:] + z[:-1]))))
    i = np.clip(np.searchsorted(x, query, side="right") - 1, 0, x.size - 2)
    beyond = query - x[i]
    integral: FloatArray = area[i] + (z[i] + 0.5 * slope[i] * beyond) * beyond
    return integral

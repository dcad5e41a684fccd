"""What no drive cycle may contain."""

import numpy as np
import numpy.typing as npt

from drivecycles.errors import CycleError

FloatArray = npt.NDArray[np.float64]


def find_fault(time_s: FloatArray, speed_mps: FloatArray, altitude_m: FloatArray) -> tuple[int, str] | None:
    """Find the first sample that no cycle may contain.

    Returns
    -------
    tuple of int and str, or None
        Index of the sample and what is wrong with it; None if all samples are possible.
    """
    for name, column in (("time", time_s), ("speed", speed_mps), ("altitude", altitude_m)):
        bad = np.flatnonzero(~np.isfinite(column))
        if bad.size:
            return int(bad[0]), f"{name} is {column[bad[0]]}; every value must be a finite number"
    bad = np.flatnonzero(np.diff(time_s) <= 0) + 1
    if bad.size:
        i = int(bad[0])
        return i, f"time goes from {time_s[i - 1]:.10g} to {time_s[i]:.10g} s; time must always increase"
    bad = np.flatnonzero(speed_mps < 0)
    if bad.size:
        i = int(bad[0])
        return i, f"speed is {speed_mps[i]:g} m/s; speed must be 0 or more (set sensor noise around 0 to 0)"
    return None


def frozen_column(field: str, values: npt.ArrayLike) -> FloatArray:
    """Copy values into a read-only one-dimensional float64 array, or raise CycleError."""
    try:
        column = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise CycleError(f"{field} must hold numbers: {error}") from error
    if column.ndim != 1:
        raise CycleError(f"{field} has shape {column.shape}; give a one-dimensional array")
    column.setflags(write=False)
    return column

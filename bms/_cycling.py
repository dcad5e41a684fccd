"""Charge and discharge cycles between two limits of the SOC, as a numba kernel."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, nogil=True)
def cycle(
    drive_A: Array,
    charge_A: float,
    soc_per_A: float,
    low: float,
    high: float,
    state: Array,
    current_A: Array,
    soc: Array,
) -> None:
    """Discharge by a current that repeats down to ``low``, charge up to ``high``, and so on.

    Parameters
    ----------
    drive_A : ndarray, shape (m,)
        Current while driving.
    charge_A : float
        Current while charging.
    soc_per_A : float
        Change of SOC by one ampere over one sample.
    low, high : float
        Limits of the SOC, compared at the start of each sample.
    state : ndarray, shape (3,)
        SOC, whether it charges (0 or 1), next sample of the drive; left at the end of the last sample.
    current_A, soc : ndarray, shape (n,)
        Filled with the current of each sample and the SOC at its start.
    """
    now, charging, at = state[0], state[1] > 0.0, int(state[2])
    for k in range(current_A.size):
        if charging and now >= high:
            charging, at = False, 0
        elif not charging and now <= low:
            charging = True
        if charging:
            current = charge_A
        else:
            current = drive_A[at]
            at += 1
            if at == drive_A.size:
                at = 0
        current_A[k], soc[k] = current, now
        now += soc_per_A * current
    state[0], state[1], state[2] = now, 1.0 if charging else 0.0, at

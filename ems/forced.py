"""How far a road alone carries the SOC upwards, which decides how far the SOC grid must reach.

No control refuses recuperation: on a long descent the battery is charged whatever the policy does, beyond its
window if it comes to that. Where the grid ended before, the cost-to-go would be held constant, going further
would cost nothing, and the policy would run the engine downhill.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bms import Pack

HEADROOM = 0.05
"""What the grid reaches beyond a rise that is forced, for noise and for what lies before it."""


def forced_rise(power_W: NDArray[np.float64], pack: Pack, soc: float, step_s: float) -> float:
    """Find the largest rise of the SOC over any part of a trip when every step charges as little as it can.

    Parameters
    ----------
    power_W : ndarray, shape (N, C)
        Battery power of every step and control; charging is positive.
    pack : Pack
        Battery, taken without losses.
    soc : float
        SOC at which its voltage is taken.
    step_s : float
        Length of a step.
    """
    least_W = power_W.min(axis=1)
    moves = least_W * step_s / (float(np.asarray(pack.ocv(np.array([soc])))[0]) * pack.capacity_C)
    walked = np.concatenate(([0.0], np.cumsum(moves)))
    return float(np.max(walked - np.minimum.accumulate(walked)))

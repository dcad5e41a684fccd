"""The charge-depleting, charge-sustaining rules, compiled; `ems.policies.rule_based` says them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

KEEP_RUNNING = 0.5  # share of the starting power below which a running engine stops
AVOID_SHORTFALL_W_PER_KG = 1e9


class Rules(NamedTuple):
    """Thresholds, and what the rules know of the trip."""

    sustain_soc: float
    band: float
    start_power_W: float
    deplete_power_W: float
    charge_power_W: float
    wheel_power_W: Array  # (N,)
    needs_engine: NDArray[np.bool_]  # (N,) the motor alone cannot follow


@njit(cache=True, nogil=True)
def choose_by_rule(
    rules: Rules, k: int, soc: float, engine_on: int, power_W: Array, shortfall_kg: Array
) -> tuple[int, int]:
    """Choose the control of step ``k`` and the engine state of the next.

    Parameters
    ----------
    rules : Rules
    k : int
        Step.
    soc : float
        SOC estimate.
    engine_on : int
        Engine state of this step.
    power_W, shortfall_kg : ndarray, shape (C,)
        Stage tables of this step.
    """
    excess = min(max((soc - rules.sustain_soc) / rules.band, -1.0), 1.0)
    if excess >= 0.0:
        start_W = rules.start_power_W + excess * (rules.deplete_power_W - rules.start_power_W)
        wanted_W = -excess * rules.deplete_power_W
    else:
        start_W = (1.0 + excess) * rules.start_power_W
        wanted_W = -excess * rules.charge_power_W
    engine_next = 0
    if k + 1 < rules.wheel_power_W.size:
        threshold_W = KEEP_RUNNING * start_W if engine_on else start_W
        engine_next = int(rules.needs_engine[k + 1] or rules.wheel_power_W[k + 1] > threshold_W)
    if not engine_on:
        return 0, engine_next
    control = 1
    if rules.wheel_power_W[k] > 0.0:
        least = np.inf
        for c in range(1, power_W.size):
            miss = abs(power_W[c] - wanted_W) + AVOID_SHORTFALL_W_PER_KG * shortfall_kg[c]
            if miss < least:
                least = miss
                control = c
    return control, engine_next

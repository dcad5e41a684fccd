"""What a policy decides at every node of its grid, one byte each, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms._filter import Filter, weigh
from ems._choose import decide, pack_at
from ems._sdp import Grid, Scalars

Array = NDArray[np.float64]

NEXT_ON = 128
"""Bit of a byte that says whether the engine runs in the next step; the others are the control."""


@njit(cache=True, nogil=True, error_model="numpy")
def map_stage(
    grid: Grid,
    scalars: Scalars,
    after: NDArray[np.float32],
    cost_kg: Array,
    power_W: Array,
    acts_on: int,
    known: Filter,
    out: NDArray[np.uint8],
) -> None:
    """Decide at every (engine state, variance row, node).

    Parameters
    ----------
    grid, scalars, after, cost_kg, power_W, acts_on
        As `ems._choose.choose` takes them.
    known : Filter
        The filter that the policy believes in.
    out : ndarray of uint8, shape (2, r, n)
        Filled: control, plus NEXT_ON where the engine runs next.
    """
    for j in range(out.shape[2]):
        soc = grid.soc_first + grid.soc_step * j
        pack = pack_at(grid, soc)
        for r in range(out.shape[1]):
            variance = grid.level[r] if out.shape[1] > 1 else 0.0
            gain, posterior, _ = weigh(known, soc, variance)
            spread = np.sqrt(gain * variance)
            for engine in range(2):
                control, engine_next = decide(
                    grid.soc_first,
                    grid.soc_step,
                    grid.level_step,
                    grid.level,
                    grid.cubic,
                    pack,
                    scalars,
                    after,
                    cost_kg,
                    power_W,
                    acts_on,
                    soc,
                    posterior,
                    spread,
                    engine,
                )
                out[engine, r, j] = control + (NEXT_ON if engine_next else 0)

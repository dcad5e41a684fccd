r"""Forward simulation of a policy over many realizations of the noise, compiled.

The plant is [L]'s postulated one: the true SOC walks with the process noise, the BMS measures it with noise,
and its estimate follows with the gain of [L] eq 8 (`bms.uncertainty`). In *belief space* the truth is left
out and the innovation itself is drawn; that is the process whose expectation the dynamic program computes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms._filter import Filter, at_soc, move_estimate, weigh
from ems._choose import TRUTH, choose, pack_at
from ems._moves import solve_current
from ems._rules import Rules, choose_by_rule
from ems._sdp import Grid, Scalars, Stages

Array = NDArray[np.float64]

RULES = 3  # acts_on of the rule-based policy


class Tracks(NamedTuple):
    """What a rollout fills: arrays of shape (n, N + 1) for states, (n, N) for the rest."""

    soc: Array
    estimate: Array
    variance: Array
    engine_on: NDArray[np.int8]
    control: NDArray[np.int32]
    current_A: Array
    missing_kg: Array


@njit(cache=True, nogil=True)
def simulate(
    acts_on: int,
    grid: Grid,
    pack: Grid,
    scalars: Scalars,
    stages: Stages,
    shortfall_kg: Array,
    cost_to_go: NDArray[np.float32],
    rules: Rules,
    known: Filter,
    belief_space: bool,
    process: Array,
    measurement: Array,
    tracks: Tracks,
) -> None:
    """Drive every realization from the state in column 0 of ``tracks`` to the end.

    Parameters
    ----------
    acts_on : int
        ESTIMATE, CERTAIN, TRUTH or RULES.
    grid, scalars, stages, shortfall_kg, cost_to_go, rules, known
        Problem, policy and filter; ``grid``, ``cost_to_go``, ``rules`` are read where a policy needs them.
    pack : Grid
        Gives the battery's tables to every policy alike.
    belief_space : bool
        Draw the innovation from the belief instead of simulating the truth.
    process, measurement : ndarray, shape (n, N)
        Standard normal draws.
    tracks : Tracks
        Filled in place.
    """
    for r in range(process.shape[0]):
        for k in range(process.shape[1]):
            true, soc, p = tracks.soc[r, k], tracks.estimate[r, k], tracks.variance[r, k]
            engine = int(tracks.engine_on[r, k])
            seen = true if acts_on == TRUTH else soc
            gain, posterior, total = weigh(known, soc, p)
            if acts_on == RULES:
                control, engine_next = choose_by_rule(
                    rules, k, soc, engine, stages.power_W[k], shortfall_kg[k]
                )
            else:
                control, engine_next = choose(
                    grid,
                    scalars,
                    cost_to_go[k + 1],
                    stages.cost_kg[k],
                    stages.power_W[k],
                    acts_on,
                    seen,
                    posterior,
                    np.sqrt(gain * p),
                    engine,
                )
            ocv_V, discharge_ohm, charge_ohm, low_A, high_A = pack_at(pack, seen)
            i, missing_W = solve_current(
                stages.power_W[k, control], ocv_V, discharge_ohm, charge_ohm, low_A, high_A
            )
            drift = scalars.drift + scalars.drift_per_A * abs(i)
            moved = scalars.charge_to_soc * i
            walked = min(max(true + moved + np.sqrt(drift) * process[r, k], 0.0), 1.0)
            if acts_on == TRUTH:
                tracks.estimate[r, k + 1], tracks.variance[r, k + 1] = walked, 0.0
            else:
                if belief_space:
                    noise = np.sqrt(total) * measurement[r, k]
                else:
                    noise = true - soc + np.sqrt(known.mu * at_soc(known.alpha, true)) * measurement[r, k]
                tracks.estimate[r, k + 1] = move_estimate(soc, moved, gain, noise)
                tracks.variance[r, k + 1] = posterior + drift
            tracks.soc[r, k + 1] = tracks.estimate[r, k + 1] if belief_space else walked
            tracks.engine_on[r, k + 1] = engine_next
            tracks.control[r, k] = control
            tracks.current_A[r, k] = i
            tracks.missing_kg[r, k] = missing_W * scalars.step_s * scalars.shortfall_kg_per_J

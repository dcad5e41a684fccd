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
from ems._choose import TRUTH, decide, table_at
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
    first: int,
    last: int,
    process: Array,
    measurement: Array,
    tracks: Tracks,
) -> None:
    """Drive every realization from the state in column ``first`` of ``tracks`` to column ``last``.

    All realizations take a step before the next: they read the same cost-to-go, which stays in the cache.

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
    first, last : int
        Steps; stage ``k`` of the cost-to-go is at ``k - first`` of ``cost_to_go``.
    process, measurement : ndarray, shape (n, N)
        Standard normal draws.
    tracks : Tracks
        Filled in place.
    """
    # Fields, not tuples of arrays, go to what is called for every sample; see `ems._choose.decide`.
    soc_first, soc_step, level_step = grid.soc_first, grid.soc_step, grid.level_step
    level, cubic = grid.level, grid.cubic
    own_ocv_V, own_discharge_ohm, own_charge_ohm = grid.ocv_V, grid.discharge_ohm, grid.charge_ohm
    own_low_A, own_high_A = grid.current_low_A, grid.current_high_A
    pack_first, pack_step = pack.soc_first, pack.soc_step
    ocv_V, discharge_ohm, charge_ohm = pack.ocv_V, pack.discharge_ohm, pack.charge_ohm
    low_A, high_A = pack.current_low_A, pack.current_high_A
    price_kg_per_W = scalars.step_s * scalars.shortfall_kg_per_J
    mu, alpha = known.mu, known.alpha
    for k in range(first, last):
        power_W, cost_kg, missed_kg = stages.power_W[k], stages.cost_kg[k], shortfall_kg[k]
        after = cost_to_go[k + 1 - first]
        for r in range(process.shape[0]):
            true, soc, p = tracks.soc[r, k], tracks.estimate[r, k], tracks.variance[r, k]
            engine = int(tracks.engine_on[r, k])
            seen = true if acts_on == TRUTH else soc
            gain, posterior, total = weigh(known, soc, p)
            if acts_on == RULES:
                control, engine_next = choose_by_rule(rules, k, soc, engine, power_W, missed_kg)
            else:
                control, engine_next = decide(
                    soc_first,
                    soc_step,
                    level_step,
                    level,
                    cubic,
                    table_at(
                        soc_first,
                        soc_step,
                        own_ocv_V,
                        own_discharge_ohm,
                        own_charge_ohm,
                        own_low_A,
                        own_high_A,
                        seen,
                    ),
                    scalars,
                    after,
                    cost_kg,
                    power_W,
                    acts_on,
                    seen,
                    posterior,
                    np.sqrt(gain * p),
                    engine,
                )
            volt, ohm_out, ohm_in, least_A, most_A = table_at(
                pack_first, pack_step, ocv_V, discharge_ohm, charge_ohm, low_A, high_A, seen
            )
            i, missing_W = solve_current(power_W[control], volt, ohm_out, ohm_in, least_A, most_A)
            drift = scalars.drift + scalars.drift_per_A * abs(i)
            moved = scalars.charge_to_soc * i
            walked = min(max(true + moved + np.sqrt(drift) * process[r, k], 0.0), 1.0)
            if acts_on == TRUTH:
                tracks.estimate[r, k + 1], tracks.variance[r, k + 1] = walked, 0.0
            else:
                if belief_space:
                    noise = np.sqrt(total) * measurement[r, k]
                else:
                    noise = true - soc + np.sqrt(mu * at_soc(alpha, true)) * measurement[r, k]
                tracks.estimate[r, k + 1] = move_estimate(soc, moved, gain, noise)
                tracks.variance[r, k + 1] = posterior + drift
            tracks.soc[r, k + 1] = tracks.estimate[r, k + 1] if belief_space else walked
            tracks.engine_on[r, k + 1] = engine_next
            tracks.control[r, k] = control
            tracks.current_A[r, k] = i
            tracks.missing_kg[r, k] = missing_W * price_kg_per_W

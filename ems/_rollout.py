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

from ems._choose import ESTIMATE, TRUTH, choose, pack_at
from ems._interpolate import level_weights
from ems._rules import Rules, choose_by_rule
from ems._sdp import Grid, Scalars, Stages, solve_current

Array = NDArray[np.float64]

RULES = 3  # acts_on of the rule-based policy


class Filter(NamedTuple):
    """Expected measurement variance over uniform SOC nodes on [0, 1] and levels uniform in sqrt(p)."""

    alpha: Array  # (a,) alpha on a uniform grid on [0, 1]
    mu: float
    level_step: float
    level: Array  # (l,)
    measured: Array  # (l, m) expected variance of the measurement


class Tracks(NamedTuple):
    """What a rollout fills: arrays of shape (n, N + 1) for states, (n, N) for the rest."""

    soc: Array
    estimate: Array
    variance: Array
    engine_on: NDArray[np.int8]
    control: NDArray[np.int32]
    current_A: Array
    missing_kg: Array


@njit(cache=True, inline="always")
def _linear(table: Array, soc: float) -> float:
    x = min(max(soc, 0.0), 1.0) * (table.size - 1)
    at = min(int(x), table.size - 2)
    return float(table[at] + (x - at) * (table[at + 1] - table[at]))


@njit(cache=True, nogil=True)
def expected_measurement_variance(known: Filter, soc: float, variance: float) -> float:
    """Expected variance of the measurement at a belief, [L] eq 10, from the filter's table."""
    inside = min(variance, known.level[known.level.size - 1])
    q, (a, b, c) = level_weights(known.level, known.level_step, inside)
    value = a * _linear(known.measured[q], soc)
    value += b * _linear(known.measured[q + 1], soc) + c * _linear(known.measured[q + 2], soc)
    return max(value, 0.0)


@njit(cache=True, nogil=True)
def step_belief(
    known: Filter, soc: float, variance: float, moved: float, drift: float, innovation: float
) -> tuple[float, float]:
    """Move the belief over one step, [L] eqs 5, 8, 9.

    Parameters
    ----------
    known : Filter
    soc, variance : float
        The belief.
    moved : float
        Charge passed, in SOC.
    drift : float
        Process variance of the step.
    innovation : float
        Measured less estimated SOC.
    """
    measured = expected_measurement_variance(known, soc, variance)
    total = variance + measured
    gain = variance / total if total > 0.0 else 0.0
    estimate = min(max(soc + moved + gain * innovation, 0.0), 1.0)
    return estimate, gain * measured + drift


@njit(cache=True, nogil=True)
def simulate(
    acts_on: int,
    grid: Grid,
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
        Problem, policy and filter; ``cost_to_go`` and ``rules`` are read where the policy needs them.
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
            if acts_on == RULES:
                control, engine_next = choose_by_rule(
                    rules, k, soc, engine, stages.power_W[k], shortfall_kg[k]
                )
            else:
                posterior = spread = 0.0
                if acts_on == ESTIMATE:
                    measured = expected_measurement_variance(known, soc, p)
                    total = p + measured
                    if total > 0.0:
                        posterior, spread = p * measured / total, p / np.sqrt(total)
                control, engine_next = choose(
                    grid,
                    scalars,
                    cost_to_go[k + 1],
                    stages.cost_kg[k],
                    stages.power_W[k],
                    acts_on,
                    seen,
                    posterior,
                    spread,
                    engine,
                )
            ocv_V, discharge_ohm, charge_ohm, low_A, high_A = pack_at(grid, seen)
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
                    noise = np.sqrt(p + expected_measurement_variance(known, soc, p)) * measurement[r, k]
                else:
                    noise = true - soc + np.sqrt(known.mu * _linear(known.alpha, true)) * measurement[r, k]
                tracks.estimate[r, k + 1], tracks.variance[r, k + 1] = step_belief(
                    known, soc, p, moved, drift, noise
                )
            tracks.soc[r, k + 1] = tracks.estimate[r, k + 1] if belief_space else walked
            tracks.engine_on[r, k + 1] = engine_next
            tracks.control[r, k] = control
            tracks.current_A[r, k] = i
            tracks.missing_kg[r, k] = missing_W * scalars.step_s * scalars.shortfall_kg_per_J

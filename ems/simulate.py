"""Rollouts of a policy on [L]'s postulated plant, over many realizations at once (`ems._rollout`)."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from bms.filtering import tabulate_filter
from ems._choose import TRUTH
from ems._rollout import Tracks, simulate
from ems._rules import Rules
from ems._sdp import Grid
from ems.cost_to_go import CostToGo, Kept
from ems.errors import GridWarning
from ems.grid import deterministic_grid
from ems.noise import Noise
from ems.policies import AnyPolicy, CostToGoPolicy
from ems.problem import Problem
from ems.records import Rollout

Array = NDArray[np.float64]

PACK_NODES = 401
OUTSIDE_TOLERATED = 0.005


def roll_out(problem: Problem, policy: AnyPolicy, noise: Noise, *, belief_space: bool = False) -> Rollout:
    """Drive the cycle with a policy, once per realization of the noise.

    Parameters
    ----------
    problem : Problem
        The problem as it is; its mu may differ from the one that the policy was solved for.
    policy : CostToGoPolicy or RuleBasedPolicy
        The policy.
    noise : Noise
        Draws for n realizations and the N steps of the problem.
    belief_space : bool
        Draw the innovation from the belief and leave the truth out: the process that the dynamic program
        averages over. Penalties are then the expected ones at the belief, and ``soc`` repeats
        ``soc_estimate``.
    """
    tracks = start_tracks(problem, noise, knows_truth=policy.acts_on == TRUTH, belief_space=belief_space)
    plant = plant_grid(problem)
    cost_to_go: CostToGo
    if isinstance(policy, CostToGoPolicy):
        grid, cost_to_go, rules = policy.solution.grid, policy.solution.cost_to_go, _no_rules()
    else:
        grid, rules = plant, policy.rules
        cost_to_go = Kept(np.zeros((problem.steps + 1, 2, 1, 1), dtype=np.float32))
    known = tabulate_filter(problem.pack, problem.uncertainty)
    for first, last, stages_kg in cost_to_go.parts():
        simulate(
            policy.acts_on,
            grid,
            plant,
            problem.scalars,
            problem.stages,
            problem.shortfall_kg,
            stages_kg,
            rules,
            known,
            belief_space,
            first,
            last,
            noise.process,
            noise.measurement,
            tracks,
        )
    if isinstance(policy, CostToGoPolicy):
        _warn_outside(policy, tracks.soc if policy.acts_on == TRUTH else tracks.estimate)
    return summarise(problem, tracks, belief_space=belief_space)


def _warn_outside(policy: CostToGoPolicy, soc: Array) -> None:
    nodes = policy.solution.soc
    share = float(np.mean((soc < nodes[0]) | (soc > nodes[-1])))
    if share > OUTSIDE_TOLERATED:
        concept = policy.problem.concept
        warnings.warn(
            f"{policy.name} on {concept.name!r}: {share:.1%} of the samples lie outside the SOC grid"
            f" {nodes[0]:.2f} to {nodes[-1]:.2f}, where the cost-to-go is held constant, and its cost is not"
            " to be trusted; the penalties do not keep the SOC near its window: make them steeper,"
            " or widen the grid (GridSettings.soc_margin)",
            GridWarning,
            stacklevel=3,
        )


def start_tracks(problem: Problem, noise: Noise, *, knows_truth: bool, belief_space: bool = False) -> Tracks:
    """Allocate the tracks of a rollout and set their first column: the belief and, around it, the truth."""
    concept = problem.concept
    realizations, steps = noise.process.shape
    tracks = allocate_tracks(realizations, steps)
    truth = np.clip(concept.initial_soc + concept.initial_soc_sd * noise.initial, 0.0, 1.0)
    tracks.soc[:, 0] = concept.initial_soc if belief_space else truth
    tracks.estimate[:, 0] = truth if knows_truth else concept.initial_soc
    tracks.variance[:, 0] = 0.0 if knows_truth else concept.initial_soc_sd**2
    return tracks


def allocate_tracks(realizations: int, steps: int) -> Tracks:
    """Allocate the tracks of a number of realizations, the engine off throughout."""
    states, inputs = (realizations, steps + 1), (realizations, steps)
    return Tracks(
        soc=np.empty(states),
        estimate=np.empty(states),
        variance=np.empty(states),
        engine_on=np.zeros(states, dtype=np.int8),
        control=np.zeros(inputs, dtype=np.int32),
        current_A=np.empty(inputs),
        missing_kg=np.empty(inputs),
    )


def plant_grid(problem: Problem) -> Grid:
    """Tabulate the pack over all SOC, for the plant's circuit."""
    return deterministic_grid(np.linspace(0.0, 1.0, PACK_NODES), problem.pack)


def summarise(problem: Problem, tracks: Tracks, *, belief_space: bool = False) -> Rollout:
    """Add up fuel, penalties and the rest along the tracks."""
    concept, steps = problem.concept, problem.steps
    rows = np.arange(steps)
    fuel_kgps = problem.fuel_kgps[rows, tracks.control]
    starts = np.count_nonzero(np.diff(tracks.engine_on, axis=1) > 0, axis=1)
    running, terminal = concept.window.penalty_kgps(), concept.terminal.penalty_kg()
    before, end = tracks.soc[:, :-1], tracks.soc[:, -1]
    if belief_space:
        penalty = running.expectation(tracks.estimate[:, :-1], tracks.variance[:, :-1])
        last = terminal.expectation(tracks.estimate[:, -1], tracks.variance[:, -1])
    else:
        penalty, last = running(before), terminal(end)
    outside = (tracks.soc < concept.window.low) | (tracks.soc > concept.window.high)
    return Rollout(
        time_s=np.asarray(problem.cycle.time_s),
        soc=tracks.soc.astype(np.float32),
        soc_estimate=tracks.estimate.astype(np.float32),
        variance=tracks.variance.astype(np.float32),
        engine_on=tracks.engine_on.astype(np.bool_),
        current_A=tracks.current_A.astype(np.float32),
        engine_torque_Nm=problem.engine_torque_Nm[rows, tracks.control].astype(np.float32),
        fuel_kgps=fuel_kgps.astype(np.float32),
        fuel_kg=fuel_kgps.sum(axis=1) * problem.step_s + starts * concept.start_fuel_kg,
        penalty_kg=penalty.sum(axis=1) * problem.step_s + last,
        shortfall_kg=problem.shortfall_kg[rows, tracks.control].sum(axis=1) + tracks.missing_kg.sum(axis=1),
        mean_abs_current_A=np.abs(tracks.current_A).mean(axis=1),
        engine_starts=starts,
        outside_window=outside.mean(axis=1),
    )


def _no_rules() -> Rules:
    return Rules(0.0, 1.0, 0.0, 0.0, 0.0, np.zeros(0), np.zeros(0, dtype=np.bool_))

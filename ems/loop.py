"""The closed loop, one realization at a time: policy, plant and estimator through their protocols.

This is the slow face of `ems._rollout`, for plants and estimators that are not a kernel; on [L]'s postulated
plant the two agree, which a test holds.
"""

from __future__ import annotations

from bms.belief import SocBelief
from bms.estimators import Estimator
from bms.plants import Plant
from ems._choose import pack_at
from ems._rollout import Tracks
from ems._sdp import Grid, solve_current
from ems.policies import Policy
from ems.problem import Problem
from ems.records import Rollout
from ems.simulate import allocate_tracks, plant_grid, summarise


def run_closed_loop(
    problem: Problem, policy: Policy, plant: Plant, estimator: Estimator, *, knows_truth: bool = False
) -> Rollout:
    """Drive the cycle once.

    Parameters
    ----------
    problem : Problem
        Stage tables, pack and costs.
    policy : Policy
        Decides.
    plant : Plant
        Answers.
    estimator : Estimator
        Believes.
    knows_truth : bool
        Give the policy the plant's true SOC instead of the belief (perfect information).

    Returns
    -------
    Rollout
        With a single realization.
    """
    grid = plant_grid(problem)
    tracks = allocate_tracks(1, problem.steps)
    engine_on = 0
    for k in range(problem.steps):
        belief = SocBelief(plant.soc, 0.0) if knows_truth else estimator.belief
        _record(tracks, k, plant.soc, belief, engine_on)
        action = policy.act(belief, k, bool(engine_on))
        power_W = float(problem.stages.power_W[k, action.control])
        current_A, missing_W = _current(grid, power_W, belief.mean)
        measurement = plant.step(power_W, current_A, problem.step_s)
        estimator.observe(measurement, problem.step_s)
        tracks.control[0, k] = action.control
        tracks.current_A[0, k] = measurement.current_A
        tracks.missing_kg[0, k] = missing_W * problem.step_s * problem.scalars.shortfall_kg_per_J
        engine_on = int(action.engine_next)
    belief = SocBelief(plant.soc, 0.0) if knows_truth else estimator.belief
    _record(tracks, problem.steps, plant.soc, belief, engine_on)
    return summarise(problem, tracks)


def _current(grid: Grid, power_W: float, soc: float) -> tuple[float, float]:
    current_A, missing_W = solve_current(power_W, *pack_at(grid, soc))
    return float(current_A), float(missing_W)


def _record(tracks: Tracks, k: int, soc: float, belief: SocBelief, engine_on: int) -> None:
    tracks.soc[0, k] = soc
    tracks.estimate[0, k] = belief.mean
    tracks.variance[0, k] = belief.variance
    tracks.engine_on[0, k] = engine_on

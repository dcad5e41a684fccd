"""The closed loop, one realization at a time: policy, plant and estimator through their protocols.

This is the slow face of `ems._rollout`, for plants and estimators that are not a kernel; on [L]'s postulated
plant the two agree, which a test holds.
"""

from __future__ import annotations

import math

from bms.belief import SocBelief
from bms.estimators import Estimator, ModelEstimator
from bms.filtering import tabulate_filter
from bms.plants import ModelPlant, Plant
from bms.plants.sensed import SensedPlant
from ems._choose import pack_at
from ems._moves import solve_current
from ems._rollout import Tracks
from ems._sdp import Grid
from ems.errors import EmsError
from ems.noise import Noise
from ems.policies import Action, Policy, acts_on_truth
from ems.problem import Problem
from ems.records import Rollout
from ems.simulate import allocate_tracks, plant_grid, start_tracks, summarise


def run_closed_loop(
    problem: Problem,
    policy: Policy,
    plant: Plant,
    estimator: Estimator | None,
    *,
    knows_truth: bool = False,
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
    estimator : Estimator or None
        Believes; may be left out where the policy knows the truth.
    knows_truth : bool
        Give the policy the plant's true SOC instead of the belief (perfect information).

    Returns
    -------
    Rollout
        With a single realization.
    """
    tracks = allocate_tracks(1, problem.steps)
    drive(problem, policy, plant, None if knows_truth else estimator, plant_grid(problem), tracks, 0)
    return summarise(problem, tracks)


def roll_out_loop(problem: Problem, policy: Policy, noise: Noise) -> Rollout:
    """Drive the cycle with any policy on [L]'s postulated plant, once per realization of the noise.

    What `ems.roll_out` does for the policies of socwise, on the same noise and with the same result, one
    call of ``policy.act`` a step.

    Parameters
    ----------
    problem : Problem
        The problem; its mu may differ from the one that the policy was made for.
    policy : Policy
        Decides.
    noise : Noise
        Draws for n realizations and the N steps of the problem.

    Raises
    ------
    EmsError
        When the policy decides something that cannot be done.
    """
    pack, model, knows_truth = problem.pack, problem.uncertainty, acts_on_truth(policy)
    known, grid = tabulate_filter(pack, model), plant_grid(problem)
    tracks = start_tracks(problem, noise, knows_truth=knows_truth)
    start = SocBelief(problem.concept.initial_soc, problem.concept.initial_soc_sd**2)
    for row, truth in enumerate(tracks.soc[:, 0].tolist()):
        plant = ModelPlant(truth, pack.capacity_C, model, known, noise.process[row], noise.measurement[row])
        estimator = None if knows_truth else ModelEstimator(start, pack.capacity_C, model, known)
        drive(problem, policy, plant, estimator, grid, tracks, row)
    return summarise(problem, tracks)


def drive(
    problem: Problem,
    policy: Policy,
    plant: Plant,
    estimator: Estimator | None,
    grid: Grid,
    tracks: Tracks,
    row: int,
    *,
    most_variance: float = math.inf,
) -> None:
    """Drive the cycle once, into a row of the tracks.

    Parameters
    ----------
    problem, policy, plant
        As in `run_closed_loop`.
    estimator : Estimator or None
        Believes; without one the policy is given the true SOC.
    grid : Grid
        The pack as the energy management knows it, see `ems.simulate.plant_grid`.
    tracks : Tracks
        Filled; currents are those that flowed, not those that were measured.
    row : int
        Which realization.
    most_variance : float
        The policy is told no larger variance than this, the end of its tables.

    Raises
    ------
    EmsError
        When the policy decides something that cannot be done.
    """
    power_W, step_s = problem.stages.power_W, problem.step_s
    price_kg_per_W = step_s * problem.scalars.shortfall_kg_per_J
    soc, estimate, variance = tracks.soc[row], tracks.estimate[row], tracks.variance[row]
    engine, control, current_A = tracks.engine_on[row], tracks.control[row], tracks.current_A[row]
    missing_kg, engine_on = tracks.missing_kg[row], 0
    sensed = isinstance(plant, SensedPlant)
    for k in range(problem.steps):
        true = plant.soc
        belief = _truth(true) if estimator is None else estimator.belief
        soc[k], estimate[k], variance[k] = true, belief.mean, belief.variance
        engine[k] = engine_on
        told = belief if belief.variance <= most_variance else SocBelief(belief.mean, most_variance)
        action = policy.act(told, k, bool(engine_on))
        if not _can_be_done(action, engine_on, power_W.shape[1]):
            raise EmsError(_cannot(policy, action, k, engine_on, power_W.shape[1]))
        asked_W = float(power_W[k, action.control])
        # A plant that is measured has a circuit of its own.
        expected_A, missing_W = (0.0, 0.0) if sensed else _current(grid, asked_W, belief.mean)
        measurement = plant.step(asked_W, expected_A, step_s)
        if estimator is not None:
            estimator.observe(measurement, step_s)
        if measurement.withheld_W is not None:
            missing_W = measurement.withheld_W
        elif sensed:
            missing_W = _current(grid, asked_W, belief.mean)[1]
        flowed_A = plant.true_current_A if isinstance(plant, SensedPlant) else measurement.current_A
        control[k], current_A[k], missing_kg[k] = action.control, flowed_A, missing_W * price_kg_per_W
        engine_on = int(action.engine_next)
    belief = _truth(plant.soc) if estimator is None else estimator.belief
    soc[-1], estimate[-1], variance[-1] = plant.soc, belief.mean, belief.variance
    engine[-1] = engine_on


def _can_be_done(action: Action, engine_on: int, controls: int) -> bool:
    return (0 < action.control < controls if engine_on else action.control == 0) and action.engine_next in (
        0,
        1,
    )


def _cannot(policy: Policy, action: Action, step: int, engine_on: int, controls: int) -> str:
    state, allowed = ("on", f"1 to {controls - 1}") if engine_on else ("off", "0")
    return (
        f"the policy {policy.name!r} decided {tuple(action)} at step {step} with the engine {state};"
        f" allowed are the controls {allowed} (columns of the problem's stage tables) and 0 or 1 for the"
        " engine in the next step"
    )


def _truth(soc: float) -> SocBelief:
    return SocBelief(min(max(soc, 0.0), 1.0), 0.0)


def _current(grid: Grid, power_W: float, soc: float) -> tuple[float, float]:
    current_A, missing_W = solve_current(power_W, *pack_at(grid, soc))
    return float(current_A), float(missing_W)

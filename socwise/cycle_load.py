"""The battery power of a concept's own vehicle on a cycle, to drive a battery with."""

from __future__ import annotations

import numpy as np

from bms.load_profile import LoadProfile
from drivecycles import DriveCycle
from ems.concept import Concept
from ems.noise import Noise
from ems.policies import build_policy
from ems.problem import build_problem
from ems.simulate import roll_out


def cycle_load(concept: Concept, cycle: DriveCycle, policy: str = "rule_based") -> LoadProfile:
    """Drive a cycle without noise, on the concept's own pack, and return the power at its terminals.

    Parameters
    ----------
    concept : Concept
        The vehicle and its pack.
    cycle : DriveCycle
        What it drives.
    policy : str
        Who decides; one that is solved takes a while.

    Raises
    ------
    EmsError
        When the policy is unknown, or the vehicle cannot follow the cycle.
    """
    problem = build_problem(concept, cycle)
    silence = Noise(np.zeros(1), np.zeros((1, problem.steps)), np.zeros((1, problem.steps)))
    rollout = roll_out(problem, build_policy(policy, problem), silence)
    current_A = rollout.current_A[0].astype(np.float64)
    soc = rollout.soc[0, :-1].astype(np.float64)
    discharge_ohm, charge_ohm = problem.pack.resistances_ohm(soc)
    ohm = np.where(current_A < 0.0, discharge_ohm, charge_ohm)
    return LoadProfile(
        step_s=problem.step_s,
        power_W=current_A * (problem.pack.ocv(soc) + ohm * current_A),
        source=f"{concept.name} on {cycle.name}, {policy}",
    )

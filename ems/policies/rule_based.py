r"""Charge-depleting, charge-sustaining rules: the baseline that a car has today.

When to use: to see what optimisation is worth at all. With ``u`` the distance of the SOC estimate from the
sustained SOC in units of the band, clipped to [-1, 1]:

* the engine starts for the next step when the wheel power then exceeds a threshold, which rises from zero at
  ``u = -1`` over ``start_power_W`` at ``u = 0`` to ``deplete_power_W`` at ``u = 1``, or when the motor alone
  cannot follow; it stops below half of the threshold;
* running, its torque is the one that brings the battery's power closest to ``-u deplete_power_W`` (above the
  sustained SOC, the battery helps) or ``-u charge_power_W`` (below, it is charged); it idles when the car
  brakes or stands.

The rules know the demand of the next second, as the engine state is decided a step ahead, and nothing else of
the trip.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np

from bms import SocBelief
from ems._choose import Action
from ems._rollout import RULES
from ems._rules import Rules, choose_by_rule
from ems.problem import Problem

NAME = "rule_based"
DEPENDS_ON_MU = False


@final
@dataclass(frozen=True, eq=False)
class RuleBasedPolicy:
    """The rules with the concept's thresholds; they promise no value."""

    problem: Problem
    name: str = NAME
    acts_on: int = RULES
    value_kg: float | None = None
    solve_s: float = 0.0

    @cached_property
    def rules(self) -> Rules:
        """Thresholds and trip knowledge, for the kernel."""
        problem = self.problem
        parameters = problem.concept.rule_based
        battery_W = -float(problem.pack.power_limits_W(problem.concept.window.low)[0])
        return Rules(
            sustain_soc=parameters.sustain_soc,
            band=parameters.band,
            start_power_W=parameters.start_power_W,
            deplete_power_W=parameters.deplete_power_W,
            charge_power_W=parameters.charge_power_W,
            wheel_power_W=np.ascontiguousarray(problem.demand.wheel_power_W),
            needs_engine=(problem.shortfall_kg[:, 0] > 0.0) | (problem.stages.power_W[:, 0] < -battery_W),
        )

    def act(self, belief: SocBelief, step: int, engine_on: bool) -> Action:
        """Decide at a step, see `ems.policies.base.Policy.act`."""
        power_W, shortfall_kg = self.problem.stages.power_W[step], self.problem.shortfall_kg[step]
        return Action(*choose_by_rule(self.rules, step, belief.mean, int(engine_on), power_W, shortfall_kg))


def build(problem: Problem) -> RuleBasedPolicy:
    """Take the thresholds of the problem's concept."""
    return RuleBasedPolicy(problem)

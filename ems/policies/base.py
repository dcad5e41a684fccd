"""What a policy is, and the one that a cost-to-go defines."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, final

from bms import SocBelief
from bms._filter import Filter, weigh
from bms.filtering import tabulate_filter
from ems._choose import Action, choose
from ems.problem import Problem
from ems.solution import Solution


class Policy(Protocol):
    """Decides, at every step, the control and the engine state of the next step."""

    @property
    def name(self) -> str:
        """Name used by the command line and in results."""

    def act(self, belief: SocBelief, step: int, engine_on: bool) -> Action:
        """Decide at a step.

        Parameters
        ----------
        belief : SocBelief
            What the BMS believes; a policy with perfect information is given the true SOC and no variance.
        step : int
            The step, 0 to N - 1.
        engine_on : bool
            Whether the engine runs in this step.
        """


@final
@dataclass(frozen=True, eq=False)
class CostToGoPolicy:
    """The policy that looks one step ahead with a cost-to-go, [L] eq 19.

    Parameters
    ----------
    name : str
        Its name.
    acts_on : int
        What it takes for the SOC: ESTIMATE (with its variance), CERTAIN (the estimate as if it were true) or
        TRUTH.
    problem : Problem
        The stage tables.
    solution : Solution
        The cost-to-go.
    value_kg : float
        Expected cost from the start that its own model promises.
    """

    name: str
    acts_on: int
    problem: Problem
    solution: Solution
    value_kg: float

    @property
    def solve_s(self) -> float:
        """Processor time that solving took."""
        return self.solution.solve_s

    def act(self, belief: SocBelief, step: int, engine_on: bool) -> Action:
        """Decide at a step, see `Policy.act`."""
        gain, posterior, _ = weigh(self._filter, belief.mean, belief.variance)
        stages = self.problem.stages
        return Action(
            *choose(
                self.solution.grid,
                self.problem.scalars,
                self.solution.cost_to_go.stage(step + 1),
                stages.cost_kg[step],
                stages.power_W[step],
                self.acts_on,
                belief.mean,
                posterior,
                math.sqrt(gain * belief.variance),
                int(engine_on),
            )
        )

    @cached_property
    def _filter(self) -> Filter:
        return tabulate_filter(self.problem.pack, self.problem.uncertainty)

"""A policy as a table of bytes: what it decides at every node of its grid.

A byte a state and step, a quarter of what the stored cost-to-go takes: to look at a strategy, to compare two,
or to carry one where there is no room for more. Between nodes a table of decisions must be rounded; `ems`
looks one step ahead at the belief itself instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bms.filtering import tabulate_filter
from ems.errors import EmsError

if TYPE_CHECKING:
    from ems.policies import CostToGoPolicy

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PolicyMap:
    """Decisions of one step, or of several.

    Parameters
    ----------
    soc : ndarray, shape (n,)
        Nodes.
    variance : ndarray, shape (r,)
        Rows; one row, zero, for a policy that does not heed the variance.
    code : ndarray of uint8, shape (..., 2, r, n)
        Decisions with the engine off and on: the control's column in the stage tables, plus 128 where the
        engine runs in the next step.
    """

    soc: Array
    variance: Array
    code: NDArray[np.uint8]

    @property
    def control(self) -> NDArray[np.uint8]:
        """Column of the control in the stage tables."""
        return self.code & np.uint8(127)

    @property
    def engine_next(self) -> NDArray[np.bool_]:
        """Whether the engine runs in the next step."""
        return self.code >= np.uint8(128)


def policy_map(policy: CostToGoPolicy, first: int = 0, last: int | None = None) -> PolicyMap:
    """Tabulate what a policy decides at the nodes of its grid.

    Parameters
    ----------
    policy : CostToGoPolicy
        The policy.
    first, last : int
        Steps ``first`` to ``last - 1``; all of them unless told.

    Returns
    -------
    PolicyMap
        ``code`` of shape (steps, 2, r, n).

    Raises
    ------
    EmsError
        There are no such steps, or more controls than a byte can number.
    """
    from ems._map import NEXT_ON, map_stage

    problem, solution = policy.problem, policy.solution
    last = problem.steps if last is None else last
    if not 0 <= first < last <= problem.steps:
        raise EmsError(
            f"steps {first} to {last - 1} are asked for; the trip has steps 0 to {problem.steps - 1}"
        )
    controls = problem.stages.power_W.shape[1]
    if controls > NEXT_ON:
        raise EmsError(f"{controls} controls do not fit in a byte; {NEXT_ON} do: take fewer torque_levels")
    _, _, rows, nodes = solution.shape
    code = np.empty((last - first, 2, rows, nodes), dtype=np.uint8)
    known = tabulate_filter(problem.pack, problem.uncertainty)
    for k in range(first, last):
        map_stage(
            solution.grid,
            problem.scalars,
            solution.cost_to_go.stage(k + 1),
            problem.stages.cost_kg[k],
            problem.stages.power_W[k],
            policy.acts_on,
            known,
            code[k - first],
        )
    variance = np.array(solution.grid.level) if rows > 1 else np.zeros(1)
    return PolicyMap(solution.soc, variance, code)

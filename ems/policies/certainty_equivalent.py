r"""The policy that takes the SOC estimate for the truth: deterministic DP over (SOC, engine state).

When to use: as the baseline of the literature, and wherever the comparison shows that it loses nothing: wide
windows, mild penalties, a good BMS. It is the cheapest of the three programs. Its value is what it believes,
not what it gets.

The certainty-equivalence principle: Anderson and Moore, Linear Optimal Control, 1971, as [L] section 1 cites
it.
"""

from __future__ import annotations

import numpy as np

from ems._choose import CERTAIN
from ems.grid import deterministic_grid, soc_nodes
from ems.policies.base import CostToGoPolicy
from ems.problem import Problem
from ems.solution import node_penalties, solve

NAME = "certainty_equivalent"
DEPENDS_ON_MU = False


def build(problem: Problem) -> CostToGoPolicy:
    """Solve the deterministic program of a problem."""
    settings, concept = problem.settings, problem.concept
    nodes = soc_nodes(concept, settings, settings.deterministic_soc_step)
    grid = deterministic_grid(nodes, problem.pack)
    solution = solve(problem, grid, *node_penalties(problem, nodes, np.zeros(1), grid.soc_step))
    return CostToGoPolicy(NAME, CERTAIN, problem, solution, solution.value_kg(concept.initial_soc))

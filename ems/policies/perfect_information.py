r"""Perfect information: stochastic DP over (true SOC, engine state) with the process noise.

The policy is told the true SOC at every step.

When to use: as a lower bound. No estimator, however good, lets a policy do better on this plant, so the
distance to it is what better SOC estimation can still be worth. It is not a policy that a car could drive.

Its value at the start is averaged over the initial error of the estimate.

Process noise smooths the kinks of the cost-to-go, on which cubic look-ups would go astray (docs/method.md).
That of a real estimator mostly does not (docs/closed-loop.md): where it is narrower than a cell the grid is
refined, and at last solved by operators that cannot overshoot (`ems.resolution`).
"""

from __future__ import annotations

import numpy as np

from ems._choose import TRUTH
from ems.grid import perfect_information_grid, soc_nodes
from ems.policies.base import CostToGoPolicy
from ems.problem import Problem
from ems.resolution import process_resolution
from ems.solution import node_penalties, solve

NAME = "perfect_information"
DEPENDS_ON_MU = False


def build(problem: Problem) -> CostToGoPolicy:
    """Solve the program over the true SOC."""
    settings, concept = problem.settings, problem.concept
    fine = process_resolution(problem)
    nodes, levels = soc_nodes(concept, settings, fine.soc_step), settings.process_levels
    grid = perfect_information_grid(
        nodes, levels, problem.pack, problem.uncertainty, problem.step_s, fine.cubic
    )
    solution = solve(problem, grid, *node_penalties(problem, nodes, np.zeros(1), grid.soc_step))
    points, weights = np.polynomial.hermite_e.hermegauss(15)
    starts = np.clip(concept.initial_soc + concept.initial_soc_sd * points, nodes[0], nodes[-1])
    value = float(np.dot(weights, [solution.value_kg(float(soc)) for soc in starts]) / weights.sum())
    return CostToGoPolicy(NAME, TRUTH, problem, solution, value)

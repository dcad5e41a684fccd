r"""The optimum under SOC uncertainty: stochastic DP over (estimate, variance, engine state).

When to use: where the SOC window or the end cost is steep compared with the uncertainty. It keeps a distance
from the edges that grows with sqrt(p), and it can choose small currents to learn more before the trip ends.
Costs about ten times a deterministic solve.

Larsson, Johannesson, Egardt: Influence of state of charge estimation uncertainty on energy management
strategies for hybrid electric vehicles, eqs 16 to 19.

Where belief and innovation are narrower than the grid's cells the grid is refined, and at last solved by
operators that cannot overshoot (`ems.resolution`).
"""

from __future__ import annotations

from dataclasses import replace

from ems._choose import ESTIMATE
from ems.grid import soc_nodes, stochastic_grid, variance_rows
from ems.policies.base import CostToGoPolicy
from ems.problem import Problem
from ems.resolution import belief_resolution
from ems.solution import node_penalties, solve

NAME = "stochastic"
DEPENDS_ON_MU = True


def build(problem: Problem) -> CostToGoPolicy:
    """Solve the stochastic program of a problem."""
    settings, concept = problem.settings, problem.concept
    fine = belief_resolution(problem)
    nodes = soc_nodes(concept, settings, fine.soc_step)
    rows = variance_rows(
        concept,
        problem.pack,
        problem.uncertainty,
        problem.step_s,
        settings,
        steps=problem.steps,
        least_reach=problem.least_reach,
    )
    grid = stochastic_grid(nodes, rows, problem.pack, problem.uncertainty, problem.step_s, fine.cubic)
    solution = solve(problem, grid, *node_penalties(problem, nodes, rows, grid.soc_step))
    if not fine.cubic:
        # A look-up of several rows is cubic in rollouts: it is made once a step and nothing adds up.
        solution = replace(solution, grid=grid._replace(cubic=True))
    value = solution.value_kg(concept.initial_soc, concept.initial_soc_sd**2)
    return CostToGoPolicy(NAME, ESTIMATE, problem, solution, value)

r"""Perfect information: stochastic DP over (true SOC, engine state) with the process noise.

The policy is told the true SOC at every step.

When to use: as a lower bound. No estimator, however good, lets a policy do better on this plant, so the
distance to it is what better SOC estimation can still be worth. It is not a policy that a car could drive.

Its value at the start is averaged over the initial error of the estimate.

Process noise smooths the kinks of the cost-to-go, on which cubic look-ups would go astray (docs/method.md).
That of a real estimator mostly does not (docs/closed-loop.md): where its spread over a step, at a tenth of
the largest current, is less than a cell of the grid, the grid is refined to two fifths of the spread, but not
beyond that of the deterministic program, which is solved in its place when that is not enough.
"""

from __future__ import annotations

import math

import numpy as np

from bms.uncertainty import UncertaintyModel
from ems._choose import TRUTH
from ems.grid import deterministic_grid, perfect_information_grid, soc_nodes
from ems.policies.base import CostToGoPolicy
from ems.problem import Problem
from ems.solution import node_penalties, solve

NAME = "perfect_information"
DEPENDS_ON_MU = False
TYPICAL, WIDEST_CELL = 0.1, 0.0025
"""Share of the largest current that is typical; a cell that is wider than this is a coarse grid anyway."""
CELLS, ENOUGH = 2.5, 0.8
"""Cells that a small spread is given, and the share of them that must do."""


def build(problem: Problem) -> CostToGoPolicy:
    """Solve the program over the true SOC."""
    settings, concept = problem.settings, problem.concept
    uncertainty: UncertaintyModel = problem.uncertainty
    largest_A = max(problem.pack.discharge_limit_A, problem.pack.charge_limit_A)
    spread = math.sqrt(float(uncertainty.process_variance(TYPICAL * largest_A, problem.step_s)))
    finest, step = settings.deterministic_soc_step, settings.soc_step
    if spread < min(step, WIDEST_CELL):
        step = min(step, max(finest, spread / CELLS))
    if spread < CELLS * ENOUGH * finest and step == finest:
        nodes = soc_nodes(concept, settings, finest)
        grid = deterministic_grid(nodes, problem.pack)
    else:
        nodes, levels = soc_nodes(concept, settings, step), settings.process_levels
        grid = perfect_information_grid(nodes, levels, problem.pack, uncertainty, problem.step_s)
    solution = solve(problem, grid, *node_penalties(problem, nodes, np.zeros(1), grid.soc_step))
    points, weights = np.polynomial.hermite_e.hermegauss(15)
    starts = np.clip(concept.initial_soc + concept.initial_soc_sd * points, nodes[0], nodes[-1])
    value = float(np.dot(weights, [solution.value_kg(float(soc)) for soc in starts]) / weights.sum())
    return CostToGoPolicy(NAME, TRUTH, problem, solution, value)

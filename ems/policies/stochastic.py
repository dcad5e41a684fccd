r"""The optimum under SOC uncertainty: stochastic DP over (estimate, variance, engine state).

When to use: where the SOC window or the end cost is steep compared with the uncertainty. It keeps a distance
from the edges that grows with sqrt(p), and it can choose small currents to learn more before the trip ends.
Costs about ten times a deterministic solve.

Larsson, Johannesson, Egardt: Influence of state of charge estimation uncertainty on energy management
strategies for hybrid electric vehicles, eqs 16 to 19.

Where belief and innovation are narrower than the grid's cells the grid is refined, and at last solved by
operators that cannot overshoot (`ems.resolution`). Where only the belief is wide enough the solution is held
against a floor (`ems.floor`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ems._choose import ESTIMATE
from ems.floor import floor_kg
from ems.grid import soc_nodes, stochastic_grid, variance_rows
from ems.policies.base import CostToGoPolicy
from ems.problem import Problem
from ems.resolution import Resolution, belief_resolution, finer, row_damping
from ems.solution import Solution, node_penalties, solve

NAME = "stochastic"
DEPENDS_ON_MU = True


def build(problem: Problem) -> CostToGoPolicy:
    """Solve the stochastic program of a problem."""
    fine = belief_resolution(problem)
    solution = _solve(problem, fine) if fine.sure else _believable(problem, fine)
    return CostToGoPolicy(NAME, ESTIMATE, problem, solution, _value_kg(problem, solution))


def _believable(problem: Problem, fine: Resolution) -> Solution:
    """Solve on finer and finer grids until the value keeps above its floor; the last cannot overshoot."""
    step = problem.settings.soc_step
    coarse_kg, half_kg = (
        _value_kg(problem, _solve(problem, Resolution(step / parts, cubic=False), parabolas=True))
        for parts in (1, 2)
    )
    floor = floor_kg(coarse_kg, half_kg)
    for trial in finer(problem, fine):
        solution = _solve(problem, trial)
        if _value_kg(problem, solution) >= floor:
            break
    return solution


def _value_kg(problem: Problem, solution: Solution) -> float:
    return solution.value_kg(problem.concept.initial_soc, problem.concept.initial_soc_sd**2)


def _solve(problem: Problem, fine: Resolution, parabolas: bool | None = None) -> Solution:
    settings, concept = problem.settings, problem.concept
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
    parabolas = fine.cubic if parabolas is None else parabolas
    row_step = float(np.sqrt(rows[-1])) / (rows.size - 1)
    grid = stochastic_grid(
        nodes,
        rows,
        problem.pack,
        problem.uncertainty,
        problem.step_s,
        fine.cubic,
        parabolas,
        row_damping(problem, row_step) if parabolas else 0.0,
    )
    solution = solve(problem, grid, *node_penalties(problem, nodes, rows, grid.soc_step))
    if fine.cubic:
        return solution
    # A look-up of several rows is cubic in rollouts: it is made once a step and nothing adds up.
    return replace(solution, grid=grid._replace(cubic=True))

"""The solution of a dynamic program: the cost-to-go of every stage, and its value at a belief."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from bms import PiecewiseLinear
from bms._levels import level_weights
from ems._sdp import Grid
from ems.cost_to_go import CostToGo, Kept, solve_backwards
from ems.memory import require_memory
from ems.problem import Problem

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Solution:
    """Cost-to-go of every stage.

    Parameters
    ----------
    grid : Grid
        The grid it was computed on.
    cost_to_go : CostToGo
        ``J_k`` over (engine state, variance row, SOC node), less ``offset_kg[k]``.
    offset_kg : ndarray, shape (N + 1,)
        The least cost-to-go of each stage.
    first_kg : ndarray, shape (2, r, n)
        ``J_0`` in double precision.
    solve_s : float
        Processor time that the sweep took.
    """

    grid: Grid
    cost_to_go: CostToGo
    offset_kg: Array
    first_kg: Array
    solve_s: float

    @property
    def cost_to_go_kg(self) -> NDArray[np.float32]:
        """All stages in one table, shape (N + 1, 2, r, n); of a long trip it is computed on every call."""
        return self.cost_to_go.whole()

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Stages N + 1, engine states, variance rows r, nodes n."""
        engine_states, rows, nodes = self.first_kg.shape
        return self.offset_kg.size, engine_states, rows, nodes

    def with_cost_to_go(self, table_kg: NDArray[np.float32]) -> Solution:
        """Return the solution with another cost-to-go."""
        return replace(self, cost_to_go=Kept(table_kg))

    @property
    def soc(self) -> Array:
        """Nodes of the SOC grid."""
        return self.grid.soc_first + self.grid.soc_step * np.arange(self.grid.ocv_V.size, dtype=np.float64)

    def value_kg(self, soc: float, variance: float = 0.0, engine_on: bool = False) -> float:
        """Expected cost from the start, in kg.

        Parameters
        ----------
        soc, variance : float
            The belief at the start; the variance does not matter to a program with a single row.
        engine_on : bool
            The engine state at the start.
        """
        rows = CubicSpline(self.soc, self.first_kg[int(engine_on)], axis=1)(soc)
        if rows.size == 1:
            return float(rows[0])
        at, weights = level_weights(self.grid.level, self.grid.level_step, variance)
        return float(np.dot(weights, rows[at : at + 3]))


def solve(problem: Problem, grid: Grid, penalty_kg: Array, terminal_kg: Array) -> Solution:
    """Sweep backwards over the cycle.

    Parameters
    ----------
    problem : Problem
        Stage tables and scalars.
    grid : Grid
        SOC grid, variance rows, smoothing.
    penalty_kg, terminal_kg : ndarray, shape (r, n)
        Expected running penalty of a step, and terminal penalty.

    Raises
    ------
    EmsError
        It takes more memory than there is.
    """
    require_memory(problem.steps, *penalty_kg.shape)
    started = time.thread_time()
    cost_to_go, offset, first = solve_backwards(
        grid, problem.scalars, problem.stages, penalty_kg, terminal_kg
    )
    return Solution(grid, cost_to_go, offset, first, time.thread_time() - started)


def node_penalties(problem: Problem, nodes: Array, variances: Array, soc_step: float) -> tuple[Array, Array]:
    """Expected running (per step) and terminal penalty at every (row, node), shape (r, n), in kg.

    A node stands for its cell: the variance of a uniform error over one spacing, ``soc_step^2 / 12``, is
    added to that of the row. A jump of the penalty then sits where it is, and not up to half a cell beside
    it, which would leave an error of first order in the spacing.
    """
    mean, variance = np.broadcast_arrays(nodes[None, :], variances[:, None] + soc_step**2 / 12.0)

    def expected(function: PiecewiseLinear) -> Array:
        return np.ascontiguousarray(function.expectation(mean, variance))

    running = expected(problem.concept.window.penalty_kgps())
    return problem.step_s * running, expected(problem.concept.terminal.penalty_kg())

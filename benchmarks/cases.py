"""The problems that are timed, as the kernels take them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bms.uncertainty import innovation_spread
from drivecycles import DriveCycle, load_cycle
from ems import GridSettings, Problem, build_problem, load_concept
from ems._sdp import Grid, Scalars, Stages, sweep
from ems.grid import deterministic_grid, measurement_variance, soc_nodes, stochastic_grid, variance_rows
from ems.smoothing import smoothing_weights
from ems.solution import node_penalties

Array = NDArray[np.float64]

NEGLIGIBLE_WEIGHT = 1e-9
"""Smoothing weights below it are dropped, by the rivals as by `ems.grid`."""


@dataclass(frozen=True, eq=False)
class Case:
    """One dynamic program.

    Parameters
    ----------
    grid, scalars, stages
        As `ems._sdp.sweep` takes them; the stages have N steps and C controls.
    penalty_kg, terminal_kg, spread : ndarray, shape (r, n)
        Expected penalties, and standard deviation of the innovation in SOC.
    inside : ndarray of bool, shape (n,)
        Which nodes lie within the SOC window.
    """

    grid: Grid
    scalars: Scalars
    stages: Stages
    penalty_kg: Array
    terminal_kg: Array
    spread: Array
    inside: NDArray[np.bool_]

    @property
    def distinct(self) -> NDArray[np.bool_]:
        """Controls that do not repeat the one before, shape (N, C); only these are evaluated."""
        cost, power = self.stages.cost_kg, self.stages.power_W
        distinct = np.ones(power.shape, dtype=np.bool_)
        distinct[:, 2:] = (power[:, 2:] != power[:, 1:-1]) | (cost[:, 2:] != cost[:, 1:-1])
        return distinct

    @property
    def evaluations(self) -> int:
        """Number of (state, control, step) that a solver evaluates.

        A control belongs to one engine state, the engine off or on, so the two states count once.
        """
        return int(self.distinct.sum()) * self.penalty_kg.size

    @cached_property
    def half_weights(self) -> tuple[NDArray[np.int_], Array]:
        """Smoothing for rivals: taps to either side of every row, weights (r, t, n) from the middle on.

        They belong to the grid, as the kernel's own do, so finding them is not timed.
        """
        weights = smoothing_weights(self.spread, self.grid.soc_step)
        used = np.abs(weights).max(axis=2) > NEGLIGIBLE_WEIGHT
        weights[~used] = 0.0
        weights /= weights.sum(axis=1, keepdims=True)
        middle = weights.shape[1] // 2
        distance = np.abs(np.arange(weights.shape[1]) - middle)
        taps = np.array([int(distance[row].max()) for row in used], dtype=np.int_)
        return taps, np.ascontiguousarray(weights[:, middle : middle + taps.max() + 1])

    def every(self, stride: int) -> Case:
        """Keep one step in ``stride``: a sample of all of them, for what is too slow to run in full."""
        stages = Stages(*(np.ascontiguousarray(table[::stride]) for table in self.stages))
        return replace(self, stages=stages)

    def solve(self) -> Array:
        """Solve with the project's kernel; ``J_0``, shape (2, r, n)."""
        rows, nodes = self.penalty_kg.shape
        steps = self.stages.power_W.shape[0]
        kept, offset = np.empty((steps + 1, 2, rows, nodes), np.float32), np.empty(steps + 1)
        last = np.array([self.terminal_kg, self.terminal_kg])
        first: Array = sweep(self.grid, self.scalars, self.stages, self.penalty_kg, last, False, kept, offset)
        return first


def hev_problem(steps: int, settings: GridSettings) -> Problem:
    """Build the HEV's problem on the first steps of the cycle `larsson`."""
    cycle = load_cycle("larsson").resample(1.0)
    part = slice(0, steps + 1)
    start = DriveCycle("start", cycle.time_s[part], cycle.speed_mps[part], cycle.altitude_m[part])
    return build_problem(load_concept("hev"), start, settings=settings)


def stochastic_case(problem: Problem) -> Case:
    """Prepare the program over (estimate, variance, engine state)."""
    settings, pack, uncertainty = problem.settings, problem.pack, problem.uncertainty
    nodes = soc_nodes(problem.concept, settings, settings.soc_step)
    rows = variance_rows(problem.concept, pack, uncertainty, problem.step_s, settings)
    grid = stochastic_grid(nodes, rows, pack, uncertainty, problem.step_s)
    measured = measurement_variance(nodes, rows, pack, uncertainty)
    spread = innovation_spread(np.broadcast_to(rows[:, None], measured.shape), measured)
    penalties = node_penalties(problem, nodes, rows, grid.soc_step)
    return Case(grid, problem.scalars, problem.stages, *penalties, spread, _inside(problem, nodes))


def certain_case(problem: Problem) -> Case:
    """Prepare the deterministic program over (SOC, engine state)."""
    nodes = soc_nodes(problem.concept, problem.settings, problem.settings.deterministic_soc_step)
    grid = deterministic_grid(nodes, problem.pack)
    penalties = node_penalties(problem, nodes, np.zeros(1), grid.soc_step)
    spread = np.zeros((1, nodes.size))
    return Case(grid, problem.scalars, problem.stages, *penalties, spread, _inside(problem, nodes))


def _inside(problem: Problem, nodes: Array) -> NDArray[np.bool_]:
    window = problem.concept.window
    return (nodes >= window.low) & (nodes <= window.high)

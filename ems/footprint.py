"""What a solve will take, known before it starts: the size of its tables, and the memory at its peak."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ems import memory
from ems.cost_to_go import table_bytes
from ems.errors import EmsError
from ems.grid import soc_nodes, variance_rows
from ems.problem import Problem
from ems.resolution import Resolution, belief_resolution, finer, process_resolution
from ems.smoothing import REACH

STAGE_TABLES = 5
"""Tables over (step, control) that a problem holds."""
TEMPORARIES = 3
"""Copies of the smoothing weights that building them takes."""
COPIES = 3
"""Tables of the cost-to-go that are in memory while a file is written."""


@dataclass(frozen=True)
class Footprint:
    """Size of a program.

    Parameters
    ----------
    steps, rows, nodes, controls : int
        Steps N, variance rows r, SOC nodes n, controls C.
    solve_bytes : int
        Memory that problem and solve take at the peak, beside the program itself.
    file_bytes : int
        The same with a policy file written, which takes the cost-to-go of every stage.
    """

    steps: int
    rows: int
    nodes: int
    controls: int
    solve_bytes: int
    file_bytes: int


def program_resolution(problem: Problem, policy: str) -> Resolution:
    """Find spacing and look-up in SOC of a policy's program, by the policy's name; of trials the finest."""
    if policy == "stochastic":
        found = belief_resolution(problem)
        return found if found.sure else min(finer(problem, found), key=lambda one: one.soc_step)
    if policy == "perfect_information":
        return process_resolution(problem)
    return Resolution(problem.settings.deterministic_soc_step, cubic=False)


def footprint(problem: Problem, policy: str) -> Footprint:
    """Find the size of the program of a policy that is solved for, by its name."""
    settings, uncertainty = problem.settings, problem.uncertainty
    step = program_resolution(problem, policy).soc_step
    nodes = soc_nodes(problem.concept, settings, step).size
    rows, levels, widest = 1, 1, 0.0
    if policy == "stochastic":
        top = variance_rows(
            problem.concept,
            problem.pack,
            uncertainty,
            problem.step_s,
            settings,
            steps=problem.steps,
            least_reach=problem.least_reach,
        )
        rows = levels = top.size
        widest = math.sqrt(float(top[-1]))
    elif policy == "perfect_information":
        largest_A = max(problem.pack.discharge_limit_A, problem.pack.charge_limit_A)
        levels = settings.process_levels
        widest = math.sqrt(float(uncertainty.process_variance(largest_A, problem.step_s)))
    taps = 2 * math.ceil(REACH * widest / step) + 5
    grid = 8 * levels * taps * nodes * TEMPORARIES
    stages = 8 * STAGE_TABLES * problem.stages.power_W.size
    tables = memory.solve_bytes(problem.steps, rows, nodes)
    return Footprint(
        steps=problem.steps,
        rows=rows,
        nodes=nodes,
        controls=problem.stages.power_W.shape[1],
        solve_bytes=stages + grid + tables,
        file_bytes=stages + grid + COPIES * table_bytes(problem.steps, rows, nodes),
    )


def require_room(size: Footprint) -> None:
    """Refuse what would not fit with its policy file written.

    Raises
    ------
    EmsError
        Says what it would take, what there is, and what to do.
    """
    memory.require_memory(size.steps, size.rows, size.nodes)
    available = memory.available_bytes()
    if available is not None and size.file_bytes > memory.SPARE * available:
        raise EmsError(
            f"to write the cost-to-go over {size.nodes} SOC nodes, {size.rows} variance rows and"
            f" {size.steps} steps takes {size.file_bytes / 1e9:.1f} GB of memory, and"
            f" {available / 1e9:.1f} GB are available; take a larger soc_step or fewer variance_rows, or a"
            " shorter cycle"
        )

"""What a grid costs and how far its value is from that of a much finer one: the table behind the defaults."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from scipy.interpolate import CubicSpline

from bms.uncertainty import UncertaintyModel
from drivecycles import DriveCycle, load_cycle
from ems import GridSettings, Problem, build_policy, build_problem, load_concept
from ems.grid import deterministic_grid, soc_nodes, stochastic_grid, variance_rows
from ems.solution import Solution, node_penalties, solve

Array = NDArray[np.float64]

CONCEPTS = ("hev", "phev")
STEPS = (2134, 4268)
ROUNDS = 2
REFERENCE = GridSettings(
    soc_step=0.00125,
    deterministic_soc_step=0.0000625,
    variance_rows=32,
    process_levels=12,
    torque_levels=336,
    soc_margin=0.3,
)
"""The judge: finer in everything, and a wider grid."""
ROWS: dict[str, Callable[[Array], Array]] = {
    "sqrt(p)": lambda x: np.square(x),
    "p": lambda x: x,
    "p^(1/3)": lambda x: np.power(x, 3.0),
    "log-like": lambda x: np.square(np.expm1(3.0 * x) / np.expm1(3.0)),
}
"""How rows are spread: variance over its largest, from the row's number over the last."""


@dataclass(frozen=True)
class Variant:
    """One way to discretise.

    Parameters
    ----------
    name : str
        What it differs in from the defaults.
    change : dict
        The settings that differ.
    cubic : bool
        Cubic look-ups in SOC, or linear ones.
    rows : str
        One of `ROWS`.
    """

    name: str
    change: dict[str, Any] = field(default_factory=dict)
    cubic: bool = True
    rows: str = "sqrt(p)"

    @property
    def settings(self) -> GridSettings:
        """All settings."""
        return GridSettings().model_copy(update=self.change)


DEFAULT = Variant("default")
STOCHASTIC = (
    DEFAULT,
    *(Variant(f"SOC step {step:g}", {"soc_step": step}) for step in (0.01, 0.005, 0.00125)),
    *(
        Variant(f"linear in SOC, step {step:g}", {"soc_step": step}, cubic=False)
        for step in (0.005, 0.0025, 0.00125, 0.000625)
    ),
    *(Variant(f"{rows} variance rows", {"variance_rows": rows}) for rows in (5, 8, 10, 24, 32)),
    *(Variant(f"rows uniform in {name}", rows=name) for name in ("p", "p^(1/3)")),
    Variant("rows log-like in p", rows="log-like"),
    *(Variant(f"{levels} torque levels", {"torque_levels": levels}) for levels in (11, 21, 42, 84, 168)),
    *(Variant(f"margin {margin:g}", {"soc_margin": margin}) for margin in (0.05, 0.1, 0.2, 0.3)),
    Variant("10 variance rows, 21 torque levels", {"variance_rows": 10, "torque_levels": 21}),
)
PERFECT = (
    DEFAULT,
    *(Variant(f"SOC step {step:g}", {"soc_step": step}) for step in (0.005, 0.00125)),
    *(Variant(f"{levels} levels", {"process_levels": levels}) for levels in (3, 4, 9, 12)),
)
CERTAIN = (
    Variant("default", cubic=False),
    *(
        Variant(f"linear, SOC step {step:g}", {"deterministic_soc_step": step}, cubic=False)
        for step in (0.001, 0.0005, 0.000125)
    ),
    *(
        Variant(f"cubic, SOC step {step:g}", {"deterministic_soc_step": step}, True)
        for step in (0.0025, 0.00025)
    ),
)


def problem_of(concept: str, steps: int, settings: GridSettings) -> Problem:
    """Build the problem on the first steps of the cycle `larsson`."""
    cycle = load_cycle("larsson").resample(1.0)
    part = slice(0, steps + 1)
    start = DriveCycle("start", cycle.time_s[part], cycle.speed_mps[part], cycle.altitude_m[part])
    return build_problem(load_concept(concept), start, settings=settings)


def stochastic_value(problem: Problem, variant: Variant) -> tuple[float, float]:
    """Value at the start in kg and processor time in s, on exactly the grid that is asked for."""
    settings, concept, pack = problem.settings, problem.concept, problem.pack
    uncertainty: UncertaintyModel = problem.uncertainty
    nodes = soc_nodes(concept, settings, settings.soc_step)
    uniform = variance_rows(concept, pack, uncertainty, problem.step_s, settings, steps=problem.steps)
    rows = uniform[-1] * ROWS[variant.rows](np.linspace(0.0, 1.0, uniform.size))
    grid = stochastic_grid(nodes, rows, pack, uncertainty, problem.step_s, variant.cubic)
    solution = solve(problem, grid, *node_penalties(problem, nodes, rows, grid.soc_step))
    # Not `Solution.value_kg`, which takes rows for uniform in sqrt(p).
    at_start = CubicSpline(solution.soc, solution.first_kg[0], axis=1)(concept.initial_soc)
    found = CubicSpline(np.sqrt(rows), at_start)(concept.initial_soc_sd)
    return float(found), solution.solve_s


def perfect_value(problem: Problem, variant: Variant) -> tuple[float, float]:
    """Value and processor time of the program that is told the true SOC."""
    policy = build_policy("perfect_information", problem)
    return float(policy.value_kg), float(policy.solve_s)  # type: ignore[union-attr]


def certain_value(problem: Problem, variant: Variant) -> tuple[float, float]:
    """Value and processor time of the deterministic program, which the policy solves with linear look-ups."""
    nodes = soc_nodes(problem.concept, problem.settings, problem.settings.deterministic_soc_step)
    grid = deterministic_grid(nodes, problem.pack, variant.cubic)
    solution: Solution = solve(problem, grid, *node_penalties(problem, nodes, np.zeros(1), grid.soc_step))
    return solution.value_kg(problem.concept.initial_soc), solution.solve_s


PROGRAMS: dict[str, tuple[Callable[[Problem, Variant], tuple[float, float]], Sequence[Variant]]] = {
    "stochastic": (stochastic_value, STOCHASTIC),
    "perfect information": (perfect_value, PERFECT),
    "certainty equivalent": (certain_value, CERTAIN),
}


@dataclass(frozen=True)
class Measured:
    """Errors of one variant, and what it cost.

    Parameters
    ----------
    error : dict
        By (concept, steps): value over that of the reference, less one.
    cpu_s : dict
        By concept: least processor time on the longest trip.
    """

    error: dict[tuple[str, int], float]
    cpu_s: dict[str, float]


def measure(
    program: str,
    concepts: Sequence[str] = CONCEPTS,
    steps: Sequence[int] = STEPS,
    reference: GridSettings = REFERENCE,
    rounds: int = ROUNDS,
    variants: Sequence[Variant] | None = None,
) -> dict[str, Measured]:
    """Judge the variants of a program by its value on the reference grid.

    Parameters
    ----------
    program : str
        One of `PROGRAMS`.
    concepts, steps : sequence
        Cars, and how many steps of the cycle they drive.
    reference : GridSettings
        The judge, solved as the first of the variants is.
    rounds : int
        How often the longest trip is solved, to take the least time.
    variants : sequence of Variant, optional
        What is judged, all of the program's unless told.
    """
    value_of, known = PROGRAMS[program]
    known = variants or known
    found = {variant.name: Measured({}, {}) for variant in known}
    for concept in concepts:
        for count in steps:
            judge, _ = value_of(problem_of(concept, count, reference), known[0])
            for variant in known:
                problem = problem_of(concept, count, variant.settings)
                runs = [value_of(problem, variant) for _ in range(rounds if count == max(steps) else 1)]
                found[variant.name].error[concept, count] = runs[0][0] / judge - 1.0
                if count == max(steps):
                    found[variant.name].cpu_s[concept] = min(cpu_s for _, cpu_s in runs)
    return found


def accuracy_table() -> Table:
    """Measure everything, and lay out a row per variant."""
    started = time.perf_counter()
    table = Table(title="Error of the value at the start against the reference grid, and processor time")
    table.add_column("")
    for concept in CONCEPTS:
        for count in STEPS:
            table.add_column(f"{concept} {count:,}", justify="right", no_wrap=True)
        table.add_column(f"{concept} time", justify="right", no_wrap=True)
    for program in PROGRAMS:
        table.add_row(f"[bold]{program}[/bold]")
        for name, one in measure(program).items():
            cells = []
            for concept in CONCEPTS:
                cells += [f"{100.0 * one.error[concept, count]:+.3f} %" for count in STEPS]
                cells.append(f"{one.cpu_s[concept]:.2f} s")
            table.add_row(f"  {name}", *cells)
        table.add_section()
    took_s = time.perf_counter() - started
    table.caption = f"times of {max(STEPS):,} steps, least of {ROUNDS} rounds; all in {took_s:.0f} s"
    return table

"""What the stochastic solve costs over the size of all it depends on, and the straight lines through that."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from scipy.optimize import nnls

from benchmarks.cases import Case, hev_problem, stochastic_case
from ems import GridSettings
from ems._blocks import NODES
from ems._lanes import LANES

Array = NDArray[np.float64]

STEPS = 400
BASE = GridSettings(soc_step=0.0025, variance_rows=15, torque_levels=39)
ROUNDS = 3
WORK = (
    "step x node x control",
    "step x node x row x control",
    "step x node x row",
    "step x node x row x tap",
)
"""What the time should be a sum of: circuit, look-ups, slopes and tables, smoothing. Rows of the look-ups are
counted in whole vectors. A tap is a weight of the smoothing: a row has as many as ten standard deviations of
its innovation have nodes, for each level that its currents reach; so a finer grid has more of them."""


@dataclass(frozen=True, eq=False)
class Line:
    """Times of one dimension and the straight line through them, ``a + b x``.

    Parameters
    ----------
    name : str
        What is varied; all else stays as in `BASE`.
    size : ndarray
        How large it is.
    work : ndarray, shape (points, 4)
        How often each of `WORK` is done.
    cpu_s, memory_bytes : ndarray
        Least processor time of the rounds, and how much the peak of the memory lies above what was in use
        before; NaN where the system does not tell.
    """

    name: str
    size: Array
    work: Array
    cpu_s: Array
    memory_bytes: Array

    def fit(self) -> tuple[float, float, float]:
        """Intercept in s, slope in s per unit, and R squared."""
        slope, intercept = np.polynomial.Polynomial.fit(self.size, self.cpu_s, 1).convert().coef[::-1]
        residual = self.cpu_s - intercept - slope * self.size
        spread = self.cpu_s - self.cpu_s.mean()
        return float(intercept), float(slope), float(1.0 - residual @ residual / (spread @ spread))


def dimensions() -> list[tuple[str, Callable[[Case], int], list[tuple[int, GridSettings]]]]:
    """List what is varied: name, how to measure its size, and (steps, settings) of every point."""

    def vary(name: str, values: Sequence[float]) -> list[tuple[int, GridSettings]]:
        return [(STEPS, BASE.model_copy(update={name: value})) for value in values]

    return [
        (
            "SOC nodes, wider grid",
            lambda case: case.penalty_kg.shape[1],
            vary("soc_margin", (0.025, 0.0875, 0.15, 0.25, 0.55)),
        ),
        (
            "SOC nodes, finer grid",
            lambda case: case.penalty_kg.shape[1],
            vary("soc_step", (0.005, 0.0025, 0.00125, 0.000625)),
        ),
        (
            "variance rows",
            lambda case: case.penalty_kg.shape[0],
            vary("variance_rows", (8, 12, 15, 16, 24, 32, 48)),
        ),
        (
            "controls",
            lambda case: round(case.distinct.sum() / case.distinct.shape[0]),
            vary("torque_levels", (7, 15, 39, 79, 159)),
        ),
        (
            "steps",
            lambda case: case.stages.power_W.shape[0],
            [(steps, BASE) for steps in (STEPS, 1000, 2134, 4268)],
        ),
    ]


def measure_lines(rounds: int = ROUNDS) -> list[Line]:
    """Time the solve over each dimension."""
    stochastic_case(hev_problem(2, BASE)).solve()
    lines = []
    for name, size_of, points in dimensions():
        found, work = np.empty((3, len(points))), np.empty((len(points), len(WORK)))
        for at, (steps, settings) in enumerate(points):
            case = stochastic_case(hev_problem(steps, settings))
            found[:, at], work[at] = (size_of(case), *_cost(case.solve, rounds)), work_of(case)
        size, cpu_s, memory_bytes = found
        lines.append(Line(name, size, work, cpu_s, memory_bytes))
    return lines


def work_of(case: Case) -> tuple[int, int, int, int]:
    """Count how often each of `WORK` is done."""
    rows, nodes = case.penalty_kg.shape
    steps, controls = case.distinct.shape[0], int(case.distinct.sum())
    whole_rows = -(-rows // LANES) * LANES
    levels = (case.grid.levels[..., 1] - case.grid.levels[..., 0]).sum(axis=1) * NODES
    taps = int((levels * (2 * case.grid.plan[:, 0, 2] + 1)).sum())
    return nodes * controls, nodes * whole_rows * controls, steps * nodes * rows, steps * taps


def fit_together(lines: Sequence[Line]) -> tuple[Array, float, float]:
    """Fit all times by one sum over `WORK`, relative errors least.

    Returns
    -------
    ndarray, shape (4,)
        Time of each, in s; not negative.
    float
        R squared.
    float
        Largest relative error.
    """
    work, cpu_s = (
        np.concatenate([line.work for line in lines]),
        np.concatenate([line.cpu_s for line in lines]),
    )
    each, _ = nnls(work / cpu_s[:, None], np.ones_like(cpu_s))
    residual, spread = cpu_s - work @ each, cpu_s - cpu_s.mean()
    return each, float(1.0 - residual @ residual / (spread @ spread)), float(np.abs(residual / cpu_s).max())


def scaling_table() -> Table:
    """Measure, and lay out a row per point and a line per dimension."""
    base = stochastic_case(hev_problem(STEPS, BASE))
    rows, nodes = base.penalty_kg.shape
    table = Table(
        title=f"Stochastic solve, one dimension varied at a time: {nodes} SOC nodes, {rows} variance rows,"
        f" {base.stages.power_W.shape[1]} controls, {STEPS} steps",
        caption=f"processor time of one thread, least of {ROUNDS} rounds; memory above that of the problem",
    )
    table.add_column("")
    for name in ("size", "time", "a + b x", "memory"):
        table.add_column(name, justify="right", no_wrap=True)
    lines = measure_lines()
    for line in lines:
        intercept, slope, determination = line.fit()
        table.add_row(
            f"[bold]{line.name}[/bold]",
            "",
            f"{1e3 * intercept:+.1f} ms + {1e3 * slope:.4g} ms x",
            f"R² {determination:.4f}",
            "",
        )
        for size, cpu_s, memory in zip(line.size, line.cpu_s, line.memory_bytes, strict=True):
            table.add_row(
                "",
                f"{size:,.0f}",
                f"{1e3 * cpu_s:,.1f} ms",
                f"{1e3 * (intercept + slope * size):,.1f} ms",
                "" if np.isnan(memory) else f"{memory / 1e6:,.1f} MB",
            )
        table.add_section()
    each, determination, worst = fit_together(lines)
    table.add_row("[bold]all points together[/bold]", "", "", f"R² {determination:.4f}", "")
    for name, seconds in zip(WORK, each, strict=True):
        table.add_row(f"  {name}", "", f"{1e9 * seconds:.3f} ns", "", "")
    table.add_row("  largest error", "", f"{worst:.0%}", "", "")
    return table


def _cost(run: Callable[[], object], rounds: int) -> tuple[float, float]:
    known = _forget_peak()
    least, before = np.inf, _resident("VmRSS")
    for _ in range(rounds):
        started = time.thread_time()
        run()
        least = min(least, time.thread_time() - started)
    return least, _resident("VmHWM") - before if known else np.nan


def _forget_peak() -> bool:
    """Let the peak of the memory in use start anew, where the system can (Linux with glibc)."""
    try:
        # Memory that was given up but kept at hand would hide what the next solve needs.
        ctypes.CDLL(None).malloc_trim(0)
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except (AttributeError, OSError, TypeError):
        return False
    return True


def _resident(name: str) -> float:
    """Read a figure of the memory in use, in bytes; NaN where the system does not tell."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return np.nan
    return next((1024.0 * float(line.split()[1]) for line in lines if line.startswith(name)), np.nan)

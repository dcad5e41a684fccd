"""Who is timed against the kernel, how far they may differ from it, and the check that they do not more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.cases import Case
from benchmarks.cpp_sweep import cpp_sweep
from benchmarks.naive_sweep import naive_sweep
from benchmarks.numpy_sweep import deterministic_sweep, stochastic_sweep
from benchmarks.quantecon_sweep import quantecon_sweep
from benchmarks.timing import Task

Array = NDArray[np.float64]


class DisagreementError(RuntimeError):
    """Two solvers of one problem found different values: their times must not be compared."""


@dataclass(frozen=True)
class Rival:
    """Another way to solve a case.

    Parameters
    ----------
    name : str
        Shown in the table.
    solve : callable
        Takes a case, gives ``J_0`` of shape (2, r, n).
    tolerance : float
        Most by which values may deviate from the kernel's: root mean square over the SOC window, all
        variances and engine states, divided by the mean value there.
    stride : int
        It is timed on one step in so many.
    """

    name: str
    solve: Callable[[Case], Array]
    tolerance: float
    stride: int

    def require_agreement(self, case: Case, ours: Array) -> float:
        """Compare with the kernel's values and give the deviation, see `tolerance`.

        Raises
        ------
        DisagreementError
            It exceeds the tolerance.
        """
        expected, found = ours[..., case.inside], self.solve(case)[..., case.inside]
        deviation = float(np.sqrt(np.mean(np.square(found - expected))) / np.mean(expected))
        if not deviation <= self.tolerance:
            raise DisagreementError(
                f"{self.name} differs from the kernel by {deviation:.2g} of the mean value,"
                f" {self.tolerance:.2g} is allowed; one of the two is wrong, so no time is taken"
            )
        return deviation

    def task(self, case: Case) -> Task:
        """Prepare the solution of every ``stride``-th step for timing."""
        sample = case.every(self.stride)
        return Task(self.name, lambda: self.solve(sample), sample.evaluations)


def _naive(case: Case, cubic: bool) -> Array:
    first: Array = naive_sweep(
        case.grid, case.scalars, case.stages, case.penalty_kg, case.terminal_kg, case.spread, cubic
    )
    return first


STOCHASTIC = (
    Rival("C++, rows as vectors, by hand", cpp_sweep, 5e-3, 1),
    Rival("numba, quadrature inside the loop", lambda case: _naive(case, True), 2e-3, 10),
    Rival("numba, same with linear look-ups", lambda case: _naive(case, False), 5e-2, 10),
    Rival("NumPy, smoothing once per row", stochastic_sweep, 1e-6, 10),
)
"""Linear look-ups blur the cost-to-go in every step, hence their wide tolerance: cheaper, but not as good.
The C++ kernel takes one parabola per step through all p' of a row, so it differs most where few steps are
left: by 4e-3 with 12 steps, 7e-4 with 300, 2e-4 with 2,134."""

CERTAIN = (
    Rival("NumPy, the same algorithm", deterministic_sweep, 1e-12, 1),
    Rival("QuantEcon, DiscreteDP", quantecon_sweep, 1e-12, 10),
)

"""[M] part 1, mass-spring: the two filters of Tables 1 and 2 on 50 logs, and those of today beside them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from socwise.inertia import InertiaRun, honesty
from socwise.inertia_cases import run_mass_spring
from vehicle.inertia.mass_spring import simulate

Array = NDArray[np.float64]

SEEDS = 50
FAR_M = 0.2
"""True initial position that the filter of Table 1 does not know of: it starts at 0."""
MASS = "mass_kg"
LATER_SHARE = 0.5
"""Tracking is judged over the second half of a log."""


@lru_cache(maxsize=16)
def runs(mode: str, position_m: float, seeds: int = SEEDS) -> tuple[InertiaRun, ...]:
    """Run a filter over logs that differ in noise; the true system starts at a position, at rest."""
    found = []
    for seed in range(seeds):
        found += run_mass_spring(simulate(seed=seed, position_m=position_m), [mode], seed=seed)
    return tuple(found)


def errors_percent(found: tuple[InertiaRun, ...]) -> Array:
    """Final errors of the mass, shape (runs,)."""
    return np.array([100.0 * run.estimate.error(run.truth)[MASS] for run in found])


def over_confidence(found: tuple[InertiaRun, ...]) -> Array:
    """Final errors of the mass in claimed standard deviations, shape (runs,)."""
    claimed = np.array([run.estimate.final_sd[MASS] / run.truth[MASS] for run in found])
    return np.abs(errors_percent(found)) / (100.0 * claimed)


def tracking(found: tuple[InertiaRun, ...], name: str) -> tuple[float, float]:
    """Root of the mean square of a state's error and of its claimed standard deviation, later on."""
    squares, claimed = [], []
    for run in found:
        values, sds = run.estimate.column(name)
        later = slice(round(LATER_SHARE * values.size), None)
        squares.append(np.mean((values - run.course[name])[later] ** 2))
        claimed.append(np.mean(sds[later] ** 2))
    return float(np.sqrt(np.mean(squares))), float(np.sqrt(np.mean(claimed)))


def nees(found: tuple[InertiaRun, ...]) -> tuple[float, float, float, bool]:
    """Mean NEES per quantity, its 95 % band, and whether it lies inside."""
    judged = honesty(found)
    if judged is None:
        return np.nan, np.nan, np.nan, False
    return judged.mean, judged.low, judged.high, judged.honest

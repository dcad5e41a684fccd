"""The road of [M] part 4 in the report's own cells and scheme, run for the report's own draws.

The draws are those of `socwise.reproduce.traffic_draws`; at t = 1 s the speed is the free-flow speed, so
Tables 9 and 11 show at once whether they are the right ones.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from drivecycles.traffic import Diagram, Greenshields, Road, Underwood
from drivecycles.traffic.lwr import simulate_members
from socwise.reproduce.traffic_draws import report_draws
from socwise.reproduce.traffic_published import SIZES

Array = NDArray[np.float64]

MPH, MILE = 0.44704, 1609.344
HOUR_S = 3600.0
DURATION_S, STEP_S = 300.0, 1.0
DEMAND_PER_S = 2400.0 / HOUR_S
CELL_M = 0.1 * MILE
CELLS = (6, 11, 26, 51)
"""Where the report reads speeds: position over cell length + 2, counted from 1."""
LOCATIONS_MILE = (0.5, 1.0, 2.5, 5.0)
TIMES_S = (1.0, 150.0, 300.0)
SPEED_MPH, JAM_PER_MILE, CRITICAL_PER_MILE = 75.0, 250.0, 50.0
GREENSHIELDS, UNDERWOOD = "greenshields", "underwood"
SPARE = 1.02
"""Least capacity over demand for Greenshields: below 1 the report's scheme blows up."""


def road() -> Road:
    """Give the report's road, with the two cells that its locations lie further down."""
    return Road((CELLS[-1] + 1) * CELL_M, CELLS[-1] + 1)


def diagram(kind: str, speed_mph: float = SPEED_MPH, density_per_mile: float | None = None) -> Diagram:
    """Make one of the report's diagrams; the density is the jam's, or Underwood's critical one."""
    if kind == GREENSHIELDS:
        return Greenshields(speed_mph * MPH, (density_per_mile or JAM_PER_MILE) / MILE)
    return Underwood(speed_mph * MPH, (density_per_mile or CRITICAL_PER_MILE) / MILE)


def parameters(kind: str, sd: float, draws: Array) -> tuple[Array, int]:
    """Turn standard draws, shape (..., 2), into speeds and densities in mph and 1/mile.

    Returns
    -------
    tuple of ndarray, shape (..., 2), and int
        And how many draws were truncated: their capacity would be below the demand.
    """
    density = JAM_PER_MILE if kind == GREENSHIELDS else CRITICAL_PER_MILE
    values = np.array([SPEED_MPH, density]) + sd * draws
    if kind == UNDERWOOD:
        low = values[..., 1] < 1.0
        values[..., 1][low] = 1.0
        return values, int(low.sum())
    least = 4.0 * SPARE * HOUR_S * DEMAND_PER_S / values[..., 1]
    low = values[..., 0] < least
    values[..., 0][low] = least[low]
    return values, int(low.sum())


def run(kind: str, values: Array, time_s: tuple[float, ...] = TIMES_S, scheme: str = "report") -> Array:
    """Run the report's road for speeds and densities, shape (..., 2); gives mph, (times, locations, ...)."""
    flat = values.reshape(-1, 2)
    members = [diagram(kind, float(speed), float(density)) for speed, density in flat]
    fields = simulate_members(
        road(), members, demand=DEMAND_PER_S, duration_s=DURATION_S, step_s=STEP_S, scheme=scheme,
        time_s=time_s, cells=CELLS,
    )  # fmt: skip
    return fields.speed_mps.reshape(len(time_s), len(CELLS), *values.shape[:-1]) / MPH


@lru_cache(maxsize=6)
def plain_speeds(kind: str, sd: float) -> tuple[Array, int]:
    """Run the report's draws.

    Returns
    -------
    tuple of ndarray, shape (3, 4, 100), and int
        Speeds in mph, and how many draws were truncated.
    """
    values, low = parameters(kind, sd, report_draws(SIZES[-1]))
    return run(kind, values), low


@lru_cache(maxsize=4)
def pair_means(kind: str, sd: float) -> tuple[Array, int]:
    """Run the first half of the draws and their mirror images.

    Returns
    -------
    tuple of ndarray, shape (3, 4, 50), and int
        Mean speeds of the pairs in mph, and how many draws were truncated.
    """
    draws = report_draws(SIZES[-1] // 2)
    values, low = parameters(kind, sd, np.stack([draws, -draws]))
    return run(kind, values).mean(axis=2), low


def sample_error(speed: Array, size: int) -> Array:
    """Estimate the standard error of the mean of the first ``size`` scenarios, ``s / sqrt(n)``."""
    return np.asarray(speed[..., :size].std(axis=-1, ddof=1) / np.sqrt(size), dtype=np.float64)


def pair_error(pairs: Array, size: int) -> Array:
    """Estimate that of ``size`` antithetic runs: p = n/2 pairs, rounded up, ``s / sqrt(p)``."""
    return sample_error(pairs, (size + 1) // 2)

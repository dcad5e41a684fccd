"""The road of [M] part 4 in the report's own cells and scheme, and draws that match what it prints.

The report's random draws are unknown, but its tables tell their moments. At t = 1 s the speed is the
free-flow speed, so Tables 9 and 11 give its mean and standard deviation for every number of scenarios; we
take them for nested, each sample beginning with the one before. The mean speed at location 1 after 300 s,
Table 10, gives the mean of the jam density of the plain samples; nothing else is known of densities, and
nothing of those of the antithetic samples. Of draws with these moments there are many: we take a number of
samples of them, and compare their median.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from drivecycles.traffic import Diagram, Greenshields, Road, Underwood
from drivecycles.traffic.lwr import simulate_members
from socwise.reproduce.traffic_published import PUBLISHED, SIZES

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
SAMPLES, SEED, NEWTON = 400, 20100200, 2
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


@lru_cache(maxsize=2)
def matched_draws(samples: int = SAMPLES) -> Array:
    """Draw nested samples with the moments that the report prints, shape (samples, 100, 3).

    The last axis holds free-flow speed, density of the plain and density of the antithetic samples.
    """
    blocks = np.diff(SIZES, prepend=0).astype(np.float64)
    error, mean = (np.array(half)[:, 0] for half in PUBLISHED[9])
    total, square = _sums((mean - SPEED_MPH) / 3.0, error * np.sqrt(SIZES) / 3.0)
    first = _blocks(np.random.default_rng(SEED), samples, total, square - total**2 / blocks)
    free = np.random.default_rng(SEED + 2).standard_normal(first.shape)
    wanted, shift = np.array(PUBLISHED[10][1])[:, 0], np.zeros(len(SIZES))
    for turn in range(NEWTON + 1):
        total, _ = _sums(shift, np.ones(len(SIZES)))
        second = _blocks(np.random.default_rng(SEED + 1), samples, total, None)
        draws = np.stack([first, second, free], axis=-1)
        if turn < NEWTON:
            speed = run(GREENSHIELDS, parameters(GREENSHIELDS, 3.0, draws[..., :2])[0], TIMES_S[-1:])[0, 0]
            ours = np.array([speed[:, :size].mean() for size in SIZES])
            shift = shift + (wanted - ours) / _slope()
    draws.flags.writeable = False
    return draws


def _slope() -> float:
    """Give the slope of the speed at location 1 after 300 s over the jam density's standard draw."""
    values = np.array([[SPEED_MPH, JAM_PER_MILE - 3.0], [SPEED_MPH, JAM_PER_MILE + 3.0]])
    low, high = run(GREENSHIELDS, values, TIMES_S[-1:])[0, 0]
    return float(0.5 * (high - low))


def _sums(mean: Array, sd: Array) -> tuple[Array, Array]:
    """Turn means and standard deviations of nested samples into sums and squares of what each adds."""
    sizes = np.array(SIZES, dtype=np.float64)
    square = (sizes - 1.0) * sd**2 + sizes * mean**2
    return np.diff(mean * sizes, prepend=0.0), np.diff(square, prepend=0.0)


def _blocks(generator: np.random.Generator, samples: int, total: Array, scatter: Array | None) -> Array:
    """Draw blocks of given sums and, unless left free, sums of squares about their means."""
    parts = []
    for at, size in enumerate(np.diff(SIZES, prepend=0)):
        z = generator.standard_normal((samples, int(size)))
        z -= z.mean(axis=1, keepdims=True)
        if scatter is not None:
            z *= np.sqrt(scatter[at] / np.sum(z**2, axis=1, keepdims=True))
        parts.append(z + total[at] / size)
    return np.concatenate(parts, axis=1)


@lru_cache(maxsize=6)
def plain_speeds(kind: str, sd: float, samples: int = SAMPLES) -> tuple[Array, int]:
    """Run matched draws.

    Returns
    -------
    tuple of ndarray, shape (3, 4, samples, 100), and int
        Speeds in mph, and how many draws were truncated.
    """
    values, low = parameters(kind, sd, matched_draws(samples)[..., :2])
    return run(kind, values), low


@lru_cache(maxsize=4)
def pair_means(kind: str, sd: float, samples: int = SAMPLES) -> tuple[Array, int]:
    """Run the first half of the draws and their mirror images.

    Returns
    -------
    tuple of ndarray, shape (3, 4, samples, 50), and int
        Mean speeds of the pairs in mph, and how many draws were truncated.
    """
    draws = matched_draws(samples)[:, : SIZES[-1] // 2, ::2]
    values, low = parameters(kind, sd, np.stack([draws, -draws]))
    return run(kind, values).mean(axis=2), low


def sample_error(speed: Array, size: int) -> Array:
    """Estimate the standard error of the mean of the first ``size`` scenarios, ``s / sqrt(n)``."""
    return np.asarray(speed[..., :size].std(axis=-1, ddof=1) / np.sqrt(size), dtype=np.float64)


def pair_error(pairs: Array, size: int) -> Array:
    """Estimate that of ``size`` antithetic runs, n/2 pairs (drawn: rounded up), ``s / sqrt(n/2)``."""
    first = pairs[..., : (size + 1) // 2]
    return np.asarray(first.std(axis=-1, ddof=1) / np.sqrt(0.5 * size), dtype=np.float64)

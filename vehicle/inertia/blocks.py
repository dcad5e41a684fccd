r"""Averages over blocks of time, and how much chance is left in them.

A mean of n samples scatters about the mean over the whole block by :math:`v = s^2 / n`, with the variance
:math:`s^2` of the samples within the block: noise of the sensor, and motion that is faster than the clock. In
a regressor that is an error, and shrinks what is found from it by :math:`v / S^2`, :math:`S^2` being the
variance of the means (errors in variables; Fuller, Measurement Error Models, 1987, section 1.1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vehicle.errors import VehicleError

Array = NDArray[np.float64]

HOLE = 0.5
LONGEST_STEP = 1.5
"""A step in time is a hole if it is longer than this share of a block, and than so many usual steps."""
FEWEST = 1.5
"""Samples in a block from which on their scatter is taken; below it, that of neighbouring blocks."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """Columns averaged over blocks of time.

    Attributes
    ----------
    time_s : ndarray, shape (b,)
        Time of the last row of each block.
    means : ndarray, shape (b, k)
        NaN where holes take more than half of a block.
    samples : float
        Rows in a block: the harmonic mean, on which the scatter depends; NaN without a whole block.
    noise_share : ndarray, shape (k,)
        Variance of the means that is chance, as a share of their variance, 0 to 1.
    left_out : int
        Blocks with too little in them; that at the end, which is seldom full, does not count.
    """

    time_s: Array
    means: Array
    samples: float
    noise_share: Array
    left_out: int


def average(time_s: Array, columns: Array, block_s: float) -> Blocks:
    """Average columns, shape (n, k), over blocks of time; rows with NaN do not count.

    How much of a block holds samples is judged by the steps between them, not by their number: a clock may
    slow down, or tick in bursts. Blocks no longer than a step leave the columns as they are.

    Raises
    ------
    VehicleError
        When the block is not a time.
    """
    if not 0.0 <= block_s < np.inf:
        raise VehicleError(f"average_s must be 0 (do not average) or a time in s, got {block_s}")
    step = float(np.median(np.diff(time_s)))
    full: NDArray[np.bool_] = np.asarray(np.isfinite(columns).all(axis=1))
    if block_s <= step:
        samples = 1.0 if full.any() else np.nan
        return Blocks(time_s, columns, samples, _share(columns, _roughness(columns)), 0)
    # Half a step off, lest rounding puts a sample at a border into either block.
    number = np.floor((time_s - time_s[0] + 0.5 * step) / block_s)
    starts = np.append(0, np.flatnonzero(np.diff(number) > 0.0) + 1)
    weight = full.astype(np.float64)
    count = np.add.reduceat(weight, starts)
    known = np.nan_to_num(columns) * weight[:, np.newaxis]
    whole = _covered_s(time_s, full, step, block_s, number[starts]) >= 0.5 * block_s
    share = np.where(whole & (count > 0.0), 1.0 / np.maximum(count, 1.0), np.nan)
    means = np.add.reduceat(known, starts, axis=0) * share[:, np.newaxis]
    filled = np.isfinite(share)
    samples = float(1.0 / share[filled].mean()) if filled.any() else np.nan
    several = filled & (count > 1.0)
    if samples >= FEWEST:
        apart = known - np.repeat(means, np.diff(np.append(starts, time_s.size)), axis=0)
        apart = np.where(full[:, np.newaxis], apart, 0.0)
        squares = np.add.reduceat(apart**2, starts, axis=0)[several]
        chance = (squares / (count * (count - 1.0))[several, np.newaxis]).mean(axis=0)
    else:
        chance = _roughness(means)
    ends = np.append(starts[1:], time_s.size) - 1
    left_out = int(np.count_nonzero(~filled[:-1]))
    return Blocks(time_s[ends], means, samples, _share(means, chance), left_out)


def told_of(blocks: Blocks, block_s: float) -> tuple[str, ...]:
    """Say how many blocks were left out, if any."""
    if not blocks.left_out:
        return ()
    return (
        f"{blocks.left_out} of {blocks.time_s.size} blocks of {block_s:g} s were left out: their samples are"
        " too far apart, or missing, for more than half of the time",
    )


def _covered_s(time_s: Array, full: NDArray[np.bool_], step: float, block_s: float, number: Array) -> Array:
    """Give the time in each block that lies between samples which are close to each other."""
    seen = time_s[full]
    if not seen.size:
        return np.zeros(number.size)
    gaps = np.diff(seen)
    gaps[gaps > max(HOLE * block_s, LONGEST_STEP * step)] = 0.0
    reached = np.concatenate([[0.0], np.cumsum(gaps)])
    # A sample at either end stands for half a step beyond it.
    seen = np.concatenate([[seen[0] - 0.5 * step], seen, [seen[-1] + 0.5 * step]])
    reached = np.concatenate([[-0.5 * step], reached, [reached[-1] + 0.5 * step]])
    begin = time_s[0] - 0.5 * step + number * block_s
    covered: Array = np.interp(begin + block_s, seen, reached) - np.interp(begin, seen, reached)
    return covered


def _roughness(columns: Array) -> Array:
    """Guess the variance of chance from second differences, in which slow motion cancels."""
    whole = columns[np.isfinite(columns).all(axis=1)]
    if whole.shape[0] < 3:
        return np.zeros(columns.shape[1])
    squares: Array = np.mean(np.diff(whole, 2, axis=0) ** 2, axis=0) / 6.0
    return squares


def _share(means: Array, chance: Array) -> Array:
    whole = means[np.isfinite(means).all(axis=1)]
    variance = whole.var(axis=0) if whole.size else np.zeros(chance.size)
    # Rounding in the mean of a column that does not change is no scatter.
    size = np.abs(whole).max(axis=0) if whole.size else variance
    moved = variance > (1e-12 * size) ** 2
    return np.where(moved, np.minimum(chance / np.where(moved, variance, 1.0), 1.0), 0.0)

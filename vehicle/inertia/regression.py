"""What a model makes of a log: inputs and outputs of a regression, averaged over blocks of time if wanted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vehicle.errors import VehicleError

Array = NDArray[np.float64]

DRAG_HEIGHT_SD_M = 0.3
"""Of the height over the centre of gravity at which drag acts: no log tells it, and C is blamed for it."""


@dataclass(frozen=True, eq=False)
class Regression:
    """A model on a log: ``outputs = model(inputs; parameters) + noise``.

    Attributes
    ----------
    kind : int
        Of the kernels in `vehicle.inertia._regression`.
    model : str
    time_s : ndarray, shape (n,)
        End of each block.
    inputs, outputs : ndarray, shapes (n, k) and (n, m)
        NaN in a row leaves it out.
    lengths_m : ndarray, shape (2,)
        Wheelbase and track.
    """

    kind: int
    model: str
    time_s: Array
    inputs: Array
    outputs: Array
    lengths_m: Array

    def __post_init__(self) -> None:
        whole = np.isfinite(self.inputs).all(axis=1) & np.isfinite(self.outputs).all(axis=1)
        if np.count_nonzero(whole) < 10:
            raise VehicleError(
                f"the model {self.model!r} finds {np.count_nonzero(whole)} complete samples, it needs 10 or"
                " more: look for NaN, give a longer log, or average over shorter blocks"
            )


def average(time_s: Array, columns: Array, block_s: float) -> tuple[Array, Array]:
    """Average columns, shape (n, k), over blocks of time; rows with NaN do not count.

    Returns
    -------
    tuple of ndarray, shapes (blocks,) and (blocks, k)
        Time of the last row of each block, and means; NaN where more than half of a block is missing.

    Raises
    ------
    VehicleError
        When the block is not a time.
    """
    if not 0.0 <= block_s < np.inf:
        raise VehicleError(f"average_s must be 0 (do not average) or a time in s, got {block_s}")
    step = float(np.median(np.diff(time_s)))
    if block_s <= step:
        return time_s, columns
    # Half a step off, lest rounding puts a sample at a border into either block.
    block = np.floor((time_s - time_s[0] + 0.5 * step) / block_s)
    starts = np.append(0, np.flatnonzero(np.diff(block) > 0.0) + 1)
    weight = np.asarray(np.isfinite(columns).all(axis=1), dtype=np.float64)
    count = np.add.reduceat(weight, starts)
    total = np.add.reduceat(np.nan_to_num(columns) * weight[:, np.newaxis], starts, axis=0)
    share = np.where(count >= 0.5 * block_s / step, 1.0 / np.maximum(count, 1.0), np.nan)
    means = total * share[:, np.newaxis]
    ends = np.append(starts[1:], time_s.size) - 1
    return time_s[ends], means


def propagate(function: Callable[[Array], Array], mean: Array, covariance: Array) -> tuple[Array, Array]:
    """Carry means, shape (n, p), and covariances, (n, p, p), through a function of rows, to first order."""
    centre = function(mean)
    slope = np.empty((*centre.shape, mean.shape[1]))
    sd = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))
    for j in range(mean.shape[1]):
        step = np.maximum(1e-5 * np.abs(mean[:, j]), 1e-6 * sd[:, j])
        step = np.where(step > 0.0, step, 1e-9)
        ahead, behind = mean.copy(), mean.copy()
        ahead[:, j] += step
        behind[:, j] -= step
        slope[:, :, j] = (function(ahead) - function(behind)) / (2.0 * step)[:, np.newaxis]
    return centre, slope @ covariance @ slope.transpose(0, 2, 1)

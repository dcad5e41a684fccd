"""What a model makes of a log: inputs and outputs of a regression, averaged over blocks of time if wanted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

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
    noise_share : ndarray, shape (2,)
        Variance of A_y and A_x that is chance, see `vehicle.inertia.blocks`.
    notes : tuple of str
        What became of the log on the way.
    """

    kind: int
    model: str
    time_s: Array
    inputs: Array
    outputs: Array
    lengths_m: Array
    noise_share: Array = field(default_factory=lambda: np.zeros(2))
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        whole = np.isfinite(self.inputs).all(axis=1) & np.isfinite(self.outputs).all(axis=1)
        if np.count_nonzero(whole) < 10:
            raise VehicleError(
                f"the model {self.model!r} finds {np.count_nonzero(whole)} complete samples, it needs 10 or"
                " more: look for NaN and gaps in time, or give a longer log"
                + "".join(f"; {note}" for note in self.notes)
            )


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

"""[L] eq 9 simulated forwards in time at constant SOC estimate, with the Beta expectation of eq 10."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bms import PiecewiseLinear
from bms.uncertainty import next_variance, steady_variance

Array = NDArray[np.float64]
_SWEEPS = 60


@dataclass(frozen=True, eq=False)
class Settings:
    """Settings of ``m`` curves, broadcast against each other; [L]'s medium values unless given.

    Parameters
    ----------
    soc, current_A : array_like
        SOC estimate and current, both constant.
    gamma, beta, mu : array_like
        Parameters of [L] eqs 3 and 4.
    """

    soc: ArrayLike = 0.65
    current_A: ArrayLike = 23.0
    gamma: ArrayLike = 1e-6
    beta: ArrayLike = 3.9e-7
    mu: ArrayLike = 2e-3

    def broadcast(self) -> tuple[Array, Array, Array, Array, Array]:
        """All five as arrays of one shape (m,)."""
        values = np.broadcast_arrays(
            *(np.atleast_1d(np.asarray(value, dtype=np.float64)) for value in vars(self).values())
        )
        soc, current_A, gamma, beta, mu = (np.array(value) for value in values)
        return soc, current_A, gamma, beta, mu


def simulate_variance(
    settings: Settings,
    alpha: PiecewiseLinear,
    duration_s: int,
    *,
    start: float = 0.0,
    rest_from_s: int | None = None,
) -> Array:
    """Variance over time, steps of 1 s.

    Parameters
    ----------
    settings : Settings
        ``m`` curves.
    alpha : PiecewiseLinear
        Of the pack.
    duration_s : int
        Number of steps.
    start : float
        Variance at time zero.
    rest_from_s : int, optional
        From here on there is no current.

    Returns
    -------
    ndarray, shape (duration_s + 1, m)
        ``p``.
    """
    soc, current_A, gamma, beta, mu = settings.broadcast()
    variance = np.empty((duration_s + 1, soc.size))
    variance[0] = start
    for k in range(duration_s):
        resting = rest_from_s is not None and k >= rest_from_s
        drift = gamma + beta * (0.0 if resting else np.abs(current_A))
        measured = mu * alpha.expectation(soc, variance[k])
        variance[k + 1] = next_variance(variance[k], measured, drift)
    return variance


def settled_variance(settings: Settings, alpha: PiecewiseLinear) -> Array:
    """Variance at which eq 9 settles, shape (m,).

    The fixed point of eq 9 at a known measurement variance is explicit; the expectation of eq 10 depends
    on it weakly, so the two are repeated in turn until they agree.
    """
    soc, current_A, gamma, beta, mu = settings.broadcast()
    drift = gamma + beta * np.abs(current_A)
    variance = steady_variance(mu * alpha(soc), drift)
    for _ in range(_SWEEPS):
        variance = steady_variance(mu * alpha.expectation(soc, variance), drift)
    return variance

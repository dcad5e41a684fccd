r"""Can a covariance be trusted: normalised squares of errors and innovations, and the band they belong in.

If an error :math:`e` of p entries is normal with the covariance P that a filter claims, then
:math:`e^T P^{-1} e` (NEES; of an innovation: NIS) is chi-square of p degrees of freedom. The sum over n
independent runs has n p degrees, so the mean over runs, divided by p, is near 1 and lies within

.. math:: \left[\chi^2_{np}(0.025),\; \chi^2_{np}(0.975)\right] / (n p)

in 95 of 100 repetitions. Above the band a filter is over-confident, below it timid (Bar-Shalom, Li,
Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaincinv

from gpc.belief import normalised_square
from gpc.errors import ChaosError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Consistency:
    """Mean normalised square per degree of freedom, and the band of an honest filter.

    Attributes
    ----------
    mean : float
        1 is expected; infinite if a covariance was singular.
    low, high : float
        Ends of the band.
    """

    mean: float
    low: float
    high: float

    @property
    def honest(self) -> bool:
        """Whether the mean lies inside the band."""
        return self.low <= self.mean <= self.high

    @property
    def verdict(self) -> str:
        """Say it in a word: over-confident, honest or timid."""
        return "honest" if self.honest else "over-confident" if not self.mean <= self.high else "timid"


def consistency(squares: ArrayLike, degrees: int, level: float = 0.95) -> Consistency:
    """Judge independent normalised squares of ``degrees`` degrees of freedom each.

    Parameters
    ----------
    squares : array_like, shape (n,)
        NEES of n runs, or NIS of n updates.
    degrees : int
        Entries of each error or innovation.
    level : float
        Probability that an honest filter lies inside the band.

    Raises
    ------
    ChaosError
        When there is nothing to judge, or a number is out of range.
    """
    values = np.asarray(squares, dtype=np.float64).ravel()
    if values.size < 1 or degrees < 1 or not 0.0 < level < 1.0:
        raise ChaosError(
            "give one normalised square or more, 1 degree of freedom or more and a level between 0 and 1,"
            f" got {values.size}, {degrees} and {level}"
        )
    total = values.size * degrees
    tails = np.array([0.5 * (1.0 - level), 0.5 * (1.0 + level)])
    low, high = 2.0 * gammaincinv(0.5 * total, tails) / total
    return Consistency(float(np.mean(values)) / degrees, float(low), float(high))


def nees(errors: ArrayLike, covariances: ArrayLike, level: float = 0.95) -> Consistency:
    """Judge the errors of n runs by the covariances that were claimed for them.

    Parameters
    ----------
    errors : array_like, shape (n, p)
        Estimate less truth.
    covariances : array_like, shape (n, p, p)
    level : float
        As in `consistency`.

    Raises
    ------
    ChaosError
        When shapes do not fit.
    """
    e, p = np.asarray(errors, dtype=np.float64), np.asarray(covariances, dtype=np.float64)
    if e.ndim != 2 or p.shape != (*e.shape, e.shape[1]):
        raise ChaosError(f"{e.shape} errors need covariances of shape (n, p, p), got {p.shape}")
    squares = [normalised_square(error, covariance) for error, covariance in zip(e, p, strict=True)]
    return consistency(squares, e.shape[1], level)

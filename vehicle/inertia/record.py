r"""What a method found on a log: parameters over time, each with a standard deviation that can be held to.

A parameter has settled at the first time after which its estimate stays within a band about its final value.
Where the truth is known, :math:`e^T P^{-1} e` (NEES) says whether the claimed covariance deserves trust.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gpc.belief import normalised_square
from vehicle.errors import VehicleError

Array = NDArray[np.float64]

SETTLED = 0.02
"""A parameter has settled when it stays within this share of its final value."""


@dataclass(frozen=True, eq=False)
class InertiaEstimate:
    """Estimates of one method on one log.

    Parameters
    ----------
    method : str
        Name of the method.
    time_s : ndarray, shape (n,)
        Times of the samples.
    names : tuple of str
        Of the p quantities, with their unit: ``mass_kg``, ``cg_height_m``.
    values, sds : ndarray, shape (n, p)
        Estimate and standard deviation after each sample.
    covariance : ndarray, shape (p, p)
        At the end.
    nis : float
        Mean normalised innovation squared per output: 1 is expected of an honest filter; NaN if a method has
        none.
    notes : tuple of str
        What a reader should know: a bias, a parameter that the log does not identify.

    Raises
    ------
    VehicleError
        When shapes do not fit.
    """

    method: str
    time_s: Array
    names: tuple[str, ...]
    values: Array
    sds: Array
    covariance: Array
    nis: float = np.nan
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        p = len(self.names)
        shape = (self.time_s.size, p)
        if self.time_s.ndim != 1 or self.time_s.size < 1 or self.values.shape != shape:
            raise VehicleError(
                f"an estimate has a row per sample and a column per name: {self.values.shape} is not {shape}"
            )
        if self.sds.shape != shape or self.covariance.shape != (p, p):
            raise VehicleError(
                f"standard deviations {self.sds.shape} and covariance {self.covariance.shape} do not fit"
                f" values of shape {shape}"
            )
        for array in vars(self).values():
            if isinstance(array, np.ndarray):
                array.setflags(write=False)

    @property
    def final(self) -> dict[str, float]:
        """Estimate after the last sample, by name."""
        return dict(zip(self.names, self.values[-1].tolist(), strict=True))

    @property
    def final_sd(self) -> dict[str, float]:
        """Standard deviation after the last sample, by name."""
        return dict(zip(self.names, self.sds[-1].tolist(), strict=True))

    def column(self, name: str) -> tuple[Array, Array]:
        """Give one quantity and its standard deviation over time, shape (n,) each."""
        at = self.names.index(name)
        return self.values[:, at], self.sds[:, at]

    @cached_property
    def settled_s(self) -> Array:
        """Time at which each quantity has settled, shape (p,)."""
        return settling_time_s(self.time_s, self.values)

    def error(self, truth: Mapping[str, float]) -> dict[str, float]:
        """Relative error at the end of every quantity whose truth is known; a fraction.

        The error of a quantity that is truly zero is absolute.
        """
        final = self.final
        return {
            name: (final[name] - true) / (abs(true) or 1.0) for name, true in truth.items() if name in final
        }

    def deviations(self, truth: Mapping[str, float]) -> dict[str, float]:
        """Error at the end of every quantity whose truth is known, in its own standard deviations.

        Infinite where the standard deviation is zero.
        """
        final, sd = self.final, self.final_sd
        found = {}
        for name in [known for known in truth if known in final]:
            error = final[name] - truth[name]
            found[name] = error / sd[name] if sd[name] > 0.0 else float(np.copysign(np.inf, error))
        return found

    def nees(self, truth: Mapping[str, float]) -> float:
        """Normalised square of the final error, per quantity whose truth is known: 1 is expected.

        Raises
        ------
        VehicleError
            When the truth of none of them is known.
        """
        known = [i for i, name in enumerate(self.names) if name in truth]
        if not known:
            raise VehicleError(f"the truth names none of {', '.join(self.names)}")
        error = self.values[-1, known] - np.array([truth[self.names[i]] for i in known])
        return normalised_square(error, self.covariance[np.ix_(known, known)]) / len(known)


def settling_time_s(time_s: Array, values: Array, band: float = SETTLED) -> Array:
    """Find when each column stays within ``band`` times its final value for good.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
    values : ndarray, shape (n, p)
    band : float
        Share of the final value.

    Returns
    -------
    ndarray, shape (p,)
        NaN where only the last sample lies in the band, or values are not finite.
    """
    settled = np.full(values.shape[1], np.nan)
    for i, column in enumerate(values.T):
        outside = np.flatnonzero(~(np.abs(column - column[-1]) <= band * abs(column[-1])))
        first = outside[-1] + 1 if outside.size else 0
        if first < time_s.size - 1 or time_s.size == 1:
            settled[i] = time_s[first]
    return settled

r"""What is known of an uncertain parameter of traffic, all of it positive.

Each distribution is a map from a germ, a random variable of a known family, to the parameter's values, so one
description serves sampling and polynomial chaos:

- truncated normal: :math:`F^{-1}(\Phi(\xi))`, :math:`\xi` standard normal, almost a line where little is cut;
- lognormal: :math:`e^{\mu + \sigma \xi}`, :math:`\xi` standard normal; from mean m and standard deviation s,
  :math:`\sigma^2 = \ln(1 + s^2/m^2)` and :math:`\mu = \ln m - \sigma^2/2`;
- beta on an interval: a line in :math:`\xi \in [-1, 1]`, which has the same shape.

Correlated parameters share normal germs (a Gaussian copula, Nataf's model).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaincinv, ndtr, ndtri

from drivecycles.traffic.errors import TrafficError
from gpc import Family, Hermite, Jacobi

Array = NDArray[np.float64]

WIDTH_SD = 4.0
"""Standard deviations from the mean at which a normal is cut where no bounds are given."""


class Distribution(ABC):
    """The distribution of a positive parameter."""

    @property
    @abstractmethod
    def family(self) -> Family:
        """Polynomials of its germ."""

    @property
    @abstractmethod
    def cut(self) -> float:
        """Probability that truncation took away."""

    @abstractmethod
    def of_normal(self, normal: ArrayLike) -> Array:
        """Turn standard normal variables into values, increasing."""

    def of_germ(self, germ: ArrayLike) -> Array:
        """Turn germs into values."""
        return self.of_normal(germ)

    def germ_of_share(self, share: ArrayLike) -> Array:
        """Turn variables uniform on (0, 1) into germs, increasing."""
        return np.asarray(ndtri(np.asarray(share, dtype=np.float64)), dtype=np.float64)


@final
@dataclass(frozen=True)
class TruncatedNormal(Distribution):
    """Normal, cut at bounds.

    Parameters
    ----------
    mean, sd : float
        Of the normal before it is cut.
    lower, upper : float, optional
        Bounds; four standard deviations from the mean by default. The lower one must be positive.

    Raises
    ------
    TrafficError
        When the distribution reaches below zero, or the bounds do not enclose the mean.
    """

    mean: float
    sd: float
    lower: float | None = None
    upper: float | None = None

    def __post_init__(self) -> None:
        require_moments("normal", self.mean, self.sd)
        low, high = self.bounds
        if not low > 0.0:
            raise TrafficError(
                f"the normal distribution of mean {self.mean:g} and standard deviation {self.sd:g} reaches"
                f" below zero, to {low:.4g}; give a positive lower bound, a smaller standard deviation, or"
                " take 'lognormal' or 'beta'"
            )
        if not low < self.mean < high < math.inf:
            raise TrafficError(
                f"the bounds of a truncated normal must enclose its mean, {self.mean:g}, got"
                f" {low:g} to {high:g}"
            )

    @property
    def bounds(self) -> tuple[float, float]:
        """Where it is cut."""
        low = self.mean - WIDTH_SD * self.sd if self.lower is None else self.lower
        high = self.mean + WIDTH_SD * self.sd if self.upper is None else self.upper
        return low, high

    @property
    def family(self) -> Family:
        """Polynomials of its germ: Hermite."""
        return Hermite()

    @property
    def cut(self) -> float:
        """Probability that truncation took away."""
        low, high = ((bound - self.mean) / self.sd for bound in self.bounds)
        return float(ndtr(low) + ndtr(-high))

    def of_normal(self, normal: ArrayLike) -> Array:
        """Turn standard normal variables into values, increasing."""
        z = np.asarray(normal, dtype=np.float64)
        low, high = ((bound - self.mean) / self.sd for bound in self.bounds)
        # Each half from its own tail, where probabilities are small and hence precise.
        left = ndtr(low) + ndtr(z) * (ndtr(high) - ndtr(low))
        right = ndtr(-high) + ndtr(-z) * (ndtr(-low) - ndtr(-high))
        score = np.where(z < 0.0, ndtri(left), -ndtri(right))
        return np.clip(self.mean + self.sd * score, *self.bounds)


@final
@dataclass(frozen=True)
class LogNormal(Distribution):
    """Lognormal, with a long upper tail.

    Parameters
    ----------
    mean, sd : float
        Of the parameter itself, not of its logarithm.

    Raises
    ------
    TrafficError
        When one is not positive and finite.
    """

    mean: float
    sd: float

    def __post_init__(self) -> None:
        require_moments("lognormal", self.mean, self.sd)

    @property
    def family(self) -> Family:
        """Polynomials of its germ: Hermite."""
        return Hermite()

    @property
    def cut(self) -> float:
        """Nothing is cut."""
        return 0.0

    def of_normal(self, normal: ArrayLike) -> Array:
        """Turn standard normal variables into values, increasing."""
        variance = math.log1p((self.sd / self.mean) ** 2)
        exponent = math.sqrt(variance) * np.asarray(normal, dtype=np.float64) - 0.5 * variance
        return np.asarray(self.mean * np.exp(exponent), dtype=np.float64)


@final
@dataclass(frozen=True)
class Beta(Distribution):
    """Beta on an interval.

    Parameters
    ----------
    mean, sd : float
        Of the parameter.
    lower, upper : float
        The interval; the lower end positive.

    Raises
    ------
    TrafficError
        When the interval reaches zero or does not enclose the mean, or the standard deviation is too large
        for it.
    """

    mean: float
    sd: float
    lower: float
    upper: float

    def __post_init__(self) -> None:
        require_moments("beta", self.mean, self.sd)
        if not self.lower > 0.0:
            raise TrafficError(
                f"the beta distribution on {self.lower:g} to {self.upper:g} reaches zero or below; its lower"
                " end must be positive"
            )
        if not self.lower < self.mean < self.upper < math.inf:
            raise TrafficError(
                f"the interval of a beta distribution must enclose its mean, {self.mean:g}, got"
                f" {self.lower:g} to {self.upper:g}"
            )
        most = math.sqrt((self.mean - self.lower) * (self.upper - self.mean))
        if not self.sd < most:
            raise TrafficError(
                f"a beta distribution of mean {self.mean:g} on {self.lower:g} to {self.upper:g} has a"
                f" standard deviation below {most:.4g}, got {self.sd:g}; widen the interval"
            )

    @property
    def shapes(self) -> tuple[float, float]:
        """Shape parameters a and b."""
        width = self.upper - self.lower
        share = (self.mean - self.lower) / width
        total = share * (1.0 - share) * (width / self.sd) ** 2 - 1.0
        return share * total, (1.0 - share) * total

    @property
    def family(self) -> Family:
        """Polynomials of its germ: Jacobi with its own shape."""
        return Jacobi(*self.shapes)

    @property
    def cut(self) -> float:
        """Nothing is cut."""
        return 0.0

    def of_normal(self, normal: ArrayLike) -> Array:
        """Turn standard normal variables into values, increasing."""
        return self.of_germ(self.germ_of_share(ndtr(np.asarray(normal, dtype=np.float64))))

    def of_germ(self, germ: ArrayLike) -> Array:
        """Turn germs on [-1, 1] into values."""
        return self.lower + 0.5 * (self.upper - self.lower) * (1.0 + np.asarray(germ, dtype=np.float64))

    def germ_of_share(self, share: ArrayLike) -> Array:
        """Turn variables uniform on (0, 1) into germs, increasing."""
        a, b = self.shapes
        return np.asarray(2.0 * betaincinv(a, b, np.asarray(share, dtype=np.float64)) - 1.0, dtype=np.float64)


def require_moments(name: str, mean: float, sd: float) -> None:
    """Refuse a mean or a standard deviation that is not positive and finite.

    Raises
    ------
    TrafficError
        Saying which.
    """
    for what, value in (("mean", mean), ("standard deviation", sd)):
        if not 0.0 < value < math.inf:
            raise TrafficError(
                f"the {what} of a {name} distribution must be positive and finite, got {value!r}"
            )

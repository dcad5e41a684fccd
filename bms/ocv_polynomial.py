r"""[M]'s open-circuit voltage: one polynomial of 6th order over 10 to 90 % SOC (section 4.1, Fig 25b).

.. math:: V_{oc}(SOC) = \sum_{i=0}^{6} c_i\,x^i, \qquad x = \frac{2\,SOC - s_0 - s_1}{s_1 - s_0} \in [-1, 1]

fitted by least squares between :math:`s_0` and :math:`s_1`. A plateau asks for more than six bends, so the
fit of a real curve usually falls somewhere: two SOCs then share a voltage, and an estimator that follows the
slope is led the wrong way. The ranges are found from the roots of the derivative. The monotone table of
`bms.ocv` is the default of every cell; `OcvPolynomial.to_curve` makes the nearest one to the polynomial.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import isotonic_regression

from bms.errors import BatteryError, BatteryWarning
from bms.ocv import OcvCurve

Array = NDArray[np.float64]

DEGREE = 6
RANGE = (0.1, 0.9)
FIT_POINTS = 161
"""Where a curve, unlike a table, is sampled for the fit: 0.5 % of SOC apart over [M]'s range."""

NEGLIGIBLE_FALL_V = 1e-9
"""A fall by less than this is rounding at a root of the derivative."""


@dataclass(frozen=True, eq=False)
class OcvPolynomial:
    """A polynomial open-circuit voltage between two SOCs.

    Parameters
    ----------
    polynomial : Polynomial
        Voltage in V over SOC; its domain is the range of the fit.
    rms_V : float
        Root of the mean square of what the fit leaves.
    """

    polynomial: Polynomial
    rms_V: float

    @property
    def low(self) -> float:
        """SOC where the range of the fit begins."""
        return float(self.polynomial.domain[0])

    @property
    def high(self) -> float:
        """SOC where the range of the fit ends."""
        return float(self.polynomial.domain[1])

    def __call__(self, soc: ArrayLike) -> Array:
        """Open-circuit voltage in V at ``soc``, which is clipped to the range of the fit."""
        return np.asarray(self.polynomial(np.clip(soc, self.low, self.high)), dtype=np.float64)

    def slope_V(self, soc: ArrayLike) -> Array:
        """Slope in V per unit of SOC at ``soc`` (clipped to the range of the fit)."""
        return np.asarray(self.polynomial.deriv()(np.clip(soc, self.low, self.high)), dtype=np.float64)

    @cached_property
    def falls(self) -> tuple[tuple[float, float], ...]:
        """SOC ranges over which the voltage falls with SOC; empty when the polynomial is monotone."""
        roots = self.polynomial.deriv().roots()
        real = np.sort(roots[np.abs(roots.imag) < 1e-9].real)
        inside = real[(real > self.low) & (real < self.high)]
        edges = np.concatenate(([self.low], inside, [self.high]))
        return tuple(
            (float(a), float(b))
            for a, b in pairwise(edges)
            if self.polynomial(b) < self.polynomial(a) - NEGLIGIBLE_FALL_V
        )

    def to_curve(self, outside: OcvCurve) -> OcvCurve:
        """Turn the polynomial into a monotone table over [0, 1].

        Parameters
        ----------
        outside : OcvCurve
            Gives the nodes below and above the range of the fit; a polynomial of this order means nothing
            there.

        Returns
        -------
        OcvCurve
            Nodes 1 % apart in the range of the fit. Where the polynomial falls, or where it does not meet
            ``outside``, the nearest non-decreasing values in the sense of least squares.
        """
        count = max(3, round((self.high - self.low) * 100.0) + 1)
        inner = np.linspace(self.low, self.high, count)
        below = outside.soc < self.low - 1e-9
        above = outside.soc > self.high + 1e-9
        soc = np.concatenate((outside.soc[below], inner, outside.soc[above]))
        voltage_V = np.concatenate((outside.voltage_V[below], self(inner), outside.voltage_V[above]))
        monotone = np.asarray(isotonic_regression(voltage_V).x, dtype=np.float64)
        return OcvCurve(soc, monotone, outside.slope_floor)


def fit_polynomial(
    soc: ArrayLike,
    voltage_V: ArrayLike,
    *,
    degree: int = DEGREE,
    soc_range: tuple[float, float] = RANGE,
) -> OcvPolynomial:
    """Fit a polynomial to the points of an open-circuit voltage inside a range of SOC.

    Parameters
    ----------
    soc, voltage_V : array_like, shape (n,)
        Points, in any order; those outside ``soc_range`` are left out.
    degree : int
        [M] takes 6.
    soc_range : tuple of float
        [M] takes 10 to 90 %.

    Returns
    -------
    OcvPolynomial
        With a `BatteryWarning` that names the ranges when the voltage falls with SOC somewhere.

    Raises
    ------
    BatteryError
        When the range is not one inside [0, 1], or holds too few points for the degree.
    """
    low, high = (float(value) for value in soc_range)
    if not 0.0 <= low < high <= 1.0:
        raise BatteryError(f"the range of the fit must increase inside [0, 1], got {low:g} to {high:g}")
    at, voltage = np.asarray(soc, dtype=np.float64), np.asarray(voltage_V, dtype=np.float64)
    if (
        at.ndim != 1
        or at.shape != voltage.shape
        or not (np.isfinite(at).all() and np.isfinite(voltage).all())
    ):
        raise BatteryError(
            f"soc and voltage_V must be two rows of finite numbers of one length, got {at.shape},"
            f" {voltage.shape}"
        )
    inside = (at >= low - 1e-9) & (at <= high + 1e-9)
    distinct = np.unique(at[inside]).size
    if degree < 1 or distinct <= degree:
        raise BatteryError(
            f"a polynomial of degree {degree} needs more than {max(degree, 1)} points between {low:g} and"
            f" {high:g}, got {distinct}; widen the range or lower the degree (1 or more)"
        )
    polynomial = Polynomial.fit(at[inside], voltage[inside], degree, domain=[low, high])
    left = voltage[inside] - polynomial(at[inside])
    fitted = OcvPolynomial(polynomial, float(np.sqrt(np.mean(np.square(left)))))
    if fitted.falls:
        ranges = " and ".join(f"{a:.3f} to {b:.3f}" for a, b in fitted.falls)
        warnings.warn(
            f"the OCV polynomial of degree {degree} falls with SOC from {ranges}: one voltage stands for"
            " several SOCs there; use the monotone table instead, or to_curve()",
            BatteryWarning,
            stacklevel=2,
        )
    return fitted


def fit_polynomial_to_curve(
    curve: OcvCurve, *, degree: int = DEGREE, soc_range: tuple[float, float] = RANGE
) -> OcvPolynomial:
    """Fit a polynomial to a curve at evenly spaced SOCs; see `fit_polynomial`."""
    soc = np.linspace(*soc_range, FIT_POINTS)
    return fit_polynomial(soc, curve(soc), degree=degree, soc_range=soc_range)

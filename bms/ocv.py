r"""Open-circuit voltage over SOC, its slope, and [L]'s measurement-quality function alpha.

The table is joined by a shape-preserving cubic (PCHIP), which keeps a monotone table monotone, so its slope
is non-negative everywhere. [L] eq 4 scales the variance of the voltage-derived SOC with
``alpha(SOC) = (dOCV/dSOC)^-1``, drawn in its Fig 2 without units; here it is scaled to a maximum of one
(ERRATA.md), hence ``mu`` is the measurement variance where the curve is flattest:

.. math:: \alpha(SOC) = \min_x \mathrm{OCV}'(x) / \mathrm{OCV}'(SOC).

A measured plateau can be flat to within its noise; a slope floor (a share of the mean slope) keeps one flat
sample from setting the scale of the whole curve.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from bms.errors import BatteryError
from bms.piecewise import PiecewiseLinear

ALPHA_NODES = 101
"""Nodes of the piecewise-linear table of alpha; 1 % of SOC apart."""


@dataclass(frozen=True, eq=False)
class OcvCurve:
    """Open-circuit voltage as a monotone table over SOC.

    Parameters
    ----------
    soc : ndarray, shape (n,)
        Strictly increasing, from 0 to 1.
    voltage_V : ndarray, shape (n,)
        Open-circuit voltage, non-decreasing.
    slope_floor : float
        The least slope that alpha takes into account, as a share of the mean slope of the table.

    Raises
    ------
    BatteryError
        When the table is not a monotone one over [0, 1], or the floor is not between 0 and 1.
    """

    soc: NDArray[np.float64]
    voltage_V: NDArray[np.float64]
    slope_floor: float = 0.02

    def __post_init__(self) -> None:
        soc = np.array(self.soc, dtype=np.float64)
        voltage_V = np.array(self.voltage_V, dtype=np.float64)
        if soc.ndim != 1 or soc.shape != voltage_V.shape or soc.size < 3:
            raise BatteryError(
                f"an OCV table needs at least 3 pairs (soc, voltage), got {soc.shape}, {voltage_V.shape}"
            )
        if not (np.all(np.isfinite(soc)) and np.all(np.isfinite(voltage_V))):
            raise BatteryError("the OCV table holds NaN or inf; remove or fill these rows")
        if np.any(np.diff(soc) <= 0.0) or abs(soc[0]) > 1e-9 or abs(soc[-1] - 1.0) > 1e-9:
            raise BatteryError(
                f"the OCV table's soc must increase strictly from 0 to 1, got {soc[0]:g} ... {soc[-1]:g};"
                " give fractions, not per cent, and extrapolate the ends"
            )
        falls = np.flatnonzero(np.diff(voltage_V) < 0.0)
        if falls.size:
            at = int(falls[0])
            raise BatteryError(
                f"OCV must not fall with SOC, but drops from {voltage_V[at]:g} V at {soc[at]:g} to"
                f" {voltage_V[at + 1]:g} V at {soc[at + 1]:g}; smooth the measurement first"
            )
        if voltage_V[0] <= 0.0 or voltage_V[-1] <= voltage_V[0]:
            raise BatteryError(f"OCV must be positive and rise, got {voltage_V[0]:g} ... {voltage_V[-1]:g} V")
        if not 0.0 < self.slope_floor < 1.0:
            raise BatteryError(
                f"slope_floor must lie between 0 and 1, got {self.slope_floor:g}; default: 0.02"
            )
        soc.flags.writeable = voltage_V.flags.writeable = False
        object.__setattr__(self, "soc", soc)
        object.__setattr__(self, "voltage_V", voltage_V)

    @cached_property
    def interpolant(self) -> PchipInterpolator:
        """The shape-preserving cubic through the table."""
        return PchipInterpolator(self.soc, self.voltage_V)

    def __call__(self, soc: ArrayLike) -> NDArray[np.float64]:
        """Open-circuit voltage in V at ``soc``, which is clipped to [0, 1]."""
        return np.asarray(self.interpolant(np.clip(soc, 0.0, 1.0)), dtype=np.float64)

    def slope_V(self, soc: ArrayLike) -> NDArray[np.float64]:
        """Slope dOCV/dSOC in V per unit of SOC at ``soc`` (clipped to [0, 1])."""
        return np.asarray(self.interpolant(np.clip(soc, 0.0, 1.0), 1), dtype=np.float64)

    @cached_property
    def alpha(self) -> PiecewiseLinear:
        """Measurement-quality function of [L] eq 4, at most one, as a table of 101 nodes."""
        nodes = np.linspace(0.0, 1.0, ALPHA_NODES)
        least = self.slope_floor * (self.voltage_V[-1] - self.voltage_V[0])
        slope = np.maximum(self.slope_V(nodes), least)
        return PiecewiseLinear.continuous(nodes, slope.min() / slope)

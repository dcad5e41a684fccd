r"""Open-circuit voltage and hysteresis from a slow discharge and a slow charge ([M] section 4.1, Fig 25a).

Each branch runs between full and empty, so its own charge is its capacity, and coulomb counting gives the SOC
of every sample. With the two hysteresis states :math:`h_c` and :math:`h_d` the branches read

.. math::

    V_c = V_{oc} + M h_c + R I_c, \qquad V_d = V_{oc} + M h_d + R I_d .

Fully developed, :math:`h_c = 1 = -h_d`: the open-circuit voltage is the mean of the branches and M half
their difference, both less :math:`R I`. After the turn at either end the state is still on its way: where the
branches follow each other, a change of SOC of x since the turn leaves :math:`h = \pm(1 - 2 e^{-\kappa x})`.
Given the rate :math:`\kappa` the two equations are solved with these states; where they hardly differ, M
keeps the value of the nearest node where they do.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import isotonic_regression

from bms.cell import Cell
from bms.cell_tables import with_ocv
from bms.errors import BatteryError, BatteryWarning
from bms.ocv import OcvCurve

Array = NDArray[np.float64]

COLUMNS = ("time_s", "current_A", "voltage_V")

LEAST_SAMPLES = 20

NODES = np.concatenate((np.arange(8) / 200, np.arange(4, 97) / 100, np.arange(193, 201) / 200))
"""SOC nodes of the result: 1 % apart, 0.5 % near the ends."""

IDLE_SHARE = 0.05
"""Samples below this share of the branch's largest current are rests and are left out of the curve."""

SLOW_C_RATE = 0.12
"""Faster branches carry overvoltages that no single resistance takes out."""

CHARGE_MISMATCH = 0.02
"""More than this between the charges of the branches: they did not run between the same ends."""

SEPARATED = 0.5
"""M is taken where the two hysteresis states differ by at least this."""

LINE_SAMPLES = 8
"""With fewer samples around a node the curve is interpolated instead of fitted by a line."""


@dataclass(frozen=True, eq=False)
class SlowBranch:
    """A slow discharge from full to empty, or a slow charge from empty to full.

    Parameters
    ----------
    time_s, current_A, voltage_V : array_like, shape (n,)
        Samples; the current, > 0 when charging, is held from each to the next.

    Raises
    ------
    BatteryError
        When the columns do not fit together, hold NaN, or the time does not increase.
    """

    time_s: Array
    current_A: Array
    voltage_V: Array

    def __post_init__(self) -> None:
        for name in COLUMNS:
            column = np.array(getattr(self, name), dtype=np.float64)
            if column.ndim != 1 or column.size < LEAST_SAMPLES or column.size != len(self.time_s):
                raise BatteryError(
                    f"a slow branch has time_s, current_A and voltage_V of one length, {LEAST_SAMPLES}"
                    f" samples or more; {name} has the shape {column.shape}"
                )
            if not np.isfinite(column).all():
                raise BatteryError(f"{name} of a slow branch holds NaN or inf; remove or fill these samples")
            column.flags.writeable = False
            object.__setattr__(self, name, column)
        if np.any(np.diff(self.time_s) <= 0.0):
            raise BatteryError("time_s of a slow branch must increase strictly; sort it, drop repetitions")

    @property
    def charge_Ah(self) -> float:
        """Charge that the branch moves in, in Ah; negative for a discharge."""
        return float(np.sum(self.current_A[:-1] * np.diff(self.time_s)) / 3600.0)

    def soc_from(self, start: float) -> Array:
        """SOC of each sample, shape (n,); the branch begins at ``start``, 0 or 1, and ends at the other."""
        moved_As = np.concatenate(([0.0], np.cumsum(self.current_A[:-1] * np.diff(self.time_s))))
        return np.asarray(start + moved_As / abs(moved_As[-1]))

    def _at(self, nodes: Array, start: float, resistance_ohm: float) -> Array:
        """Voltage less ``R I`` at SOC nodes, each from a line through the samples nearest to it."""
        moving = np.abs(self.current_A) > IDLE_SHARE * np.abs(self.current_A).max()
        soc = self.soc_from(start)[moving]
        order = np.argsort(soc, kind="stable")
        soc = soc[order]
        voltage_V = (self.voltage_V - resistance_ohm * self.current_A)[moving][order]
        reach = 0.5 * np.minimum(np.diff(nodes, prepend=-1.0), np.diff(nodes, append=2.0))
        found = np.interp(nodes, soc, voltage_V)
        first = np.searchsorted(soc, nodes - reach, side="left")
        last = np.searchsorted(soc, nodes + reach, side="right")
        for k in np.flatnonzero(last - first >= LINE_SAMPLES):
            near = slice(first[k], last[k])
            found[k] = np.polynomial.polynomial.polyfit(soc[near] - nodes[k], voltage_V[near], 1)[0]
        return np.asarray(found, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class OcvFit:
    """What `fit_ocv` found.

    Parameters
    ----------
    soc, ocv_V, hysteresis_V : ndarray, shape (n,)
        SOC nodes, open-circuit voltage (non-decreasing), half the distance of the branches.
    capacity_Ah, charge_Ah : float
        Charge of the discharge, which is the capacity, and of the charge.
    smoothing_V : float
        The most by which the open-circuit voltage was moved to make it monotone.
    """

    soc: Array
    ocv_V: Array
    hysteresis_V: Array
    capacity_Ah: float
    charge_Ah: float
    smoothing_V: float

    @property
    def curve(self) -> OcvCurve:
        """The open-circuit voltage as a monotone curve."""
        return OcvCurve(self.soc, self.ocv_V)

    def apply_to(self, cell: Cell, *, hysteresis_rate: float | None = None) -> Cell:
        """Give a cell this open-circuit voltage and capacity, and the hysteresis where its rate is known.

        Parameters
        ----------
        cell : Cell
            Gives everything else; its tables are looked up at the new nodes.
        hysteresis_rate : float, optional
            Rate of the hysteresis; by default that of the cell, and without either no hysteresis.
        """
        rate = hysteresis_rate if hysteresis_rate is not None else getattr(cell.hysteresis, "rate", None)
        hysteresis = (
            None if rate is None else {"voltage_V": tuple(self.hysteresis_V.tolist()), "rate": float(rate)}
        )
        return with_ocv(cell, self.curve, capacity_Ah=self.capacity_Ah, hysteresis=hysteresis)


def fit_ocv(
    discharge: SlowBranch,
    charge: SlowBranch,
    *,
    resistance_ohm: float = 0.0,
    hysteresis_rate: float | None = None,
    nodes: ArrayLike = NODES,
) -> OcvFit:
    """Find the open-circuit voltage between a slow discharge and a slow charge.

    Parameters
    ----------
    discharge, charge : SlowBranch
        From full to empty, and from empty to full.
    resistance_ohm : float
        Resistance at constant current, relaxation included; its ``R I`` is not counted as hysteresis.
    hysteresis_rate : float, optional
        Rate of the hysteresis state, if known: takes the turns at both ends into account. Without it the ends
        are off by up to the hysteresis voltage.
    nodes : array_like, shape (n,)
        SOC nodes from 0 to 1.

    Returns
    -------
    OcvFit
        With a `BatteryWarning` when the branches are fast, or their charges differ by more than 2 %.

    Raises
    ------
    BatteryError
        When a branch runs the wrong way, or a number is out of range.
    """
    if not resistance_ohm >= 0.0 or not (hysteresis_rate is None or hysteresis_rate > 0.0):
        raise BatteryError(
            f"resistance_ohm must be zero or more and hysteresis_rate positive, got {resistance_ohm},"
            f" {hysteresis_rate}"
        )
    _check(discharge, charge)
    at = np.array(nodes, dtype=np.float64)
    if at.ndim != 1 or at.size < 3 or np.any(np.diff(at) <= 0.0) or at[0] != 0.0 or at[-1] != 1.0:
        raise BatteryError("nodes must increase strictly from 0 to 1, three or more of them")
    low_V, high_V = discharge._at(at, 1.0, resistance_ohm), charge._at(at, 0.0, resistance_ohm)
    turned = 2.0 * np.exp(-(hysteresis_rate or np.inf) * np.stack((at, 1.0 - at)).clip(1e-12))
    up, down = 1.0 - turned[0], turned[1] - 1.0
    apart = up - down >= SEPARATED
    if not apart.any():
        raise BatteryError(
            f"with hysteresis_rate = {hysteresis_rate:g} the branches never part; flipping takes a change of"
            " SOC of about 1 / rate, so give a larger rate"
        )
    hysteresis_V = np.interp(at, at[apart], ((high_V - low_V)[apart] / (up - down)[apart]).clip(0.0))
    middle_V = 0.5 * (low_V + high_V - hysteresis_V * (up + down))
    ocv_V = np.asarray(isotonic_regression(middle_V).x, dtype=np.float64)
    for array in (at, ocv_V, hysteresis_V):
        array.flags.writeable = False
    return OcvFit(
        at, ocv_V, hysteresis_V, -discharge.charge_Ah, charge.charge_Ah, float(np.abs(ocv_V - middle_V).max())
    )


def _check(discharge: SlowBranch, charge: SlowBranch) -> None:
    """Refuse branches that run the wrong way; warn of fast ones and of charges that differ."""
    for name, branch, sign in (("discharge", discharge, -1.0), ("charge", charge, 1.0)):
        if sign * branch.charge_Ah <= 0.0:
            raise BatteryError(
                f"the {name} moves {branch.charge_Ah:+.4g} Ah; a current > 0 charges: turn the sign, or swap"
                " the branches"
            )
    capacity_Ah = -discharge.charge_Ah
    mismatch = charge.charge_Ah / capacity_Ah - 1.0
    if abs(mismatch) > CHARGE_MISMATCH:
        warnings.warn(
            f"the charge took {charge.charge_Ah:.4g} Ah and the discharge gave {capacity_Ah:.4g} Ah:"
            f" {100.0 * mismatch:+.1f} %; did both run between the same ends?",
            BatteryWarning,
            stacklevel=3,
        )
    fastest = max(float(np.median(np.abs(branch.current_A))) for branch in (discharge, charge)) / capacity_Ah
    if fastest > SLOW_C_RATE:
        warnings.warn(
            f"a branch ran at {fastest:.2g} C; above {SLOW_C_RATE:g} C the overvoltage is not R I alone and"
            " passes for hysteresis",
            BatteryWarning,
            stacklevel=3,
        )

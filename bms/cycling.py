"""A long current profile out of a short one ([M] section 4.2, Fig 28).

The current of a drive is applied back to back until the SOC has fallen to the lower limit; a constant current
then charges to the upper one, and the drive begins anew. The SOC counts charge with the capacity that is
given. A cell that fades is cycled in parts: every part goes on where the one before ended, with the capacity
that is left by then.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bms.errors import BatteryError

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class CyclingState:
    """Where a cycled cell stands between two samples.

    Parameters
    ----------
    soc : float
        State of charge.
    charging : bool
        Whether it is being charged.
    at : int
        Sample of the drive that comes next when it is not.
    """

    soc: float = 0.7
    charging: bool = False
    at: int = 0


@dataclass(frozen=True, eq=False, slots=True)
class CyclingProfile:
    """Charge and discharge cycles.

    Parameters
    ----------
    current_A : ndarray, shape (n,)
        Current held over each sample, > 0 charges.
    soc : ndarray, shape (n,)
        SOC at the start of each sample.
    step_s : float
        Length of a sample.
    final : CyclingState
        State at the end, to go on from.
    """

    current_A: Array
    soc: Array
    step_s: float
    final: CyclingState

    @property
    def time_s(self) -> Array:
        """Time at the start of each sample, from 0."""
        return np.arange(self.current_A.size, dtype=np.float64) * self.step_s


def cycling_profile(
    capacity_Ah: float,
    drive_current_A: ArrayLike,
    duration_s: float,
    *,
    low: float = 0.2,
    high: float = 0.8,
    charge_current_A: float = 2.0,
    step_s: float = 1.0,
    state: CyclingState | None = None,
) -> CyclingProfile:
    """Cycle a cell between two limits of its SOC: discharged by a drive, charged by a constant current.

    Parameters
    ----------
    capacity_Ah : float
        Capacity of the cell.
    drive_current_A : array_like, shape (m,)
        Current of one drive, > 0 charges; on the whole it discharges.
    duration_s : float
        Length of the profile, rounded to whole samples.
    low, high : float
        Limits of the SOC. They are compared at the start of a sample, so the SOC passes them by up to one.
    charge_current_A : float
        Current of the charge.
    step_s : float
        Length of a sample.
    state : CyclingState, optional
        Where to begin; by default driving at 70 % SOC, as in [M].

    Raises
    ------
    BatteryError
        A number out of range, a drive that does not discharge, or one that would leave [0, 1].
    """
    drive = np.ascontiguousarray(drive_current_A, dtype=np.float64)
    begin = state or CyclingState()
    for name, value in (
        ("capacity_Ah", capacity_Ah),
        ("charge_current_A", charge_current_A),
        ("step_s", step_s),
    ):
        if not (value > 0.0 and np.isfinite(value)):
            raise BatteryError(f"{name} must be positive, got {value:g}")
    samples = round(duration_s / step_s) if np.isfinite(duration_s) else 0
    if samples < 1:
        raise BatteryError(f"duration_s is {duration_s:g}; give at least one sample of {step_s:g} s")
    soc_per_A = step_s / (3600.0 * capacity_Ah)
    _check_drive(drive, soc_per_A, charge_current_A, low, high, begin)
    from bms._cycling import cycle

    values = np.array([begin.soc, float(begin.charging), float(begin.at)])
    current_A, soc = np.empty(samples), np.empty(samples)
    cycle(drive, float(charge_current_A), soc_per_A, float(low), float(high), values, current_A, soc)
    final = CyclingState(float(values[0]), bool(values[1]), int(values[2]))
    return CyclingProfile(current_A, soc, float(step_s), final)


def _check_drive(
    drive_A: Array, soc_per_A: float, charge_A: float, low: float, high: float, begin: CyclingState
) -> None:
    if drive_A.ndim != 1 or drive_A.size == 0 or not np.all(np.isfinite(drive_A)):
        raise BatteryError(
            f"drive_current_A must be one row of finite numbers, got the shape {drive_A.shape}"
        )
    if not 0.0 <= begin.soc <= 1.0 or not 0 <= begin.at < drive_A.size:
        raise BatteryError(f"{begin} is no state of a drive of {drive_A.size} samples")
    if not 0.0 < low < high < 1.0:
        raise BatteryError(
            f"the limits of the SOC must increase inside (0, 1), got {low:g} to {high:g}; give fractions"
        )
    moved = np.concatenate(([0.0], np.cumsum(drive_A))) * soc_per_A
    if not moved[-1] < 0.0:
        raise BatteryError(
            f"the drive moves the SOC by {moved[-1]:+.3g}, so it never falls to {low:g};"
            " a drive that discharges has a negative sum, as a current > 0 charges"
        )
    # The largest rise inside a drive begins at its lowest point so far.
    rise = float(np.max(moved - np.minimum.accumulate(moved)))
    top = max(high + charge_A * soc_per_A, begin.soc) + rise
    bottom = low + float(drive_A.min()) * soc_per_A
    if top > 1.0 or bottom < 0.0:
        raise BatteryError(
            f"the drive would take the SOC from {bottom:.3f} to {top:.3f}, outside [0, 1];"
            " narrow the limits, or check the unit of the current and capacity_Ah"
        )

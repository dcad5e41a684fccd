"""[M] section 4.4: a hundred days of cycling a cell that fades by the degradation map, and its estimates.

Part by part: the cell is cycled between 20 and 80 % with the capacity that is left, the map ages it by what
it went through, and the estimator takes the noisy samples. The fade's clock runs faster than the profile's by
a declared factor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bms.ageing import age
from bms.cycling import CyclingState, cycling_profile
from bms.degradation import DegradationMap
from bms.estimators.base import KernelEstimator
from bms.fade_laws import Wear
from bms.simulation import CellState, simulate
from socwise.reproduce.battery_case import (
    DAY_S,
    SOC_MODEL,
    TABLE_7,
    add_noise,
    battery_cell,
    generator,
    new_estimator,
)
from socwise.reproduce.phev_current import phev_trip
from socwise.reproduce.registry import Progress

Array = NDArray[np.float64]

PART_S = 21_600
EVERY = 1800


@dataclass(frozen=True, eq=False)
class Lifetime:
    """Truth and estimates over the life of a cell, every half hour.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Time.
    capacity_Ah, soc : ndarray, shape (n,)
        True capacity and SOC.
    soc_estimate : ndarray, shape (n,)
        Estimated SOC.
    estimates : dict of str to ndarray, shape (n,)
        Estimated parameters by name.
    acceleration : float
        How much faster than the profile the cell aged.
    off_s : float
        When the estimator was switched on.
    """

    time_s: Array
    capacity_Ah: Array
    soc: Array
    soc_estimate: Array
    estimates: dict[str, Array]
    acceleration: float
    off_s: float

    def capacity_error_percent(self, from_s: float) -> Array:
        """Estimated over true capacity less one from a time on, in per cent."""
        late = self.time_s >= from_s
        return np.asarray(100.0 * (self.estimates["capacity_Ah"][late] / self.capacity_Ah[late] - 1.0))

    def resistance_error_percent(self, from_s: float) -> Array:
        """Estimated over true resistance less one from a time on, in per cent."""
        found = self.estimates["resistance_ohm"][self.time_s >= from_s]
        return np.asarray(100.0 * (found / TABLE_7[1].model - 1.0))


def live(
    days: float,
    off_days: float,
    fades: DegradationMap,
    *,
    terms: int = 3,
    acceleration: float = 1.0,
    temperature_C: float = 25.0,
    progress: Progress | None = None,
) -> Lifetime:
    """Cycle, age and estimate the cell of Table 7.

    Parameters
    ----------
    days, off_days : float
        Length, and how long the estimator only counts charge.
    fades : DegradationMap
        Fade over current and SOC.
    terms : int
        Terms N of the expansion.
    acceleration : float
        How much faster than the profile the cell ages.
    temperature_C : float
        Where the map is read.
    progress : callable, optional
        Told what is done.
    """
    new, random = battery_cell(), generator(0)
    drive_A = phev_trip(new.capacity_Ah).current_A
    estimator = new_estimator(new, terms, off_days)
    cycling, state, wear = CyclingState(SOC_MODEL), CellState(SOC_MODEL), Wear()
    parts = round(days * DAY_S / PART_S)
    rows: list[Array] = []
    for part in range(parts):
        cell = new.with_values(capacity_Ah=new.capacity_Ah * wear.capacity_factor)
        profile = cycling_profile(cell.capacity_Ah, drive_A, PART_S, state=cycling)
        run = simulate(cell, profile.current_A, 1.0, state=state)
        found = _estimates(estimator, *add_noise(profile.current_A, run.voltage_V, random))
        truth = (part * PART_S + run.time_s[::EVERY], np.full(found.shape[1], cell.capacity_Ah))
        rows.append(np.vstack([*truth, run.soc[::EVERY], found]))
        cycling, state = profile.final, run.final
        soc = np.clip(profile.soc, 0.0, 1.0)
        wear = age(
            fades, profile.current_A, soc, temperature_C, 1.0, acceleration=acceleration, wear=wear
        ).final
        if progress is not None:
            progress(part + 1, parts)
    names = tuple(estimator.parameters)
    time_s, capacity_Ah, true_soc, soc_estimate, *values = np.hstack(rows)
    estimates = dict(zip(names, values, strict=True))
    return Lifetime(time_s, capacity_Ah, true_soc, soc_estimate, estimates, acceleration, off_days * DAY_S)


def _estimates(estimator: KernelEstimator, current_A: Array, voltage_V: Array) -> Array:
    """SOC and parameters while the estimator takes the samples, shape (1 + p, rows)."""
    trace = estimator.run(current_A, voltage_V, 1.0, every=EVERY)
    return np.vstack([trace.soc, *trace.parameters.values()])

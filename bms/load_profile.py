r"""A load over time, current or power, to drive a battery with: from a log, or made elsewhere.

A sample's load holds until the next one. On steps of another length it is averaged, so that the charge, or
the energy, stays what it was:

.. math:: \bar u_k = \frac{1}{h} \int_{t_k}^{t_k + h} u(t)\, dt .
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bms.errors import BatteryError
from bms.load_columns import find_load
from bms.log_checks import kept_times
from bms.log_columns import Column
from bms.log_text import Layout, blocks, line_of, parse

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LoadProfile:
    """A load over time; exactly one of current and power is there.

    Parameters
    ----------
    step_s : float
        Length of the steps.
    current_A, power_W : ndarray of shape (n,) or None
        Load of each step, > 0 charges.
    source : str
        Where it comes from.
    notes : tuple of str
        What was done to it.
    """

    step_s: float
    current_A: Array | None = None
    power_W: Array | None = None
    source: str = "profile"
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if (self.current_A is None) == (self.power_W is None):
            raise BatteryError("a load is either a current or a power; give one of the two")
        if not (
            self.step_s > 0.0 and self.load.ndim == 1 and self.load.size and np.all(np.isfinite(self.load))
        ):
            raise BatteryError("a load needs a step above zero and one number for every step")

    @property
    def load(self) -> Array:
        """The current or the power."""
        load = self.power_W if self.current_A is None else self.current_A
        return np.empty(0) if load is None else load

    @property
    def is_power(self) -> bool:
        """Whether the load is a power."""
        return self.current_A is None

    def __len__(self) -> int:
        return self.load.size


def read_profile(
    path: str | Path,
    *,
    step_s: float | None = None,
    unit_s: float = 1.0,
    columns: Mapping[str, str | None] | None = None,
    discharge_positive: bool = False,
) -> LoadProfile:
    """Read a load from a CSV file with a column of time and one of current or power; others are ignored.

    Parameters
    ----------
    path : str or Path
        As for `bms.logged_data.read_log`; the headers carry the units.
    step_s : float, optional
        Length of the steps; left out: the median step of the file, in whole units.
    unit_s : float
        Steps are whole multiples of this.
    columns : mapping of str to str, optional
        Names of the columns of ``time``, ``current`` and ``power``, ``NAME`` or ``NAME:UNIT``. A power that
        is named goes before a current that is found.
    discharge_positive : bool
        Whether a positive load in the file discharges.

    Raises
    ------
    BatteryError
        When the file cannot be read, a column or unit is missing, or time does not increase.
    """
    path = Path(path)
    layout, time, load = find_load(path, dict(columns or {}))
    time_s, values, notes = _table(layout, time, load)
    if discharge_positive:
        values = -values
        notes.append("the sign of the load was turned: in the file a positive one discharges")
    step_s = step_s or unit_s * max(round(float(np.median(np.diff(time_s))) / unit_s), 1)
    held = resample(time_s, values, step_s)
    named = {"power_W": held} if load.quantity == "power" else {"current_A": held}
    return LoadProfile(step_s=step_s, source=str(path), notes=tuple(notes), **named)


def resample(time_s: Array, load: Array, step_s: float) -> Array:
    """Average a load that holds from sample to sample over equal steps; the last sample only ends it.

    Parameters
    ----------
    time_s, load : ndarray, shape (n,)
        Samples.
    step_s : float
        Length of the steps.

    Raises
    ------
    BatteryError
        When a step is longer than the whole.
    """
    count = math.floor((time_s[-1] - time_s[0]) / step_s * (1.0 + 1e-12))
    if count < 1:
        raise BatteryError(f"a step of {step_s:g} s is longer than the load, {time_s[-1] - time_s[0]:g} s")
    integral = np.concatenate(([0.0], np.cumsum(load[:-1] * np.diff(time_s))))
    ends = time_s[0] + step_s * np.arange(count + 1)
    held: Array = np.diff(np.interp(ends, time_s, integral)) / step_s
    return held


def _table(layout: Layout, time: Column, load: Column) -> tuple[Array, Array, list[str]]:
    notes: list[str] = []
    parts = []
    for line, block, _ in blocks(layout):
        values, unfinished = parse(layout, line, block, [time, load])
        parts.append(values)
        if unfinished:
            notes.append("the last line is not complete and was left out")
    table = np.concatenate([*parts, np.empty((0, 2))])
    time_s = time.factor * table[:, 0] + time.offset
    values = load.factor * table[:, 1] + load.offset
    keep = kept_times(time_s, str(layout.path), lambda sample: line_of(layout, sample))
    if keep is not None:
        time_s, values = time_s[keep], values[keep]
        notes.append("of samples with the same time the last one was kept")
    lost = ~np.isfinite(values)
    if np.all(lost):
        raise BatteryError(f"{layout.path}: the {load.quantity} is missing in every row")
    if np.any(lost):
        # A hole keeps the load before it; at the start there is none.
        last = np.maximum.accumulate(np.where(lost, -1, np.arange(values.size)))
        values = np.where(last >= 0, values[np.maximum(last, 0)], 0.0)
        notes.append(f"the {load.quantity} is missing in {int(lost.sum())} samples; the one before was held")
    return time_s, values, notes

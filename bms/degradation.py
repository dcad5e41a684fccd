"""The degradation map: how fast capacity fades and resistance grows over current, SOC and temperature.

[M] Fig 32 draws such a map for an LFP cell and gives no numbers; here it is a table on a grid, from the
user's CSV or from the laws of `bms.fade_laws`. Rates are per second and relative to the initial capacity and
resistance: at a rate of 1e-9 a cell loses 3.2 % a year. They do not depend on how far the cell has aged, so a
map from a power law is linearised at a given `Wear`. Between nodes the map is trilinear; beyond them it is
clamped, with a warning.

The CSV has one row per node of the grid, in any order, with the columns ``current_A, soc, temperature_C,
capacity_fade_per_s`` and, unless it is zero, ``resistance_growth_per_s``.
"""

from __future__ import annotations

import csv
import io
import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bms.errors import BatteryError
from bms.fade_laws import FadeLaws, Wear, warn_outside
from bms.table_csv import read_columns

Array = NDArray[np.float64]

AXES = ("current_A", "soc", "temperature_C")
RATES = ("capacity_fade_per_s", "resistance_growth_per_s")


@dataclass(frozen=True, eq=False)
class DegradationMap:
    """Rates of ageing on a grid of current, SOC and temperature.

    Parameters
    ----------
    current_A : ndarray, shape (i,)
        Increasing, positive when charging. When no node is negative the map is looked up by the size of the
        current.
    soc, temperature_C : ndarray, shape (s,) and (t,)
        Increasing; SOC in fractions. An axis of one node is constant.
    capacity_fade_per_s, resistance_growth_per_s : ndarray, shape (i, s, t)
        Relative rates in 1/s, not negative.
    source : str
        Where the figures come from; drawn on the plot.

    Raises
    ------
    BatteryError
        When an axis does not increase, a shape does not fit, a rate is negative or not finite.
    """

    current_A: Array
    soc: Array
    temperature_C: Array
    capacity_fade_per_s: Array
    resistance_growth_per_s: Array
    source: str = ""

    def __post_init__(self) -> None:
        for name in (*AXES, *RATES):
            array = np.array(getattr(self, name), dtype=np.float64)
            if not np.all(np.isfinite(array)):
                raise BatteryError(f"{name} of the degradation map holds NaN or inf; fill these rows")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        for name in AXES:
            axis = getattr(self, name)
            if axis.ndim != 1 or axis.size == 0 or np.any(np.diff(axis) <= 0.0):
                raise BatteryError(f"{name} of a degradation map must increase strictly, got {axis}")
        if self.soc[0] < 0.0 or self.soc[-1] > 1.0:
            raise BatteryError(
                f"soc of the degradation map runs from {self.soc[0]:g} to {self.soc[-1]:g};"
                " give fractions between 0 and 1, not per cent"
            )
        for name in RATES:
            table = getattr(self, name)
            if table.shape != self.shape:
                raise BatteryError(f"{name} has the shape {table.shape}, its axes ask for {self.shape}")
            if np.any(table < 0.0):
                at = tuple(int(k) for k in np.argwhere(table < 0.0)[0])
                raise BatteryError(
                    f"{name} is {table[at]:g} at {self._node(at)}; ageing is not undone: give zero or more"
                )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Nodes along current, SOC and temperature."""
        return self.current_A.size, self.soc.size, self.temperature_C.size

    def _node(self, at: tuple[int, ...]) -> str:
        values = (getattr(self, name)[k] for name, k in zip(AXES, at, strict=True))
        return ", ".join(f"{name} = {value:g}" for name, value in zip(AXES, values, strict=True))

    def lookup_current_A(self, current_A: ArrayLike) -> Array:
        """Give the current at which the map is read: its size when the map has no negative node."""
        current = np.asarray(current_A, dtype=np.float64)
        return np.abs(current) if self.current_A[0] >= 0.0 else current

    def rates_per_s(
        self, current_A: ArrayLike, soc: ArrayLike, temperature_C: ArrayLike
    ) -> tuple[Array, Array]:
        """Capacity fade and resistance growth per second, relative, at points that broadcast.

        Points outside the grid take the nearest node, with a `BatteryWarning`.
        """
        points = (self.lookup_current_A(current_A), soc, temperature_C)
        for name, values in zip(AXES, points, strict=True):
            axis = getattr(self, name)
            limits = (float(axis[0]), float(axis[-1]))
            warn_outside(values, limits, name, "the degradation map", "its end is taken")
        near = [_locate(getattr(self, name), v) for name, v in zip(AXES, points, strict=True)]
        fade, growth = np.zeros(()), np.zeros(())
        for corner in itertools.product((0, 1), repeat=3):
            at = tuple(side[upper] for side, upper in zip(near, corner, strict=True))
            weight: Array = np.ones(())
            for side, upper in zip(near, corner, strict=True):
                weight = weight * (side[2] if upper else 1.0 - side[2])
            fade = fade + weight * self.capacity_fade_per_s[at]
            growth = growth + weight * self.resistance_growth_per_s[at]
        return fade, growth

    @classmethod
    def from_laws(
        cls,
        laws: FadeLaws,
        *,
        current_A: ArrayLike,
        soc: ArrayLike,
        temperature_C: ArrayLike,
        capacity_Ah: float,
        wear: Wear,
    ) -> Self:
        """Tabulate laws on a grid, linearised at a state of wear.

        Parameters
        ----------
        laws : FadeLaws
            The laws.
        current_A, soc, temperature_C : array_like
            Nodes, one-dimensional.
        capacity_Ah : float
            Initial capacity of the cell; gives the C-rates.
        wear : Wear
            Where to linearise; the parts whose law is on must not be zero.
        """
        current, charge, heat = (
            np.atleast_1d(np.asarray(axis, dtype=np.float64)) for axis in (current_A, soc, temperature_C)
        )
        if not capacity_Ah > 0.0:
            raise BatteryError(f"capacity_Ah must be positive, got {capacity_Ah:g}")
        grid = np.meshgrid(current, charge, heat, indexing="ij")
        fade, growth = laws.rates_per_s(*grid, capacity_Ah=capacity_Ah, wear=wear)
        source = f"laws at {100.0 * wear.cycle:g} % cycle and {100.0 * wear.calendar:g} % calendar fade"
        return cls(current, charge, heat, fade, growth, source)

    def to_csv(self, path: str | Path) -> None:
        """Write the map as the CSV that `load_degradation_map` reads back to the bit."""
        text = io.StringIO()
        if self.source:
            text.write(f"# {' '.join(self.source.split())}\n")
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow((*AXES, *RATES))
        grid = np.meshgrid(self.current_A, self.soc, self.temperature_C, indexing="ij")
        columns = (*grid, self.capacity_fade_per_s, self.resistance_growth_per_s)
        writer.writerows(zip(*(map(repr, column.ravel().tolist()) for column in columns), strict=True))
        Path(path).write_text(text.getvalue(), encoding="utf-8")


def load_degradation_map(path: str | Path) -> DegradationMap:
    """Load a degradation map from a CSV in long format (see the module's docstring).

    Raises
    ------
    BatteryError
        File not readable, column missing or unknown, a cell that is no number, a node of the grid missing or
        given twice, a negative rate.
    """
    path = Path(path)
    columns = read_columns(path, required=(*AXES, RATES[0]), optional=RATES[1:])
    rows = np.array([columns[name] for name in AXES])
    if not np.all(np.isfinite(rows)):
        raise BatteryError(f"{path}: {', '.join(AXES)} must be finite numbers in every row")
    axes, places = zip(*(np.unique(row, return_inverse=True) for row in rows), strict=True)
    _require_every_node(path, axes, Counter(zip(*(place.tolist() for place in places), strict=True)))
    current, soc, temperature = axes
    fade = np.zeros((current.size, soc.size, temperature.size))
    growth = np.zeros_like(fade)
    fade[places] = columns[RATES[0]]
    growth[places] = columns.get(RATES[1], 0.0)
    try:
        return DegradationMap(current, soc, temperature, fade, growth, source=path.name)
    except BatteryError as error:
        raise BatteryError(f"{path}: {error}") from error


def _require_every_node(path: Path, axes: Sequence[Array], counts: Counter[tuple[int, ...]]) -> None:
    """Raise for the first node of the grid that is not given once; scattered points fail at once."""
    for at in itertools.product(*(range(axis.size) for axis in axes)):
        if counts[at] != 1:
            node = ", ".join(f"{name} = {axis[k]:g}" for name, axis, k in zip(AXES, axes, at, strict=True))
            asked = " x ".join(str(axis.size) for axis in axes)
            raise BatteryError(
                f"{path}: {'no row' if counts[at] == 0 else f'{counts[at]} rows'} for {node}; a degradation"
                f" map needs one row for every combination of its currents, SOCs and temperatures ({asked})"
            )


def _locate(axis: Array, value: ArrayLike) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Lower node, upper node and weight of the upper one, for values clamped to the axis."""
    inside = np.clip(np.asarray(value, dtype=np.float64), axis[0], axis[-1])
    low = np.clip(np.searchsorted(axis, inside, side="right") - 1, 0, max(axis.size - 2, 0))
    high = np.minimum(low + 1, axis.size - 1)
    width = np.where(high > low, axis[high] - axis[low], 1.0)
    return low, high, np.asarray((inside - axis[low]) / width)

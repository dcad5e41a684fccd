"""The road, what stands in the way, and what wants to drive on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivecycles.traffic.errors import TrafficError

Array = NDArray[np.float64]

MOST_CELLS = 100_000


@dataclass(frozen=True)
class Bottleneck:
    """A place that lets no more than a flow through, for a time: an incident, a lane drop, a signal.

    Parameters
    ----------
    position_m : float
        Where on the road; it acts at the nearest face between cells, 0 being the entrance.
    capacity_per_s : float
        Flow that it lets through, in vehicles per second; 0 closes the road.
    start_s, end_s : float
        When it is there; for ever by default.

    Raises
    ------
    TrafficError
        When the position or the flow is negative, or it ends before it starts.
    """

    position_m: float
    capacity_per_s: float
    start_s: float = 0.0
    end_s: float = math.inf

    def __post_init__(self) -> None:
        if not 0.0 <= self.position_m < math.inf:
            raise TrafficError(f"a bottleneck's position must be 0 m or more, got {self.position_m!r}")
        if not 0.0 <= self.capacity_per_s < math.inf:
            raise TrafficError(
                f"a bottleneck's capacity must be 0 veh/s or more and finite, got {self.capacity_per_s!r}"
            )
        if not self.start_s < self.end_s:
            raise TrafficError(
                f"a bottleneck must start before it ends, got {self.start_s:g} to {self.end_s:g} s"
            )


@dataclass(frozen=True)
class Road:
    """A homogeneous stretch of road in cells of equal length.

    Parameters
    ----------
    length_m : float
        Length.
    cells : int
        Number of cells, 2 or more.
    bottlenecks : tuple of Bottleneck
        What stands in the way.

    Raises
    ------
    TrafficError
        When the length or the number is out of range, or a bottleneck is not on the road.
    """

    length_m: float
    cells: int
    bottlenecks: tuple[Bottleneck, ...] = ()

    def __post_init__(self) -> None:
        if not 0.0 < self.length_m < math.inf:
            raise TrafficError(f"a road's length must be positive and finite, got {self.length_m!r} m")
        if not 2 <= self.cells <= MOST_CELLS:
            raise TrafficError(f"a road has 2 to {MOST_CELLS} cells, got {self.cells!r}")
        for each in self.bottlenecks:
            self.require_inside(each.position_m, "a bottleneck")

    @property
    def cell_m(self) -> float:
        """Length of a cell."""
        return self.length_m / self.cells

    @property
    def position_m(self) -> Array:
        """Middles of the cells, shape (cells,)."""
        return (np.arange(self.cells, dtype=np.float64) + 0.5) * self.cell_m

    def require_inside(self, position_m: float, what: str = "a position") -> float:
        """Give a position back if it is on the road.

        Raises
        ------
        TrafficError
            When it is not; ``what`` says what is there.
        """
        if not -1e-9 * self.length_m <= position_m <= self.length_m * (1.0 + 1e-9):
            raise TrafficError(
                f"{what} at {position_m:g} m is outside the road, which goes from 0 to {self.length_m:g} m"
            )
        return float(position_m)

    def cell_at(self, position_m: float) -> int:
        """Find the cell, from 0, that holds a position; the road's end belongs to the last.

        Raises
        ------
        TrafficError
            When the position is outside the road.
        """
        share = self.require_inside(position_m) / self.cell_m
        # A face, 16 cells up, say, must not fall into the cell before it by rounding.
        return min(max(math.floor(share + 1e-9), 0), self.cells - 1)

    def face_at(self, position_m: float) -> int:
        """Find the nearest face between cells; 0 is the entrance, ``cells`` the exit.

        Raises
        ------
        TrafficError
            When the position is outside the road.
        """
        return round(self.require_inside(position_m) / self.cell_m)


@dataclass(frozen=True, eq=False)
class Demand:
    """Flow that wants to enter, constant from each time to the next.

    Parameters
    ----------
    time_s : array_like, shape (n,)
        Times from which a flow holds, increasing; the first holds before it too, the last for ever.
    flow_per_s : array_like, shape (n,)
        Flows, in vehicles per second, 0 or more.

    Raises
    ------
    TrafficError
        When the shapes differ, times do not increase, or a flow is negative or not finite.
    """

    time_s: Array
    flow_per_s: Array

    def __post_init__(self) -> None:
        time_s = np.array(self.time_s, dtype=np.float64, ndmin=1)
        flow = np.array(self.flow_per_s, dtype=np.float64, ndmin=1)
        if time_s.ndim != 1 or time_s.shape != flow.shape or time_s.size < 1:
            raise TrafficError(
                f"a demand needs as many times as flows, one or more, got {time_s.shape} and {flow.shape}"
            )
        if not np.all(np.isfinite(time_s)) or np.any(np.diff(time_s) <= 0.0):
            raise TrafficError("the times of a demand must be finite and increase")
        if not np.all(np.isfinite(flow)) or np.any(flow < 0.0):
            raise TrafficError(
                f"a demand must be finite and 0 veh/s or more everywhere, its least is {flow.min():g} veh/s"
            )
        for name, column in (("time_s", time_s), ("flow_per_s", flow)):
            column.flags.writeable = False
            object.__setattr__(self, name, column)

    @classmethod
    def of(cls, given: float | Demand) -> Demand:
        """Take a number for a constant demand."""
        return given if isinstance(given, Demand) else cls(np.zeros(1), np.full(1, float(given)))

    def at(self, time_s: ArrayLike) -> Array:
        """Look up the flow at times."""
        index = np.searchsorted(self.time_s, np.asarray(time_s, dtype=np.float64) + 1e-9, side="right") - 1
        return self.flow_per_s[np.maximum(index, 0)]

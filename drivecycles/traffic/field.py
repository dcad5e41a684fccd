"""What a traffic model gives: density, speed and flow over time and road."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivecycles.traffic.road import Road

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TrafficField:
    """One run of a traffic model with n steps.

    Attributes
    ----------
    road : Road
        Where.
    scheme : str
        How it was computed.
    time_s : ndarray, shape (n + 1,)
        From the start on, equidistant.
    density_per_m : ndarray, shape (n + 1, cells)
        Vehicles per metre in each cell.
    speed_mps : ndarray, shape (n + 1, cells)
        Speed in each cell.
    flow_per_s : ndarray, shape (n, cells + 1)
        Vehicles per second through each face between cells during each step; face 0 is the entrance.
    demand_per_s : ndarray, shape (n,)
        What wanted to enter.
    courant : float
        Courant number: cells that the fastest wave crosses in a step; at most 1.
    """

    road: Road
    scheme: str
    time_s: Array
    density_per_m: Array
    speed_mps: Array
    flow_per_s: Array
    demand_per_s: Array
    courant: float

    @property
    def position_m(self) -> Array:
        """Middles of the cells, shape (cells,)."""
        return self.road.position_m

    @property
    def step_s(self) -> float:
        """Time step."""
        return float(self.time_s[1] - self.time_s[0])

    @property
    def vehicles(self) -> Array:
        """Vehicles on the road at each time, shape (n + 1,)."""
        return np.asarray(self.density_per_m.sum(axis=1) * self.road.cell_m)

    @property
    def refused_veh(self) -> float:
        """Vehicles that wanted to enter and found no room; they do not wait, they are gone."""
        return float((self.demand_per_s - self.flow_per_s[:, 0]).sum() * self.step_s)

    @property
    def imbalance_veh(self) -> float:
        """Largest deviation of the vehicles on the road from those that entered less those that left."""
        through = np.cumsum(self.flow_per_s[:, 0] - self.flow_per_s[:, -1]) * self.step_s
        return float(np.abs(self.vehicles[1:] - self.vehicles[0] - through).max())

    def speed_at(self, position_m: float) -> Array:
        """Speed over time in the cell that holds a position, shape (n + 1,).

        Raises
        ------
        TrafficError
            When the position is outside the road.
        """
        return self.speed_mps[:, self.road.cell_at(position_m)]

    def at(self, time_s: ArrayLike) -> Array:
        """Speed of every cell at times, linear between steps and held outside, shape ``(*times, cells)``."""
        share = np.clip(
            (np.asarray(time_s, dtype=np.float64) - self.time_s[0]) / self.step_s, 0.0, self.time_s.size - 1.0
        )
        before = np.minimum(share.astype(np.int64), self.time_s.size - 2)
        weight = (share - before)[..., np.newaxis]
        found: Array = (1.0 - weight) * self.speed_mps[before] + weight * self.speed_mps[before + 1]
        return found

"""Kinematic waves from one moment to another, every member with densities and a diagram of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivecycles.traffic.diagrams import Diagram
from drivecycles.traffic.lwr import COURANT, gates, lay_out, split_duration
from drivecycles.traffic.road import Demand, Road

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Advance:
    """Godunov's scheme in steps that suit the fastest diagram, from any whole number of steps on.

    Parameters
    ----------
    road : Road
        Where.
    demand : Demand
        Flow that wants to enter.
    step_s : float
        Time step.
    """

    road: Road
    demand: Demand
    step_s: float

    @classmethod
    def fit(cls, road: Road, demand: float | Demand, period_s: float, fastest_mps: float) -> Advance:
        """Choose a step that divides a period, with a Courant number of 0.9 at most.

        Raises
        ------
        TrafficError
            When the period is not positive.
        """
        _, step_s = split_duration(period_s, None, road.cell_m, fastest_mps)
        return cls(road, Demand.of(demand), step_s)

    def __call__(self, density_per_m: Array, diagrams: list[Diagram], start: int, steps: int) -> Array:
        """Run some steps.

        Parameters
        ----------
        density_per_m : ndarray, shape (cells, M)
            Densities to start from; those beyond a member's jam are taken for the jam, those below 0 for 0.
        diagrams : list of Diagram
            One per member, of one kind.
        start, steps : int
            Number of the first step since time 0, and how many.

        Returns
        -------
        ndarray, shape (cells, M)
            Densities at the end.
        """
        from drivecycles.traffic import _kernels as _kernels
        from drivecycles.traffic._lwr import Gates, Recorded, run_block

        members = lay_out(diagrams)
        full = np.array([diagram.full_per_m for diagram in diagrams])
        density = np.ascontiguousarray(np.clip(density_per_m, 0.0, full))
        barred = gates(self.road, self.step_s, start + steps)
        shifted = Gates(barred.face, barred.flow_per_s, barred.first - start, barred.end - start)
        offered = self.demand.at((start + np.arange(steps) + 0.5) * self.step_s)
        cells, count = density.shape
        kept = Recorded(np.array([steps]), np.arange(cells), np.empty((1, cells, count)), np.empty((0, 0, 0)))
        run_block(
            members.kind,
            False,
            members.constants,
            density,
            offered,
            self.step_s / self.road.cell_m,
            shifted,
            kept,
            0,
        )
        return np.asarray(kept.density[0], dtype=np.float64)


__all__ = ["COURANT", "Advance"]

"""[M] section 4.2: the battery current of a PHEV that blends fuel and battery, for one cell of its pack.

The report simulates a power-split PHEV with a pack of 16 kWh and the policy of an earlier paper; neither is
given. Here it is the PHEV of [L] with its certainty-equivalent policy on FTP-72, driven four times without
noise: 48 km that the usable energy cannot carry alone, so the policy blends. The current of the first lap is
the one that is applied back to back.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from bms import Pack
from drivecycles import load_cycle
from ems.concept import load_concept
from ems.noise import Noise
from ems.policies import build_policy
from ems.problem import Problem, build_problem
from ems.records import Rollout
from ems.simulate import roll_out

Array = NDArray[np.float64]

CONCEPT, POLICY, CYCLE = "phev", "certainty_equivalent", "ftp72"
LAPS = 4
PACK_ENERGY_J = 16.0 * 3.6e6
"""Energy of the report's pack."""


@dataclass(frozen=True, eq=False)
class PhevTrip:
    """One lap of the cycle, and what the whole trip came to.

    Parameters
    ----------
    time_s, speed_mps : ndarray, shape (n + 1,)
        The cycle.
    current_A : ndarray, shape (n,)
        Current of the cell, > 0 charges.
    distance_m : float
        Length of the lap.
    engine_share : float
        Share of the trip with the engine running.
    fuel_l_per_100km : float
        Fuel of the trip.
    soc : tuple of float
        SOC of the pack at the start and at the end of the trip.
    """

    time_s: Array
    speed_mps: Array
    current_A: Array
    distance_m: float
    engine_share: float
    fuel_l_per_100km: float
    soc: tuple[float, float]


def phev_trip(capacity_Ah: float, laps: int = LAPS) -> PhevTrip:
    """Drive the trip and scale the pack's current to a cell.

    Parameters
    ----------
    capacity_Ah : float
        Capacity of the cell.
    laps : int
        How often the cycle is driven.
    """
    problem, rollout = _drive(laps)
    n = problem.steps // laps
    current_A = rollout.current_A[0, :n].astype(np.float64) * cell_share(problem.pack, capacity_Ah)
    fuel = problem.vehicle.fuel_l_per_100km(float(rollout.fuel_kg[0]), problem.demand.distance_m)
    return PhevTrip(
        time_s=np.asarray(problem.cycle.time_s[: n + 1]),
        speed_mps=np.asarray(problem.cycle.speed_mps[: n + 1]),
        current_A=current_A,
        distance_m=float(problem.demand.distance_m) / laps,
        engine_share=float(rollout.engine_on[0].mean()),
        fuel_l_per_100km=float(fuel),
        soc=(float(rollout.soc[0, 0]), float(rollout.soc[0, -1])),
    )


@lru_cache(maxsize=2)
def _drive(laps: int) -> tuple[Problem, Rollout]:
    """Solve the policy and drive the trip without noise."""
    problem = build_problem(load_concept(CONCEPT), load_cycle(CYCLE).repeat(laps))
    silence = Noise(np.zeros(1), np.zeros((1, problem.steps)), np.zeros((1, problem.steps)))
    return problem, roll_out(problem, build_policy(POLICY, problem), silence)


def cell_share(pack: Pack, capacity_Ah: float) -> float:
    """Current of a cell over that of our pack, at the C-rates that the power has in a pack of 16 kWh."""
    return capacity_Ah / (pack.capacity_C / 3600.0) * (pack.energy_J / PACK_ENERGY_J)

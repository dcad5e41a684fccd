"""The records that leave the energy-management room: what was driven, and how policies compare."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Rollout:
    """Trajectories of one policy over ``n`` realizations of the noise and ``N`` steps of the cycle.

    Parameters
    ----------
    time_s : ndarray, shape (N + 1,)
        Time of the samples.
    soc, soc_estimate, variance : ndarray of float32, shape (n, N + 1)
        True SOC, its estimate, and the variance of the estimate's error.
    engine_on : ndarray of bool, shape (n, N + 1)
        Engine state.
    current_A, engine_torque_Nm, fuel_kgps : ndarray of float32, shape (n, N)
        Battery current (> 0 charges), torque at the crank, fuel rate without the fuel of starts.
    fuel_kg, penalty_kg, shortfall_kg : ndarray, shape (n,)
        Fuel with starts; running and terminal penalties at the true SOC; price of power that was demanded but
        not delivered.
    mean_abs_current_A : ndarray, shape (n,)
        Mean of the absolute battery current.
    engine_starts : ndarray of int, shape (n,)
        Number of engine starts.
    outside_window : ndarray, shape (n,)
        Share of the samples with the true SOC outside the allowed window.
    """

    time_s: Array
    soc: NDArray[np.float32]
    soc_estimate: NDArray[np.float32]
    variance: NDArray[np.float32]
    engine_on: NDArray[np.bool_]
    current_A: NDArray[np.float32]
    engine_torque_Nm: NDArray[np.float32]
    fuel_kgps: NDArray[np.float32]
    fuel_kg: Array
    penalty_kg: Array
    shortfall_kg: Array
    mean_abs_current_A: Array
    engine_starts: NDArray[np.int64]
    outside_window: Array

    @property
    def cost_kg(self) -> Array:
        """Realised cost in kg of fuel, shape (n,): fuel, penalties and shortfall."""
        return self.fuel_kg + self.penalty_kg + self.shortfall_kg


@dataclass(frozen=True, eq=False)
class Case:
    """One policy in one setting.

    Parameters
    ----------
    concept, mu, policy
        What was run.
    rollout : Rollout
        Its trajectories.
    value_kg : float or None
        Expected cost that the policy's own model promises at the start; None where it promises nothing.
    fuel_l_per_100km : ndarray, shape (n,)
        Fuel consumption of each realization.
    solve_s : float
        Seconds of processor time that solving took; zero where an earlier case's solution served.
    window : tuple of float
        The allowed SOC window.
    target_soc : float
        The SOC that the terminal penalty asks for.
    """

    concept: str
    mu: float
    policy: str
    rollout: Rollout
    value_kg: float | None
    fuel_l_per_100km: Array
    solve_s: float
    window: tuple[float, float]
    target_soc: float


@dataclass(frozen=True, eq=False)
class Comparison:
    """Every case of a comparison, on common random numbers.

    Parameters
    ----------
    seed : int
        Seed of the noise.
    cycle_name : str
        Name of the cycle.
    time_s, speed_mps, altitude_m : ndarray, shape (N + 1,)
        The cycle as driven, resampled to the step of the problem.
    distance_m : float
        Its length.
    cases : tuple of Case
        In the order concept, mu, policy.
    settings : dict
        Everything that decides the result, JSON-serialisable: concepts in full, grids, versions.
    """

    seed: int
    cycle_name: str
    time_s: Array
    speed_mps: Array
    altitude_m: Array
    distance_m: float
    cases: tuple[Case, ...]
    settings: dict[str, Any]

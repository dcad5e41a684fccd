"""The optimisation problem as data: stage tables, pack, uncertainty and penalties on one cycle.

[L] eqs 16 to 19 with the corrections of ERRATA.md: stages 0 .. N-1 and the terminal cost at N. Everything
that depends on (step, control) is evaluated here once; what depends on the state is left to the kernels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bms import Pack, UncertaintyModel
from drivecycles import DriveCycle
from ems._sdp import Scalars, Stages
from ems.concept import Concept
from ems.errors import EmsError
from ems.forced import HEADROOM, forced_rise
from ems.grid import GridSettings
from vehicle import Demand, Vehicle

Array = NDArray[np.float64]
OnInfeasible = Literal["error", "limit"]
STEP_TOLERANCE_S = 1e-9


@dataclass(frozen=True, eq=False)
class Problem:
    """One concept on one cycle, ready to be solved.

    Parameters
    ----------
    concept, vehicle, pack
        The car and its costs.
    cycle : DriveCycle
        The cycle, uniform in time.
    demand : Demand
        What it demands at the wheels, N steps.
    stages : Stages
        Cost and battery power of every (step, control), shape (N, C).
    engine_torque_Nm, fuel_kgps, shortfall_kg : ndarray, shape (N, C)
        Parts of the stage tables that the results report.
    uncertainty : UncertaintyModel
        gamma, beta and mu.
    settings : GridSettings
        How finely to discretise.
    least_reach : float
        Variance that the policy must have an answer to at least, whatever the uncertainty model says.
    """

    concept: Concept
    vehicle: Vehicle
    pack: Pack
    cycle: DriveCycle
    demand: Demand
    stages: Stages
    engine_torque_Nm: Array
    fuel_kgps: Array
    shortfall_kg: Array
    uncertainty: UncertaintyModel
    settings: GridSettings
    least_reach: float = 0.0

    @property
    def step_s(self) -> float:
        """Length of a step."""
        return float(self.demand.step_s)

    @property
    def steps(self) -> int:
        """Number of steps N."""
        return int(self.stages.power_W.shape[0])

    @property
    def scalars(self) -> Scalars:
        """Numbers that every stage shares, for the kernels."""
        return Scalars(
            step_s=self.step_s,
            charge_to_soc=self.step_s / self.pack.capacity_C,
            drift=self.step_s * self.uncertainty.gamma,
            drift_per_A=self.step_s * self.uncertainty.beta,
            start_cost_kg=self.concept.start_fuel_kg,
            shortfall_kg_per_J=1e-6 * self.concept.shortfall_kg_per_MJ,
        )

    def with_mu(self, mu: float) -> Problem:
        """Return the problem with another measurement variance.

        Raises
        ------
        EmsError
            When ``mu`` is negative or not finite.
        """
        if not (np.isfinite(mu) and mu >= 0.0):
            raise EmsError(
                f"mu is {mu:g}; it is a variance of the measured SOC and must be zero or positive, like 0.002"
            )
        return replace(self, uncertainty=self.uncertainty.model_copy(update={"mu": float(mu)}))


def build_problem(
    concept: Concept,
    cycle: DriveCycle,
    *,
    step_s: float = 1.0,
    settings: GridSettings | None = None,
    on_infeasible: OnInfeasible = "error",
    pack: Pack | None = None,
) -> Problem:
    """Assemble the stage tables of a concept on a cycle.

    Parameters
    ----------
    concept : Concept
        Vehicle, pack, window and costs.
    cycle : DriveCycle
        Resampled to ``step_s`` where its own step differs.
    step_s : float
        Length h of a step; [L] does not give it, 1 s is used (ERRATA.md).
    settings : GridSettings, optional
        Grid spacings; the defaults when left out.
    on_infeasible : {"error", "limit"}
        Whether a step that the powertrain cannot follow, with the battery at the low end of its window, is an
        error, or is driven as well as possible with the energy it lacks priced in.
    pack : Pack, optional
        Another pack than the concept's own.

    Raises
    ------
    EmsError
        A step cannot be followed and ``on_infeasible`` is ``"error"``.
    """
    settings = settings or GridSettings()
    vehicle, pack = concept.load_vehicle(), pack or concept.load_pack()
    if not cycle.is_uniform or abs(cycle.step_s - step_s) > STEP_TOLERANCE_S:
        cycle = cycle.resample(step_s)
    demand = vehicle.demand(cycle)
    if on_infeasible == "error":
        _require_followable(concept, vehicle, pack, demand, cycle.name)
    table = vehicle.controls(demand, settings.torque_levels)
    shortfall_kg = table.shortfall_W * (step_s * 1e-6 * concept.shortfall_kg_per_MJ)
    rise = forced_rise(table.battery_power_W, pack, concept.window.high, step_s) + HEADROOM
    if rise > settings.soc_margin:
        settings = settings.model_copy(update={"soc_margin": min(rise, 1.0)})
    return Problem(
        concept=concept,
        vehicle=vehicle,
        pack=pack,
        cycle=cycle,
        demand=demand,
        stages=Stages(
            cost_kg=np.ascontiguousarray(table.fuel_kgps * step_s + shortfall_kg),
            power_W=np.ascontiguousarray(table.battery_power_W),
        ),
        engine_torque_Nm=np.ascontiguousarray(table.engine_torque_Nm),
        fuel_kgps=np.ascontiguousarray(table.fuel_kgps),
        shortfall_kg=np.ascontiguousarray(shortfall_kg),
        uncertainty=concept.uncertainty,
        settings=settings,
    )


def _require_followable(
    concept: Concept, vehicle: Vehicle, pack: Pack, demand: Demand, cycle_name: str
) -> None:
    limit_W = -float(pack.power_limits_W(concept.window.low)[0])
    missed = vehicle.shortfall(demand, limit_W)
    if missed:
        raise EmsError(
            f"concept {concept.name!r} cannot follow {cycle_name!r} in {len(missed)} of"
            f" {demand.time_s.size} steps: {missed[0].message()}"
            f" with the battery at {concept.window.low:.0%} SOC;"
            " take a stronger vehicle or pack or an easier cycle,"
            " or --on-infeasible limit to drive it as well as possible"
        )

"""What a policy needs in order to decide, as arrays and numbers, and nothing of what found it.

The cost-to-go of stage 0 is not among them: a decision at step k looks at stage k + 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bms._filter import Filter
from bms.filtering import tabulate_filter
from ems._choose import ESTIMATE
from ems._rules import Rules
from ems._sdp import Scalars
from ems.errors import EmsError
from ems.policies import AnyPolicy, CostToGoPolicy

Array = NDArray[np.float64]

STENCIL = 2
"""Nodes beyond the last one inside that a look-up reads."""


@dataclass(frozen=True, eq=False)
class StageTables:
    """What C controls do in each of N steps; arrays of shape (N, C).

    Parameters
    ----------
    power_W : ndarray
        Battery power, > 0 charges.
    cost_kg : ndarray
        Fuel and price of missing power.
    engine_torque_Nm : ndarray
        Torque at the crank.
    fuel_kgps : ndarray
        Fuel rate.
    shortfall_kg : ndarray, optional
        Price of missing power alone; only rules ask for it.
    """

    power_W: Array
    cost_kg: Array
    engine_torque_Nm: Array
    fuel_kgps: Array
    shortfall_kg: Array | None = None


@dataclass(frozen=True, eq=False)
class LookAhead:
    """The cost-to-go and what one step ahead needs ([L] eq 19).

    Parameters
    ----------
    acts_on : int
        ESTIMATE, CERTAIN or TRUTH.
    soc : ndarray, shape (n,)
        Nodes, uniform.
    soc_step : float
        Their distance.
    cubic : bool
        Cubic look-ups in SOC, or linear ones.
    ocv_V, discharge_ohm, charge_ohm, current_low_A, current_high_A : ndarray, shape (n,)
        The battery at the nodes.
    level : ndarray, shape (r,)
        Variances of the rows, uniform in their root; a single one where the policy knows no variance.
    cost_to_go_kg : ndarray of float32, shape (N, 2, r, n)
        Of stages 1 to N, over (engine state, row, node).
    scalars : Scalars
        Numbers that all stages share.
    known : Filter, optional
        What the next measurement will teach (ESTIMATE).
    """

    acts_on: int
    soc: Array
    soc_step: float
    cubic: bool
    ocv_V: Array
    discharge_ohm: Array
    charge_ohm: Array
    current_low_A: Array
    current_high_A: Array
    level: Array
    cost_to_go_kg: NDArray[np.float32]
    scalars: Scalars
    known: Filter | None


@dataclass(frozen=True, eq=False)
class PolicyTables:
    """A policy as data.

    Parameters
    ----------
    policy, concept, cycle : str
        Names.
    step_s : float
        Length of a step.
    stages : StageTables
        What the controls do.
    basis : LookAhead or Rules
        What it decides by.
    """

    policy: str
    concept: str
    cycle: str
    step_s: float
    stages: StageTables
    basis: LookAhead | Rules

    @property
    def steps(self) -> int:
        """Number of steps N."""
        return int(self.stages.power_W.shape[0])


def tables_of(policy: AnyPolicy) -> PolicyTables:
    """Take a policy's tables.

    Parameters
    ----------
    policy : CostToGoPolicy or RuleBasedPolicy
        The policy.
    """
    problem = policy.problem
    stages = StageTables(
        power_W=problem.stages.power_W,
        cost_kg=problem.stages.cost_kg,
        engine_torque_Nm=problem.engine_torque_Nm,
        fuel_kgps=problem.fuel_kgps,
        shortfall_kg=problem.shortfall_kg,
    )
    basis = _look_ahead(policy) if isinstance(policy, CostToGoPolicy) else policy.rules
    return PolicyTables(policy.name, problem.concept.name, problem.cycle.name, problem.step_s, stages, basis)


def _look_ahead(policy: CostToGoPolicy) -> LookAhead:
    problem, solution = policy.problem, policy.solution
    grid = solution.grid
    known = tabulate_filter(problem.pack, problem.uncertainty) if policy.acts_on == ESTIMATE else None
    return LookAhead(
        acts_on=policy.acts_on,
        soc=solution.soc,
        soc_step=grid.soc_step,
        cubic=grid.cubic,
        ocv_V=grid.ocv_V,
        discharge_ohm=grid.discharge_ohm,
        charge_ohm=grid.charge_ohm,
        current_low_A=grid.current_low_A,
        current_high_A=grid.current_high_A,
        level=grid.level if solution.cost_to_go_kg.shape[2] > 1 else np.zeros(1),
        cost_to_go_kg=solution.cost_to_go_kg[1:],
        scalars=problem.scalars,
        known=known,
    )


def narrowed(tables: PolicyTables, low: float, high: float) -> PolicyTables:
    """Leave out the nodes of the SOC grid that a car does not come to; an embedded target may have no room.

    Decisions are the same as long as the SOC, and what a step and the next measurement make of it, stay
    within ``low`` and ``high``; beyond, the cost-to-go is taken as constant, as it is beyond a whole grid.

    Parameters
    ----------
    tables : PolicyTables
        The policy; rules have no grid and come back as they are.
    low, high : float
        Least and greatest SOC that matter.

    Raises
    ------
    EmsError
        When the range is empty or beside the grid.
    """
    basis = tables.basis
    if not isinstance(basis, LookAhead):
        return tables
    soc = basis.soc
    if not (low < high and low < soc[-1] and high > soc[0]):
        raise EmsError(
            f"a SOC range of {low:g} to {high:g} leaves nothing of the grid, which goes from {soc[0]:g} to"
            f" {soc[-1]:g}; give fractions, the lower one first"
        )
    first = max(int(np.searchsorted(soc, low, side="right")) - 1 - STENCIL, 0)
    last = min(int(np.searchsorted(soc, high, side="left")) + 1 + STENCIL, soc.size)
    part = slice(first, last)
    return replace(
        tables,
        basis=replace(
            basis,
            soc=soc[part],
            ocv_V=basis.ocv_V[part],
            discharge_ohm=basis.discharge_ohm[part],
            charge_ohm=basis.charge_ohm[part],
            current_low_A=basis.current_low_A[part],
            current_high_A=basis.current_high_A[part],
            cost_to_go_kg=basis.cost_to_go_kg[..., part],
        ),
    )

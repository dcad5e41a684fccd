"""Cases that share a solve go to one worker.

Cases that differ only in the uncertainty model or in the noise share the stage tables of their problem, and
every solve that does not depend on what differs: the certainty-equivalent and the perfect-information program
do not depend on mu, and none depends on the seed. There is a price: a unit keeps one worker busy. So units
are cut where there would be too few of them for the workers. A case gives the same bytes in every unit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ems.policies import find_policy
from socwise.study.digest import code_digest, digest
from socwise.study.plan import Plan
from socwise.study.task import PlannedCase, WorkUnit

ROUNDS = 4
"""Units per worker that are wanted at least, so that the last ones do not keep a study waiting."""
MOST_CASES = 32
"""A unit that is lost when a worker dies shall not be the whole study."""


def make_units(plan: Plan, cases: Sequence[PlannedCase], workers: int) -> list[WorkUnit]:
    """Group cases into units of work.

    Parameters
    ----------
    plan : Plan
        Gives the trips.
    cases : sequence of PlannedCase
        What is to be computed.
    workers : int
        How many there are to compute.
    """
    groups: dict[str, list[PlannedCase]] = {}
    for case in cases:
        groups.setdefault(_group(case), []).append(case)
    size = MOST_CASES
    while size > 1 and sum(-(-len(group) // size) for group in groups.values()) < ROUNDS * workers:
        size //= 2
    return [
        WorkUnit(tuple(group[at : at + size]), plan.trips[group[0].trip], code_digest())
        for group in groups.values()
        for at in range(0, len(group), size)
    ]


def alone(unit: WorkUnit) -> list[WorkUnit]:
    """Take a unit apart into its cases."""
    return [replace(unit, cases=(case,)) for case in unit.cases]


def solve_key(case: PlannedCase, policy: str) -> tuple[float, ...]:
    """What decides the solve of a policy among the cases of a unit."""
    model = case.concept.uncertainty
    if find_policy(policy).DEPENDS_ON_MU:
        return (model.gamma, model.beta, model.mu)
    return (model.gamma, model.beta)


def count_solves(units: Sequence[WorkUnit]) -> tuple[int, int]:
    """Count the solves of some units, and how many there would be if no case shared one."""
    shared = alone_ = 0
    for unit in units:
        closed = unit.cases[0].loop is not None
        for name in unit.cases[0].policies:
            keys = {solve_key(case, name) for case in unit.cases}
            shared += len(unit.cases) if closed else len(keys)
            alone_ += len(unit.cases)
    return shared, alone_


def _group(case: PlannedCase) -> str:
    if case.loop is not None:
        return case.key
    concept = case.concept.model_dump()
    del concept["uncertainty"]
    return digest(
        [
            concept,
            str(case.concept._folder),
            case.trip,
            list(case.policies),
            case.settings,
            case.on_infeasible,
        ]
    )

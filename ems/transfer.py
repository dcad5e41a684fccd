r"""A policy on another trip over the same road: the stage it looks up is the one of the same place.

A policy is solved for a planned cycle, and the traffic makes another one of it: other speeds, another
duration. What a cost-to-go says depends on what is still to be driven, so the stage that a vehicle looks up
is that of its place, not that of its clock. With :math:`\sigma_k` the share of the road that is behind at
sample k of the trip, and :math:`\bar\sigma_j` the same of the planned cycle, the cost-to-go after step k is

.. math:: J(\cdot) = (1 - w)\,\bar J_j(\cdot) + w\,\bar J_{j+1}(\cdot), \qquad
          \sigma_{k+1} = (1 - w)\,\bar\sigma_j + w\,\bar\sigma_{j+1}.

Where both stand at the same place, the trip walks through the planned stop second by second and waits at its
last sample; where only the trip stands, the policy expects to drive on at the next step. At the end of the
trip the terminal cost stands as it is. On the planned cycle itself the policy is unchanged. The share of
*time* would need a duration that nobody knows before the end, and it would take a vehicle in a jam for one
that has arrived. The costs and powers of the step itself are those of the trip: the driver's pedal tells
them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivecycles import DriveCycle
from ems.policies import AnyPolicy, CostToGoPolicy, build_policy
from ems.problem import Problem

Array = NDArray[np.float64]


def planned_stage(planned: DriveCycle, driven: DriveCycle) -> Array:
    """Give the stage of a planned cycle that belongs to each sample of a driven one.

    Parameters
    ----------
    planned, driven : DriveCycle
        Over the same road; distances are compared as shares of their own whole.

    Returns
    -------
    ndarray, shape (samples of driven,)
        Fractional, rising from 0 or more to the last stage.
    """
    share, wanted = _share(planned), _share(driven)
    last = np.minimum(np.searchsorted(share, wanted, side="right") - 1, share.size - 2)
    stage = last + (wanted - share[last]) / np.maximum(share[last + 1] - share[last], 1e-300)
    first = np.searchsorted(share, wanted, side="left")
    for k in range(wanted.size):
        if share[min(first[k], share.size - 1)] == wanted[k]:
            stood = k > 0 and wanted[k] == wanted[k - 1]
            stage[k] = min(max(float(first[k]), stage[k - 1] + 1.0 if stood else 0.0), stage[k])
    stage[-1] = share.size - 1
    return np.asarray(stage, dtype=np.float64)


def transfer(policy: AnyPolicy, problem: Problem) -> AnyPolicy:
    """Take a policy that was solved for a planned cycle to a problem on another one.

    Parameters
    ----------
    policy : CostToGoPolicy or RuleBasedPolicy
        As solved; rules know no trip and are only set up anew.
    problem : Problem
        The same concept on the driven cycle.
    """
    if not isinstance(policy, CostToGoPolicy):
        return build_policy(policy.name, problem)
    stage = planned_stage(policy.problem.cycle, problem.cycle)
    table = policy.solution.cost_to_go_kg
    low = np.minimum(stage.astype(np.int64), table.shape[0] - 2)
    weight = (stage - low).astype(np.float32)[:, None, None, None]
    moved = (1.0 - weight) * table[low] + weight * table[low + 1]
    return replace(policy, problem=problem, solution=policy.solution.with_cost_to_go(moved))


def _share(cycle: DriveCycle) -> Array:
    position = cycle.position_m
    return np.asarray(position / max(float(position[-1]), 1e-9), dtype=np.float64)

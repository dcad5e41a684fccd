r"""Choose the grid by the error that it leaves: what ``socwise solve --accuracy`` does.

The value at the start is computed on a grid and again with one spacing at a time halved (or the range of SOC
widened). For a spacing ``h`` whose error goes with ``h`` or faster, what is left beyond the halved grid is at
most what halving moved, so the error of the grid itself is at most twice that:

.. math:: |V(h) - V(0)| \le 2\,|V(h) - V(h/2)|.

The estimate is the sum over the spacings, and what widening the range moved. While it is larger than asked
for, every spacing with more than its share is halved. An estimate is no bound: a kink that both grids miss
stays hidden, so the coarsest grid tried resolves the window by twenty nodes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ems.errors import EmsError
from ems.grid import GridSettings
from ems.policies import CostToGoPolicy, build_policy, find_policy
from ems.problem import Problem

LEAST, MOST = 1e-5, 0.1
"""Accuracies that may be asked for."""
SAFETY = 2.0
WIDER = 0.1
"""What the range of SOC is widened by, on either side."""
# Rows: with very little drift 64 of them, closer than their parabolas can bear, made the value fall again.
FINEST = {
    "soc_step": 1e-4,
    "deterministic_soc_step": 2e-5,
    "variance_rows": 32,
    "process_levels": 48,
    "torque_levels": 320,
    "soc_margin": 0.9,
}
DIMENSIONS = {
    "stochastic": ("soc_step", "variance_rows", "torque_levels", "soc_margin"),
    "certainty_equivalent": ("deterministic_soc_step", "torque_levels", "soc_margin"),
    "perfect_information": ("soc_step", "process_levels", "torque_levels", "soc_margin"),
}


@dataclass(frozen=True)
class GridChoice:
    """A grid, and how far its value may be off.

    Parameters
    ----------
    policy : CostToGoPolicy
        Solved on the chosen grid.
    settings : GridSettings
        That grid.
    asked, estimated_error : float
        Relative error of the value at the start: allowed, and estimated.
    parts : dict
        Estimated share of every spacing.
    solves : int
        How many grids were tried.
    """

    policy: CostToGoPolicy
    settings: GridSettings
    asked: float
    estimated_error: float
    parts: dict[str, float]
    solves: int

    @property
    def reached(self) -> bool:
        """Whether the estimate is as small as asked for."""
        return self.estimated_error <= self.asked


def choose_grid(
    make_problem: Callable[[GridSettings], Problem],
    policy: str,
    accuracy: float,
    progress: Callable[[int, int], None] | None = None,
) -> GridChoice:
    """Find a grid whose value at the start is as accurate as asked for.

    Parameters
    ----------
    make_problem : callable
        Builds the problem with given settings.
    policy : str
        Name of a policy that is solved for.
    accuracy : float
        Relative error of the value that is allowed, 0.00001 to 0.1.
    progress : callable, optional
        Called with the number of finished solves, and of those that are planned so far.

    Returns
    -------
    GridChoice
        The last grid tried; see its ``reached``.

    Raises
    ------
    EmsError
        The accuracy is out of range, or the policy is not solved for.
    """
    name = find_policy(policy).NAME
    if name not in DIMENSIONS:
        raise EmsError(f"the policy {name!r} has no grid; choose {', '.join(DIMENSIONS)}")
    if not (math.isfinite(accuracy) and LEAST <= accuracy <= MOST):
        raise EmsError(
            f"an accuracy of {accuracy:g} is asked for; it is the relative error of the value that is"
            f" allowed, {LEAST:g} to {MOST:g}, such as 0.003"
        )
    settings = _coarsest(make_problem(GridSettings()))
    done = 0

    def solve(tried: GridSettings) -> CostToGoPolicy:
        nonlocal done
        solved = build_policy(name, make_problem(tried))
        if not isinstance(solved, CostToGoPolicy):
            raise EmsError(f"the policy {name!r} has no grid")
        done += 1
        if progress is not None:
            progress(done, max(done, 2 * len(DIMENSIONS[name])))
        return solved

    found = solve(settings)
    parts: dict[str, float] = {}
    while True:
        finer = {d: tried for d in DIMENSIONS[name] if (tried := _halved(settings, d))}
        scale = max(abs(found.value_kg), 1e-9)
        # What cannot be halved any more keeps its estimate, less what the last halving should have done.
        parts = {dimension: 0.5 * part for dimension, part in parts.items() if dimension not in finer}
        for dimension, tried in finer.items():
            other = solve(tried)
            again = _halved(tried, dimension)
            while dimension == "soc_step" and other.value_kg == found.value_kg and again:
                # The program had refined the grid by itself, to the same spacing (`ems.resolution`).
                tried, other = again, solve(again)
                again = _halved(tried, dimension)
            moved = abs(other.value_kg - found.value_kg) / scale
            parts[dimension] = moved * (1.0 if dimension == "soc_margin" else SAFETY)
        choice = GridChoice(found, settings, accuracy, sum(parts.values()), parts, done)
        worst = [dimension for dimension in finer if parts[dimension] > accuracy / len(parts)]
        if choice.reached or not worst:
            return choice
        for dimension in worst:
            settings = settings.model_copy(update={dimension: getattr(finer[dimension], dimension)})
        found = solve(settings)


def _coarsest(problem: Problem) -> GridSettings:
    window = problem.concept.window
    step = min(0.01, (window.high - window.low) / 20.0)
    return GridSettings(
        soc_step=step,
        deterministic_soc_step=step / 5.0,
        variance_rows=8,
        process_levels=4,
        torque_levels=10,
        soc_margin=0.1,
    )


def _halved(settings: GridSettings, dimension: str) -> GridSettings | None:
    """Give the settings with one spacing halved, or the range widened; None if it is the finest."""
    value = getattr(settings, dimension)
    if dimension == "soc_margin":
        halved, possible = value + WIDER, value + WIDER <= FINEST[dimension]
    elif dimension.endswith("soc_step"):
        halved, possible = value / 2.0, value / 2.0 >= FINEST[dimension]
    else:
        halved, possible = 2 * value, 2 * value <= FINEST[dimension]
    return settings.model_copy(update={dimension: halved}) if possible else None

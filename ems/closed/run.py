"""Run realizations of a closed loop, in several processes if wanted, every policy on the same ones.

The loop is Python, which threads do not speed up, so blocks of realizations go to processes; the policies'
tables reach them as shared memory. A realization in which an FMU crashes is dropped for every policy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import joblib
import numpy as np

from bms.cell import Cell
from bms.plants.fmu.errors import FmuCrash
from ems._rollout import Tracks
from ems._sdp import Grid
from ems.closed.battery import ClosedLoop, FmuSource
from ems.closed.plants import Start, open_plant
from ems.closed.scatter import COMPARISON, Draws, draw_realization
from ems.cost_to_go import Kept
from ems.errors import EmsError
from ems.loop import drive
from ems.policies import CostToGoPolicy, Policy, acts_on_truth
from ems.problem import Problem
from ems.simulate import allocate_tracks, plant_grid

BLOCK = 5
"""Realizations to a block, where starting a plant costs nothing."""
SHARED = "32M"
"""Arrays of this size and more are shared with the processes instead of copied: tables of policies."""


@dataclass(frozen=True, eq=False)
class Ensemble:
    """What a set of policies did in the same realizations.

    Parameters
    ----------
    tracks : mapping of str to Tracks
        By the policies' keys; rows are the realizations that were kept.
    kept : tuple of int
        Their numbers. Complete pairs come first (`ems.statistics`), then those that lost their mirror image.
    dropped : mapping of int to str
        Realizations that broke off, and why.
    """

    tracks: Mapping[str, Tracks]
    kept: tuple[int, ...]
    dropped: Mapping[int, str]


@dataclass(frozen=True, eq=False)
class _Job:
    problem: Problem
    policies: dict[str, Policy]
    loop: ClosedLoop
    cell: Cell
    seed: int
    stream: int
    numbers: tuple[int, ...]


def run_ensemble(
    problem: Problem,
    policies: Mapping[str, Policy],
    loop: ClosedLoop,
    cell: Cell,
    *,
    seed: int,
    realizations: int,
    stream: int = COMPARISON,
    jobs: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Ensemble:
    """Drive every realization with every policy.

    Parameters
    ----------
    problem : Problem
        The trip; its costs do not matter here.
    policies : mapping of str to policy
        The policies by a key of the caller's.
    loop : ClosedLoop
        Plant, sensors and estimator.
    cell : Cell
        The nominal pack as a cell.
    seed, realizations, stream
        Which noise, see `ems.closed.scatter.draw_realization`.
    jobs : int
        Processes; the result does not depend on it.
    progress : callable, optional
        Called with the number of realizations that are done.

    Raises
    ------
    EmsError
        When no realization is left, or an FMU that is not isolated ends its process.
    BatteryError
        When plant or estimator cannot be used as asked.
    """
    numbers = list(range(realizations))
    size = -(-realizations // jobs)
    if not isinstance(loop.plant, FmuSource):
        size = min(size, BLOCK)
    blocks = [tuple(numbers[at : at + size]) for at in range(0, realizations, size)]
    work = [_Job(problem, dict(policies), loop, cell, seed, stream, block) for block in blocks]
    found: dict[int, dict[str, Tracks] | str] = {}
    for part in _results(work, jobs):
        found |= part
        if progress is not None:
            progress(len(found))
    dropped = {number: why for number, why in sorted(found.items()) if isinstance(why, str)}
    kept = tuple(sorted((n for n in found if n not in dropped), key=lambda n: (n ^ 1 in dropped, n)))
    if not kept:
        first = next(iter(dropped.values()))
        raise EmsError(f"every one of {realizations} realizations broke off; the first: {first}")
    rows = [found[number] for number in kept]
    tracks = {key: _stack([row[key] for row in rows if not isinstance(row, str)]) for key in policies}
    return Ensemble(tracks, kept, dropped)


def _results(work: Sequence[_Job], jobs: int) -> Any:
    if jobs == 1 or len(work) == 1:
        return map(_run, work)
    # Copies on write, because numba compiles anew for arrays that cannot be written.
    pool = joblib.Parallel(
        n_jobs=jobs, backend="loky", max_nbytes=SHARED, mmap_mode="c", return_as="generator_unordered"
    )
    return _guarded(pool(joblib.delayed(_run)(job) for job in work))


def _guarded(results: Any) -> Any:
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    try:
        yield from results
    except TerminatedWorkerError as error:
        raise EmsError(
            "a process that simulated ended without a word: memory ran out, or an FMU that was not isolated"
            " took it along; take fewer --jobs, or --isolate yes"
        ) from error


def _run(job: _Job) -> dict[int, dict[str, Tracks] | str]:
    """Run a block of realizations; one that breaks off gives its reason instead of tracks."""
    policies = {key: _own(policy) for key, policy in job.policies.items()}
    with open_plant(job.loop, job.problem.concept, job.cell) as start:
        grid = plant_grid(job.problem)
        return {number: _realize(job, policies, start, grid, number) for number in job.numbers}


def _realize(
    job: _Job, policies: Mapping[str, Policy], start: Start, grid: Grid, number: int
) -> dict[str, Tracks] | str:
    problem, concept = job.problem, job.problem.concept
    draws: Draws = draw_realization(job.seed, number, problem.steps, job.stream)
    done = {}
    try:
        for key, policy in policies.items():
            plant, told = start(draws)
            knows_truth = acts_on_truth(policy)
            estimator = (
                None if knows_truth else job.loop.make_estimator(job.cell, told, concept.initial_soc_sd)
            )
            most = float("inf")
            if isinstance(policy, CostToGoPolicy) and policy.solution.grid.level.size > 1 and not knows_truth:
                most = float(policy.solution.grid.level[-1])
            tracks = allocate_tracks(1, problem.steps)
            drive(problem, policy, plant, estimator, grid, tracks, 0, most_variance=most)
            done[key] = tracks
    except FmuCrash as crash:
        return str(crash)
    return done


def _own(policy: Policy) -> Policy:
    """See a table that came as shared memory as a plain array: numba looks long at any other kind."""
    if not isinstance(policy, CostToGoPolicy):
        return policy
    stored = policy.solution.cost_to_go
    if not isinstance(stored, Kept):
        return policy
    return replace(policy, solution=policy.solution.with_cost_to_go(np.asarray(stored.table)))


def _stack(rows: Sequence[Tracks]) -> Tracks:
    return Tracks(*(np.concatenate(columns) for columns in zip(*rows, strict=True)))

"""Run a study: hand out what is missing, keep what comes back, and let nothing that fails stop the rest."""

from __future__ import annotations

import platform
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from socwise.study.changes import Standing, standing
from socwise.study.digest import code_digest, digest, numeric_versions
from socwise.study.errors import StudyError
from socwise.study.folder import check_folder, clean, make_folder, write_outcome, write_study
from socwise.study.loading import LoadedStudy, load_study
from socwise.study.lock import locked
from socwise.study.plan import Plan, make_plan
from socwise.study.pool import DaskPool, LocalPool, Pool, WorkerLost
from socwise.study.reading import read_study
from socwise.study.tables import write_tables
from socwise.study.task import Json, Outcome, PlannedCase, WorkUnit
from socwise.study.units import alone, make_units

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class StudyRun:
    """What a run did.

    Parameters
    ----------
    folder : Path
        Where the results are.
    total : int
        Cases of the study.
    kept : int
        Cases that were finished before.
    computed : int
        Cases that this run finished.
    failed : tuple of (dict, str)
        Factors and message of each case that failed.
    lost_workers : int
        How often a worker ended without a word.
    wall_s : float
        How long the run took.
    """

    folder: Path
    total: int
    kept: int
    computed: int
    failed: tuple[tuple[Json, str], ...]
    lost_workers: int
    wall_s: float


def manifest_of(plan: Plan) -> Json:
    """Describe a plan: what is computed and with what. The same plan gives the same description."""
    study = plan.loaded.study
    return {
        "name": study.name,
        "description": study.description,
        "seed": study.seed,
        "realizations": study.realizations,
        "policies": list(study.policies),
        "design": study.design.model_dump(mode="json"),
        "settings": {
            "on_infeasible": study.on_infeasible,
            "keep_trajectories": study.keep_trajectories,
            "grid": study.grid.model_dump(mode="json"),
            "closed_loop": study.closed_loop.model_dump(mode="json"),
        },
        "packages": numeric_versions(),
        "python": platform.python_version(),
        "code_sha256": code_digest(),
        "study_sha256": digest(plan.loaded.text),
        "cases": [{"key": case.key, "factors": dict(case.factors)} for case in plan.cases],
    }


def where_it_stands(plan: Plan, folder: Path) -> Standing:
    """Compare a plan with what a folder holds, without touching it.

    Raises
    ------
    StoreError
        If the folder holds something that is no study.
    """
    return standing(plan, folder, check_folder(folder, resume=True), manifest_of(plan))


def run_study(
    study: LoadedStudy | Plan | Path | str,
    out: Path | str,
    *,
    jobs: int = 2,
    dask: str | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> StudyRun:
    """Compute every case of a study that a folder does not hold yet.

    Parameters
    ----------
    study : LoadedStudy, Plan, Path or str
        The study, or its file.
    out : Path or str
        The folder of the results: absent or empty, or to be resumed.
    jobs : int
        Processes of this machine. The results do not depend on it.
    dask : str, optional
        Address of a dask scheduler, whose workers compute instead.
    resume : bool
        Go on with what the folder holds.
    progress : callable, optional
        Called with the number of cases that have ended and of all that this run computes.

    Returns
    -------
    StudyRun
        With the cases that failed; they are recorded in the folder, and tried again by the next run.

    Raises
    ------
    StudyError
        If the study cannot be run, or the scheduler is gone.
    StoreError
        If the folder cannot be used, or another run writes to it.
    KeyboardInterrupt
        As it came; what is finished is kept, and nothing is left half done.
    """
    if jobs < 1:
        raise StudyError(f"{jobs} jobs were asked for; give at least 1")
    plan = study if isinstance(study, Plan) else make_plan(_loaded(study))
    folder, started = Path(out).expanduser().absolute(), time.perf_counter()
    before = check_folder(folder, resume)
    make_folder(folder)
    with locked(folder):
        clean(folder)
        manifest = manifest_of(plan)
        found = standing(plan, folder, before, manifest)
        write_study(folder, plan.loaded.text, manifest)
        todo = (*found.redo, *found.new, *found.failed)
        run = _Run(folder, len(todo), progress)
        if todo:
            pool: Pool = LocalPool(jobs) if dask is None else DaskPool(dask)
            run.drain(pool, make_units(plan, _in_order(plan, todo), max(jobs, pool.width)))
        write_tables(read_study(folder))
    return StudyRun(
        folder=folder,
        total=len(plan.cases),
        kept=len(found.done),
        computed=run.ended - len(run.failed),
        failed=tuple(run.failed),
        lost_workers=run.lost,
        wall_s=time.perf_counter() - started,
    )


def _loaded(study: LoadedStudy | Path | str) -> LoadedStudy:
    return study if isinstance(study, LoadedStudy) else load_study(study)


def _in_order(plan: Plan, chosen: Sequence[PlannedCase]) -> list[PlannedCase]:
    keys = {case.key: case for case in chosen}
    return [keys.pop(case.key) for case in plan.cases if case.key in keys]


class _Run:
    """Keeps account of what has ended, and writes it down."""

    def __init__(self, folder: Path, total: int, progress: Progress | None) -> None:
        self.folder, self.total, self.progress = folder, total, progress
        self.ended, self.lost = 0, 0
        self.failed: list[tuple[Json, str]] = []

    def drain(self, pool: Pool, units: Sequence[WorkUnit]) -> None:
        """Compute all units, whatever becomes of single ones."""
        waiting: deque[WorkUnit] = deque(units)
        flying: dict[Future[list[Outcome]], WorkUnit] = {}
        self._tell()
        try:
            while waiting or flying:
                suspects = self._hand_out(pool, waiting, flying)
                if flying:
                    ended, _ = wait(flying, return_when=FIRST_COMPLETED)
                    suspects += self._collect(pool, ended, flying)
                if suspects:
                    # Where one worker of this machine dies, joblib ends the others: nobody knows whose fault.
                    suspects += (
                        self._collect(pool, list(flying), flying) if isinstance(pool, LocalPool) else []
                    )
                    self.lost += 1
                    pool.renew()
                    self._one_by_one(pool, suspects)
        except BaseException:
            pool.close(at_once=True)
            raise
        pool.close()

    def _hand_out(self, pool: Pool, waiting: deque[WorkUnit], flying: dict[Any, WorkUnit]) -> list[WorkUnit]:
        width = pool.width
        while waiting and len(flying) < width:
            unit = waiting.popleft()
            try:
                flying[pool.submit(unit)] = unit
            except WorkerLost:
                return [unit]
        return []

    def _collect(self, pool: Pool, ended: Any, flying: dict[Any, WorkUnit]) -> list[WorkUnit]:
        """Write down what has ended; return the units whose worker was lost."""
        lost = []
        for future in ended:
            unit = flying.pop(future)
            try:
                self._record(unit, pool.result(future))
            except WorkerLost:
                lost.append(unit)
        return lost

    def _one_by_one(self, pool: Pool, units: Sequence[WorkUnit]) -> None:
        """Compute the cases of units whose worker was lost, each by itself; who loses it again has failed."""
        for unit in (single for several in units for single in alone(several)):
            try:
                self._record(unit, pool.alone(unit))
            except WorkerLost as error:
                self.lost += 1
                failure = {"kind": "WorkerLost", "message": str(error)}
                self._record(
                    unit, [Outcome(unit.cases[0].key, None, failure, {"wall_s": 0.0, "solve_s": {}})]
                )

    def _record(self, unit: WorkUnit, outcomes: Sequence[Outcome]) -> None:
        for case, outcome in zip(unit.cases, outcomes, strict=True):
            write_outcome(self.folder, case, outcome)
            self.ended += 1
            if outcome.error is not None:
                self.failed.append((dict(case.factors), outcome.error["message"]))
        self._tell()

    def _tell(self) -> None:
        if self.progress is not None:
            self.progress(self.ended, self.total)

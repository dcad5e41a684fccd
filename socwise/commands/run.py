"""``socwise run``: studies at scale."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from socwise.commands.errors import CommandError
from socwise.commands.options import DEFAULT_JOBS, JsonOption
from socwise.commands.screen import complain, show, show_json

if TYPE_CHECKING:
    from socwise.study import Plan, StudyRun

FAILED, INTERRUPTED = 1, 130
_MOST_FAILURES = 10


def run(
    study: Annotated[
        Path | None, typer.Argument(metavar="STUDY.toml", help="The study.", show_default=False)
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for results.", show_default="results/NAME of the study"),
    ] = None,
    jobs: Annotated[
        int,
        typer.Option(min=1, metavar="N", help="Processes that compute; the results do not depend on it."),
    ] = DEFAULT_JOBS,
    dask: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Scheduler of a dask cluster that computes instead."),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", metavar="", help="Go on with what the folder holds.")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", metavar="", help="Show cases, memory and time; compute nothing.")
    ] = False,
    schema: Annotated[
        bool, typer.Option("--schema", metavar="", help="Print the JSON Schema of study files.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Run a study: many comparisons as data, each kept as soon as it is finished.

    Exit code 1 if cases failed; they are recorded, and --resume tries them again.
    """
    if schema:
        from socwise.study.schema import json_schema

        show_json(json_schema())
        return
    if study is None:
        raise CommandError(
            "name a study, a TOML file; docs/examples and `socwise run --schema` say what is in it"
        )
    from socwise.study.loading import load_study
    from socwise.study.plan import make_plan

    plan = make_plan(load_study(study))
    folder = out or Path("results") / plan.loaded.study.name
    if dry_run:
        _preview(plan, folder, jobs, dask, as_json=as_json)
        return
    _run(study, plan, folder, jobs, dask, resume=resume, as_json=as_json)


def _run(
    study: Path, plan: Plan, folder: Path, jobs: int, dask: str | None, *, resume: bool, as_json: bool
) -> None:
    from socwise.commands.run_screen import study_progress
    from socwise.study.folder import check_folder
    from socwise.study.running import run_study, where_it_stands

    check_folder(folder, resume)
    for sentence in where_it_stands(plan, folder).sentences:
        complain(sentence)
    try:
        with study_progress(plan.loaded.study.name) as advance:
            done = run_study(plan, folder, jobs=jobs, dask=dask, resume=resume, progress=advance)
    except KeyboardInterrupt:
        complain(_how_to_go_on(study, plan, folder))
        raise typer.Exit(INTERRUPTED) from None
    _show(done, as_json=as_json)
    if done.failed:
        raise typer.Exit(FAILED)


def _how_to_go_on(study: Path, plan: Plan, folder: Path) -> str:
    from socwise.study.layout import case_file

    keys = {case.key for case in plan.cases}
    finished = sum(case_file(folder, key).is_file() for key in keys)
    return (
        f"{finished} of {len(keys)} cases are finished and kept; go on with"
        f" `socwise run {study} --out {folder} --resume`"
    )


def _show(done: StudyRun, *, as_json: bool) -> None:
    if as_json:
        show_json(
            {
                "schema": 1,
                "folder": str(done.folder),
                "cases": done.total,
                "kept": done.kept,
                "computed": done.computed,
                "failed": [{"factors": factors, "error": message} for factors, message in done.failed],
                "lost_workers": done.lost_workers,
                "wall_s": done.wall_s,
            }
        )
        return
    for factors, message in done.failed[:_MOST_FAILURES]:
        complain(f"failed: {_point(factors)}: {message}")
    if len(done.failed) > _MOST_FAILURES:
        complain(f"and {len(done.failed) - _MOST_FAILURES} more failed; {done.folder / 'cases'} has them all")
    kept = f", {done.kept} were there" if done.kept else ""
    failed = f", {len(done.failed)} failed" if done.failed else ""
    lost = f" A worker ended without a word {done.lost_workers} times." if done.lost_workers else ""
    show(
        f"{done.computed} of {done.total} cases computed in {_duration(done.wall_s)}{kept}{failed}.{lost}",
        f"Results are in {done.folder}: summary.csv, paired.csv, and a file for each case in cases.",
    )


def _preview(plan: Plan, folder: Path, jobs: int, dask: str | None, *, as_json: bool) -> None:
    from socwise.study.estimate import estimate
    from socwise.study.pool import DaskPool
    from socwise.study.running import where_it_stands
    from socwise.study.units import count_solves, make_units

    stands = where_it_stands(plan, folder)
    todo = {case.key for case in (*stands.redo, *stands.new, *stands.failed)}
    workers = jobs
    if dask is not None:
        cluster = DaskPool(dask)
        workers = cluster.threads
        cluster.close()
    cases = [case for case in plan.cases if case.key in todo]
    units = make_units(plan, list({case.key: case for case in cases}.values()), workers)
    shared, single = count_solves(units)
    guess = estimate(units, workers)
    states = {case.key: name for name in ("done", "failed", "redo", "new") for case in getattr(stands, name)}
    if as_json:
        show_json(
            {
                "schema": 1,
                "study": plan.loaded.study.name,
                "folder": str(folder),
                "cases": [
                    {"key": case.key, "state": states[case.key], "factors": dict(case.factors)}
                    for case in plan.cases
                ],
                "no_longer": [entry["key"] for entry in stands.gone],
                "changed": list(stands.changed),
                "solves": {"needed": shared, "without_sharing": single},
                "workers": workers,
                "estimate": {
                    "wall_s": guess.wall_s,
                    "busy_s": guess.busy_s,
                    "memory_MB_per_process": guess.memory_MB,
                    "cases_left_out": guess.left_out,
                },
            }
        )
        return
    from socwise.commands.run_screen import cases_table

    show(cases_table(plan, states), "")
    for sentence in stands.sentences:
        show(sentence)
    counts = f"{len(plan.cases)} cases, {len(todo)} to be computed"
    show(
        f"{counts}: {shared} solves, of {single} if no case shared one, in {len(units)} pieces for"
        f" {workers} {'worker' if workers == 1 else 'workers'}."
    )
    if len(units) and guess.busy_s:
        where = (
            "as if the cluster's machines were this one" if dask else "on this machine, from a short trial"
        )
        show(
            f"Estimate, {where}: {_duration(guess.wall_s)}, {guess.memory_MB:.0f} MB for each process."
            + (
                f" {guess.left_out} cases with a closed loop or traffic are not in it."
                if guess.left_out
                else ""
            )
        )
    elif guess.left_out:
        show(f"No estimate: {guess.left_out} cases have a closed loop or traffic.")
    show(f"Results would go to {folder}")


def _point(factors: Any) -> str:
    return ", ".join(f"{name} = {value}" for name, value in factors.items())


def _duration(seconds: float) -> str:
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    if seconds < 6000.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"

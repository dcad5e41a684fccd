"""Run tables and figures one after another; one that fails is recorded and stops no other."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path

from socwise import reproduce
from socwise.gallery.entry import Entry, load, save
from socwise.gallery.state import state_digest
from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import Progress

KEPT = "items"

Bar = Callable[[str], AbstractContextManager[Progress | None]]


def collect(
    items: Sequence[str],
    out: Path,
    *,
    jobs: int = 2,
    resume: bool = False,
    keep: bool = True,
    bar: Bar | None = None,
    complain: Callable[[str], None] | None = None,
) -> Iterator[Entry]:
    """Run items and write their pictures, and what is needed to go on where a killed run ended.

    Parameters
    ----------
    items : sequence of str
        Their ids.
    out : Path
        Folder for the pictures; created when the first is written.
    jobs : int
        Threads that compute.
    resume : bool
        Take over what an earlier run finished with the very same code, data and packages.
    keep : bool
        Write a file of each finished item into ``items`` of the folder.
    bar : callable, optional
        Given what is being done, a context that gives a progress function or None.
    complain : callable, optional
        Told of every item that fails, with its traceback.

    Yields
    ------
    Entry
        In the order of the items. One that failed has a row that is not as it should be.
    """
    state = state_digest() if keep or resume else ""
    for place, item in enumerate(items, 1):
        path = out / KEPT / f"{item}.json"
        entry = load(path, state) if resume else None
        if entry is None:
            with (bar or _silent)(f"{place}/{len(items)} {item}") as progress:
                entry = _run(item, out, jobs, progress, complain)
            if keep and not entry.failure:
                path.parent.mkdir(parents=True, exist_ok=True)
                save(entry, state, path)
        yield entry


def _silent(what: str) -> AbstractContextManager[Progress | None]:
    return nullcontext()


def _run(
    item: str, out: Path, jobs: int, progress: Progress | None, complain: Callable[[str], None] | None
) -> Entry:
    start = time.perf_counter()
    title = reproduce.title(item)
    found = Reproduction(item, "", ())
    figure: Path | None = None
    failure = ""
    try:
        found = reproduce.run(item, jobs=jobs, progress=progress)
        figure = found.write_figure(out)
    except Exception as error:
        # Whatever goes wrong in one item, the others are still worth having; the exit code tells.
        failure = f"{type(error).__name__}: {error}"
        rows = (*found.rows, Row.holds(f"it can be computed and drawn ({failure})", False, "failed"))
        found = Reproduction(item, found.source or item, rows, found.note)
        if complain is not None:
            complain(f"{item} failed\n{traceback.format_exc()}")
    # What draws holds all trajectories of the item.
    kept = replace(found, draw=None)
    return Entry(kept, title, None if figure is None else figure.name, failure, time.perf_counter() - start)

"""A worker's own affairs: one thread, its memory, and not to outlive the study that it works for."""

from __future__ import annotations

import os
import socket
import sys
import threading
import time
from dataclasses import replace

from socwise.study.digest import code_digest, numeric_versions
from socwise.study.task import Outcome, WorkUnit

THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)
"""What libraries read when they are loaded; a worker computes with one thread."""
WATCH_S = 0.5

_alone = threading.Lock()


def belong_to(study: int) -> None:
    """End this process when the process of the study ends, which a killed one cannot see to itself.

    Parameters
    ----------
    study : int
        Number of that process, the parent of this one. On Windows nothing is watched.
    """
    if os.name != "nt":
        threading.Thread(target=_watch, args=(study,), daemon=True, name="socwise-watch").start()


def work(unit: WorkUnit) -> list[Outcome]:
    """Compute a unit in a worker.

    Parameters
    ----------
    unit : WorkUnit
        What to compute.

    Returns
    -------
    list of Outcome
        One for each case. Where the worker's code is not that of the plan, all of them are errors.
    """
    if code_digest() != unit.code:
        return [_stranger(case.key) for case in unit.cases]
    from socwise.study.compute import compute

    # Warnings are collected for each case, which threads side by side would mix up.
    with _alone:
        return [replace(one, timing={**one.timing, **_where()}) for one in compute(unit)]


def _watch(study: int) -> None:
    # Whoever inherits the children of a process that was killed has another number.
    while os.getppid() == study:
        time.sleep(WATCH_S)
    os._exit(1)


def _where() -> dict[str, object]:
    return {"peak_rss_MB": round(peak_rss_MB(), 1), "host": socket.gethostname(), "process": os.getpid()}


def peak_rss_MB() -> float:
    """Return the most memory that this process has had so far, in MB; zero where the system does not say."""
    try:
        import resource
    except ImportError:
        return 0.0
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / 1e6 if sys.platform == "darwin" else most * 1024 / 1e6


def _stranger(key: str) -> Outcome:
    return Outcome(
        key,
        None,
        {
            "kind": "StudyError",
            "message": f"the worker on {socket.gethostname()} runs other code than the study (socwise"
            f" {numeric_versions()['socwise']} there); install the same version everywhere",
        },
        {"wall_s": 0.0, "solve_s": {}},
    )

"""What a worker does to itself before it loads somebody else's code: limits, and not outliving its parent.

Containment of faults, not a sandbox: the FMU runs with the rights of the user. Linux holds all of it. Where
there is no `resource` module (Windows) memory and files are not limited, and a worker notices that its parent
has gone only when it next waits for a request: one that hangs inside the FMU then has to be ended by hand.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import select
import signal
import sys
import threading
import time
from pathlib import Path

from bms.plants.fmu.limits import Limits

try:
    import resource
except ImportError:
    HAS_LIMITS = False
else:
    HAS_LIMITS = True

PR_SET_PDEATHSIG = 1
NO_CORE_DUMP = 1
"""Bytes: too few for a file, and where Linux pipes cores to a handler, 1 prevents it and 0 does not."""
LOOK_AFTER_PARENT_MS = 1000


def take_pipes() -> tuple[int, int]:
    """Move requests and answers away from where the FMU prints; what it prints goes to the log.

    Returns
    -------
    requests, answers : int
        Descriptors that no program started by the FMU inherits.
    """
    requests, answers = os.dup(0), os.dup(1)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    return requests, answers


def limit_itself(limits: Limits) -> None:
    """Hold the process to its limits from now on, where the platform can."""
    if HAS_LIMITS:
        _lower(resource.RLIMIT_CORE, NO_CORE_DUMP)
        if limits.file_bytes is not None:
            _lower(resource.RLIMIT_FSIZE, limits.file_bytes)
        if limits.memory_bytes is not None:
            _lower(resource.RLIMIT_AS, _address_space_bytes() + limits.memory_bytes)
    # Out of memory, the system should take this process, not the study.
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000", encoding="ascii")


def follow_parent(parent: int, requests: int, patience_s: float, at_once: bool) -> None:
    """End this process, and what it started, when the parent has gone, whatever the FMU is doing.

    Parameters
    ----------
    parent : int
        Its process id, as it was when this process began.
    requests : int
        The pipe that it closes at the end.
    patience_s : float
        Time to end by itself after the pipe was closed.
    at_once : bool
        Let Linux kill this process together with the thread that started it; only for a parent's main thread,
        as others may end before.
    """
    if at_once and sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if hasattr(select, "poll"):
        threading.Thread(target=_watch, args=(parent, requests, patience_s), daemon=True).start()


def _watch(parent: int, requests: int, patience_s: float) -> None:
    pipe = select.poll()
    pipe.register(requests, 0)
    while os.getppid() == parent and not pipe.poll(LOOK_AFTER_PARENT_MS):
        pass
    time.sleep(patience_s)
    end_group()


def end_group() -> None:
    """Kill this process and what it started; it leads its group."""
    if hasattr(os, "killpg"):
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


def _lower(which: int, value: int) -> None:
    """Lower a limit; a hard limit that is lower already stays."""
    _, hard = resource.getrlimit(which)
    value = value if hard == resource.RLIM_INFINITY else min(value, hard)
    # Some systems refuse single limits (macOS: address space); the others are still worth having.
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(which, (value, value))


def _address_space_bytes() -> int:
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    except (OSError, ValueError):
        return 0
    return pages * resource.getpagesize()

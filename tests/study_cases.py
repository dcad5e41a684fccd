"""Small studies: a trip of a minute on coarse grids, so that a case takes some hundredths of a second."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from command_line import write_cycle

from socwise.study.lock import is_running

ROOT = Path(__file__).parents[1]

HEAD = """
name = "tiny"
realizations = 4
policies = ["stochastic", "certainty_equivalent"]

[grid]
soc_step = 0.02
deterministic_soc_step = 0.02
torque_levels = 3
"""

EIGHT = """
[factors]
concept = ["hev", "phev"]
cycle = "hill.csv"
mu = [1e-3, 4e-3]
penalty_steepness = [0.1, 1]
"""

MANY = """
[factors]
concept = ["hev", "phev"]
cycle = "hill.csv"
mu = {low = 1e-4, high = 1e-2, count = 4, scale = "log"}
penalty_steepness = {low = 0.1, high = 10, count = 5, scale = "log"}
"""


def write_study(folder, factors=EIGHT, head=HEAD, name="study.toml"):
    """Write a study and the trip that it names; return the study's path."""
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / "hill.csv").exists():
        write_cycle(folder / "hill.csv")
    path = folder / name
    path.write_text(head + factors, encoding="utf-8")
    return path


def results(folder):
    """Return the bytes of every file of a study's folder, timings aside."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.relative_to(folder).parts[0] != "timings"
    }


def start(*arguments):
    """Start ``socwise run`` in a process of its own."""
    command = [sys.executable, "-m", "socwise", "run", *(str(argument) for argument in arguments)]
    return subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=_listen
    )


def _listen():
    """Hear interrupts, even where the tests themselves were started without ears for them."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def finished(folder):
    """Return the names of the finished cases."""
    return {path.name for path in (folder / "cases").glob("[!.]*.json") if ".error." not in path.name}


def wait_for(condition, seconds=60.0, what="that"):
    """Wait until something is so.

    Raises
    ------
    TimeoutError
        If it is not within the time.
    """
    until = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > until:
            raise TimeoutError(f"waited {seconds:g} s for {what}")
        time.sleep(0.005)


def children(process):
    """Return the processes that a process has started and that still run (Linux)."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[1]) == process and fields[0] != "Z":
                found.append(int(entry.name))
    return found


def gone(processes):
    """Whether none of some processes runs any more."""
    return not any(is_running(one) for one in processes)


class Suicide:
    """Ends the process that it is sent to, as running out of memory would: what a pickle says is done."""

    def __reduce__(self):
        return os._exit, (9,)

"""A worker seen from its parent: started without forking, asked before a deadline, always buried.

The worker is a fresh interpreter and leads a process group of its own, so that Ctrl-C at the terminal reaches
the parent alone and that ending the worker ends what the FMU started as well. It is reaped whatever happens:
when the parent closes it, drops it, ends, or is interrupted.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
import weakref
from pathlib import Path
from subprocess import PIPE, Popen

import bms
import bms.plants
from bms.plants.fmu import protocol
from bms.plants.fmu.errors import FmuError
from bms.plants.fmu.limits import Limits
from bms.plants.fmu.obituary import cause_of_death, last_lines
from bms.plants.fmu.pipes import Pipes, pipes_of

BOOT = """
import json, sys, types
path, packages, at_once = json.loads(sys.argv[1])
sys.path[:] = path
for name, folders in packages.items():
    sys.modules[name] = types.ModuleType(name)
    sys.modules[name].__path__ = folders
from bms.plants.fmu.worker import main
main(at_once)
"""
"""The packages above ours are entered without running them: they would import compilers that no FMU needs."""

DYING_S = 1.0
"""A process that has closed its pipes is given so long to be gone."""
BURIAL_S = 5.0
"""What was killed is waited for no longer."""
LAST_WORDS_S = 0.2
"""What the FMU started may hold the log open; it is waited for no longer."""


class WorkerLostError(Exception):
    """The worker gave no answer; says what became of it and quotes its log."""


class WorkerProcess:
    """A running worker.

    Parameters
    ----------
    folder : Path
        Its working folder: the unpacked FMU, so that what the FMU writes beside itself goes with it.
    limits : Limits
        Only the time to close is used here.
    """

    def __init__(self, folder: Path, limits: Limits) -> None:
        self._process = _start(folder)
        self._pipes = pipes_of(self._process)
        self._end = weakref.finalize(
            self, _end, self._process, self._pipes, limits.close_deadline_s, os.getpid()
        )

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    def ask(self, request: bytes, deadline_s: float) -> bytes:
        """Send a request and wait for the whole answer.

        Parameters
        ----------
        request : bytes
            See `bms.plants.fmu.protocol`.
        deadline_s : float
            From now.

        Raises
        ------
        WorkerLostError
            The worker died, gave no answer in time, or none that can be read; it is buried then.
        """
        try:
            return self._ask(request, deadline_s)
        except BrokenPipeError:
            raise self._lost(b"") from None
        except BaseException:
            # An answer that nobody waits for any more would be taken for that to the next request.
            self.kill()
            raise

    def _ask(self, request: bytes, deadline_s: float) -> bytes:
        self._pipes.send(request)
        data = self._pipes.receive(deadline_s)
        if not data:
            raise self._lost(data, deadline_s)
        size = protocol.answer_bytes(data)
        if size == len(data):
            return data
        due_s = time.monotonic() + deadline_s
        while len(data) < size:
            more = self._pipes.receive(max(due_s - time.monotonic(), 0.0))
            if not more:
                raise self._lost(more, deadline_s)
            data += more
            size = protocol.answer_bytes(data)
        if size != len(data):
            self.kill()
            raise WorkerLostError("its process answered what is no answer; the FMU wrote where it must not")
        return data

    def forget_log(self) -> None:
        """Quote only what the FMU says from now on."""
        self._pipes.forget_log()

    def close(self) -> None:
        """Let the FMU free itself, and end the process."""
        self._end()

    def kill(self) -> None:
        """End the process at once."""
        if self._end.detach():
            _bury(self._process, self._pipes)

    def _lost(self, data: bytes | None, deadline_s: float = 0.0) -> WorkerLostError:
        died = _wait_for_death(self._process, 0.0 if data is None else DYING_S)
        self.kill()
        if died and self._process.returncode != protocol.BROKEN:
            how = f"its process ended: {cause_of_death(self._process.returncode)}"
        elif data is None:
            how = f"it gave no answer within {deadline_s:g} s and was killed"
        else:
            how = "it closed its process's pipe to this one, or did other harm to what carries it"
        log = last_lines(self._pipes.log)
        return WorkerLostError(f"{how}; its log ends: {log}" if log else how)


def _start(folder: Path) -> Popen[bytes]:
    if not sys.executable:
        raise FmuError("there is no Python interpreter to start for the FMU here; use isolate=False")
    path = [str(Path(entry).absolute()) for entry in sys.path]
    packages = {package.__name__: [*package.__path__] for package in (bms, bms.plants)}
    in_main = threading.current_thread() is threading.main_thread()
    arguments = json.dumps([path, packages, in_main])
    # NumPy's linear algebra reserves memory per thread, which would count against the FMU's.
    environment = {"OPENBLAS_NUM_THREADS": "1", **os.environ}
    own_group = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
    try:
        return Popen(
            [sys.executable, "-P", "-W", "ignore", "-c", BOOT, arguments],
            bufsize=0,
            stdin=PIPE,
            stdout=PIPE,
            stderr=PIPE,
            cwd=folder,
            env=environment,
            start_new_session=True,
            creationflags=own_group,
        )
    except OSError as error:
        raise FmuError(
            f"no process can be started for the FMU: {error}; end others, or use isolate=False"
        ) from error


def _end(process: Popen[bytes], pipes: Pipes, patience_s: float, owner: int) -> None:
    """Ask a worker to end, wait, bury it."""
    if os.getpid() != owner:
        # A fork has a copy of the handle; the worker is not its to end.
        return
    try:
        # A fork of this process may hold the pipe open as well, so closing it alone may say nothing.
        with contextlib.suppress(BrokenPipeError):
            pipes.send(protocol.REQUEST.pack(protocol.END, 0, 0.0))
        pipes.hang_up()
        due_s = time.monotonic() + patience_s
        while pipes.receive(max(due_s - time.monotonic(), 0.0)):
            pass
        _wait_for_death(process, max(due_s - time.monotonic(), 0.0))
    finally:
        _bury(process, pipes)


def _bury(process: Popen[bytes], pipes: Pipes) -> None:
    """Kill what is left of the group, then reap; not the other way round, as the number may be reused."""
    try:
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
    except OSError:
        pass
    # One that is stuck in the kernel, say on a file server, is left for it to end.
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(BURIAL_S)
    pipes.close(LAST_WORDS_S)


def _wait_for_death(process: Popen[bytes], patience_s: float) -> bool:
    """Whether a process has ended, without reaping it where the platform can."""
    due_s = time.monotonic() + patience_s
    while not _is_dead(process):
        if time.monotonic() >= due_s:
            return False
        time.sleep(1e-3)
    return True


def _is_dead(process: Popen[bytes]) -> bool:
    if not hasattr(os, "waitid"):
        return process.poll() is not None
    try:
        return os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
    except ChildProcessError:
        return True

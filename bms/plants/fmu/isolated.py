"""An FMU in a child process: what it does to itself ends one realization, never the study.

A `Channel` like the one in process. A realization that crashes, hangs or refuses to go on raises `FmuCrash`;
the next `start` gets a fresh worker. Containment of faults, not a sandbox against malice: see docs/fmu.md.
"""

from __future__ import annotations

from pathlib import Path
from typing import final

from bms.plants.fmu import protocol
from bms.plants.fmu.channel import Wiring
from bms.plants.fmu.errors import FmuCrash, FmuError
from bms.plants.fmu.limits import Limits
from bms.plants.fmu.process import WorkerLostError, WorkerProcess

__all__ = ["IsolatedChannel", "Limits"]

HEAD = protocol.ANSWER.size
STEP = protocol.REQUEST.pack


@final
class IsolatedChannel:
    """A running FMU in a process of its own, see `bms.plants.fmu.channel.Channel`; for one thread at a time.

    Parameters
    ----------
    folder : Path
        The unpacked FMU; also the working folder of the process.
    wiring : Wiring
        What it is connected to.
    limits : Limits
        What it may take.

    Raises
    ------
    FmuError
        The FMU cannot be opened as asked.
    FmuCrash
        It does not survive being loaded.
    """

    def __init__(self, folder: Path, wiring: Wiring, limits: Limits | None = None) -> None:
        self._folder = folder.absolute()
        self._wiring = wiring
        self._limits = Limits() if limits is None else limits
        self._closed = False
        self._stage = ""
        self._before = self._after = 0
        self._worker: WorkerProcess | None = None
        self._open()

    @property
    def pid(self) -> int | None:
        """Process id of the worker; None where a crash ended it and no realization has started since."""
        return None if self._worker is None else self._worker.pid

    def start(self, values: tuple[float, ...]) -> tuple[float, ...]:
        """Begin a realization at time zero, see `Channel.start`; with a fresh worker after a crash."""
        if self._closed:
            raise FmuError("this FMU has been closed; open it again")
        worker = self._worker or self._open()
        worker.forget_log()
        self._stage = "when it was initialised"
        self._after = 0
        outputs = self._ask(worker, protocol.start_request(values), self._limits.start_deadline_s)
        self._stage = ""
        return outputs

    def step(self, value: float, steps: int) -> tuple[float, ...]:
        """Hold the input over a number of communication steps, see `Channel.step`."""
        worker = self._worker
        if worker is None or self._stage:
            raise FmuError("no realization is running in this FMU; start one first")
        self._before, self._after = self._after, self._after + steps
        return self._ask(worker, STEP(protocol.STEP, steps, value), self._limits.step_deadline_s)

    def renew(self) -> None:
        """Have the next `start` begin with a fresh worker, for an FMU that nothing else restores."""
        if self._worker is not None:
            self._worker.close()
            self._worker = None

    def close(self) -> None:
        """End the worker; it may be called twice."""
        self._closed = True
        self.renew()

    def _open(self) -> WorkerProcess:
        worker = self._worker = WorkerProcess(self._folder, self._limits)
        self._stage = "when it was loaded"
        request = protocol.open_request(self._folder, self._wiring, self._limits)
        try:
            self._ask(worker, request, self._limits.start_deadline_s)
        except FmuError:
            worker.kill()
            self._worker = None
            raise
        return worker

    def _ask(self, worker: WorkerProcess, request: bytes, deadline_s: float) -> tuple[float, ...]:
        try:
            answer = worker.ask(request, deadline_s)
        except WorkerLostError as error:
            self._worker = None
            raise FmuCrash(f"the FMU crashed {self._when()}: {error}") from None
        except BaseException:
            self._worker = None
            raise
        if answer[0] == protocol.OUTPUTS:
            return protocol.numbers_from_bytes(answer, HEAD)
        text = answer[HEAD:].decode("utf-8", "replace")
        if answer[0] == protocol.REFUSED:
            raise FmuError(text)
        # What is left of the instance may crash or hang when it is freed.
        worker.kill()
        self._worker = None
        raise FmuCrash(text)

    def _when(self) -> str:
        step_s = self._wiring.step_s
        return self._stage or f"in the step from {self._before * step_s:g} s to {self._after * step_s:g} s"

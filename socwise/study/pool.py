"""Who computes: joblib's processes on this machine (loky), or the workers of a dask scheduler.

Both are executors of `concurrent.futures`, so that one loop (`socwise.study.running`) serves both. joblib's
``Parallel`` is not used on top: it does not tell which task a dead worker had, and with a dask backend it
waits for ever for the result of one.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager, suppress
from typing import Any, Protocol

from socwise.study.errors import StudyError
from socwise.study.task import Outcome, WorkUnit
from socwise.study.worker import THREADS, belong_to, work

IDLE_S = 20
CONNECT_S = 10
SETTLE_S = 1.0
QUEUED = 2
"""Units per thread of a cluster that are handed out, so that none waits for the next."""


class WorkerLost(Exception):  # noqa: N818
    """A worker ended, or cannot be used, while it had a unit; the message says what is known."""


class Pool(Protocol):
    """Computes units."""

    @property
    def width(self) -> int:
        """How many units are handed out at a time."""

    def submit(self, unit: WorkUnit) -> Future[list[Outcome]]:
        """Hand out a unit.

        Raises
        ------
        WorkerLost
            If the pool has broken down.
        """

    def result(self, future: Future[list[Outcome]]) -> list[Outcome]:
        """Return what came out of a unit that has ended.

        Raises
        ------
        WorkerLost
            If its worker did not live to say.
        """

    def alone(self, unit: WorkUnit) -> list[Outcome]:
        """Compute a unit whose worker was lost once more, where it can harm no other.

        Raises
        ------
        WorkerLost
            If this worker is lost, too.
        """

    def renew(self) -> None:
        """Replace what has broken down."""

    def close(self, at_once: bool = False) -> None:
        """Let the workers go, at once if what they compute does not matter any more."""


class LocalPool:
    """Processes of this machine, each with one thread; they end when this process does."""

    died = "the process that computed it ended without a word: it was killed, or memory ran out"

    def __init__(self, jobs: int) -> None:
        self.width = jobs
        self._executor = self._start()
        self._single: Any = None
        self._last: Future[list[Outcome]] | None = None

    def submit(self, unit: WorkUnit) -> Future[list[Outcome]]:
        """See `Pool.submit`."""
        from joblib.externals.loky.process_executor import BrokenProcessPool, ShutdownExecutorError

        try:
            with _without_interrupts():
                found: Future[list[Outcome]] = self._executor.submit(work, unit)
                self._last = found
        except (BrokenProcessPool, ShutdownExecutorError) as error:
            raise WorkerLost(self.died) from error
        return found

    def result(self, future: Future[list[Outcome]]) -> list[Outcome]:
        """See `Pool.result`."""
        from joblib.externals.loky.process_executor import BrokenProcessPool

        try:
            return future.result()
        except (BrokenProcessPool, CancelledError) as error:
            raise WorkerLost(self.died) from error

    def alone(self, unit: WorkUnit) -> list[Outcome]:
        """See `Pool.alone`."""
        from joblib.externals.loky import ProcessPoolExecutor

        with _without_interrupts():
            if self._single is None:
                self._single = ProcessPoolExecutor(1, **self._options())
            future = self._single.submit(work, unit)
        try:
            return self.result(future)
        except WorkerLost:
            self._end_single()
            raise

    def renew(self) -> None:
        """See `Pool.renew`."""
        self.close(at_once=True)
        self._executor = self._start()

    def close(self, at_once: bool = False) -> None:
        """See `Pool.close`; those that are idle end by themselves, unless the next study wants them."""
        self._end_single()
        if at_once:
            self._settle()
            self._executor.shutdown(wait=True, kill_workers=True)

    def _settle(self) -> None:
        """Wait until the last unit is on its way: loky stumbles over one that is taken back before."""
        until = time.monotonic() + SETTLE_S
        while self._last and not (self._last.running() or self._last.done()) and time.monotonic() < until:
            time.sleep(0.001)

    def _end_single(self) -> None:
        if self._single is not None:
            self._single.shutdown(wait=True, kill_workers=True)
        self._single = None

    def _start(self) -> Any:
        # Through joblib, not loky: Parallel, later in this process, would else take over what is not its own.
        from joblib.executor import get_memmapping_executor

        with _without_interrupts():
            return get_memmapping_executor(self.width, **self._options())

    @staticmethod
    def _options() -> dict[str, Any]:
        return {
            "timeout": IDLE_S,
            "initializer": belong_to,
            "initargs": (os.getpid(),),
            "env": dict.fromkeys(THREADS, "1"),
        }


class DaskPool:
    """Workers of a dask scheduler that somebody else started.

    Raises
    ------
    StudyError
        If dask is not installed, or nobody answers at the address.
    """

    def __init__(self, address: str) -> None:
        try:
            import distributed
        except ImportError as error:
            raise StudyError(
                "--dask takes the package distributed; pip install 'socwise[cluster]'"
            ) from error
        self._address = address
        # Its functions are untyped.
        library: Any = distributed
        try:
            self._client = library.Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise StudyError(
                f"no dask scheduler answers at {address!r} ({error}); give the address that it prints when it"
                " starts, such as tcp://10.0.0.1:8786"
            ) from error
        self._executor = self._client.get_executor(pure=False)

    @property
    def width(self) -> int:
        """See `Pool.width`; a cluster may grow and shrink."""
        return QUEUED * self.threads

    @property
    def threads(self) -> int:
        """Threads of all workers, at least one."""
        return max(1, sum(int(count) for count in self._client.ncores().values()))

    def submit(self, unit: WorkUnit) -> Future[list[Outcome]]:
        """See `Pool.submit`."""
        found: Future[list[Outcome]] = self._executor.submit(work, unit)
        return found

    def result(self, future: Future[list[Outcome]]) -> list[Outcome]:
        """See `Pool.result`.

        Raises
        ------
        WorkerLost
            If the scheduler gave up on it.
        StudyError
            If the scheduler is gone, or a worker has no socwise.
        """
        from distributed import KilledWorker

        try:
            return future.result()
        except KilledWorker as error:
            raise WorkerLost(
                "the workers that computed it ended without a word: they were killed, or memory ran out"
            ) from error
        except CancelledError as error:
            raise StudyError(
                f"the dask scheduler at {self._address} is gone; what is finished is kept, --resume goes on"
            ) from error
        except ImportError as error:
            raise StudyError(
                f"a worker of {self._address} cannot load socwise ({error}); install the same version there"
            ) from error

    def alone(self, unit: WorkUnit) -> list[Outcome]:
        """See `Pool.alone`; the scheduler keeps units apart anyway."""
        return self.result(self.submit(unit))

    def renew(self) -> None:
        """See `Pool.renew`; a cluster renews itself."""

    def close(self, at_once: bool = False) -> None:
        """See `Pool.close`; what is under way is cancelled."""
        with suppress(Exception):
            self._executor.shutdown(wait=False)
        self._client.close()


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Keep SIGINT from the processes that a block starts; one that comes meanwhile is delivered after it.

    Ctrl-C reaches every process of a terminal. The workers inherit that they do not listen to it, and are
    ended by the process that does.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)

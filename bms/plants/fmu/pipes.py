"""The parent's ends of a worker's pipes: requests out, answers in before a deadline, the end of the log kept.

Whoever waits for the FMU empties its log meanwhile, so that a flood neither blocks the FMU nor fills memory.
`PolledPipes` waits for both at once; where pipes cannot be polled (Windows), `ThreadedPipes` has a thread for
each.
"""

from __future__ import annotations

import os
import queue
import select
import threading
import time
from subprocess import Popen
from typing import IO, Protocol

CHUNK = 65536
LOG_BYTES = 8192
"""What is kept of the log."""


class Pipes(Protocol):
    """Requests out, answers in."""

    log: bytes

    def send(self, request: bytes) -> None:
        """Write a request; BrokenPipeError where the worker is gone."""

    def receive(self, deadline_s: float) -> bytes | None:
        """Read what has come: at least a byte, none where the worker closed its end, None at the deadline."""

    def forget_log(self) -> None:
        """Drop what the log says so far."""

    def hang_up(self) -> None:
        """Close the requests, which asks the worker to end."""

    def close(self, patience_s: float) -> None:
        """Read the rest of the log and close; what the worker started may still hold its end of it."""


class PolledPipes:
    """Both pipes in one thread, by `poll`.

    Parameters
    ----------
    process : Popen
        Started with three unbuffered pipes: requests, answers, log.
    """

    def __init__(self, process: Popen[bytes]) -> None:
        self._files, (self._requests, self._answers, self._log) = _ends(process)
        self._both, self._only_log = select.poll(), select.poll()
        self._both.register(self._answers, select.POLLIN)
        self._both.register(self._log, select.POLLIN)
        self._only_log.register(self._log, select.POLLIN)
        self._log_open = True
        self.log = b""

    def send(self, request: bytes) -> None:
        """Write a request, see `Pipes.send`."""
        sent = os.write(self._requests, request)
        while sent < len(request):
            sent += os.write(self._requests, request[sent:])

    def receive(self, deadline_s: float) -> bytes | None:
        """Read what has come, see `Pipes.receive`."""
        ready = self._both.poll(deadline_s * 1e3)
        if len(ready) == 1 and ready[0][0] == self._answers:
            return os.read(self._answers, CHUNK)
        due_s = time.monotonic() + deadline_s
        while ready:
            if any(descriptor == self._answers for descriptor, _ in ready):
                return os.read(self._answers, CHUNK)
            self._read_log()
            ready = self._both.poll(max(due_s - time.monotonic(), 0.0) * 1e3)
        return None

    def forget_log(self) -> None:
        """Drop what the log says so far."""
        self._read_rest(0.0)
        self.log = b""

    def hang_up(self) -> None:
        """Close the requests, which asks the worker to end."""
        self._files[0].close()

    def close(self, patience_s: float) -> None:
        """Read the rest of the log and close, see `Pipes.close`."""
        self._read_rest(patience_s)
        for file in self._files:
            file.close()

    def _read_rest(self, patience_s: float) -> None:
        due_s = time.monotonic() + patience_s
        while self._log_open and self._only_log.poll(max(due_s - time.monotonic(), 0.0) * 1e3):
            self._read_log()

    def _read_log(self) -> None:
        more = os.read(self._log, CHUNK)
        self.log = (self.log + more)[-LOG_BYTES:]
        if not more:
            # The end of a file is always ready: waiting for it as well would be no waiting.
            self._log_open = False
            self._both.unregister(self._log)
            self._only_log.unregister(self._log)


class ThreadedPipes:
    """The same where pipes cannot be polled: one thread reads answers, another the log.

    Parameters
    ----------
    process : Popen
        Started with three unbuffered pipes: requests, answers, log.
    """

    def __init__(self, process: Popen[bytes]) -> None:
        self._files, (self._requests, self._answers, self._log) = _ends(process)
        self._come: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self.log = b""
        self._threads = [
            threading.Thread(target=read, daemon=True) for read in (self._read_answers, self._read_log)
        ]
        for thread in self._threads:
            thread.start()

    def send(self, request: bytes) -> None:
        """Write a request, see `Pipes.send`."""
        while request:
            request = request[os.write(self._requests, request) :]

    def receive(self, deadline_s: float) -> bytes | None:
        """Read what has come, see `Pipes.receive`."""
        try:
            come = self._come.get(timeout=deadline_s)
        except queue.Empty:
            return None
        if not come:
            self._come.put(come)
        return come

    def forget_log(self) -> None:
        """Drop what the log says so far."""
        self.log = b""

    def hang_up(self) -> None:
        """Close the requests, which asks the worker to end."""
        self._files[0].close()

    def close(self, patience_s: float) -> None:
        """Read the rest of the log and close, see `Pipes.close`."""
        for thread in self._threads:
            thread.join(patience_s)
        # Closing a pipe that a thread still waits for would wait for that thread.
        self._files[0].close()
        for file, thread in zip(self._files[1:], self._threads, strict=True):
            if not thread.is_alive():
                file.close()

    def _read_answers(self) -> None:
        while more := os.read(self._answers, CHUNK):
            self._come.put(more)
        self._come.put(b"")

    def _read_log(self) -> None:
        while more := os.read(self._log, CHUNK):
            self.log = (self.log + more)[-LOG_BYTES:]


def pipes_of(process: Popen[bytes]) -> Pipes:
    """The pipes of a worker, as this platform can read them."""
    return PolledPipes(process) if hasattr(select, "poll") else ThreadedPipes(process)


def _ends(process: Popen[bytes]) -> tuple[tuple[IO[bytes], ...], tuple[int, ...]]:
    files = tuple(file for file in (process.stdin, process.stdout, process.stderr) if file is not None)
    return files, tuple(file.fileno() for file in files)

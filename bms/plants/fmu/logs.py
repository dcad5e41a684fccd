"""What an FMU says while it runs: kept to the last few lines, whatever it says and how often.

FMI 2.0 hands over a format with C's variable arguments; fmpy's native proxy makes text of them. That proxy
knows a single receiver per process, so there is one here as well, which finds the sink of an instance by the
environment that the FMU was given.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import cache
from itertools import count
from typing import Any
from weakref import WeakValueDictionary

LINES = 5
"""Lines that are kept, the last ones."""

LINE_BYTES = 300
"""Of a longer line the beginning is kept."""

FLOOD = 100_000
"""Lines in one realization beyond which the FMU is said to flood."""

SERIOUS = 2
"""Status from which on a line tells of a failure (discard)."""


class LogSink:
    """The last lines of an instance.

    Parameters
    ----------
    on_flood : callable or None
        Called once when an FMU does not stop talking, in the middle of its call; a process of its own can end
        here. None counts on and leaves it to whoever reads ``flooded``.
    on_line : callable or None
        Called with every line that is kept, at once: what is kept here dies with a process.
    """

    def __init__(
        self,
        on_flood: Callable[[], None] | None = None,
        on_line: Callable[[bytes], None] | None = None,
    ) -> None:
        self.key = next(_keys)
        self._on_flood = on_flood
        self._on_line = on_line
        self._recent: deque[bytes] = deque(maxlen=LINES)
        self._serious: deque[bytes] = deque(maxlen=LINES)
        self.lines = 0
        _sinks[self.key] = self

    def take(self, status: int, message: bytes | None) -> None:
        """Keep a line."""
        self.lines += 1
        if self.lines > FLOOD:
            if self.lines == FLOOD + 1 and self._on_flood is not None:
                self._on_flood()
            return
        kept = (message or b"")[:LINE_BYTES]
        self._recent.append(kept)
        if self._on_line is not None:
            self._on_line(kept)
        if status >= SERIOUS:
            self._serious.append(kept)

    def clear(self) -> None:
        """Forget all lines, at the start of a realization."""
        self.lines = 0
        self._recent.clear()
        self._serious.clear()

    def receive(self, _environment: Any, status: int, _category: Any, message: bytes | None) -> None:
        """Keep a line of FMI 3.0, whose text is complete."""
        self.take(status, message)

    @property
    def flooded(self) -> bool:
        """Whether there were more lines than anybody reads."""
        return self.lines > FLOOD

    def tail(self) -> str:
        """The last lines, those about failures before others, as the end of a message; empty without any."""
        chosen = self._serious or self._recent
        said = [line.decode("utf-8", "replace").strip() for line in chosen]
        said = [line for line in said if line]
        return f"; it said: {' | '.join(said)}" if said else ""


_keys = count(1)
_sinks: WeakValueDictionary[int, LogSink] = WeakValueDictionary()


def _receive(
    environment: int | None, _name: bytes, status: int, _category: bytes, message: bytes | None
) -> None:
    sink = _sinks.get(environment or 0)
    if sink is None and _sinks:
        sink = _sinks.get(max(_sinks.keys()))  # an FMU that does not hand back what it was given
    if sink is not None:
        sink.take(status, message)


@cache
def logger() -> Any:
    """The receiver of FMI 2.0's messages, as a C function that formats them."""
    from ctypes import byref

    from fmpy.fmi2 import fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

    callbacks = fmi2CallbackFunctions()
    python_side = fmi2CallbackLoggerTYPE(_receive)
    callbacks.logger = python_side
    try:
        from fmpy.logging import addLoggerProxy
    except (ImportError, OSError):  # fmpy has no proxy for this platform: formats are kept as they are
        return python_side
    addLoggerProxy(byref(callbacks))
    _alive.append(python_side)
    return callbacks.logger


_alive: list[Any] = []
"""C functions that are called as long as the process lives."""

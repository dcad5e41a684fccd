"""The child process that loads an FMU for its parent: answers requests until they end.

It is started by `bms.plants.fmu.process` and imports no more than running the FMU takes.
"""

from __future__ import annotations

import contextlib
import os
import traceback

from bms.plants.fmu import protocol
from bms.plants.fmu.channel import Channel
from bms.plants.fmu.confine import end_group, follow_parent, limit_itself, take_pipes
from bms.plants.fmu.errors import FmuCrash, FmuError
from bms.plants.fmu.in_process import open_channel
from bms.plants.fmu.logs import FLOOD


def main(at_once: bool) -> None:
    """Answer until the parent closes the pipe, then leave without a word.

    Parameters
    ----------
    at_once : bool
        See `bms.plants.fmu.confine.follow_parent`.
    """
    parent = os.getppid()
    requests, answers = take_pipes()
    try:
        _run(requests, answers, parent, at_once)
        status = 0
    except BaseException:
        status = protocol.BROKEN
        with contextlib.suppress(OSError):
            traceback.print_exc()
    if os.getppid() != parent:
        end_group()
    # The interpreter would run the FMU's destructors, which may hang, and nothing here is left to be saved.
    os._exit(status)


def _run(requests: int, answers: int, parent: int, at_once: bool) -> None:
    _, size, patience_s = protocol.REQUEST.unpack(protocol.read_exactly(requests, protocol.REQUEST.size))
    follow_parent(parent, requests, patience_s, at_once)
    channel = _open(protocol.read_exactly(requests, size), answers)
    if channel is not None:
        _serve(channel, requests, answers)
        channel.close()


def _open(text: bytes, answers: int) -> Channel | None:
    folder, wiring, limits = protocol.read_open(text)
    limit_itself(limits)

    def stop_flood() -> None:
        # The FMU is in the middle of a call, from which it may never return.
        flood = f"the FMU floods its log: more than {FLOOD:,} lines in one realization; it was killed"
        protocol.write_all(answers, protocol.text_answer(protocol.CRASHED, flood))
        os._exit(0)

    def pass_on(line: bytes) -> None:
        # To the parent at once: should this process die, it is all that is left to tell why.
        with contextlib.suppress(OSError):
            os.write(2, line + b"\n")

    channel: Channel | None = None
    try:
        channel = open_channel(folder, wiring, on_flood=stop_flood, on_line=pass_on)
        answer = protocol.outputs_answer(())
    except Exception as error:
        answer = _refusal(error)
    protocol.write_all(answers, answer)
    return channel


def _serve(channel: Channel, requests: int, answers: int) -> None:
    size, unpack = protocol.REQUEST.size, protocol.REQUEST.unpack
    while len(head := protocol.read_exactly(requests, size)) == size:
        kind, count, value = unpack(head)
        if kind == protocol.END:
            return
        try:
            if kind == protocol.STEP:
                outputs = channel.step(value, count)
            else:
                data = protocol.read_exactly(requests, 8 * count)
                outputs = channel.start(protocol.numbers_from_bytes(data))
            answer = protocol.outputs_answer(outputs)
        except Exception as error:
            answer = _refusal(error)
        protocol.write_all(answers, answer)


def _refusal(error: Exception) -> bytes:
    """What an exception is answered as: one of ours as it is, any other as a crash."""
    if isinstance(error, FmuError):
        kind = protocol.CRASHED if isinstance(error, FmuCrash) else protocol.REFUSED
        return protocol.text_answer(kind, str(error))
    if isinstance(error, MemoryError):
        text = "the FMU left no memory within its limit; raise memory_bytes if it needs as much"
    else:
        text = f"the FMU cannot go on: {type(error).__name__}: {error}"
    return protocol.text_answer(protocol.CRASHED, text)

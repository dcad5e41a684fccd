"""What a worker is asked and what it answers: fixed heads, numbers as they are in memory, text as UTF-8.

A request is a head (kind, count, value) and, for the first two kinds, what `count` counts::

    OPEN   count bytes of JSON: folder, wiring, limits; value is the time to end in
    START  count numbers: the start values
    STEP   count communication steps with the input at value
    END    nothing more

An answer is a head (kind, count) and count numbers (`OUTPUTS`) or count bytes of text. One request, one
answer, none to the last. Nothing of it is ever unpickled or evaluated, as the process on the other side runs
somebody else's code.
"""

from __future__ import annotations

import json
import os
import struct
from dataclasses import asdict
from pathlib import Path
from typing import Any

from bms.plants.fmu.channel import Wiring
from bms.plants.fmu.limits import Limits

OPEN, START, STEP, END = 1, 2, 3, 4
OUTPUTS, CRASHED, REFUSED = 1, 2, 3

REQUEST = struct.Struct("=Bqd")
ANSWER = struct.Struct("=Bq")

BROKEN = 213
"""Exit code of a worker that could not go on, mostly as the FMU had closed its pipes."""

LONGEST_ANSWER = 2**20
"""Bytes; a longer one is no answer but what a wild write made of it."""


def open_request(folder: Path, wiring: Wiring, limits: Limits) -> bytes:
    """What to open, and within which limits."""
    text = json.dumps({"folder": str(folder), "wiring": asdict(wiring), "limits": asdict(limits)})
    return REQUEST.pack(OPEN, len(text), limits.close_deadline_s) + text.encode("ascii")


def read_open(text: bytes) -> tuple[Path, Wiring, Limits]:
    """Take `open_request` apart."""
    content = json.loads(text)
    wiring = {name: _tuples(value) for name, value in content["wiring"].items()}
    return Path(content["folder"]), Wiring(**wiring), Limits(**content["limits"])


def start_request(values: tuple[float, ...]) -> bytes:
    """Begin a realization with these start values."""
    return REQUEST.pack(START, len(values), 0.0) + numbers_to_bytes(values)


def numbers_to_bytes(values: tuple[float, ...]) -> bytes:
    """Double precision, as in memory."""
    return struct.pack(f"={len(values)}d", *values)


def numbers_from_bytes(data: bytes, offset: int = 0) -> tuple[float, ...]:
    """Undo `numbers_to_bytes`."""
    return struct.unpack_from(f"={(len(data) - offset) // 8}d", data, offset)


def text_answer(kind: int, text: str) -> bytes:
    """An answer in words, cut to what is read."""
    data = text.encode("utf-8", "replace")[: LONGEST_ANSWER - ANSWER.size]
    return ANSWER.pack(kind, len(data)) + data


def outputs_answer(outputs: tuple[float, ...]) -> bytes:
    """An answer in numbers."""
    return ANSWER.pack(OUTPUTS, len(outputs)) + numbers_to_bytes(outputs)


def answer_bytes(data: bytes) -> int:
    """Length of the whole answer that begins with this; 0 where it is none."""
    if len(data) < ANSWER.size:
        return ANSWER.size
    kind, count = ANSWER.unpack_from(data)
    size: int = ANSWER.size + count * (8 if kind == OUTPUTS else 1)
    return size if kind in (OUTPUTS, CRASHED, REFUSED) and ANSWER.size <= size <= LONGEST_ANSWER else 0


def read_exactly(descriptor: int, count: int) -> bytes:
    """Read so many bytes; fewer where the other side is gone."""
    data = b""
    while len(data) < count and (more := os.read(descriptor, count - len(data))):
        data += more
    return data


def write_all(descriptor: int, data: bytes) -> None:
    """Write everything."""
    while data:
        data = data[os.write(descriptor, data) :]


def _tuples(value: Any) -> Any:
    return tuple(_tuples(item) for item in value) if isinstance(value, list) else value

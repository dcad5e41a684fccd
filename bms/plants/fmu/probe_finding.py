"""One finding of the probe."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Level = Literal["ok", "doubt", "contradiction"]


@dataclass(frozen=True, slots=True)
class Finding:
    """What the probe says of one thing.

    Parameters
    ----------
    level : {"ok", "doubt", "contradiction"}
        Whether the mapping and the FMU agree.
    about : str
        Table of the mapping that it is about.
    text : str
        What was seen, and what to do.
    """

    level: Level
    about: str
    text: str


def ok(about: str, text: str) -> Finding:
    """Say that it fits."""
    return Finding("ok", about, text)


def doubt(about: str, text: str) -> Finding:
    """Say that it may not be as it should."""
    return Finding("doubt", about, text)


def wrong(about: str, text: str) -> Finding:
    """Say that it contradicts the mapping."""
    return Finding("contradiction", about, text)

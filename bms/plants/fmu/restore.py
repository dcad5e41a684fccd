"""How an FMU is brought back to its start, found out by trying.

FMI has three ways: reset, a state taken before, a fresh instance. Of third-party FMUs some come back from a
reset with something left of the last realization, and from a state as well; libraries with global variables
even from a fresh instance. Then only a fresh process helps. So the same short drive is repeated, and the
first way that answers the same again is kept: beside the unpacked FMU, where every process that opens it
finds it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from bms.plants.fmu.channel import Channel
from bms.plants.fmu.errors import FmuCrash, FmuError

Way = Literal["reset", "state", "instance", "worker"]

SAME = 1e-12
"""Relative to the larger of the output and one."""

NOTE = ".restored-by"
WAYS: dict[str, Way] = {"reset": "reset", "state": "state", "instance": "instance"}


def keep_way(folder: Path, way: Way) -> None:
    """Write down how the FMU in a folder is brought back to its start; a worker starts by itself."""
    (folder / NOTE).write_text(way, encoding="ascii")


def kept_way(folder: Path) -> Way:
    """How the FMU in a folder is brought back to its start; reset where nothing is known."""
    try:
        return WAYS.get((folder / NOTE).read_text(encoding="ascii", errors="replace"), "reset")
    except OSError:
        return "reset"


def drive(channel: Channel, starts: tuple[float, ...], profile: Sequence[float]) -> list[float]:
    """Run a short realization.

    Parameters
    ----------
    channel : Channel
        The FMU.
    starts : tuple of float
        Its start values.
    profile : sequence of float
        Inputs, one per communication step.

    Returns
    -------
    list of float
        All outputs, from the start on.
    """
    found = list(channel.start(starts))
    for value in profile:
        found += channel.step(value, 1)
    return found


def same(first: Sequence[float], again: Sequence[float]) -> bool:
    """Whether two runs gave the same; NaN at the start counts as equal to NaN."""
    return len(first) == len(again) and all(
        abs(a - b) <= SAME * max(1.0, abs(a)) or (a != a and b != b)
        for a, b in zip(first, again, strict=True)
    )


def comes_back(channel: Channel, starts: tuple[float, ...], profile: Sequence[float]) -> bool:
    """Whether a channel answers the same drive in the same way after another realization.

    Raises
    ------
    FmuCrash
        When the very first run fails: then nothing is known of restoring.
    """
    first = drive(channel, starts, profile)
    try:
        return same(first, drive(channel, starts, profile))
    except FmuCrash:
        return False


def cannot_restore(name: str) -> FmuError:
    """The error of an FMU that only a fresh process brings back to its start."""
    return FmuError(
        f"the FMU {name} answers differently after a reset, after its state was set back and as a fresh"
        " instance: only a fresh process restores it. Run it isolated"
    )

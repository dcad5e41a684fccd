"""Open the channel to an FMU, and find out how the FMU is brought back to its start."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from bms.plants.fmu.channel import Channel
from bms.plants.fmu.description import Description
from bms.plants.fmu.errors import FmuCrash
from bms.plants.fmu.in_process import InProcessChannel, open_channel
from bms.plants.fmu.restore import Way, cannot_restore, comes_back, keep_way
from bms.plants.fmu.roles import Roles
from bms.plants.fmu.start import Outputs, start_values

if TYPE_CHECKING:
    from bms.plants.fmu.isolated import IsolatedChannel, Limits

PROFILE = (1.0, 1.0, 0.0, -1.0, -1.0)
"""The drive that is repeated, in times of a small load."""

SMALL_LOAD_PER_H = 0.01
"""A hundredth of the capacity in an hour, as its unit may be mistaken; see also `SMALL_LOAD_A`."""

SMALL_LOAD_A = 0.1
"""Where the capacity is not known."""

NOMINAL_V = 3.0
"""Of a cell, to make a power of that current."""

SMALL_VOLTAGE = 1e-4
"""The same for an FMU that takes a voltage, relative."""


def settle(
    description: Description,
    roles: Roles,
    capacity_Ah: float | None,
    series: float,
    folder: Path,
    limits: Limits | None,
    *,
    isolate: bool,
    stack: ExitStack,
) -> tuple[InProcessChannel | IsolatedChannel, Way]:
    """Open a channel that starts every realization from the same state.

    Parameters
    ----------
    description : Description
        Of the FMU.
    roles : Roles
        What is driven and read.
    capacity_Ah : float or None
        Of the pack, to size the load of the trial.
    series : float
        Cells in series, for the same.
    folder : Path
        Where the FMU is unpacked; the finding is kept there.
    limits : Limits or None
        Of an isolated FMU.
    isolate : bool
        Run it in a process of its own.
    stack : ExitStack
        Closes the channel.

    Raises
    ------
    FmuError
        When it cannot be loaded, or not restored in this process.
    FmuCrash
        When it does not survive a few steps after its very first start.
    """
    starts = start_values(roles, 0.5 if roles.initial_soc_default is None else None)
    profile = trial_profile(roles, capacity_Ah, series)
    state = description.interface(roles.wiring.kind).state
    ways: tuple[Way, ...] = ("reset", "state", "instance") if state else ("reset", "instance")
    if isolate:
        return _isolated(ways, folder, roles, limits, starts, profile, stack)
    for way in ways:
        keep_way(folder, way)
        channel = open_channel(folder, roles.wiring)
        closing = ExitStack()
        closing.callback(channel.close)
        with closing:
            if _comes_back(channel, starts, profile, first=way == ways[0]):
                stack.push(closing.pop_all())
                return channel, way
    raise cannot_restore(description.name)


def _isolated(
    ways: tuple[Way, ...],
    folder: Path,
    roles: Roles,
    limits: Limits | None,
    starts: Outputs,
    profile: list[float],
    stack: ExitStack,
) -> tuple[IsolatedChannel, Way]:
    from bms.plants.fmu.isolated import IsolatedChannel, Limits

    keep_way(folder, ways[0])
    channel = IsolatedChannel(folder, roles.wiring, limits or Limits())
    stack.callback(channel.close)
    for way in ways:
        if way != ways[0]:
            keep_way(folder, way)
            channel.renew()
        if _comes_back(channel, starts, profile, first=way == ways[0]):
            return channel, way
    return channel, "worker"


def _comes_back(channel: Channel, starts: Outputs, profile: list[float], *, first: bool) -> bool:
    """Whether a way works; an FMU that fails where it had not been restored yet fails for good."""
    try:
        return comes_back(channel, starts, profile)
    except FmuCrash:
        if first:
            raise
        return False


def trial_profile(roles: Roles, capacity_Ah: float | None, series: float) -> list[float]:
    """The drive that is repeated, as the FMU takes it."""
    if roles.role == "voltage":
        load, rest = SMALL_VOLTAGE * roles.drive_start, roles.drive_start
    else:
        load = SMALL_LOAD_PER_H * capacity_Ah if capacity_Ah is not None else SMALL_LOAD_A
        load, rest = (load * NOMINAL_V * series if roles.role == "power" else load), 0.0
    return [roles.drive.to_raw(rest + times * load) for times in PROFILE]

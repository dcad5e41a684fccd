"""An FMU from its file to its realizations: unpacked, checked, loaded, restored in between, removed.

>>> with open_fmu("plant.fmu", load_mapping("mapping.toml")) as fmu:  # doctest: +SKIP
...     plant = fmu.start(0.6)
...     seen = plant.step(-2000.0, 0.0, 1.0)
"""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self, final
from weakref import finalize

from bms.plants.fmu.archive import unpack
from bms.plants.fmu.description import Description, read_description
from bms.plants.fmu.errors import FmuCrash, FmuError
from bms.plants.fmu.in_process import InProcessChannel
from bms.plants.fmu.mapping import Mapping
from bms.plants.fmu.plant import FmuPlant
from bms.plants.fmu.restore import Way
from bms.plants.fmu.roles import Roles, work_out
from bms.plants.fmu.settle import settle
from bms.plants.fmu.start import Outputs, find_start
from bms.plants.fmu.wires import connect

if TYPE_CHECKING:
    from bms.plants.fmu.isolated import IsolatedChannel, Limits


def open_fmu(
    path: str | Path, mapping: Mapping, *, isolate: bool = True, limits: Limits | None = None
) -> FmuSession:
    """Unpack an FMU, check it against its mapping, load it and find out how it is restored.

    Parameters
    ----------
    path : str or Path
        The ``.fmu`` file.
    mapping : Mapping
        What its variables mean, see `bms.plants.fmu.mapping.load_mapping`.
    isolate : bool
        Run it in a process of its own.
    limits : Limits or None
        What it may take there; None for the defaults.

    Returns
    -------
    FmuSession
        A context manager; close it to remove the unpacked files and to end the process.

    Raises
    ------
    FmuError
        When the FMU is damaged, not for this platform, of another FMI version, or does not fit the mapping.
    FmuCrash
        When it does not survive a few steps.
    """
    with ExitStack() as stack:
        folder = stack.enter_context(unpack(path))
        description = read_description(folder)
        description.check_platform()
        roles = work_out(description, mapping)
        connect(description, roles.wiring)
        channel, way = settle(
            description,
            roles,
            mapping.pack.capacity_Ah,
            mapping.scale.series,
            folder,
            limits,
            isolate=isolate,
            stack=stack,
        )
        return FmuSession(description, mapping, roles, channel, way, stack.pop_all())


@final
class FmuSession:
    """An FMU that is ready to run; see `open_fmu`. One realization at a time, one thread at a time.

    Parameters
    ----------
    description : Description
        What the FMU says of itself.
    mapping : Mapping
        What its variables mean.
    roles : Roles
        The same worked out.
    channel : InProcessChannel or IsolatedChannel
        The running FMU.
    restoration : {"reset", "state", "instance", "worker"}
        How the FMU is brought back to its start.
    stack : ExitStack
        Closed at the end.
    """

    def __init__(
        self,
        description: Description,
        mapping: Mapping,
        roles: Roles,
        channel: InProcessChannel | IsolatedChannel,
        restoration: Way,
        stack: ExitStack,
    ) -> None:
        self.description = description
        self.mapping = mapping
        self.roles = roles
        self.restoration = restoration
        self._channel = channel
        self._plant: FmuPlant | None = None
        self._close = finalize(self, stack.close)

    def start(self, soc: float | None = None) -> FmuPlant:
        """Start a realization; the one before ends.

        Parameters
        ----------
        soc : float or None
            SOC at the start; None leaves the FMU's own.

        Raises
        ------
        FmuError
            When the SOC cannot be set, or the session is closed.
        FmuCrash
            When the FMU does not survive its start; the next one is tried on a fresh instance or worker.
        """
        if not self._close.alive:
            raise FmuError("this FMU has been closed; open it again")
        if self._plant is not None:
            self._plant.end()
            self._plant = None
        start = find_start(self.roles, soc, self._start, self._channel.step)
        capacity_Ah = self.mapping.pack.capacity_Ah
        self._plant = FmuPlant(
            self._channel,
            self.roles,
            start,
            self.mapping.pack.resistance_ohm,
            None if capacity_Ah is None else 3600.0 * capacity_Ah,
        )
        return self._plant

    def _start(self, values: Outputs) -> Outputs:
        from bms.plants.fmu.isolated import IsolatedChannel

        channel = self._channel
        if self.restoration == "worker" and isinstance(channel, IsolatedChannel):
            channel.renew()
        try:
            return channel.start(values)
        except FmuCrash:
            # it may be the last realization that could not be ended; what is left of it is gone now
            return channel.start(values)

    def close(self) -> None:
        """End the realization and the process, and remove the unpacked files; it may be called twice."""
        if self._plant is not None:
            self._plant.end()
            self._plant = None
        self._close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

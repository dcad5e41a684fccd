"""A running FMU in this process: `bms.plants.fmu.channel.Channel` on the FMU's own library.

Nothing protects this process from what the library does; `bms.plants.fmu.isolated` runs the same in a child.
Before every realization after the first the instance is brought back to its start in the way that was found,
see `bms.plants.fmu.restore`.
"""

from __future__ import annotations

from collections.abc import Callable
from ctypes import c_void_p
from pathlib import Path
from typing import TYPE_CHECKING, final

from bms.plants.fmu.channel import Wiring
from bms.plants.fmu.cosimulation import CoSimulation, check_log
from bms.plants.fmu.description import Description, read_description
from bms.plants.fmu.errors import FmuCrash, FmuError
from bms.plants.fmu.instance import Instance
from bms.plants.fmu.logs import LogSink
from bms.plants.fmu.restore import Way, kept_way
from bms.plants.fmu.wires import Wires, check_value, connect

if TYPE_CHECKING:
    from bms.plants.fmu.exchange import ModelExchange

Step = Callable[[float, int], tuple[float, ...]]


def open_channel(
    folder: Path,
    wiring: Wiring,
    *,
    on_flood: Callable[[], None] | None = None,
    on_line: Callable[[bytes], None] | None = None,
) -> InProcessChannel:
    """Load an unpacked FMU into this process.

    Parameters
    ----------
    folder : Path
        What `bms.plants.fmu.archive.unpack` gave.
    wiring : Wiring
        What is driven and read.
    on_flood : callable or None
        Called in the middle of the FMU's call when it writes more than `bms.plants.fmu.logs.FLOOD` lines; a
        child process can end there. Without it, the lines are dropped and the step fails when it is over.
    on_line : callable or None
        Called with every line of the FMU's log up to there, while it is written.

    Raises
    ------
    FmuError
        When the FMU is not for this platform, or the wiring does not fit it.
    """
    description = read_description(folder)
    log = LogSink(on_flood, on_line)
    return InProcessChannel(description, folder, wiring, connect(description, wiring), log)


@final
class InProcessChannel:
    """A `bms.plants.fmu.channel.Channel`; see `open_channel`."""

    def __init__(
        self,
        description: Description,
        folder: Path,
        wiring: Wiring,
        wires: Wires,
        log: LogSink,
    ) -> None:
        self._wiring, self._wires = wiring, wires
        self._way: Way = kept_way(folder)
        self._log = log
        self._instance = Instance(description, wiring.kind, folder, self._log)
        self._stepper: CoSimulation | ModelExchange | None = None
        self._state: c_void_p | None = None
        self._step: Step = _not_started

    def start(self, values: tuple[float, ...]) -> tuple[float, ...]:
        """Begin a realization, see `bms.plants.fmu.channel.Channel.start`."""
        wires, instance = self._wires, self._instance
        if len(values) != len(wires.starts):
            raise FmuError(f"{len(values)} start values for {len(wires.starts)} variables; give one for each")
        starts = list(zip(wires.starts, values, strict=True))
        for variable, value in starts:
            check_value(variable, value)
        self._step = _not_started
        self._log.clear()
        try:
            stepper = self._renewed()
            instance.initialise(
                [*wires.parameters, *starts],
                [*wires.inputs, (wires.input, wires.input_start)],
                self._wiring.tolerance,
            )
            stepper.begin()
            outputs = stepper.read()
        except OSError as error:
            raise self._crashed(error) from error
        except FmuCrash:
            instance.broken = True
            raise
        check_log(instance, "at the start")
        self._step = stepper.step
        return outputs

    def step(self, value: float, steps: int) -> tuple[float, ...]:
        """Hold the input over some steps, see `bms.plants.fmu.channel.Channel.step`."""
        try:
            return self._step(value, steps)
        except OSError as error:
            raise self._crashed(error) from error
        except FmuCrash:
            self._step = _not_started
            raise

    def close(self) -> None:
        """Free the instance; the library stays with the process."""
        self._step = _not_started
        if self._state is not None:
            self._instance.drop_state(self._state)
            self._state = None
        if self._stepper is not None:
            self._stepper.close()
            self._stepper = None
        self._instance.free()

    def _crashed(self, error: OSError) -> FmuCrash:
        """What Windows reports of an access violation."""
        self._step = _not_started
        self._instance.broken = True
        return FmuCrash(f"the FMU crashed: {error}{self._log.tail()}")

    def _renewed(self) -> CoSimulation | ModelExchange:
        """Bring the instance to where it can be configured; make one where there is none that is sound."""
        instance = self._instance
        if self._stepper is not None and not instance.broken and self._way != "instance":
            try:
                if self._state is not None:
                    instance.set_state(self._state)
                else:
                    instance.reset()
                return self._stepper
            except FmuCrash:
                pass  # an instance that cannot be restored is replaced
        self.close()
        instance.make()
        self._stepper = self._new_stepper()
        if self._way == "state":
            self._state = instance.take_state()
        return self._stepper

    def _new_stepper(self) -> CoSimulation | ModelExchange:
        if self._wiring.kind == "co-simulation":
            return CoSimulation(self._instance, self._wires, self._wiring.step_s)
        from bms.plants.fmu.exchange import ModelExchange

        return ModelExchange(self._instance, self._wires, self._wiring.step_s, self._wiring.tolerance)


def _not_started(value: float, steps: int) -> tuple[float, ...]:
    raise FmuError("no realization is running in this FMU; start one first")

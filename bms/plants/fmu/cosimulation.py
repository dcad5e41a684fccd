"""Co-simulation: the FMU brings its own solver, a step is one call per communication step."""

from __future__ import annotations

import ctypes
from math import isfinite

from bms.plants.fmu.description import Variable
from bms.plants.fmu.errors import FmuCrash
from bms.plants.fmu.instance import Instance
from bms.plants.fmu.logs import FLOOD
from bms.plants.fmu.status import DISCARD, WARNING
from bms.plants.fmu.values import Port, Reader
from bms.plants.fmu.wires import Wires

TERMINATED = 3
"""The question of FMI 2.0 whether the FMU wants to end (fmi2Terminated)."""


class CoSimulation:
    """The stepping of an initialised instance; made anew for every instance, as it keeps its address.

    Parameters
    ----------
    instance : Instance
        Instantiated.
    wires : Wires
        What is driven and read.
    step_s : float
        Communication step.
    """

    def __init__(self, instance: Instance, wires: Wires, step_s: float) -> None:
        self._instance, self._variables, self._step_s = instance, wires.outputs, step_s
        dll, version, component = instance.dll, instance.version, instance.component
        drive = Port(dll, version, component, (wires.input,))
        self._reader = Reader(dll, version, component, wires.outputs)
        self._input = drive.values
        self._set_name, self._set, self._set_arguments = drive.set
        self._gets = tuple(port.get for port in self._reader.ports)
        self._single = len(self._gets) == 1 and not self._reader.ports[0].whole
        _, self._get, self._get_arguments = self._gets[0]
        self._outputs = self._reader.ports[0].values
        self._do = dll[f"fmi{version}DoStep"]
        self._time = ctypes.c_double(0.0)
        flags = [ctypes.c_bool(False) for _ in range(3)]
        _, self._ends, self._early = flags
        self._do_arguments: tuple[object, ...] = (component, self._time, ctypes.c_double(step_s))
        if version == 2:
            self._do_arguments += (ctypes.c_int(1),)
        else:
            self._reached = ctypes.c_double(0.0)
            pointers = [ctypes.byref(flag) for flag in flags]
            self._do_arguments += (ctypes.c_bool(True), *pointers, ctypes.byref(self._reached))
        self._count = 0

    def begin(self) -> None:
        """Begin at time zero, after initialisation."""
        self._count = 0

    def close(self) -> None:
        """Nothing is held besides the instance."""

    def step(self, value: float, steps: int) -> tuple[float, ...]:
        """See `bms.plants.fmu.channel.Channel.step`."""
        self._input[0] = value
        status = self._set(*self._set_arguments)
        if status > WARNING:
            raise self._instance.failed(self._set_name, status, self._when())
        do, arguments, time, step_s, count = (
            self._do,
            self._do_arguments,
            self._time,
            self._step_s,
            self._count,
        )
        for _ in range(steps):
            time.value = count * step_s
            status = do(*arguments)
            if status > WARNING or self._ends.value or self._early.value:
                self._count = count
                raise self._stopped(status)
            count += 1
        self._count = count
        if self._single:
            status = self._get(*self._get_arguments)
            if status > WARNING:
                raise self._instance.failed(self._gets[0][0], status, self._when())
            outputs = tuple(self._outputs)
        else:
            outputs = self.read()
        if self._instance.log.lines > FLOOD or not isfinite(sum(outputs)):
            check_outputs(self._instance, self._variables, outputs, self._when())
        return outputs

    def read(self) -> tuple[float, ...]:
        """The outputs as they are now.

        Raises
        ------
        FmuCrash
            When the FMU does not give them.
        """
        for call in self._gets:
            self._instance.transfer(call, self._when())
        return self._reader.numbers()

    def _when(self) -> str:
        return f"at {self._count * self._step_s:g} s"

    def _stopped(self, status: int) -> FmuCrash:
        """Say why a step did not end where it should."""
        instance = self._instance
        ends = bool(self._ends.value)
        begin_s, end_s = self._count * self._step_s, (self._count + 1) * self._step_s
        when = f"in the step from {begin_s:g} s to {end_s:g} s"
        if instance.version == 2 and status == DISCARD:
            answer = ctypes.c_int(0)
            asked = instance.dll["fmi2GetBooleanStatus"]
            known = asked(instance.component, ctypes.c_int(TERMINATED), ctypes.byref(answer)) <= WARNING
            ends = known and answer.value != 0
        error = instance.failed(f"fmi{instance.version}DoStep", status, when)
        if ends:
            return FmuCrash(f"the FMU asks to end the simulation {when}{instance.log.tail()}")
        if status <= WARNING:
            return FmuCrash(f"the FMU came back early {when}, which it was not allowed{instance.log.tail()}")
        return error


def check_log(instance: Instance, when: str) -> None:
    """Hold that an FMU does not flood its log.

    Raises
    ------
    FmuCrash
        When it does.
    """
    if instance.log.flooded:
        instance.broken = True
        raise FmuCrash(f"the FMU floods its log: more than {FLOOD:,} lines {when}{instance.log.tail()}")


def check_outputs(
    instance: Instance, variables: tuple[Variable, ...], outputs: tuple[float, ...], when: str
) -> None:
    """Hold that an FMU answered with numbers, and did not flood its log.

    Raises
    ------
    FmuCrash
        When it did not.
    """
    check_log(instance, when)
    if not all(isfinite(output) for output in outputs):
        instance.broken = True
        shown = ", ".join(
            f"{variable.name} = {output:g}"
            for variable, output in zip(variables, outputs, strict=True)
            if not isfinite(output)
        )
        raise FmuCrash(f"the FMU's output is no number {when}: {shown}{instance.log.tail()}")

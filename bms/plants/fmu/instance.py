"""The life of an instance: made, configured, initialised, restored, freed; FMI 2.0 and 3.0 alike."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from bms.plants.fmu import logs
from bms.plants.fmu.channel import Kind
from bms.plants.fmu.description import Description, Variable
from bms.plants.fmu.errors import FmuCrash
from bms.plants.fmu.library import load
from bms.plants.fmu.status import FATAL, WARNING, crash
from bms.plants.fmu.values import Call, Port

WANTED_LOGS = ("logStatusDiscard", "logStatusError", "logStatusFatal")
"""Categories of FMI 2.0 and 3.0 that tell why something failed."""

Values = Sequence[tuple[Variable, float]]


class Instance:
    """One instance of an FMU in this process.

    Parameters
    ----------
    description : Description
        Of the FMU.
    kind : {"co-simulation", "model-exchange"}
        Which interface.
    folder : Path
        Where it is unpacked.
    log : LogSink
        Keeps what it says.
    """

    def __init__(self, description: Description, kind: Kind, folder: Path, log: logs.LogSink) -> None:
        self.description, self._kind = description, kind
        self.version = description.version
        self.log = log
        self._fmu = load(description, kind, folder)
        self.dll = self._fmu.dll
        self.component = ctypes.c_void_p()
        """The instance as C sees it; a new one after every `make`."""
        self.broken = False
        """Whether a call failed; then nothing is restored, a new instance is made."""
        self.lost = False
        """Whether the FMU gave up this process (fmi2Fatal)."""

    def make(self) -> None:
        """Make a new instance; the old one is freed.

        Raises
        ------
        FmuCrash
            When the FMU refuses.
        """
        self.free()
        if self.lost:
            raise FmuCrash(
                "the FMU reported a fatal error before, after which FMI allows no further call in this"
                " process; start anew, or run it isolated (then only the realization is lost)"
            )
        try:
            if self.version == 2:
                self._fmu.instantiate(callbacks=self._callbacks(), loggingOn=False)
            else:
                self._fmu.instantiate(loggingOn=False, logMessage=self.log.receive)
        except Exception as error:
            needs_tool = self.description.interface(self._kind).needs_tool
            why = "the program that exported it" if needs_tool else "a licence or a file beside it"
            raise FmuCrash(
                f"the FMU {self.description.name} refuses to be instantiated: it may lack {why}, or allow one"
                f" instance at a time{self.log.tail()}"
            ) from error
        self.component = ctypes.c_void_p(self._fmu.component)
        self.broken = False
        self._ask_for_logs()

    def _callbacks(self) -> Any:
        from fmpy import calloc, fmi2, free

        callbacks = fmi2.fmi2CallbackFunctions()
        callbacks.logger = logs.logger()
        # the C library's own functions, not Python around them: some FMUs allocate at every step
        callbacks.allocateMemory = ctypes.cast(calloc, fmi2.fmi2CallbackAllocateMemoryTYPE)
        callbacks.freeMemory = ctypes.cast(free, fmi2.fmi2CallbackFreeMemoryTYPE)
        callbacks.componentEnvironment = self.log.key
        return callbacks

    def _ask_for_logs(self) -> None:
        wanted = [name.encode() for name in WANTED_LOGS if name in self.description.log_categories]
        if wanted:
            names = (ctypes.c_char_p * len(wanted))(*wanted)
            on = ctypes.c_int(1) if self.version == 2 else ctypes.c_bool(True)
            self._function("SetDebugLogging")(self.component, on, ctypes.c_size_t(len(wanted)), names)

    def _function(self, name: str) -> Any:
        """A C function without fmpy's conversion of arguments."""
        return self.dll[f"fmi{self.version}{name}"]

    def call(self, name: str, *arguments: Any, when: str = "") -> None:
        """Call a function of FMI by its name without the prefix, after the instance.

        Raises
        ------
        FmuCrash
            When it returns anything worse than a warning.
        """
        status = self._function(name)(self.component, *arguments)
        if status > WARNING:
            raise self.failed(f"fmi{self.version}{name}", status, when)

    def failed(self, name: str, status: int, when: str = "") -> FmuCrash:
        """Take note that a call failed; the error is for the caller to raise."""
        self.broken = True
        self.lost = status == FATAL
        return crash(name, status, self.log, when)

    def transfer(self, call: Call, when: str = "") -> None:
        """Make the call of a port.

        Raises
        ------
        FmuCrash
            When it returns anything worse than a warning.
        """
        name, function, arguments = call
        status = function(*arguments)
        if status > WARNING:
            raise self.failed(name, status, when)

    def write(self, values: Values) -> None:
        """Set variables, one after the other.

        Raises
        ------
        FmuCrash
            When the FMU does not take one.
        """
        for variable, value in values:
            port = Port(self.dll, self.version, self.component, (variable,))
            port.values[0] = int(value) if port.whole else value
            self.transfer(port.set, f"setting {variable.name} = {value:g}")

    def initialise(self, before: Values, inputs: Values, tolerance: float) -> None:
        """Configure the instance, and take it through its initialisation at time zero.

        Parameters
        ----------
        before : sequence of (Variable, float)
            Parameters and start values.
        inputs : sequence of (Variable, float)
            Inputs at time zero.
        tolerance : float
            What the FMU is told.
        """
        real, no, yes = ctypes.c_double, ctypes.c_int(0), ctypes.c_int(1)
        if self.version == 2:
            self.call("SetupExperiment", yes, real(tolerance), real(0.0), no, real(0.0))
            self.write(before)
            self.call("EnterInitializationMode", when="starting")
        else:
            self.write(before)
            off, on = ctypes.c_bool(False), ctypes.c_bool(True)
            self.call(
                "EnterInitializationMode", on, real(tolerance), real(0.0), off, real(0.0), when="starting"
            )
        self.write(inputs)
        self.call("ExitInitializationMode", when="starting")

    def reset(self) -> None:
        """Bring the instance back to where it was when it was made."""
        self.call("Terminate", when="ending a realization")
        self.call("Reset")

    def take_state(self) -> ctypes.c_void_p:
        """Copy the FMU's state; `drop_state` frees it."""
        state = ctypes.c_void_p()
        self.call(self._state("Get"), ctypes.byref(state))
        return state

    def set_state(self, state: ctypes.c_void_p) -> None:
        """Bring the FMU back to a state that was taken from this instance."""
        self.call(self._state("Set"), state)

    def drop_state(self, state: ctypes.c_void_p) -> None:
        """Free a state."""
        if self.component and not self.lost:
            self._function(self._state("Free"))(self.component, ctypes.byref(state))

    def _state(self, verb: str) -> str:
        return f"{verb}FMUstate" if self.version == 2 else f"{verb}FMUState"

    def free(self) -> None:
        """Free the instance; the library stays. After a fatal error FMI forbids even this."""
        if self.component and not self.lost:
            if not self.broken:
                self._function("Terminate")(self.component)
            free = self._function("FreeInstance")
            free.restype = None
            free(self.component)
        self.component = ctypes.c_void_p()
        with suppress(AttributeError):
            self._fmu.component = None

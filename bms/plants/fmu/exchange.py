r"""Model exchange: the FMU gives derivatives, the solver is ours.

The input is held over a communication step; where it changes, the FMU gets an event and the solver begins
anew, since its formulas remember derivatives that no longer hold. Time events end a step of the solver, state
events are roots of the FMU's indicators, step events are what it answers to a completed step of the solver.
An FMU without states gets one that stands still, so that its events are still found.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from math import inf, isfinite

from bms.plants.fmu.cosimulation import check_outputs
from bms.plants.fmu.cvode import ROOT, Cvode
from bms.plants.fmu.errors import FmuCrash
from bms.plants.fmu.instance import Instance
from bms.plants.fmu.logs import FLOOD
from bms.plants.fmu.status import DISCARD, WARNING
from bms.plants.fmu.values import Port, Reader
from bms.plants.fmu.wires import Wires

MOST_SOLVER_STEPS = 100_000
MOST_EVENTS = 1_000
MOST_IDLE = 20
"""In one communication step, and steps of no length in a row; more is an FMU that chatters, or derivatives
that cannot be integrated."""

SMALLEST_S = 1e-12
"""Relative to the time: two times closer than this are the same."""


class ModelExchange:
    """The stepping of an initialised instance; made anew for every instance, as it keeps its address.

    Parameters
    ----------
    instance : Instance
        Instantiated.
    wires : Wires
        What is driven and read.
    step_s : float
        Communication step.
    tolerance : float
        Relative tolerance of the solver.
    """

    def __init__(self, instance: Instance, wires: Wires, step_s: float, tolerance: float) -> None:
        self._instance, self._step_s, self._tolerance = instance, step_s, tolerance
        self._variables = wires.outputs
        self._component = instance.component
        self._drive = Port(instance.dll, instance.version, instance.component, (wires.input,))
        self._reader = Reader(instance.dll, instance.version, instance.component, wires.outputs)
        self._events = EventLoop(instance)
        derivatives = "GetDerivatives" if instance.version == 2 else "GetContinuousStateDerivatives"
        self._set_time = _raw(instance, "SetTime", ctypes.c_double)
        array = ctypes.c_void_p, ctypes.c_size_t
        self._set_states = _raw(instance, "SetContinuousStates", *array)
        self._get_states = _raw(instance, "GetContinuousStates", *array)
        self._get_nominals = _raw(instance, "GetNominalsOfContinuousStates", *array)
        self._get_derivatives = _raw(instance, derivatives, *array)
        self._get_indicators = _raw(instance, "GetEventIndicators", *array)
        interface = instance.description.interface("model-exchange")
        self._tell_steps = interface.completed_step
        self._solver: Cvode | None = None
        self._states = self._indicators = 0
        self._count = 0
        self._time = 0.0
        self._held: float | None = None
        self._failure: FmuCrash | None = None
        self._discarded = False

    def begin(self) -> None:
        """Begin at time zero, after initialisation."""
        self._count, self._time, self._held, self._failure = 0, 0.0, None, None
        if self._solver is None:
            self._states, self._indicators = _sizes(self._instance)
            self._solver = Cvode(
                max(self._states, 1), self._indicators, self._rhs, self._roots, self._tolerance
            )
        self._events.update("at the start")
        self._events.leave()
        self._restart()

    def close(self) -> None:
        """Free the solver."""
        if self._solver is not None:
            self._solver.close()
            self._solver = None

    def step(self, value: float, steps: int) -> tuple[float, ...]:
        """See `bms.plants.fmu.channel.Channel.step`."""
        if value != self._held:
            self._events.enter(self._when())
            self._drive.values[0] = value
            self._instance.transfer(self._drive.set, self._when())
            self._events.update(self._when())
            self._events.leave()
            self._held = value
            self._restart()
        for _ in range(steps):
            self._count += 1
            self._integrate(self._count * self._step_s)
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
        for port in self._reader.ports:
            self._instance.transfer(port.get, self._when())
        return self._reader.numbers()

    def _integrate(self, end: float) -> None:
        """Move to the end of a communication step, through the events on the way."""
        solver = self._solver
        if solver is None:
            raise self._stuck("was closed")
        events = idle = 0
        self._discarded = False
        for _ in range(MOST_SOLVER_STEPS):
            until = min(end, max(self._events.next_time, self._time))
            flag, reached = 0, until
            if until - self._time > SMALLEST_S * max(1.0, until):
                flag, reached = solver.advance(until)
                if self._failure is not None:
                    raise self._failure
                idle = idle + 1 if reached - self._time <= SMALLEST_S * max(1.0, until) else 0
                if flag < 0 or idle > MOST_IDLE:
                    raise self._stuck(f"gave up (CVode's code {flag})")
            self._time = until if until - reached <= SMALLEST_S * max(1.0, until) else reached
            self._settle()
            wanted = self._completed()
            if wanted or flag == ROOT or self._time >= self._events.next_time:
                events += 1
                if events > MOST_EVENTS:
                    raise self._stuck(f"met more than {MOST_EVENTS} events")
                self._events.enter(self._when())
                self._events.update(self._when())
                self._events.leave()
                self._restart()
            if self._time >= end:
                return
        raise self._stuck(f"made {MOST_SOLVER_STEPS} steps and was not through")

    def _settle(self) -> None:
        """Give the FMU the time and the states that the solver arrived at; it last saw some trial."""
        instance = self._instance
        instance.call("SetTime", ctypes.c_double(self._time), when=self._when())
        if self._states and self._solver is not None:
            size = ctypes.c_size_t(self._states)
            instance.call("SetContinuousStates", self._solver.states, size, when=self._when())

    def _completed(self) -> bool:
        """Tell the FMU that a step of the solver is done; whether it wants an event."""
        if not self._tell_steps:
            return False
        instance = self._instance
        flag = ctypes.c_int if instance.version == 2 else ctypes.c_bool
        wanted, ends = flag(0), flag(0)
        instance.call(
            "CompletedIntegratorStep", flag(1), ctypes.byref(wanted), ctypes.byref(ends), when=self._when()
        )
        if ends.value:
            raise self._events.ended(self._when())
        return bool(wanted.value)

    def _restart(self) -> None:
        """Begin the integration anew from the FMU's states."""
        solver, instance = self._solver, self._instance
        if solver is None:
            return
        size = ctypes.c_size_t(self._states)
        if self._states:
            instance.call("GetContinuousStates", solver.states, size, when=self._when())
            instance.call("GetNominalsOfContinuousStates", solver.nominals, size, when=self._when())
        else:
            solver.nominals[0] = 1.0
        solver.restart(self._time)

    def _rhs(self, time: float, states: int, derivatives: int) -> int:
        component, size = self._component, self._states
        status = self._set_time(component, time)
        if not size:
            ctypes.memset(derivatives, 0, ctypes.sizeof(ctypes.c_double))
        elif status <= WARNING:
            status = self._set_states(component, states, size)
            if status <= WARNING:
                status = self._get_derivatives(component, derivatives, size)
        return 0 if status <= WARNING else self._refused("derivatives", status, time)

    def _roots(self, time: float, states: int, indicators: int) -> int:
        component, size = self._component, self._states
        status = self._set_time(component, time)
        if status <= WARNING and size:
            status = self._set_states(component, states, size)
        if status <= WARNING:
            status = self._get_indicators(component, indicators, self._indicators)
        return 0 if status <= WARNING else self._refused("event indicators", status, time)

    def _refused(self, what: str, status: int, time: float) -> int:
        """A discard asks the solver for a smaller step; anything worse ends the realization."""
        if status == DISCARD:
            self._discarded = True
            return 1
        self._failure = self._instance.failed(f"asking for its {what}", status, f"at {time:g} s")
        return -1

    def _stuck(self, what: str) -> FmuCrash:
        self._instance.broken = True
        if self._discarded:
            return self._instance.failed("asking for its derivatives", DISCARD, self._when())
        return FmuCrash(
            f"the solver {what} {self._when()}: the FMU's equations are too stiff, not continuous, or answer"
            f" NaN; try a smaller step_s or another tolerance{self._instance.log.tail()}"
        )

    def _when(self) -> str:
        return f"at {self._time:g} s"


class EventLoop:
    """Event mode of model exchange: in, until nothing changes any more, out.

    Parameters
    ----------
    instance : Instance
        Instantiated.
    """

    def __init__(self, instance: Instance) -> None:
        self._instance = instance
        self.next_time = inf
        """When the next time event is due."""

    def enter(self, when: str) -> None:
        """Enter event mode."""
        self._instance.call("EnterEventMode", when=when)

    def leave(self) -> None:
        """Go on with continuous time."""
        self._instance.call("EnterContinuousTimeMode")

    def update(self, when: str) -> None:
        """Let the discrete states settle.

        Raises
        ------
        FmuCrash
            When they do not, or the FMU asks to end.
        """
        for _ in range(MOST_EVENTS):
            needed, ends, defined, time = self._once(when)
            if ends:
                raise self.ended(when)
            if not needed:
                self.next_time = time if defined else inf
                return
        self._instance.broken = True
        raise FmuCrash(f"the FMU's event {when} does not come to an end{self._instance.log.tail()}")

    def _once(self, when: str) -> tuple[bool, bool, bool, float]:
        if self._instance.version == 2:
            from fmpy.fmi2 import fmi2EventInfo

            info = fmi2EventInfo()
            self._instance.call("NewDiscreteStates", ctypes.byref(info), when=when)
            defined = bool(info.nextEventTimeDefined)
            return (
                bool(info.newDiscreteStatesNeeded),
                bool(info.terminateSimulation),
                defined,
                info.nextEventTime,
            )
        flags = [ctypes.c_bool(False) for _ in range(5)]
        time = ctypes.c_double(inf)
        pointers = [ctypes.byref(flag) for flag in flags]
        self._instance.call("UpdateDiscreteStates", *pointers, ctypes.byref(time), when=when)
        return flags[0].value, flags[1].value, flags[4].value, time.value

    def ended(self, when: str) -> FmuCrash:
        """The error of an FMU that has enough."""
        self._instance.broken = True
        return FmuCrash(f"the FMU asks to end the simulation {when}{self._instance.log.tail()}")


def _raw(instance: Instance, name: str, *arguments: object) -> Callable[..., int]:
    """A C function for the solver's callbacks, which hand over addresses."""
    function = instance.dll[f"fmi{instance.version}{name}"]
    function.argtypes = (ctypes.c_void_p, *arguments)
    checked: Callable[..., int] = function
    return checked


def _sizes(instance: Instance) -> tuple[int, int]:
    """Number of continuous states and of event indicators."""
    if instance.version == 2:
        return instance.description.states, instance.description.indicators
    sizes = []
    for name in ("GetNumberOfContinuousStates", "GetNumberOfEventIndicators"):
        size = ctypes.c_size_t(0)
        instance.call(name, ctypes.byref(size))
        sizes.append(size.value)
    return sizes[0], sizes[1]

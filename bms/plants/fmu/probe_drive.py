"""The commissioning drive: rest, a pulse that charges, rest, a pulse that discharges.

The load is as small as the voltage shows. It grows tenfold from a thousandth of the capacity an hour until
the voltage answers by 0.2 %: with a wrong unit a usual load may be a thousand times too large. An FMU that
takes a voltage is stepped by 0.2 % of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bms.plants.fmu.errors import FmuError

if TYPE_CHECKING:
    from bms.plants.fmu.plant import FmuPlant
    from bms.plants.fmu.session import FmuSession

ANSWER = 2e-3
"""Relative change of the voltage that is sought."""
_PHASE_S = 10.0
_FEWEST, _MOST = 4, 100
_LADDER_PER_H = tuple(10.0**k for k in range(-3, 1))
"""Loads in times of the capacity, where that is known."""
_LADDER_A = tuple(10.0**k for k in range(-3, 4))
_LAST_PER_H = 3.0
_LATE = 0.1


@dataclass(frozen=True, slots=True)
class Sample:
    """State at the terminals after one step; ``asked_A`` is None where a voltage was asked."""

    asked_A: float | None
    current_A: float
    voltage_V: float
    temperature_C: float | None
    soc: float


@dataclass(frozen=True, slots=True)
class Phase:
    """A phase: what was before its first step, and a sample after every step."""

    before: Sample
    samples: tuple[Sample, ...]

    @property
    def last(self) -> Sample:
        """The last sample."""
        return self.samples[-1]


@dataclass(frozen=True, slots=True)
class Record:
    """What the FMU answered.

    Parameters
    ----------
    soc_asked : float or None
        SOC that was set at the start.
    start : Sample
        Before the first step.
    rest, charge, pause, discharge : Phase
        The drive.
    step_s : float
        Length of a step.
    amplitude : float
        Ampere, or volt where the FMU takes a voltage.
    """

    soc_asked: float | None
    start: Sample
    rest: Phase
    charge: Phase
    pause: Phase
    discharge: Phase
    step_s: float
    amplitude: float


def is_late(phase: Phase) -> bool:
    """Whether the voltage answers a step late: hardly at the first, clearly at the last."""
    before_V = phase.before.voltage_V
    return abs(phase.samples[0].voltage_V - before_V) < _LATE * abs(phase.last.voltage_V - before_V)


def drive(session: FmuSession, capacity_Ah: float | None) -> Record:
    """Drive a scratch realization.

    Parameters
    ----------
    session : FmuSession
        The FMU; no realization of it may be in use.
    capacity_Ah : float or None
        Of the pack, as far as known.

    Raises
    ------
    FmuError, FmuCrash
        When the FMU refuses, or does not survive it.
    """
    mapping = session.mapping
    step_s = mapping.step_s
    count = min(max(round(_PHASE_S / step_s), _FEWEST), _MOST)
    soc = 0.5 if mapping.initial_soc is not None or mapping.soc is None else None
    by_voltage = mapping.drive.role == "voltage"
    amplitude = 0.0 if by_voltage else _amplitude(session, soc, capacity_Ah)
    plant = session.start(soc)
    start = _sample(plant, None)
    if by_voltage:
        amplitude = ANSWER * plant.voltage_V
        level_V = plant.voltage_V
        ohm = mapping.pack.resistance_ohm

        def move(direction: int) -> Sample:
            ask_A = plant.current_A + (level_V + direction * amplitude - plant.voltage_V) / ohm
            plant.carry(ask_A, step_s)
            return _sample(plant, None)
    else:

        def move(direction: int) -> Sample:
            plant.carry(direction * amplitude, step_s)
            return _sample(plant, direction * amplitude)

    phases = []
    before = start
    for direction in (0, 1, 0, -1):
        samples = tuple(move(direction) for _ in range(count))
        phases.append(Phase(before, samples))
        before = samples[-1]
    rest, charge, pause, discharge = phases
    return Record(soc, start, rest, charge, pause, discharge, step_s, amplitude)


def _sample(plant: FmuPlant, asked_A: float | None) -> Sample:
    return Sample(asked_A, plant.current_A, plant.voltage_V, plant.temperature_C, plant.soc)


def _amplitude(session: FmuSession, soc: float | None, capacity_Ah: float | None) -> float:
    """The least load of the ladder to which the voltage answers; the last of them if to none."""
    step_s = session.mapping.step_s
    if capacity_Ah is None:
        loads = [session.mapping.scale.parallel * load for load in _LADDER_A]
    else:
        loads = [capacity_Ah * load for load in (*_LADDER_PER_H, _LAST_PER_H)]
    plant = session.start(soc)
    plant.carry(0.0, step_s)
    answered = 0.0
    for load in loads:
        rest_V = plant.voltage_V
        try:
            plant.carry(load, step_s)
        except FmuError:
            # Its limits may be narrower than the ladder; what it bore before is good enough.
            if answered == 0.0:
                raise
            return answered
        answered = load
        if abs(plant.voltage_V - rest_V) >= ANSWER * abs(rest_V):
            return load
        plant.carry(0.0, step_s)
    return answered

"""Commissioning: whether an FMU behaves as its mapping says, found out by a short drive.

A scratch realization rests, is charged, rests and is discharged (`bms.plants.fmu.probe_drive`). Charging has
to raise the voltage and the SOC, the SOC has to follow charge over capacity, and the values have to be those
of a battery. What contradicts the mapping is said with the line that mends it. Besides, it measures what a
mapping may lack: series resistance, start voltage, capacity.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bms.plants.fmu.errors import FmuError
from bms.plants.fmu.probe_drive import Phase, Record, drive, is_late
from bms.plants.fmu.probe_finding import Finding
from bms.plants.fmu.probe_signs import sign_findings
from bms.plants.fmu.probe_units import measured_capacity_Ah, unit_findings

if TYPE_CHECKING:
    from bms.cell import Cell
    from bms.plants.fmu.session import FmuSession

_STEADY = 0.05
"""A current that changes less from one step to the next, relative, counts as held."""


@dataclass(frozen=True, slots=True)
class ProbeReport:
    """What the probe found.

    Parameters
    ----------
    findings : tuple of Finding
        One for each thing that was looked at.
    voltage_V : float
        At the pack's terminals without a load.
    resistance_ohm : float or None
        Series resistance of the pack; None where signs or values contradict.
    capacity_Ah : float or None
        Capacity that the SOC goes with; None where the FMU tells no SOC, does not move it, or takes a
        voltage.
    amplitude : float
        Of the pulses, ampere, or volt where the FMU takes a voltage.
    restoration : str
        How the FMU is brought back to its start.
    record : Record
        All samples.
    """

    findings: tuple[Finding, ...]
    voltage_V: float
    resistance_ohm: float | None
    capacity_Ah: float | None
    amplitude: float
    restoration: str
    record: Record

    @property
    def contradictions(self) -> tuple[Finding, ...]:
        """Findings that contradict the mapping."""
        return tuple(one for one in self.findings if one.level == "contradiction")

    def check(self) -> None:
        """Hold that nothing contradicts the mapping.

        Raises
        ------
        FmuError
            With all contradictions.
        """
        found = self.contradictions
        if found:
            listed = "\n".join(f"  [{one.about}] {one.text}" for one in found)
            raise FmuError(f"the FMU does not behave as the mapping says:\n{listed}")

    def to_json(self) -> dict[str, Any]:
        """Return what ``socwise cosim probe --json`` prints."""
        return {
            "schema": 1,
            "ok": not self.contradictions,
            "findings": [{"level": one.level, "about": one.about, "text": one.text} for one in self.findings],
            "voltage_V": self.voltage_V,
            "resistance_ohm": self.resistance_ohm,
            "capacity_Ah": self.capacity_Ah,
            "amplitude": self.amplitude,
            "restored_by": self.restoration,
        }


def probe(session: FmuSession, cell: Cell | None = None) -> ProbeReport:
    """Try an FMU out: a few dozen steps in a realization of its own.

    Parameters
    ----------
    session : FmuSession
        The FMU; a realization of it that is in use ends.
    cell : Cell or None
        The cell or pack that it is taken for; its voltage window is held against the FMU's voltage.

    Returns
    -------
    ProbeReport
        Contradictions do not raise; see `ProbeReport.check`.

    Raises
    ------
    FmuError, FmuCrash
        When the FMU refuses, or does not survive it.
    """
    mapping = session.mapping
    known_Ah = mapping.pack.capacity_Ah or (None if cell is None else cell.capacity_Ah)
    record = drive(session, known_Ah)
    findings = (*sign_findings(record, mapping), *unit_findings(record, mapping, cell))
    counts = mapping.soc is not None and mapping.drive.role != "voltage"
    clear = all(one.level != "contradiction" for one in findings)
    return ProbeReport(
        findings=findings,
        voltage_V=record.rest.last.voltage_V,
        resistance_ohm=measured_resistance_ohm(record) if clear else None,
        capacity_Ah=measured_capacity_Ah(record) if clear and counts else None,
        amplitude=record.amplitude,
        restoration=session.restoration,
        record=record,
    )


def measured_resistance_ohm(record: Record) -> float | None:
    """Voltage over current at once after a change of load, the relaxation of the first step taken off.

    Parameters
    ----------
    record : Record
        What the FMU answered.

    Returns
    -------
    float or None
        Mean over the two pulses; None where no current flows.
    """
    found = [
        ohm for phase in (record.charge, record.discharge) if (ohm := _resistance_ohm(phase)) is not None
    ]
    return sum(found) / len(found) if found else None


def _resistance_ohm(phase: Phase) -> float | None:
    first, second = phase.samples[:2]
    if is_late(phase):
        first, second = phase.samples[1:3]
    moved_A = first.current_A - phase.before.current_A
    if moved_A == 0.0:
        return None
    # The voltage relaxes on; taken back by a step, it is the one at the start of the first.
    steady = abs(second.current_A - first.current_A) < _STEADY * abs(moved_A)
    relaxed_V = second.voltage_V - first.voltage_V if steady else 0.0
    return max((first.voltage_V - relaxed_V - phase.before.voltage_V) / moved_A, 0.0)

"""What the commissioning drive says of signs: charging raises the voltage and the SOC."""

from __future__ import annotations

from bms.plants.fmu.mapping import Mapping
from bms.plants.fmu.probe_drive import Phase, Record, is_late
from bms.plants.fmu.probe_finding import Finding, doubt, ok, wrong

_DEAF = 1e-7
"""A voltage that changes less, relative, does not follow the load."""
_OTHER = {"charge": "discharge", "discharge": "charge"}


def sign_findings(record: Record, mapping: Mapping) -> list[Finding]:
    """Hold the signs of drive, current and SOC against the voltage.

    Parameters
    ----------
    record : Record
        What the FMU answered.
    mapping : Mapping
        What its variables are said to mean.
    """
    rise_V = _change(record.charge, "voltage_V")
    fall_V = _change(record.discharge, "voltage_V")
    least_V = _DEAF * abs(record.rest.last.voltage_V)
    if mapping.drive.role == "voltage":
        return [*_current(record, mapping, 1), *_soc(record, mapping, 1)]
    if max(abs(rise_V), abs(fall_V)) <= least_V:
        return [_deaf(record, mapping)]
    if rise_V * fall_V >= 0.0:
        text = (
            f"the voltage moves the same way whether it charges ({rise_V:+.4g} V) or discharges"
            f" ({fall_V:+.4g} V); is {mapping.drive.variable!r} the battery's {mapping.drive.role}?"
        )
        return [wrong("drive", text)]
    upwards = 1 if rise_V > 0.0 else -1
    late = [doubt("voltage", "the voltage answers a step late")] if is_late(record.charge) else []
    return [
        _drive(record, mapping, rise_V),
        *late,
        *_current(record, mapping, upwards),
        *_soc(record, mapping, upwards),
    ]


def _drive(record: Record, mapping: Mapping, rise_V: float) -> Finding:
    amount = f"{rise_V:+.4g} V at {record.amplitude:.3g} A"
    if rise_V > 0.0:
        return ok("drive", f"charging raises the voltage ({amount})")
    other = _OTHER[mapping.drive.positive or "charge"]
    return wrong("drive", f'the voltage falls when charging ({amount}): set positive = "{other}" in [drive]')


def _current(record: Record, mapping: Mapping, upwards: int) -> list[Finding]:
    """The direction in which the current says it flowed, against the one in which the voltage says so."""
    if mapping.current is None:
        return []
    moved_A = _change(record.charge, "current_A")
    if moved_A == 0.0:
        text = f"the current {mapping.current.variable!r} does not follow the load; map another output"
        return [wrong("current", text)]
    if moved_A * upwards > 0.0:
        return [ok("current", f"{mapping.current.variable!r} is positive while the voltage rises")]
    other = _OTHER[mapping.current.positive]
    text = (
        f"{mapping.current.variable!r} says {moved_A:+.4g} A while the voltage rises: set positive ="
        f' "{other}" in [current]'
    )
    if upwards < 0:
        text = (
            f"{mapping.current.variable!r} says {moved_A:+.4g} A while the voltage falls: set positive ="
            f' "{other}" in [current] as well'
        )
    return [wrong("current", text)]


def _soc(record: Record, mapping: Mapping, upwards: int) -> list[Finding]:
    if mapping.soc is None:
        return []
    up, down = _gain(record.charge), _gain(record.discharge)
    name = mapping.soc.variable
    if up == down == 0.0:
        return [doubt("soc", f"{name!r} does not move with a charge this small; its sign was not seen")]
    if up * upwards > 0.0 or down * upwards < 0.0:
        return [ok("soc", f"{name!r} rises and falls with the voltage")]
    text = f"{name!r} falls while the voltage rises: it is a depth of discharge, or that of another battery;"
    return [wrong("soc", f"{text} map another output, or leave [soc] out and give capacity_Ah in [pack]")]


def _deaf(record: Record, mapping: Mapping) -> Finding:
    # An FMU whose voltage does not follow its load may be fed through another input, or gives its OCV.
    text = (
        f"the voltage {mapping.voltage.variable if mapping.voltage else ''!r} does not answer a load of"
        f" {record.amplitude:.3g} A: is {mapping.drive.variable!r} the load, and is the voltage that at the"
        " terminals?"
    )
    return wrong("drive", text)


def _change(phase: Phase, name: str) -> float:
    """How far a value has moved in a phase, on average: it may answer late, or decay."""
    values = [getattr(sample, name) for sample in phase.samples]
    return float(sum(values) / len(values) - getattr(phase.before, name))


def _gain(phase: Phase) -> float:
    return phase.last.soc - phase.before.soc

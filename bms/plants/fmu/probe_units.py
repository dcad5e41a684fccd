"""What the commissioning drive says of units and scale: plausible values, and charge against SOC."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bms.plants.fmu.mapping import Mapping, Output
from bms.plants.fmu.probe_drive import Phase, Record
from bms.plants.fmu.probe_finding import Finding, doubt, ok, wrong

if TYPE_CHECKING:
    from bms.cell import Cell

_COLDEST_C, _HOTTEST_C = -60.0, 120.0
_SOC_SLACK = 0.02
_EMPTY = 1e-4
_SAME, _CLOSE, _NEAR = 0.02, 0.05, 0.3
"""Relative: as good as equal, close, and still believed to be meant."""
_PER_CENT = ("%", "percent")
_WINDOW = 0.25
"""How far beyond its cell's window a voltage is believed, relative."""
_KILO = {1e3: "a thousand times", 1e-3: "a thousandth of", 1e2: "a hundred times", 1e-2: "a hundredth of"}


def unit_findings(record: Record, mapping: Mapping, cell: Cell | None) -> list[Finding]:
    """Hold voltage, current, temperature and SOC against what a battery has.

    Parameters
    ----------
    record : Record
        What the FMU answered.
    mapping : Mapping
        What its variables are said to mean.
    cell : Cell or None
        The cell or pack that the FMU is taken for, if any.
    """
    return [
        *_voltage(record, mapping, cell),
        *_current(record, mapping),
        *_temperature(record, mapping),
        *_soc(record, mapping, cell),
    ]


def _voltage(record: Record, mapping: Mapping, cell: Cell | None) -> list[Finding]:
    rest_V = record.rest.last.voltage_V
    if cell is None:
        if rest_V > 0.5 * mapping.scale.series:
            return [ok("voltage", f"{rest_V:.5g} V without a load")]
        unit = _hint(mapping.voltage)
        return [doubt("voltage", f"{rest_V:.3g} V without a load is little for a battery{unit}")]
    low, high = (1.0 - _WINDOW) * cell.voltage_min_V, (1.0 + _WINDOW) * cell.voltage_max_V
    window = f"{cell.voltage_min_V:g} to {cell.voltage_max_V:g} V of {cell.name}"
    if low <= rest_V <= high:
        return [ok("voltage", f"{rest_V:.5g} V without a load, within {window}")]
    ratio = float(cell.ocv(min(max(record.rest.last.soc, 0.0), 1.0))) / rest_V if rest_V > 0.0 else 0.0
    if 300.0 < ratio < 3000.0 or 1.0 / 3000.0 < ratio < 1.0 / 300.0:
        why = f"{'a thousandth' if ratio > 1.0 else 'a thousand times'} of it{_hint(mapping.voltage)}"
    elif ratio > 1.0:
        why = f"1/{ratio:.3g} of it: set series in [scale], now {mapping.scale.series:g}, or --series"
    else:
        why = f"{1.0 / max(ratio, 1e-9):.3g} times it: the FMU is a pack; set --series, or series in [scale]"
    return [wrong("voltage", f"{rest_V:.4g} V without a load is not within {window}, but {why}")]


def _hint(output: Output | None) -> str:
    return (
        ""
        if output is None
        else f"; is its unit {output.unit!r} right?"
        if output.unit
        else "; is its unit right?"
    )


def _current(record: Record, mapping: Mapping) -> list[Finding]:
    """What the FMU says has flowed, against what it was asked for."""
    asked_A, told_A = record.charge.last.asked_A, record.charge.last.current_A
    if mapping.current is None or asked_A is None or told_A == 0.0:
        return []
    ratio = abs(told_A / asked_A)
    if abs(ratio - 1.0) < _SAME:
        return [ok("current", f"{mapping.current.variable!r} is what the input asks for")]
    if abs(ratio - 1.0) < _NEAR:
        return [
            doubt("current", f"{mapping.current.variable!r} is {ratio:.3g} times what the input asks for")
        ]
    by = _factor(ratio, mapping)
    text = f"{mapping.current.variable!r} is {ratio:.4g} times what the input asks for{by}"
    return [wrong("current", f"{text}; check unit in [drive] and [current]")]


def _factor(ratio: float, mapping: Mapping) -> str:
    for known, words in _KILO.items():
        if abs(ratio / known - 1.0) < _NEAR:
            return f", about {words} it"
    for name in ("parallel", "series"):
        count = getattr(mapping.scale, name)
        if count != 1.0 and min(abs(ratio * count - 1.0), abs(ratio / count - 1.0)) < _NEAR:
            return f", which is {name} in [scale]"
    return ""


def _temperature(record: Record, mapping: Mapping) -> list[Finding]:
    output = mapping.temperature
    celsius = record.rest.last.temperature_C
    if output is None or celsius is None:
        return []
    if _COLDEST_C <= celsius <= _HOTTEST_C:
        return [ok("temperature", f"{celsius:.4g} deg C")]
    text = f"{celsius:.4g} deg C is none that a battery has"
    for unit, shift in (("degC", 273.15), ("K", -273.15)):
        if _COLDEST_C <= celsius + shift <= _HOTTEST_C:
            return [wrong("temperature", f'{text}: set unit = "{unit}" in [temperature]')]
    return [wrong("temperature", f"{text}; map another output, or leave [temperature] out")]


def _soc(record: Record, mapping: Mapping, cell: Cell | None) -> list[Finding]:
    if mapping.soc is None:
        return []
    found = []
    now = record.rest.samples[0].soc
    asked = record.soc_asked
    unit = f'unit = "{mapping.soc.unit}"' if mapping.soc.unit else "its unit"
    if now > 1.0 + _SOC_SLACK or now < -_SOC_SLACK:
        why = 'set unit = "%" in [soc]' if 1.0 < now <= 100.0 else f"check {unit} in [soc]"
        if asked and abs(now / (100.0 * asked) - 1.0) < _NEAR and _may_be(mapping.initial_soc, per_cent=True):
            why += (
                ', or, if the FMU does start at a hundred times what was asked, unit = "1" in [initial_soc]'
            )
        found.append(wrong("soc", f"{mapping.soc.variable!r} is {now:.4g}, not a fraction: {why}"))
    elif asked is not None and abs(now - asked) > _SOC_SLACK:
        why = (
            f"a hundredth of it: {_hundredth(record, mapping, cell)}"
            if abs(100.0 * now / asked - 1.0) < _NEAR
            else "check unit in [initial_soc] and in [soc], and that [initial_soc] is the start of this SOC"
        )
        text = f"started at {asked:g}, {mapping.soc.variable!r} says {now:.4g} after the first step"
        found.append(wrong("initial_soc", f"{text}: {why}"))
    else:
        found.append(ok("soc", f"{mapping.soc.variable!r} is {now:.4g}" + (", as asked" if asked else "")))
    return [*found, *_capacity(record, mapping)] if found[0].level == "ok" else found


def _hundredth(record: Record, mapping: Mapping, cell: Cell | None) -> str:
    """Name the unit that makes a SOC a hundredth of what was asked for: the answer's or the start's."""
    read, start = 'set unit = "1" in [soc]', 'set unit = "%" in [initial_soc]'
    if not _may_be(mapping.soc, per_cent=True):
        return start
    if not _may_be(mapping.initial_soc, per_cent=False):
        return read
    found_Ah, known_Ah = measured_capacity_Ah(record), mapping.pack.capacity_Ah
    if known_Ah is None and cell is not None:
        known_Ah = cell.capacity_Ah
    if found_Ah is not None and known_Ah is not None:
        # A SOC that is read as per cent moves by a hundredth, too; one that only starts low moves rightly.
        if abs(found_Ah / known_Ah - 1.0) < _NEAR:
            return start
        if abs(found_Ah / (100.0 * known_Ah) - 1.0) < _NEAR:
            return read
    return f"{read} if the FMU's SOC is a fraction, or {start} if it takes its start in per cent"


def _may_be(variable: Output | None, *, per_cent: bool) -> bool:
    """Whether a variable may be in per cent, or in another unit: the mapping leaves it open, or says so."""
    return variable is not None and (variable.unit is None or (variable.unit in _PER_CENT) == per_cent)


def _capacity(record: Record, mapping: Mapping) -> list[Finding]:
    found_Ah = measured_capacity_Ah(record)
    known_Ah = mapping.pack.capacity_Ah
    if found_Ah is None or known_Ah is None:
        return []
    ratio = found_Ah / known_Ah
    text = f"SOC and charge go with a capacity of {found_Ah:.4g} Ah"
    # The current that answers a voltage decays within a step, and its charge is known roughly.
    if abs(ratio - 1.0) < (_NEAR if mapping.drive.role == "voltage" else _CLOSE):
        return [ok("pack", f"{text}, as capacity_Ah in [pack]")]
    text = f"{text}, {ratio:.3g} times capacity_Ah in [pack], {known_Ah:g}"
    if abs(ratio - 1.0) < _NEAR:
        return [doubt("pack", f"{text}; is it the nominal one?")]
    by = _factor(ratio, mapping)
    return [wrong("pack", f"{text}{by}: check unit in [drive] and [soc], capacity_Ah, and [scale]")]


def measured_capacity_Ah(record: Record) -> float | None:
    """Charge over change of SOC in both pulses, Ah; None where the SOC does not move enough.

    Parameters
    ----------
    record : Record
        What the FMU answered.
    """
    charge_C = gain = 0.0
    for phase, sign in ((record.charge, 1.0), (record.discharge, -1.0)):
        if not all(_EMPTY < sample.soc < 1.0 - _EMPTY for sample in (phase.before, phase.last)):
            continue  # an FMU may hold its SOC at the end of its range
        charge_C += sign * record.step_s * _sum_A(phase)
        gain += sign * (phase.last.soc - phase.before.soc)
    if abs(gain) < 1e-6 or charge_C * gain <= 0.0:
        return None
    return charge_C / gain / 3600.0


def _sum_A(phase: Phase) -> float:
    return sum(sample.current_A for sample in phase.samples)

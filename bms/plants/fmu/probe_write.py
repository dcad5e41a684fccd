"""Put what the probe measured into the text of a mapping, and leave every other line of it as it is."""

from __future__ import annotations

import re

from bms.errors import BatteryError
from bms.plants.fmu.probe import ProbeReport

_SECTION = re.compile(r"^\s*\[")
_NOTE = "measured by socwise cosim probe"


def with_measured(text: str, report: ProbeReport) -> str:
    """Set resistance, and capacity where there is none, in the table ``[pack]`` of a mapping's text.

    Parameters
    ----------
    text : str
        Content of the file.
    report : ProbeReport
        Without contradictions.

    Raises
    ------
    BatteryError
        When the probe found contradictions: what it measured is then of no use.
    """
    if report.contradictions:
        raise BatteryError("the FMU contradicts the mapping; nothing was written. Mend the mapping first")
    lines = text.splitlines()
    if report.resistance_ohm is not None:
        lines = _set(lines, "resistance_ohm", report.resistance_ohm)
    has_capacity = any(re.match(r"\s*capacity_Ah\s*=", line) for line in lines)
    if report.capacity_Ah is not None and not has_capacity:
        lines = _set(lines, "capacity_Ah", report.capacity_Ah)
    return "\n".join(lines) + "\n"


def _set(lines: list[str], key: str, value: float) -> list[str]:
    """Replace the key's line in ``[pack]``, be it commented out, or add one."""
    line = f"{f'{key} = {value:.6g}':<34}  # {_NOTE}"
    heading = next((at for at, text in enumerate(lines) if re.match(r"\s*\[pack\]", text)), None)
    if heading is None:
        return [*lines, "", "[pack]", line]
    end = next((at for at in range(heading + 1, len(lines)) if _SECTION.match(lines[at])), len(lines))
    for pattern in (rf"\s*{key}\s*=", rf"\s*#\s*{key}\s*="):
        for at in range(heading + 1, end):
            if re.match(pattern, lines[at]):
                return [*lines[:at], line, *lines[at + 1 :]]
    return [*lines[: heading + 1], line, *lines[heading + 1 :]]

"""What goes wrong with a functional mock-up unit."""

from __future__ import annotations

from bms.errors import BatteryError


class FmuError(BatteryError):
    """An FMU, or its mapping, that cannot be used as asked; the message says what to do."""


class FmuCrash(FmuError):  # noqa: N818 - what happened, not what was wrong
    """A realization that ended inside the FMU: it crashed, hung, or refused to go on."""

"""Which errors are the user's to mend: shown as one message, without a traceback."""

from __future__ import annotations

import sys


class CommandError(ValueError):
    """An option or argument that cannot be used; the message says what is allowed."""


_ELSEWHERE = (
    ("drivecycles.errors", "CycleError"),
    ("vehicle.errors", "VehicleError"),
    ("bms.errors", "BatteryError"),
    ("ems.errors", "EmsError"),
    ("socwise.results.staging", "StoreError"),
    ("pydantic", "ValidationError"),
)


def user_errors() -> tuple[type[Exception], ...]:
    """Return the classes of errors whose message is written for the user.

    Only modules that are loaded are asked: an error of any other cannot have been raised, and to load them
    would take longer than the command that failed.
    """
    loaded = [getattr(sys.modules[module], name) for module, name in _ELSEWHERE if module in sys.modules]
    return (CommandError, *loaded)

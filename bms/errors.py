"""The error of everything a user can get wrong about a battery."""

from __future__ import annotations


class BatteryError(ValueError):
    """Bad battery input: says what was given, what is allowed and what to do."""

"""The error of everything a user can get wrong about a battery."""

from __future__ import annotations


class BatteryError(ValueError):
    """Bad battery input: says what was given, what is allowed and what to do."""


class BatteryWarning(UserWarning):
    """A battery result that stands on thin ice: says what is outside what, and what that means."""

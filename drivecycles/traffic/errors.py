"""The error and the warning of everything that concerns traffic."""

from __future__ import annotations

from drivecycles.errors import CycleError


class TrafficError(CycleError):
    """Bad traffic input: says what was given, what is allowed and what to do."""


class TrafficWarning(UserWarning):
    """A traffic result that stands on thin ice: says what is outside what, and what that means."""

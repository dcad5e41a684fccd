"""Why a time is not taken."""

from __future__ import annotations


class UnavailableError(RuntimeError):
    """A rival cannot run here: its compiler or its distribution is missing. Its row is left out."""

"""Suggest what an unknown name may have meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def suggest(given: str, known: Iterable[str]) -> str:
    """Give a hint for the end of a message, with the nearest known name; empty if none is near."""
    near = difflib.get_close_matches(given.strip().lower(), list(known), n=1, cutoff=0.5)
    return f"; did you mean {near[0]!r}?" if near else ""

"""The error of everything that can be asked wrongly of a polynomial chaos."""

from __future__ import annotations


class ChaosError(ValueError):
    """Bad parameter of a basis or an expansion: says what was given and what is allowed."""

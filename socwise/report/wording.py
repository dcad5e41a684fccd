"""Numbers and lists as people read them."""

from __future__ import annotations

import math
from collections.abc import Sequence

MISSING = "n/a"


def number(value: float | None, digits: int = 3) -> str:
    """Return a number with fixed decimals and a real minus sign, or "n/a" for None and NaN."""
    if value is None or not math.isfinite(value):
        return MISSING
    text = f"{value:.{digits}f}"
    if float(text) == 0.0:
        text = text.removeprefix("-")
    return text.replace("-", "−")


def per_cent(value: float | None) -> str:
    """Return a percentage without its sign for "per cent": one decimal from 10 on, two below."""
    if value is None or not math.isfinite(value):
        return MISSING
    return number(value, 1 if abs(value) >= 10.0 else 2)


def plus_minus(mean: float | None, half_width: float, digits: int = 3) -> str:
    """Return "mean ± half-width", without the latter where it is NaN."""
    if not math.isfinite(half_width):
        return number(mean, digits)
    return f"{number(mean, digits)} ± {number(half_width, digits)}"


def listing(parts: Sequence[str]) -> str:
    """Return "a", "a and b" or "a, b and c"."""
    if len(parts) < 2:
        return "".join(parts)
    return f"{', '.join(parts[:-1])} and {parts[-1]}"

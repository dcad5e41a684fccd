"""Numbers and lists as people read them."""

from __future__ import annotations

import math
from collections.abc import Sequence

MISSING = "n/a"

SMALL = 1e-3
"""Numbers below this are written with an exponent."""


def number(value: float | None, digits: int = 3) -> str:
    """Return a number with fixed decimals and a real minus sign, or "n/a" for None and NaN."""
    if value is None or not math.isfinite(value):
        return MISSING
    text = f"{value:.{digits}f}"
    if float(text) == 0.0:
        text = text.removeprefix("-")
    return text.replace("-", "−")


def with_error(value: float, error: float) -> str:
    """Return a number with its standard error, to the error's first digit; small ones with an exponent."""
    if abs(value) < SMALL:
        return f"{value:.2g} ± {error:.1g}"
    if error == 0.0:
        return f"{value:.3g} ± 0"
    digits = max(0, -math.floor(math.log10(error)))
    return f"{number(value, digits)} ± {number(error, digits)}"


def per_cent(value: float | None) -> str:
    """Return a percentage without its sign for "per cent": one decimal from 10 on, two below."""
    if value is None or not math.isfinite(value):
        return MISSING
    return number(value, 1 if abs(value) >= 10.0 else 2)


def amount(value: float | None, unit: str) -> str:
    """Return a number as a percentage is written; of kilograms below one more decimals, three or four."""
    if unit == "kg" and value is not None and abs(value) < 1.0:
        return number(value, 3 if abs(value) >= 0.1 else 4)
    return per_cent(value)


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

"""How a parameter of a study is given: one value, a list, or a range."""

from __future__ import annotations

import math
from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, ValidationInfo, field_validator

T = TypeVar("T")

ONE, LIST, RANGE = "one", "list", "range"
KINDS = (ONE, LIST, RANGE)
"""Tags of the three ways; pydantic puts them into the path of an error, where a user has no use for them."""

MOST_VALUES = 100_000


class Range(BaseModel, Generic[T]):
    """Values between two ends, both included.

    Parameters
    ----------
    low, high : number
        The ends.
    count : int, optional
        How many, evenly spaced; for a factorial design, where it must be given.
    scale : {"linear", "log"}
        Evenly spaced in the value or in its logarithm.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)

    low: T = Field(description="lower end")
    high: T = Field(description="upper end, above low")
    count: int | None = Field(
        default=None, ge=2, le=MOST_VALUES, description="how many values; only in a factorial design"
    )
    scale: Literal["linear", "log"] = Field(default="linear", description="even spacing, or even ratios")

    @field_validator("high")
    @classmethod
    def _above_low(cls, high: Any, info: ValidationInfo) -> Any:
        low = info.data.get("low")
        if low is not None and not low < high:
            raise ValueError(f"must be above low, which is {low:g}")
        return high

    @field_validator("scale")
    @classmethod
    def _has_logarithm(cls, scale: str, info: ValidationInfo) -> str:
        low = info.data.get("low")
        if scale == "log" and low is not None and low <= 0.0:
            raise ValueError(f"takes ends above zero, and low is {low:g}; use 'linear'")
        return scale

    def at(self, share: float) -> float:
        """Return the value at a share, 0 to 1, of the way from low to high."""
        low, high = float(self.low), float(self.high)  # type: ignore[arg-type]
        if share <= 0.0 or share >= 1.0:
            return low if share <= 0.0 else high
        if self.scale == "log":
            return math.exp((1.0 - share) * math.log(low) + share * math.log(high))
        return (1.0 - share) * low + share * high

    def spaced(self) -> list[float]:
        """Return ``count`` values, evenly spaced, to twelve digits so that tables can show them."""
        last = (self.count or 2) - 1
        return [float(f"{self.at(place / last):.12g}") for place in range(last + 1)]


def _kind(value: Any) -> str:
    if isinstance(value, dict | Range):
        return RANGE
    return LIST if isinstance(value, list | tuple) else ONE


def _kind_without_range(value: Any) -> str:
    return LIST if isinstance(value, list | tuple) else ONE


Listed = Annotated[list[T], Field(min_length=1)]
Numbers = Annotated[
    Annotated[T, Tag(ONE)] | Annotated[Listed[T], Tag(LIST)] | Annotated[Range[T], Tag(RANGE)],
    Discriminator(_kind),
]
"""A number, a list of numbers, or a range."""
Choices = Annotated[
    Annotated[T, Tag(ONE)] | Annotated[Listed[T], Tag(LIST)], Discriminator(_kind_without_range)
]
"""A value or a list of values."""


def levels(given: Any) -> list[Any]:
    """Return the values of a parameter in a factorial design."""
    if isinstance(given, Range):
        return given.spaced()
    return list(given) if isinstance(given, list | tuple) else [given]

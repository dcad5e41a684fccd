"""What reproducing a table or a figure gives: rows of published and own values, a note, and a picture."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 150
_STYLE: dict[Any, Any] = {"font.size": 9.0, "axes.titlesize": 9.5, "legend.fontsize": 8.5}
# A tolerance written in decimals, like 0.01, must not fail by rounding in binary.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Row:
    """One value.

    Parameters
    ----------
    name : str
        What it is, without its unit.
    published : float or None
        What the source says; None where it only draws or describes it.
    ours : float, str or None
        What we get.
    tolerance : float or None
        Largest absolute deviation from what is published; None where another rule gives the verdict.
    ok : bool
        The verdict; True for a row that only informs.
    unit : str
        Unit of both values; empty where there is none.
    error : float or None
        Standard error of ours, where it is a mean over realizations.
    judged : bool
        False for a row that only informs.
    """

    name: str
    published: float | None
    ours: float | str | None
    tolerance: float | None
    ok: bool
    unit: str = ""
    error: float | None = None
    judged: bool = True

    @classmethod
    def near(
        cls,
        name: str,
        published: float,
        ours: float,
        tolerance: float,
        unit: str = "",
        error: float | None = None,
    ) -> Self:
        """Build a row that is right if ours is within a tolerance of what is published."""
        ok = bool(abs(ours - published) <= tolerance + _ROUNDING * max(1.0, abs(published)))
        return cls(name, published, float(ours), tolerance, ok, unit, error)

    @classmethod
    def between(
        cls,
        name: str,
        low: float,
        high: float,
        ours: float,
        unit: str = "",
        *,
        published: float | None = None,
        error: float | None = None,
    ) -> Self:
        """Build a row that is right if ours is from ``low`` to ``high``; the name says so."""
        limits = f"at most {high:g}" if low == -math.inf else f"at least {low:g}"
        if math.isfinite(low) and math.isfinite(high):
            limits = f"{low:g} to {high:g}"
        return cls(f"{name}, wanted {limits}", published, ours, None, low <= ours <= high, unit, error)

    @classmethod
    def holds(
        cls,
        name: str,
        ok: bool,
        ours: float | str,
        unit: str = "",
        *,
        published: float | None = None,
        error: float | None = None,
    ) -> Self:
        """Build a row whose name is a statement that holds or does not."""
        return cls(name, published, ours, None, bool(ok), unit, error)

    @classmethod
    def shown(
        cls,
        name: str,
        ours: float | str,
        unit: str = "",
        *,
        published: float | None = None,
        error: float | None = None,
    ) -> Self:
        """Build a row that informs and has no verdict."""
        return cls(name, published, ours, None, True, unit, error, judged=False)

    @property
    def label(self) -> str:
        """Name with the standard error and the unit."""
        error = "" if self.error is None else f", s.e. {self.error:.2g}"
        return f"{self.name}{error}" + (f" [{self.unit}]" if self.unit else "")

    @property
    def deviation(self) -> float | None:
        """Ours less what is published; None where either is missing or not a number."""
        if self.published is None or not isinstance(self.ours, float | int):
            return None
        return float(self.ours) - self.published


@dataclass(frozen=True, eq=False)
class Reproduction:
    """A table or a figure of a source, reproduced.

    Parameters
    ----------
    id : str
        Its id, like ``"larsson-table2"``.
    source : str
        Where it is published.
    rows : tuple of Row
        Values.
    note : str
        What is different here and why; may be empty.
    draw : callable or None
        Draws the picture; None where there is none.
    """

    id: str
    source: str
    rows: tuple[Row, ...]
    note: str = ""
    draw: Callable[[], Figure] | None = None

    @property
    def ok(self) -> bool:
        """Whether every row is right."""
        return all(row.ok for row in self.rows)

    def to_json(self, figure: Path | None = None) -> dict[str, Any]:
        """Return the JSON object of DESIGN.md section 4.

        Parameters
        ----------
        figure : Path, optional
            The picture's file, if one was written.
        """
        return {
            "id": self.id,
            "source": self.source,
            "rows": [
                {
                    "name": row.label,
                    "published": _finite(row.published),
                    "ours": _finite(row.ours),
                    "tolerance": _finite(row.tolerance),
                    "ok": row.ok,
                }
                for row in self.rows
            ],
            "figure": None if figure is None else str(figure),
        }

    def write_figure(self, folder: Path) -> Path | None:
        """Write the picture as ``<id>.png`` (150 dpi).

        Parameters
        ----------
        folder : Path
            Created if absent.

        Returns
        -------
        Path or None
            The file; None if there is no picture.
        """
        if self.draw is None:
            return None
        import matplotlib

        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{self.id}.png"
        part = folder / f".{self.id}.{os.getpid()}.png"
        try:
            with matplotlib.rc_context(_STYLE):
                self.draw().savefig(part, dpi=DPI)
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
        return path


def _finite(value: float | str | None) -> float | str | None:
    """Replace what JSON cannot write, NaN and infinities, by None."""
    return None if isinstance(value, float) and not math.isfinite(value) else value

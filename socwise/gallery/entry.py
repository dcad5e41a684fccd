"""One table or figure of the gallery: what came out, how it is judged, and its file between two runs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.shortfalls import shortfalls_of

Verdict = Literal["failed", "does not reproduce", "with reservations", "reproduces"]
VERDICTS: tuple[Verdict, ...] = ("failed", "does not reproduce", "with reservations", "reproduces")
"""From bad to good."""

FAR = 0.1
"""Deviation from a published value, as a share of it, from which on it is told of whatever the verdict."""


@dataclass(frozen=True, eq=False)
class Entry:
    """One table or figure.

    Parameters
    ----------
    found : Reproduction
        What came out, without its ``draw``.
    title : str
        What it shows, in a few words.
    figure : str or None
        Name of its picture, beside the page.
    failure : str
        Why it could not be computed or drawn; empty if it could.
    run_s : float
        Seconds that it took.
    """

    found: Reproduction
    title: str
    figure: str | None = None
    failure: str = ""
    run_s: float = math.nan

    @property
    def wrong(self) -> tuple[Row, ...]:
        """Rows that are not as they should be."""
        return tuple(row for row in self.found.rows if not row.ok)

    @property
    def verdict(self) -> Verdict:
        """One of `VERDICTS`."""
        if self.failure:
            return "failed"
        if self.wrong:
            return "does not reproduce"
        return "with reservations" if shortfalls_of(self.found.id) else "reproduces"

    @property
    def reason(self) -> str:
        """Why it failed, does not reproduce or does so with reservations; empty where it reproduces."""
        known = " ".join(f"{one.what} {one.reason}" for one in shortfalls_of(self.found.id))
        if self.failure:
            return f"{self.failure} {known}".strip()
        return known or ("No reason is known; it was right when this version was made." if self.wrong else "")


def far_off(row: Row) -> bool:
    """Whether a row deviates from a published value by more than a tenth of it.

    Parameters
    ----------
    row : Row
        One without a published value does not.
    """
    off = row.deviation
    if off is None or row.published is None:
        return False
    return not abs(off) <= FAR * abs(row.published) * (1.0 + 1e-9)


def save(entry: Entry, state: str, path: Path) -> None:
    """Write an entry whole or not at all; timings are left out.

    Parameters
    ----------
    entry : Entry
        What to write.
    state : str
        Digest of all that decides it.
    path : Path
        File to write.
    """
    content = {
        "state": state,
        "id": entry.found.id,
        "title": entry.title,
        "source": entry.found.source,
        "note": entry.found.note,
        "figure": entry.figure,
        "rows": [asdict(row) for row in entry.found.rows],
    }
    part = path.with_name(f".{path.name}.part")
    try:
        part.write_text(json.dumps(content, indent=1, ensure_ascii=False), encoding="utf-8", newline="\n")
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def load(path: Path, state: str) -> Entry | None:
    """Read an entry that `save` wrote.

    Parameters
    ----------
    path : Path
        The file.
    state : str
        Digest that it must have been written with.

    Returns
    -------
    Entry or None
        None if there is none, it is damaged, its picture is missing, or something that decides it changed.
    """
    try:
        content: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if content["state"] != state:
            return None
        figure = content["figure"]
        if figure is not None and not (path.parent.parent / figure).is_file():
            return None
        rows = tuple(Row(**row) for row in content["rows"])
        found = Reproduction(content["id"], content["source"], rows, content["note"])
        return Entry(found, content["title"], figure)
    except (OSError, ValueError, LookupError, TypeError):
        return None

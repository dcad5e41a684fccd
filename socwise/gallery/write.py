"""Write the gallery: one page, one CSV, the manifest; pictures are there already."""

from __future__ import annotations

import csv
import json
import math
import platform
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from socwise.gallery.entry import Entry
from socwise.gallery.page import render
from socwise.gallery.state import state_digest
from socwise.reproduce.record import Row
from socwise.reproduce.shortfalls import OMITTED
from socwise.results.plain import finite, versions
from socwise.results.staging import MANIFEST

PAGE, CSV, TIMINGS = "index.html", "results.csv", "timings.json"
GALLERY_FORMAT = "socwise gallery"
_COLUMNS = (
    "id", "source", "name", "published", "ours", "deviation", "tolerance", "ok", "unit", "standard_error",
    "note", "reason",
)  # fmt: skip


def write_gallery(entries: Sequence[Entry], out: Path, *, complete: bool) -> None:
    """Write page, CSV, manifest and timings into the folder that holds the pictures.

    Of the same entries all but the timings have the same bytes. Each file is there whole or not at all.

    Parameters
    ----------
    entries : sequence of Entry
        What to show, in the order of the sources.
    out : Path
        The folder.
    complete : bool
        Whether these are all items: only then are those listed that are not reproduced at all.
    """
    out.mkdir(parents=True, exist_ok=True)
    manifest = {
        "format": GALLERY_FORMAT,
        "schema": 1,
        "complete": complete,
        "state_sha256": state_digest(),
        "python": platform.python_version(),
        "packages": versions(),
        "items": [
            {"id": one.found.id, "verdict": one.verdict, "rows": len(one.found.rows), "wrong": len(one.wrong)}
            for one in entries
        ],
    }
    _whole(out / CSV, lambda path: _write_csv(path, entries, complete=complete))
    page = render(entries, manifest, out, complete=complete)
    _whole(out / PAGE, lambda path: path.write_text(page, encoding="utf-8", newline="\n"))
    _write_timings(out / TIMINGS, entries)
    _whole(out / MANIFEST, lambda path: _write_json(path, manifest))


def _write_csv(path: Path, entries: Sequence[Entry], *, complete: bool) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, _COLUMNS, restval="", lineterminator="\n")
        writer.writeheader()
        for entry in entries:
            writer.writerows(_line(entry, row) for row in entry.found.rows)
        for one in OMITTED if complete else ():
            writer.writerow({"id": one.id, "source": one.title, "name": "not covered", "reason": one.reason})


def _line(entry: Entry, row: Row) -> dict[str, Any]:
    line = {
        "id": entry.found.id,
        "source": entry.found.source,
        "name": row.name,
        "published": row.published,
        "ours": row.ours,
        "deviation": row.deviation,
        "tolerance": row.tolerance,
        # A row without verdict is neither right nor wrong.
        "ok": ("true" if row.ok else "false") if row.judged or not row.ok else None,
        "unit": row.unit,
        "standard_error": row.error,
        "note": entry.found.note,
        "reason": entry.reason,
    }
    return {key: "" if value is None else value for key, value in finite(line).items()}


def _write_timings(path: Path, entries: Sequence[Entry]) -> None:
    try:
        known = dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        known = {}
    new = {one.found.id: round(one.run_s, 2) for one in entries if math.isfinite(one.run_s)}
    _whole(path, lambda part: _write_json(part, known | new))


def _write_json(path: Path, content: object) -> None:
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8", newline="\n")


def _whole(path: Path, write: Callable[[Path], object]) -> None:
    with tempfile.TemporaryDirectory(prefix=f".{path.name}-", dir=path.parent) as folder:
        part = Path(folder) / path.name
        write(part)
        part.replace(path)

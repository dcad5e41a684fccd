"""The page of the gallery: the answer, what does not reproduce and why, and every table and figure."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from socwise.gallery.blocks import contents, far_table, item_block, omitted_table, reservations, wrong_table
from socwise.gallery.entry import Entry, far_off
from socwise.report.html import fill, paragraph, region, script, template
from socwise.report.tables import facts_table

SOURCES = {"larsson": "Larsson, Johannesson and Egardt", "mautc": "Report MAUTC-2010-02"}


def render(entries: Sequence[Entry], manifest: Mapping[str, Any], out: Path, *, complete: bool) -> str:
    """Return the page as text.

    Parameters
    ----------
    entries : sequence of Entry
        What to show, in the order of the sources.
    manifest : mapping
        How it was made.
    out : Path
        Folder of the pictures, which are put into the page.
    complete : bool
        Whether to list what is not reproduced at all.

    Returns
    -------
    str
        A complete HTML document that needs nothing beside it.
    """
    by_source = {
        name: group
        for key, name in SOURCES.items()
        if (group := [one for one in entries if one.found.id.startswith(f"{key}-")])
    }
    rows = [row for one in entries for row in one.found.rows]
    return fill(
        template("gallery.html"),
        {
            "STYLE": template("report.css"),
            "MORE_STYLE": template("gallery.css"),
            "SUBTITLE": escape(
                f"{len(entries)} tables and figures, {len(rows):,} rows: published values beside those of "
                f"socwise {manifest['packages']['socwise']}"
            ),
            "ANSWER": "".join(
                [
                    paragraph(_answer(entries)),
                    *(paragraph(_of_source(name, group)) for name, group in by_source.items()),
                ]
            ),
            "WRONG": wrong_table(entries),
            "RESERVATIONS": reservations(entries),
            "OMITTED": omitted_table() if complete else "",
            "FAR": far_table(entries),
            "CONTENTS": "".join(
                f"<h3>{escape(name)}</h3>{contents(group)}" for name, group in by_source.items()
            ),
            "ITEMS": "".join(_section(name, group, out) for name, group in by_source.items()),
            "FACTS": region("Manifest", facts_table(_facts(manifest))),
            "TABLE_SCRIPT": script(template("table.js")),
        },
    )


def _answer(entries: Sequence[Entry]) -> list[str]:
    failed = [one for one in entries if one.failure]
    wrong = [one for one in entries if one.wrong and not one.failure]
    count = sum(len(one.wrong) for one in entries)
    judged = sum(row.judged for one in entries for row in one.found.rows)
    doubtful = sum(one.verdict == "with reservations" for one in entries)
    if not count:
        lead = (
            f"Every one of the {judged} rows with a verdict is as it should be; {doubtful} of {len(entries)} "
            "tables and figures reproduce with reservations only."
        )
    else:
        parts = [f"{len(wrong)} of {len(entries)} tables and figures do not reproduce"] if wrong else []
        parts += [f"{len(failed)} failed"] if failed else []
        lead = (
            f"{'; '.join(parts)}: {count} of {judged} rows with a verdict are not as they should be. "
            f"{doubtful} reproduce with reservations only."
        )
    return [
        lead,
        "A reservation: a tolerance had to be wide, the data behind the original are not public, or a "
        "statement of the source does not hold. They stand below, before everything else.",
    ]


def _of_source(name: str, group: Sequence[Entry]) -> list[str]:
    rows = [row for one in group for row in one.found.rows]
    published = [row for row in rows if row.deviation is not None]
    near = sum(not far_off(row) for row in published)
    return [
        f"{name}: {len(group)} tables and figures.",
        f"Of {len(published)} values that are published as numbers {near} are met within 10 %. The other "
        f"{len(rows) - len(published)} rows hold what the source says in words or draws, and what our own "
        "model must satisfy.",
    ]


def _section(name: str, group: Sequence[Entry], out: Path) -> str:
    blocks = "".join(item_block(one, _picture(one, out)) for one in group)
    return f"<section><h2>{escape(name)}</h2>{blocks}</section>"


def _picture(entry: Entry, out: Path) -> str | None:
    if entry.figure is None:
        return None
    return base64.b64encode((out / entry.figure).read_bytes()).decode()


def _facts(manifest: Mapping[str, Any]) -> dict[str, str]:
    return {
        "Command": "socwise reproduce all" if manifest["complete"] else "socwise reproduce --gallery",
        "Python": manifest["python"],
        "Packages": ", ".join(f"{name} {version}" for name, version in manifest["packages"].items()),
        "Code, data and packages, SHA-256": manifest["state_sha256"],
        "Every row": "results.csv beside this page",
    }

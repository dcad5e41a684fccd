"""The parts of the gallery's page, as HTML."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from socwise.gallery.entry import Entry, far_off
from socwise.report.html import region, unbroken
from socwise.reproduce.record import Row
from socwise.reproduce.shortfalls import OMITTED, SHORTFALLS
from socwise.results.plain import finite

MISSING = "–"
_ROUNDING = 1e-12
_TONES = {
    "failed": "bad",
    "does not reproduce": "bad",
    "with reservations": "doubt",
    "reproduces": "good",
}


def wrong_table(entries: Sequence[Entry]) -> str:
    """Return what is not as it should be in this run, with the reason of each item."""
    bad = [one for one in entries if one.wrong]
    if not bad:
        return "<p>No row of this run is outside its tolerance.</p>"
    rows = "".join(
        f'<tr class="wrong"><th scope="row">{_link(one)}</th><td class="words">{escape(row.label)}</td>'
        f'{_values(row)}<td class="words">{escape(one.reason)}</td></tr>'
        for one in bad
        for row in one.wrong
    )
    heads = ("Item", "Row", "Published", "Ours", "Deviation", "Allowed", "Reason")
    return _table("Rows that are not as they should be", heads, rows, words=("Row", "Reason"))


def reservations(entries: Sequence[Entry]) -> str:
    """Return what is known not to reproduce or not to hold, whatever the tolerances say."""
    shown = {one.found.id: one for one in entries}
    points = []
    for one in SHORTFALLS:
        here = [shown[item] for item in one.items if item in shown]
        if here:
            links = ", ".join(_link(entry) for entry in here)
            points.append(
                f"<li><strong>{unbroken(escape(one.what))}</strong> {unbroken(escape(one.reason))} "
                f'<span class="note">{links}</span></li>'
            )
    if not points:
        return ""
    return f'<h3>Reservations</h3><ul class="reasons">{"".join(points)}</ul>'


def omitted_table() -> str:
    """Return what is not reproduced at all."""
    rows = "".join(
        f'<tr><th scope="row">{escape(one.id)}</th><td class="words">{escape(one.title)}</td>'
        f'<td class="words">{escape(one.reason)}</td></tr>'
        for one in OMITTED
    )
    table = _table("Not covered", ("Item", "What it shows", "Why"), rows, words=("What it shows", "Why"))
    return f"<h3>Not covered</h3>{table}"


def far_table(entries: Sequence[Entry]) -> str:
    """Return all rows that deviate from a published value by more than a tenth, whatever their verdict."""
    far = [(one, row) for one in entries for row in one.found.rows if far_off(row)]
    if not far:
        return ""
    rows = "".join(
        f'<tr><th scope="row">{_link(one)}</th><td class="words">{escape(row.label)}</td>{_values(row)}'
        f"<td>{_verdict(row)}</td></tr>"
        for one, row in far
    )
    heads = ("Item", "Row", "Published", "Ours", "Deviation", "Allowed", "Verdict")
    table = _table("Rows more than 10 % off", heads, rows, words=("Row",), name="far", classes="scroll tall")
    return (
        f'<details class="screen"><summary>{len(far)} rows deviate from a published value by more than '
        '10 %, whatever their verdict</summary><div class="controls"><label>Filter by words '
        '<input type="search" data-filter="far" autocomplete="off"></label>'
        f'<span class="count" id="far-count"></span></div>{table}</details>'
    )


def contents(entries: Sequence[Entry]) -> str:
    """Return links to the items of a source, each with its verdict."""
    points = "".join(
        f'<li><a href="#{escape(one.found.id)}">{escape(_short(one))}</a> {escape(one.title)} '
        f"{_chip(one, short=True)}</li>"
        for one in entries
    )
    return f'<ul class="contents">{points}</ul>'


def item_block(entry: Entry, picture: str | None) -> str:
    """Return one item: verdict, rows, picture, note.

    Parameters
    ----------
    entry : Entry
        What to show.
    picture : str or None
        Its PNG in base64.
    """
    found = entry.found
    rows = "".join(_row(row) for row in found.rows)
    heads = ("Row", "Published", "Ours", "Deviation", "Deviation, %", "Allowed", "Verdict")
    table = _table(f"Rows of {found.id}", heads, rows, classes="scroll tall")
    image = ""
    if picture is not None:
        label = escape(f"{_short(entry)}, reproduced: {entry.title}")
        image = f'<img alt="{label}" src="data:image/png;base64,{picture}">'
    both = " both" if image and table else ""
    note = f'<p class="note">{unbroken(escape(found.note))}</p>' if found.note else ""
    failure = f'<p class="bad">{escape(entry.failure)}</p>' if entry.failure else ""
    head = (
        f'<h3 id="{escape(found.id)}">{escape(_short(entry))}: {escape(entry.title)} {_chip(entry)}</h3>'
        f'<p class="note">{escape(found.source)}. <code>socwise reproduce {escape(found.id)}</code></p>'
    )
    body = f'<div class="body{both}"><div>{table}</div>{image}</div>'
    return f'<article class="item">{head}{failure}{body}{note}</article>'


def _row(row: Row) -> str:
    share = None
    if row.deviation is not None and row.published:
        share = 100.0 * row.deviation / abs(row.published)
    marked = "" if row.ok else ' class="wrong"'
    return (
        f'<tr{marked}><th scope="row">{escape(row.label)}</th>{_number(row.published)}{_number(row.ours)}'
        f"{_number(row.deviation)}{_number(share, '+.1f')}{_number(row.tolerance)}"
        f"<td>{_verdict(row)}</td></tr>"
    )


def _values(row: Row) -> str:
    return "".join(_number(value) for value in (row.published, row.ours, row.deviation, row.tolerance))


def _number(value: float | str | None, form: str = ".4g") -> str:
    value = finite(value)
    if value is None:
        return f"<td>{MISSING}</td>"
    if isinstance(value, str):
        return f'<td class="words">{escape(value)}</td>'
    # What is left of two equal decimals is no deviation.
    shown = 0.0 if abs(value) < _ROUNDING else value
    return f'<td data-v="{shown:.9g}">{format(shown, form).replace("-", "−")}</td>'


def _verdict(row: Row) -> str:
    if not row.ok:
        return '<span class="bad">not ok</span>'
    return '<span class="good">ok</span>' if row.judged else "shown"


def _table(
    label: str,
    heads: Sequence[str],
    rows: str,
    *,
    words: Sequence[str] = (),
    name: str = "",
    classes: str = "scroll",
) -> str:
    cells = "".join(
        f'<th scope="col"{" class=words" if head in words else ""}>{escape(head)}</th>' for head in heads
    )
    identity = f' id="{name}"' if name else ""
    return region(
        label,
        f"<table data-sortable{identity}><thead><tr>{cells}</tr></thead><tbody>{rows}</tbody></table>",
        classes,
    )


def _chip(entry: Entry, *, short: bool = False) -> str:
    verdict = entry.verdict
    text = "" if short and verdict == "reproduces" else verdict
    return f'<span class="chip {_TONES[verdict]}">{text or "ok"}</span>'


def _link(entry: Entry) -> str:
    return f'<a href="#{escape(entry.found.id)}">{escape(entry.found.id)}</a>'


def _short(entry: Entry) -> str:
    place = entry.found.id.partition("-")[2]
    return place.replace("table", "Table ").replace("fig", "Fig ")

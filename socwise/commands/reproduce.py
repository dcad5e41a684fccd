"""``socwise reproduce``: the tables and figures of the papers, published values beside ours."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from socwise.commands.errors import CommandError
from socwise.commands.files import check_file
from socwise.commands.options import DEFAULT_JOBS, JobsOption, JsonOption
from socwise.commands.screen import complain, new_table, progress, show, show_json

if TYPE_CHECKING:
    from rich.table import Table

    from socwise.gallery import Entry
    from socwise.reproduce import Reproduction, Row

_MISSING = "–"
_ROUNDING = 1e-12


def reproduce(
    what: Annotated[
        list[str],
        typer.Argument(metavar="list | ID... | all", help="What to reproduce; 'list' shows the IDs."),
    ],
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder for pictures, and for the page and the CSV of 'all'.")
    ] = Path("results/reproduce"),
    gallery: Annotated[
        bool, typer.Option("--gallery", metavar="", help="Page and CSV of the named IDs, too.")
    ] = False,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume",
            metavar="",
            help="Take over what an interrupted 'all' finished, unless anything changed.",
        ),
    ] = False,
    jobs: JobsOption = DEFAULT_JOBS,
    as_json: JsonOption = False,
) -> None:
    """Reproduce tables and figures of the papers, row by row; all of them as a gallery.

    Exit code 1 if a row is not as it should be.
    """
    from socwise.reproduce import ids, title

    if what == ["list"]:
        _list({item: title(item) for item in ids()}, as_json=as_json)
        return
    every = "all" in what
    gallery = gallery or every
    if resume and not gallery:
        raise CommandError("--resume goes with 'all' or --gallery, which keep what they finished")
    items = list(ids()) if every else list(dict.fromkeys(item.strip().lower() for item in what))
    for item in items:
        title(item)  # refuses what it does not know, before anything is computed
        check_file(out / f"{item}.png")
    entries = _run(items, out, jobs, gallery=gallery, resume=resume, as_json=as_json)
    if gallery:
        _write(entries, out, every=every, as_json=as_json)
    if as_json:
        objects = [one.found.to_json(_picture(one, out)) for one in entries]
        show_json(objects[0] if len(objects) == 1 and not every else objects)
    if not all(one.found.ok for one in entries):
        raise typer.Exit(1)


def _run(
    items: list[str], out: Path, jobs: int, *, gallery: bool, resume: bool, as_json: bool
) -> list[Entry]:
    from socwise.gallery.collect import collect

    entries = []
    for entry in collect(items, out, jobs=jobs, resume=resume, keep=gallery, bar=progress, complain=complain):
        entries.append(entry)
        if not as_json:
            _show(entry.found, _picture(entry, out))
    return entries


def _picture(entry: Entry, out: Path) -> Path | None:
    return None if entry.figure is None else out / entry.figure


def _write(entries: list[Entry], out: Path, *, every: bool, as_json: bool) -> None:
    from socwise.gallery import CSV, PAGE, write_gallery

    try:
        write_gallery(entries, out, complete=every)
    except OSError as error:
        raise CommandError(f"cannot write {out}: {error.strerror or error}; choose another --out") from error
    if not as_json:
        wrong = sum(not one.found.ok for one in entries)
        verdict = f"{wrong} of them do not reproduce" if wrong else "every row is as it should be"
        show(
            "",
            f"{len(entries)} tables and figures; {verdict}.",
            f"The gallery is {out / PAGE}, its rows {out / CSV}",
        )


def _list(titles: dict[str, str], *, as_json: bool) -> None:
    if as_json:
        show_json([{"id": item, "title": title} for item, title in titles.items()])
        return
    table = new_table("ID", "what it shows", left=2)
    for item, title in titles.items():
        table.add_row(item, title)
    show(table)


def _show(found: Reproduction, figure: Path | None) -> None:
    show(f"{found.id}: {found.source}", "", _rows_table(found.rows))
    if found.note:
        show("", found.note)
    if figure is not None:
        show("", f"The picture is {figure}")
    wrong = sum(not row.ok for row in found.rows)
    show("" if wrong == 0 else f"\n{wrong} of {len(found.rows)} rows are not as they should be.\n")


def _rows_table(rows: tuple[Row, ...]) -> Table:
    from rich.text import Text

    table = new_table("", "published", "ours", "deviation", "allowed", "", left=1)
    for row in rows:
        verdict = Text("ok") if row.ok else Text("NO", style="bold red")
        table.add_row(
            row.label,
            _cell(row.published),
            _cell(row.ours),
            _cell(row.deviation),
            _cell(row.tolerance),
            verdict,
        )
    return table


def _cell(value: Any) -> str:
    if value is None:
        return _MISSING
    if isinstance(value, str):
        return value
    # What is left of two equal decimals is no deviation.
    return f"{0.0 if abs(value) < _ROUNDING else value:.4g}"

"""``socwise reproduce``: the tables and figures of the papers, published values beside ours."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from socwise.commands.files import check_file
from socwise.commands.options import DEFAULT_JOBS, JobsOption, JsonOption
from socwise.commands.screen import new_table, progress, show, show_json

if TYPE_CHECKING:
    from rich.table import Table

    from socwise.reproduce import Reproduction, Row

_MISSING = "–"
_ROUNDING = 1e-12


def reproduce(
    what: Annotated[
        list[str],
        typer.Argument(metavar="list | ID... | all", help="What to reproduce; 'list' shows the IDs."),
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for pictures.")] = Path(
        "results/reproduce"
    ),
    jobs: JobsOption = DEFAULT_JOBS,
    as_json: JsonOption = False,
) -> None:
    """Reproduce tables and figures of the papers, row by row.

    Exit code 1 if a row is not as it should be.
    """
    from socwise.reproduce import ids, title

    if what == ["list"]:
        _list({item: title(item) for item in ids()}, as_json=as_json)
        return
    items = list(ids()) if "all" in what else list(dict.fromkeys(item.strip().lower() for item in what))
    for item in items:
        title(item)  # refuses what it does not know, before anything is computed
        check_file(out / f"{item}.png")
    objects = []
    every_row_ok = True
    for item in items:
        found, figure = _run(item, out, jobs)
        objects.append(found.to_json(figure))
        every_row_ok = every_row_ok and found.ok
        if not as_json:
            _show(found, figure)
    if as_json:
        show_json(objects[0] if len(objects) == 1 else objects)
    if not every_row_ok:
        raise typer.Exit(1)


def _run(item: str, out: Path, jobs: int) -> tuple[Reproduction, Path | None]:
    from socwise.reproduce import run

    with progress(item) as advance:
        found = run(item, jobs=jobs, progress=advance)
        return found, found.write_figure(out)


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

"""``socwise report``: write the page of a folder of results anew."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from socwise.commands.files import check_file, staged_file
from socwise.commands.screen import show

PAGE = "report.html"


def report(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder that `socwise compare` or `socwise run` wrote.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Page to write; report.html in the folder if left out."),
    ] = None,
) -> None:
    """Write one self-contained HTML page about a comparison or a study, finished or not."""
    from socwise.report import render_any

    page = folder / PAGE if out is None else out
    if out is not None:
        check_file(page, ".html", ".htm")
    content = render_any(folder)
    with staged_file(page) as path:
        path.write_text(content, encoding="utf-8", newline="\n")
    show(f"The report is {page}")

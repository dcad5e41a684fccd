"""``socwise report``: write the page of a folder of results anew."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from socwise.commands.files import staged_file
from socwise.commands.screen import show

PAGE = "report.html"


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that `socwise compare --out` wrote.")],
) -> None:
    """Write one self-contained HTML page about a comparison, as report.html in its folder."""
    from socwise.report import write_report
    from socwise.store import read

    stored = read(folder)
    page = folder / PAGE
    with staged_file(page) as path:
        write_report(stored, path)
    show(f"The report is {page}")

"""The page of whatever a folder holds."""

from __future__ import annotations

from pathlib import Path

from socwise.report.page import render
from socwise.report.study_page import render_study
from socwise.results.reading import read
from socwise.results.staging import StoreError, held_format
from socwise.study.layout import FORMAT as STUDY_FORMAT
from socwise.study.reading import read_study


def render_any(folder: Path) -> str:
    """Return one self-contained HTML page about the comparison or the study in a folder.

    Parameters
    ----------
    folder : Path
        Folder of results.

    Raises
    ------
    StoreError
        If the folder holds neither, or is damaged.
    """
    form = held_format(folder)
    if form == STUDY_FORMAT:
        return render_study(read_study(folder))
    if form is not None and form != "socwise comparison":
        raise StoreError(
            f"{folder} holds a {form}, of which there is no page; name a folder that `socwise compare --out` "
            "or `socwise run --out` wrote"
        )
    return render(read(folder))

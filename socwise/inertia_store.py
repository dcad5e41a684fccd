"""Write estimates of mass and inertia: numbers, traces and figures, in one folder."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from socwise.figures.inertia import write_inertia_figures
from socwise.inertia import InertiaRun
from socwise.results.inertia import write_inertia_run
from socwise.results.plain import finite, versions, write_json, write_rows
from socwise.results.staging import INERTIA_FORMAT, MANIFEST, files_below, staged

TIMING = "run_s"


def write_inertia(
    runs: Sequence[InertiaRun], result: Mapping[str, Any], settings: Mapping[str, Any], out: Path
) -> None:
    """Write estimates to a folder, as a whole or not at all.

    Traces are kept and figures drawn of the first seed; of all seeds the numbers are in ``result.json`` and,
    a row for each, in ``summary.csv``. Of the same input every file but ``result.json``, which holds timings,
    has the same bytes.

    Parameters
    ----------
    runs : sequence of InertiaRun
        At least one.
    result : mapping
        The object that ``socwise inertia --json`` prints.
    settings : mapping
        What was asked for, for the manifest.
    out : Path
        The folder. Earlier results in it are replaced once the new ones are complete.

    Raises
    ------
    StoreError
        If the folder holds something else or cannot be written.
    """
    with staged(out, INERTIA_FORMAT) as folder:
        write_json(folder / "result.json", result)
        write_rows(folder / "summary.csv", result["estimates"], without=(TIMING, "notes"))
        for run in runs:
            if run.seed == runs[0].seed:
                write_inertia_run(run, folder / f"{run.label}.nc")
        write_inertia_figures(runs, folder / "figures")
        write_json(folder / MANIFEST, _manifest(settings, files_below(folder)))


def _manifest(settings: Mapping[str, Any], written: list[str]) -> dict[str, Any]:
    content = finite(settings)
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return {
        "format": INERTIA_FORMAT,
        "schema": 1,
        "python": platform.python_version(),
        "packages": versions(),
        "settings_sha256": hashlib.sha256(canonical.encode()).hexdigest(),
        "settings": content,
        "files": sorted([*written, MANIFEST]),
    }

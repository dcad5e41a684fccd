"""Write a comparison: numbers, trajectories, figures and report, in one folder."""

from __future__ import annotations

import csv
import hashlib
import json
import platform
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ems.records import Case, Comparison
from socwise.figures import write_figures
from socwise.report import write_report
from socwise.results import StoredComparison, StoreError, check_writable, read, write_case
from socwise.results.plain import finite, versions, write_json, write_rows
from socwise.results.staging import FORMAT, MANIFEST, files_below, staged

__all__ = ["StoreError", "StoredComparison", "case_files", "check_writable", "read", "write"]

_REPORT = "report.html"
_TIMING = "solve_s"


def write(comparison: Comparison, result_json: Mapping[str, Any], out: Path, jobs: int = 1) -> None:
    """Write a comparison to a folder, as a whole or not at all.

    Only ``result.json`` holds timings; of the same comparison every other file has the same bytes.

    Parameters
    ----------
    comparison : Comparison
        Cycle, cases with their trajectories, settings.
    result_json : mapping
        The object that ``socwise compare --json`` prints for it; NaN and infinity are written as null.
    out : Path
        The folder. Earlier results in it are replaced once the new ones are complete.
    jobs : int
        Processes that draw the figures, where there are enough data for several.

    Raises
    ------
    StoreError
        If the folder holds something else or cannot be written.
    """
    result = finite(dict(result_json))
    with staged(out) as folder:
        write_json(folder / "result.json", result)
        write_rows(folder / "summary.csv", result["cases"], without=(_TIMING,))
        _write_cycle(folder / "cycle.csv", comparison)
        (folder / "cases").mkdir()
        files = case_files(comparison.cases)
        for case, name in zip(comparison.cases, files, strict=True):
            write_case(case, comparison.seed, folder / name)
        write_figures(comparison, folder / "figures", jobs)
        manifest = _manifest(comparison, files, files_below(folder))
        write_json(folder / MANIFEST, manifest)
        write_report(read(folder), folder / _REPORT)


def case_files(cases: tuple[Case, ...]) -> list[str]:
    """Return a relative path for each case, safe on every file system and different for different cases."""
    names: list[str] = []
    for case in cases:
        # A concept may be the path of a user's file, and two values of mu may agree in six digits.
        concept = re.sub(r"[^A-Za-z0-9_.-]+", "-", case.concept).strip("-.") or "concept"
        stem = name = f"cases/{concept}_mu{case.mu:g}_{case.policy}"
        taken = {other.lower() for other in names}
        count = 1
        while f"{name}.nc".lower() in taken:
            count += 1
            name = f"{stem}-{count}"
        names.append(f"{name}.nc")
    return names


def _manifest(comparison: Comparison, case_names: list[str], written: list[str]) -> dict[str, Any]:
    settings = finite(comparison.settings)
    canonical = json.dumps(settings, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return {
        "format": FORMAT,
        "schema": 1,
        "seed": comparison.seed,
        "cycle": comparison.cycle_name,
        "python": platform.python_version(),
        "packages": versions(),
        "settings_sha256": hashlib.sha256(canonical.encode()).hexdigest(),
        "settings": settings,
        "cases": [
            {"concept": case.concept, "mu": case.mu, "policy": case.policy, "file": name}
            for case, name in zip(comparison.cases, case_names, strict=True)
        ],
        "files": sorted([*written, MANIFEST, _REPORT]),
    }


def _write_cycle(path: Path, comparison: Comparison) -> None:
    columns = (comparison.time_s, comparison.speed_mps, comparison.altitude_m)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("time_s", "speed_mps", "altitude_m"))
        writer.writerows(rows)

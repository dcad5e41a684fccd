"""What lies where in the folder of a study.

==========================  =================================================================
``study.toml``              the study as it was given
``manifest.json``           what is computed and with what: cases with factors and keys
``cases/KEY.json``          a finished case
``cases/KEY.error.json``    a case that failed, and why
``timings/KEY.json``        how long it took and how much memory; apart, since it never repeats
``trajectories/KEY/*.nc``   one file for each policy, where the study keeps trajectories
``summary.csv``             a row for each case and policy, once all is computed
``paired.csv``              a row for each paired difference, once all is computed
``lock.json``               there while a run writes to the folder
==========================  =================================================================
"""

from __future__ import annotations

from pathlib import Path

FORMAT = "socwise study"
SCHEMA = 1

STUDY, MANIFEST, LOCK = "study.toml", "manifest.json", "lock.json"
SUMMARY, PAIRED = "summary.csv", "paired.csv"
CASES, TIMINGS, TRAJECTORIES = "cases", "timings", "trajectories"
TEMPORARY = ".tmp"
"""How the names end under which files are written before they get their own."""


def case_file(folder: Path, key: str) -> Path:
    """Where a finished case lies."""
    return folder / CASES / f"{key}.json"


def error_file(folder: Path, key: str) -> Path:
    """Where the error of a case that failed lies."""
    return folder / CASES / f"{key}.error.json"


def timing_file(folder: Path, key: str) -> Path:
    """Where the timing of a case lies."""
    return folder / TIMINGS / f"{key}.json"


def trajectory_folder(folder: Path, key: str) -> Path:
    """Where the trajectories of a case lie."""
    return folder / TRAJECTORIES / key

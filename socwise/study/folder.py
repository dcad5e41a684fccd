"""Write to the folder of a study: each file whole or not at all, so that a run may end at any moment.

A file is written under a temporary name, brought to the disk, and then renamed. Of a case, trajectories and
timing come first and the case itself last: where it stands, all of it is there.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from socwise.results.staging import StoreError
from socwise.study.layout import (
    CASES,
    FORMAT,
    LOCK,
    MANIFEST,
    PAIRED,
    SCHEMA,
    STUDY,
    SUMMARY,
    TEMPORARY,
    TIMINGS,
    TRAJECTORIES,
    case_file,
    error_file,
    timing_file,
    trajectory_folder,
)
from socwise.study.reading import study_manifest
from socwise.study.task import Outcome, PlannedCase

_LITTER = frozenset({".DS_Store", "Thumbs.db", "desktop.ini"})


def check_folder(folder: Path, resume: bool) -> dict[str, Any] | None:
    """Make sure that a study may go to a folder; return the manifest of the one that is there.

    Parameters
    ----------
    folder : Path
        It may be absent or empty, or, to resume, hold a study.
    resume : bool
        Whether the user asked to go on with what is there.

    Raises
    ------
    StoreError
        If it holds something else, or a study that was not to be resumed.
    """
    if folder.exists() and not folder.is_dir():
        raise StoreError(f"{folder} is a file; choose a folder with --out")
    found = study_manifest(folder)
    if found is None:
        foreign = [one.name for one in _entries(folder) if not _is_ours(one)]
        if foreign:
            raise StoreError(
                f"{folder} is not empty and holds no study ({sorted(foreign)[0]} is there);"
                " nothing was touched. Choose another --out"
            )
        return None
    if not resume:
        keys = {entry["key"] for entry in found["cases"]}
        done = sum(case_file(folder, key).is_file() for key in keys)
        raise StoreError(
            f"{folder} holds the study {found['name']!r}, {done} of {len(keys)} cases finished;"
            " --resume goes on with it, or choose another --out"
        )
    return found


def make_folder(folder: Path) -> None:
    """Create the folder and what belongs in it.

    Raises
    ------
    StoreError
        If the disk refuses.
    """
    try:
        for name in (CASES, TIMINGS):
            (folder / name).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise refused(folder, error) from error


def clean(folder: Path) -> None:
    """Remove what a run that was killed left under temporary names, and tables that may be out of date."""
    for place in (folder, folder / CASES, folder / TIMINGS):
        for path in place.glob(f".*{TEMPORARY}"):
            if LOCK not in path.name:
                path.unlink(missing_ok=True)
    for path in (folder / TRAJECTORIES).glob(f".*{TEMPORARY}"):
        shutil.rmtree(path, ignore_errors=True)
    for name in (SUMMARY, PAIRED):
        (folder / name).unlink(missing_ok=True)


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all.

    Raises
    ------
    StoreError
        If the disk refuses.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}{TEMPORARY}")
    try:
        with draft.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    except OSError as error:
        raise refused(path, error) from error
    finally:
        # Also where an interrupt came in between.
        draft.unlink(missing_ok=True)


def write_object(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON object; the same content gives the same bytes."""
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    write_bytes(path, f"{text}\n".encode())


def write_outcome(folder: Path, case: PlannedCase, outcome: Outcome) -> None:
    """Write what came out for a case: it is finished, or has failed.

    Raises
    ------
    StoreError
        If the disk refuses.
    """
    key = case.key
    if outcome.trajectories:
        _write_trajectories(folder, key, outcome.trajectories)
    write_object(timing_file(folder, key), outcome.timing)
    head = {"schema": SCHEMA, "key": key, "factors": dict(case.factors)}
    if outcome.content is None:
        write_object(error_file(folder, key), {**head, "error": outcome.error})
        return
    write_object(case_file(folder, key), {**head, **outcome.content})
    error_file(folder, key).unlink(missing_ok=True)


def write_study(folder: Path, text: str, manifest: Mapping[str, Any]) -> None:
    """Write the study and the manifest, which makes the folder one of a study."""
    write_bytes(folder / STUDY, text.encode())
    write_object(folder / MANIFEST, {"format": FORMAT, "schema": SCHEMA, **manifest})


def refused(path: Path, error: OSError) -> StoreError:
    """Say that the disk refused."""
    return StoreError(f"cannot write {path}: {error.strerror or error}; make room, or choose another --out")


def _write_trajectories(folder: Path, key: str, files: Mapping[str, bytes]) -> None:
    target = trajectory_folder(folder, key)
    draft = target.with_name(f".{key}.{os.getpid()}{TEMPORARY}")
    try:
        draft.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            (draft / f"{name}.nc").write_bytes(content)
        shutil.rmtree(target, ignore_errors=True)
        draft.rename(target)
    except OSError as error:
        raise refused(target, error) from error
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def _entries(folder: Path) -> list[Path]:
    return list(folder.iterdir()) if folder.is_dir() else []


def _is_ours(path: Path) -> bool:
    """Whether a run that was killed right at its start may have left this."""
    if path.name in (CASES, TIMINGS):
        return path.is_dir() and not any(path.iterdir())
    return path.name in (LOCK, STUDY, *_LITTER) or path.name.endswith(TEMPORARY)

"""Read the folder of a study: finished, failed and missing cases, for tables, reports and pictures."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from socwise.results.staging import StoreError
from socwise.study.layout import (
    FORMAT,
    MANIFEST,
    SCHEMA,
    STUDY,
    case_file,
    error_file,
    timing_file,
    trajectory_folder,
)

Json = dict[str, Any]
Factor = str | int | float
State = Literal["done", "failed", "missing"]


@dataclass(frozen=True)
class StudyCase:
    """One case of a study, as far as it is known.

    Parameters
    ----------
    number : int
        Its place in the study, from 1 on.
    key : str
        Hash of everything that decides its result; names its files.
    factors : mapping of str to value
        What the study file says of it, by factor, in the order of the file.
    state : {"done", "failed", "missing"}
        Whether it is finished, has failed, or is still to be computed.
    result : dict or None
        The object that ``socwise compare --json`` prints for this point, without timings: ``cases`` (one for
        each policy) and ``paired``.
    resolved : dict or None
        What the factors came to: concept, pack, grid and the rest.
    error : dict or None
        ``kind`` and ``message`` of a case that failed.
    timing : dict or None
        ``wall_s``, ``solve_s`` by policy, ``peak_rss_MB`` and where it was computed.
    trajectories : dict
        NetCDF files by policy, where the study keeps them.
    warnings : tuple of str
        What was said while it was computed.
    """

    number: int
    key: str
    factors: Mapping[str, Factor]
    state: State
    result: Json | None
    resolved: Json | None
    error: Json | None
    timing: Json | None
    trajectories: Mapping[str, Path]
    warnings: tuple[str, ...] = ()

    def policy(self, name: str) -> Json | None:
        """Return the row of a policy, or None where the case is not finished or has no such policy."""
        rows = self.result["cases"] if self.result else ()
        return next((row for row in rows if row["policy"] == name), None)

    def pair(self, policy: str, versus: str) -> Json | None:
        """Return the paired difference ``policy`` less ``versus``, or None."""
        rows = self.result["paired"] if self.result else ()
        return next((row for row in rows if (row["policy"], row["versus"]) == (policy, versus)), None)


@dataclass(frozen=True)
class StoredStudy:
    """A study on disk.

    Parameters
    ----------
    folder : Path
        Where it is.
    manifest : dict
        ``name``, ``settings``, ``packages``, ``cases`` and so on.
    study_text : str
        The study file.
    cases : tuple of StudyCase
        In the order of the study.
    """

    folder: Path
    manifest: Json
    study_text: str
    cases: tuple[StudyCase, ...]

    @property
    def name(self) -> str:
        """Name of the study."""
        return str(self.manifest["name"])

    @property
    def factors(self) -> dict[str, list[Factor]]:
        """Every factor and the different values that the cases have, in the order of the study."""
        found: dict[str, dict[Factor, None]] = {}
        for case in self.cases:
            for name, value in case.factors.items():
                found.setdefault(name, {})[value] = None
        return {name: list(values) for name, values in found.items()}

    @property
    def varied(self) -> dict[str, list[Factor]]:
        """The factors that have more than one value."""
        return {name: values for name, values in self.factors.items() if len(values) > 1}

    def in_state(self, state: State) -> list[StudyCase]:
        """Return the cases in a state."""
        return [case for case in self.cases if case.state == state]

    @property
    def is_complete(self) -> bool:
        """Whether every case is finished."""
        return all(case.state == "done" for case in self.cases)


def read_study(folder: Path | str) -> StoredStudy:
    """Read the folder of a study, whether it is finished, interrupted or still running.

    Parameters
    ----------
    folder : Path or str
        What ``socwise run --out`` named.

    Raises
    ------
    StoreError
        If there is no such folder, it holds no study, or a file is damaged.
    """
    place = Path(folder)
    manifest = study_manifest(place)
    if manifest is None:
        what = "holds no study" if place.is_dir() else "is no folder"
        raise StoreError(f"{place} {what}; name a folder that `socwise run --out` wrote")
    try:
        text = (place / STUDY).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise StoreError(f"{place / STUDY} is missing or damaged ({error})") from error
    return StoredStudy(place, manifest, text, tuple(_cases(place, manifest)))


def study_manifest(folder: Path) -> Json | None:
    """Return the manifest of a study's folder, or None if the folder holds none.

    Raises
    ------
    StoreError
        If the folder was written by a later version.
    """
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        return None
    if manifest.get("schema") != SCHEMA:
        raise StoreError(
            f"{folder} holds a study of schema {manifest.get('schema')}, and this version knows {SCHEMA};"
            " use the version of socwise that wrote it, or choose another --out"
        )
    return manifest


def _cases(folder: Path, manifest: Json) -> Iterator[StudyCase]:
    for number, entry in enumerate(manifest["cases"], 1):
        key = entry["key"]
        done = read_json(case_file(folder, key))
        failed = None if done else read_json(error_file(folder, key))
        state: State = "done" if done else "failed" if failed else "missing"
        yield StudyCase(
            number=number,
            key=key,
            factors=entry["factors"],
            state=state,
            result=done["result"] if done else None,
            resolved=done["resolved"] if done else None,
            error=failed["error"] if failed else None,
            timing=read_json(timing_file(folder, key)),
            trajectories={path.stem: path for path in sorted(trajectory_folder(folder, key).glob("*.nc"))},
            warnings=tuple(done["warnings"]) if done else (),
        )


def read_json(path: Path) -> Json | None:
    """Read a JSON object, None where there is no file.

    Raises
    ------
    StoreError
        If it is damaged.
    """
    try:
        content: Json = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise StoreError(
            f"{path} is damaged ({error}); remove it, and `socwise run --resume` computes it again"
        ) from error
    return content

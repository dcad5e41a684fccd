"""What a changed study means for the cases that are there already."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from socwise.study.layout import case_file, error_file
from socwise.study.plan import Plan
from socwise.study.task import Json, PlannedCase

_MOST_SHOWN = 12


@dataclass(frozen=True)
class Standing:
    """Where the cases of a plan stand in a folder.

    Parameters
    ----------
    done : tuple of PlannedCase
        Finished.
    failed : tuple of PlannedCase
        Failed; they are tried again.
    redo : tuple of PlannedCase
        Known by their factors, but something else that decides the result has changed.
    new : tuple of PlannedCase
        Not known before, or not computed yet.
    gone : tuple of dict
        Entries of the folder's manifest that are no longer part of the study; their files stay.
    changed : tuple of str
        What the manifests differ in, in words.
    """

    done: tuple[PlannedCase, ...]
    failed: tuple[PlannedCase, ...]
    redo: tuple[PlannedCase, ...]
    new: tuple[PlannedCase, ...]
    gone: tuple[Json, ...]
    changed: tuple[str, ...]

    @property
    def sentences(self) -> list[str]:
        """Say what has changed since the folder was written; nothing where nothing has."""
        said = []
        if self.changed:
            said.append(f"Changed since then: {'; '.join(self.changed)}.")
        if self.redo:
            said.append(f"{len(self.redo)} cases are computed anew: {_named(self.redo)}.")
        if self.gone:
            said.append(
                f"{len(self.gone)} cases of the folder are no longer part of the study; their files stay, and"
                " no table counts them."
            )
        return said


def standing(plan: Plan, folder: Path, before: Mapping[str, Any] | None, now: Mapping[str, Any]) -> Standing:
    """Compare a plan with what a folder holds.

    Parameters
    ----------
    plan : Plan
        What is to be there.
    folder : Path
        The folder.
    before, now : mapping
        The folder's manifest, None if it has none, and the one of the plan.
    """
    entries = before["cases"] if before else []
    known = {_label(entry["factors"]): entry["key"] for entry in entries}
    groups: dict[str, list[PlannedCase]] = {"done": [], "failed": [], "redo": [], "new": []}
    for case in _each_once(plan):
        groups[_state(case, folder, known)].append(case)
    points = {_label(case.factors) for case in plan.cases}
    gone = tuple(entry for entry in entries if _label(entry["factors"]) not in points)
    changed = tuple(_differences(before, now)) if before else ()
    return Standing(
        tuple(groups["done"]),
        tuple(groups["failed"]),
        tuple(groups["redo"]),
        tuple(groups["new"]),
        gone,
        changed,
    )


def _each_once(plan: Plan) -> list[PlannedCase]:
    found: dict[str, PlannedCase] = {}
    for case in plan.cases:
        found.setdefault(case.key, case)
    return list(found.values())


def _state(case: PlannedCase, folder: Path, known: Mapping[Any, str]) -> str:
    if case_file(folder, case.key).is_file():
        return "done"
    if error_file(folder, case.key).is_file():
        return "failed"
    before = known.get(_label(case.factors))
    return "redo" if before is not None and before != case.key else "new"


def _label(factors: Mapping[str, Any]) -> tuple[tuple[str, Any], ...]:
    return tuple(sorted(factors.items()))


def _differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """The entries of two manifests that differ, those of nested tables one by one."""
    skipped = {"cases", "study_sha256", "format", "schema"}
    old, new = (_flat({k: v for k, v in one.items() if k not in skipped}) for one in (before, now))
    said = [
        f"{name} {_short(old.get(name))} -> {_short(new.get(name))}"
        for name in dict.fromkeys([*old, *new])
        if old.get(name) != new.get(name)
    ]
    return said[:_MOST_SHOWN] + (["and more"] if len(said) > _MOST_SHOWN else [])


def _flat(content: Mapping[str, Any], prefix: str = "") -> Json:
    found: Json = {}
    for name, value in content.items():
        if isinstance(value, Mapping):
            found |= _flat(value, f"{prefix}{name}.")
        else:
            found[f"{prefix}{name}"] = value
    return found


def _short(value: Any) -> str:
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 40 else f"{text[:10]}..."


def _named(cases: tuple[PlannedCase, ...]) -> str:
    said = [", ".join(f"{name} {value}" for name, value in case.factors.items()) for case in cases[:3]]
    more = [f"and {len(cases) - 3} more"] if len(cases) > 3 else []
    return "; ".join([*said, *more])

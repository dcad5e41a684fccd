"""The tables of a study: a row for each case and policy, and one for each paired difference."""

from __future__ import annotations

from typing import Any

from socwise.results.plain import write_rows
from socwise.study.layout import PAIRED, SUMMARY
from socwise.study.reading import StoredStudy, StudyCase

Row = dict[str, Any]


def summary_rows(study: StoredStudy) -> list[Row]:
    """Return a row for each finished case and policy: factors first, then what came out."""
    return [
        {**_head(case), **{name: value for name, value in row.items() if name not in case.factors}}
        for case in study.in_state("done")
        for row in (case.result or {})["cases"]
    ]


def paired_rows(study: StoredStudy) -> list[Row]:
    """Return a row for each paired difference of a finished case: mean and 95 % interval, also in per cent.

    The percentages are of the mean of the policy that ``versus`` is compared with, ``policy``.
    """
    rows = []
    for case in study.in_state("done"):
        for pair in (case.result or {})["paired"]:
            base = case.policy(pair["policy"]) or {}
            row = {**_head(case), "policy": pair["policy"], "versus": pair["versus"]}
            for name in ("cost_kg", "fuel_l_per_100km"):
                low, high = pair[name]["ci95"] or (None, None)
                mean, reference = pair[name]["mean"], base.get(name, {}).get("mean")
                row[name] = {"mean": mean, "low": low, "high": high, "percent": _percent(mean, reference)}
            rows.append(row)
    return rows


def write_tables(study: StoredStudy) -> None:
    """Write ``summary.csv`` and ``paired.csv`` of a study into its folder."""
    for name, rows in ((SUMMARY, summary_rows(study)), (PAIRED, paired_rows(study))):
        draft = study.folder / f".{name}.tmp"
        try:
            write_rows(draft, rows)
            draft.replace(study.folder / name)
        finally:
            draft.unlink(missing_ok=True)


def _head(case: StudyCase) -> Row:
    return {"case": case.number, "key": case.key, **case.factors}


def _percent(value: float, reference: float | None) -> float | None:
    return 100.0 * value / reference if reference else None

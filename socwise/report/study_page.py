"""The page of a study: when certainty equivalence is good enough, as a sentence, a map and a table."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from socwise.labels import CERTAINTY_EQUIVALENT
from socwise.report.html import fill, json_in_html, paragraph, region, script, template
from socwise.report.study_answer import concept_answers, study_answer
from socwise.report.study_influence import factor_label, influence, value_label
from socwise.report.study_judge import LIMIT, Judged, judge, loss
from socwise.report.study_tables import doubts_table, failures_table, influence_table, study_table
from socwise.report.tables import facts_table
from socwise.study.reading import Factor, StoredStudy, read_study

DECIMALS = 4
FEW_VALUES = 15


def write_study_report(source: StoredStudy | Path, path: Path) -> None:
    """Write one self-contained HTML page about a study, finished or not.

    Parameters
    ----------
    source : StoredStudy or Path
        The study, or its folder.
    path : Path
        File to write. The same results give the same bytes; nothing on the page needs a network.

    Raises
    ------
    StoreError
        If the folder holds no study, or it is damaged.
    """
    study = read_study(source) if isinstance(source, Path) else source
    path.write_text(render_study(study), encoding="utf-8", newline="\n")


def render_study(study: StoredStudy) -> str:
    """Return the page as text.

    Parameters
    ----------
    study : StoredStudy
        What it is about.

    Returns
    -------
    str
        A complete HTML document.
    """
    from plotly.offline import get_plotlyjs

    judged = judge(study)
    return fill(
        template("study.html"),
        {
            "STYLE": template("report.css"),
            "NAME": escape(study.name),
            "SUBTITLE": escape(_subtitle(study)),
            "ANSWER": "".join(
                [paragraph(study_answer(study, judged)), *map(paragraph, concept_answers(judged))]
            ),
            "LIMIT": f"{LIMIT:g}",
            "INFLUENCE": _influence(study, judged),
            "CASES": region("All cases", study_table(study, judged), "scroll tall"),
            "FAILED": _failed(study) + _doubted(judged),
            "FACTS": region("Manifest", facts_table(_facts(study))),
            "STUDY": escape(study.study_text),
            "SETTINGS": escape(json.dumps(study.manifest.get("settings", {}), indent=2, ensure_ascii=False)),
            "DATA": json_in_html(study_payload(study, judged)),
            "PLOTLY": script(get_plotlyjs()),
            "TABLE_SCRIPT": script(template("table.js")),
            "SCRIPT": script(template("study.js")),
        },
    )


def study_payload(study: StoredStudy, judged: Sequence[Judged]) -> dict[str, Any]:
    """Return what the page's script draws, JSON-serialisable.

    Parameters
    ----------
    study : StoredStudy
        The study.
    judged : sequence of Judged
        Its cases.

    Returns
    -------
    dict
        ``factors``: those that vary, each with ``name``, ``label``, ``numeric``, ``few``, ``values`` (texts,
        in ascending order where they are numbers) and ``numbers``; ``deciding``: places
        of the factors, the one that parts the cases most first; ``cases``: ``factors`` (places of their
        values), ``loss``, ``fuel`` (value, low, high; per cent) and ``outside`` (per cent of the time).
    """
    factors, places = [], []
    for name, values in study.varied.items():
        numeric = not any(isinstance(value, str) for value in values)
        ordered: list[Any] = sorted(values) if numeric else list(values)
        factors.append(
            {
                "name": name,
                "label": factor_label(name),
                "numeric": numeric,
                "few": len(values) <= FEW_VALUES,
                "values": [value_label(value) for value in ordered],
                "numbers": ordered if numeric else None,
            }
        )
        places.append({value: place for place, value in enumerate(ordered)})
    deciding = dict.fromkeys(row.factor for row in influence(study, judged))
    return {
        "factors": factors,
        "deciding": [list(study.varied).index(name) for name in deciding],
        "cases": [
            {
                "number": one.case.number,
                "factors": [
                    place.get(one.case.factors.get(name, ""))
                    for name, place in zip(study.varied, places, strict=True)
                ],
                **_measured(one),
            }
            for one in judged
        ],
    }


def _measured(one: Judged) -> dict[str, Any]:
    """What is drawn of a case; nothing where it is not to be trusted."""
    if one.doubts:
        return {"loss": None, "fuel": None, "outside": None}
    return {
        "loss": _rounded((one.percent, one.low, one.high)),
        "fuel": _rounded(loss(one.case, "fuel_l_per_100km")),
        "outside": _outside(one),
    }


def _rounded(values: Sequence[float | None]) -> list[float | None] | None:
    if values[0] is None:
        return None
    return [None if value is None else round(value, DECIMALS) for value in values]


def _outside(one: Judged) -> list[float | None] | None:
    row = one.case.policy(CERTAINTY_EQUIVALENT)
    if row is None or row["window_violation"] is None:
        return None
    return [round(100.0 * row["window_violation"], DECIMALS), None, None]


def _influence(study: StoredStudy, judged: Sequence[Judged]) -> str:
    table = influence_table(study, judged)
    if not table:
        return ""
    label = "What decides"
    return f"<h3>{label}</h3>{region(label, table)}"


def _failed(study: StoredStudy) -> str:
    failed = study.in_state("failed")
    if not failed:
        return ""
    label = "Cases that failed"
    return f"<h3>{label}</h3>{region(label, failures_table(failed))}"


def _doubted(judged: Sequence[Judged]) -> str:
    doubted = [one for one in judged if one.doubts]
    if not doubted:
        return ""
    label = "Cases not to be trusted"
    return f"<h3>{label}</h3>{region(label, doubts_table(doubted))}"


def _subtitle(study: StoredStudy) -> str:
    done, total = len(study.in_state("done")), len(study.cases)
    count = f"{total} cases" if done == total else f"{done} of {total} cases finished"
    varied = ", ".join(f"{factor_label(name)} ({len(values)})" for name, values in study.varied.items())
    over = f" over {varied}" if varied else ""
    manifest = study.manifest
    return (
        f"Study {study.name}: {count}{over}; {manifest['realizations']} realizations of the noise in each, "
        f"the same for every policy; seed {manifest['seed']}"
    )


def _facts(study: StoredStudy) -> dict[str, str]:
    manifest = study.manifest
    constant: Mapping[str, list[Factor]] = {
        name: values for name, values in study.factors.items() if len(values) == 1
    }
    facts = {
        "Study": study.name,
        "Design": _plain(manifest.get("design")),
        "Policies": ", ".join(manifest["policies"]),
        "Realizations": str(manifest["realizations"]),
        "Seed": str(manifest["seed"]),
        "Same in every case": ", ".join(
            f"{factor_label(name)} {value_label(values[0])}" for name, values in constant.items()
        ),
        "Python": _plain(manifest.get("python")),
        "Packages": _plain(manifest.get("packages")),
        "Code, SHA-256": _plain(manifest.get("code_sha256")),
    }
    return {name: value for name, value in facts.items() if value}


def _plain(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {part}" for name, part in value.items() if part is not None)
    return "" if value is None else str(value)

"""Put the page together: text and tables here, plots by the script that travels with it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

from socwise.report.answer import Finding, findings
from socwise.report.closed import identified_table, loop_sentences
from socwise.report.html import fill, json_in_html, paragraph, region, script, template, unbroken
from socwise.report.payload import payload
from socwise.report.sentences import answer
from socwise.report.tables import cases_table, facts_table, findings_table
from socwise.report.wording import number
from socwise.results.reading import StoredComparison, read


def write_report(source: StoredComparison | Path, path: Path) -> None:
    """Write one self-contained HTML page about a comparison.

    Parameters
    ----------
    source : StoredComparison or Path
        Results, or the folder that holds them.
    path : Path
        File to write. The same results give the same bytes; nothing on the page needs a network.

    Raises
    ------
    StoreError
        If the folder holds no results, or they are damaged.
    """
    stored = read(source) if isinstance(source, Path) else source
    path.write_text(render(stored), encoding="utf-8", newline="\n")


def render(stored: StoredComparison) -> str:
    """Return the page as text.

    Parameters
    ----------
    stored : StoredComparison
        What it is about.

    Returns
    -------
    str
        A complete HTML document.
    """
    from plotly.offline import get_plotlyjs

    found = findings(stored.result)
    concepts = list(dict.fromkeys(one.concept for one in found))
    numbers = payload(stored)
    return fill(
        template("report.html"),
        {
            "STYLE": template("report.css"),
            "SUBTITLE": escape(_subtitle(stored.result)),
            "ANSWER": "".join(
                paragraph(answer(concept, [one for one in found if one.concept == concept]))
                for concept in concepts
            ),
            "FINDINGS": _findings(found),
            "LOOP": _loop(stored.result),
            "CASES": cases_table(stored.result["cases"]),
            "THINNED": _thinned(numbers),
            "FACTS": facts_table(_facts(stored.manifest)),
            "SETTINGS": escape(json.dumps(stored.manifest["settings"], indent=2, ensure_ascii=False)),
            "DATA": json_in_html(numbers),
            "TABLE_SCRIPT": script(template("table.js")),
            "PLOTLY": script(get_plotlyjs()),
            "SCRIPT": script(template("report.js")),
        },
    )


def _findings(found: list[Finding]) -> str:
    if all(one.cost is None for one in found):
        return ""
    label = "What the stochastic policy saves"
    return region(label, findings_table(found))


def _loop(result: Mapping[str, Any]) -> str:
    """What a closed loop consists of and how well [L]'s model fits it; nothing where there is none."""
    sentences = loop_sentences(result)
    if not sentences:
        return ""
    label = "The identified uncertainty model"
    text = "".join(f"<p>{unbroken(escape(sentence))}</p>" for sentence in sentences)
    return f"\n<h3>{label}</h3>\n{text}\n{region(label, identified_table(result))}"


def _thinned(numbers: Mapping[str, Any]) -> str:
    if numbers["points_per_stretch"] == 1:
        return ""
    stretch = number(numbers["stretch_s"], 0)
    return f"Each pair of points is the least and the greatest value within {stretch} s. "


def _subtitle(result: Mapping[str, Any]) -> str:
    cycle = result["cycle"]
    counts = {row["realizations"] for row in result["cases"]}
    realizations = f"{min(counts)} to {max(counts)}" if len(counts) > 1 else str(next(iter(counts), 0))
    noun = "realization" if realizations == "1" else "realizations"
    return (
        f"Cycle {cycle['name']}, {number(cycle['distance_km'], 1)} km in {number(cycle['duration_s'], 0)} s; "
        f"{realizations} {noun} of the noise in each case, the same for every policy; seed {result['seed']}"
    )


def _facts(manifest: Mapping[str, Any]) -> dict[str, str]:
    versions = ", ".join(f"{name} {version}" for name, version in manifest["packages"].items())
    settings, loop = manifest["settings"], {}
    if isinstance(settings, Mapping) and "closed_loop" in settings:
        loop = {"Plant": settings["plant"], "Estimator": settings["estimator"]}
    return {
        "Cycle": manifest["cycle"],
        **loop,
        "Seed": str(manifest["seed"]),
        "Python": manifest["python"],
        "Packages": versions,
        "Settings, SHA-256": manifest["settings_sha256"],
    }

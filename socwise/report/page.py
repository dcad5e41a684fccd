"""Put the page together: text and tables here, plots by the script that travels with it."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any

from socwise.report.answer import Finding, findings
from socwise.report.closed import identified_table, loop_sentences
from socwise.report.payload import payload
from socwise.report.sentences import answer
from socwise.report.tables import cases_table, facts_table, findings_table
from socwise.report.wording import number
from socwise.results.reading import StoredComparison, read

_SLOT = re.compile(r"@@([A-Z_]+)@@")


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
    return _fill(
        _template("report.html"),
        {
            "STYLE": _template("report.css"),
            "SUBTITLE": escape(_subtitle(stored.result)),
            "ANSWER": "".join(
                _paragraph(answer(concept, [one for one in found if one.concept == concept]))
                for concept in concepts
            ),
            "FINDINGS": _findings(found),
            "LOOP": _loop(stored.result),
            "CASES": cases_table(stored.result["cases"]),
            "THINNED": _thinned(numbers),
            "FACTS": facts_table(_facts(stored.manifest)),
            "SETTINGS": escape(json.dumps(stored.manifest["settings"], indent=2, ensure_ascii=False)),
            "DATA": _json_in_html(numbers),
            "PLOTLY": _script(get_plotlyjs()),
            "SCRIPT": _script(_template("report.js")),
        },
    )


def _fill(template: str, values: Mapping[str, str]) -> str:
    # One pass: what is put in is not searched for slots again, whatever a user called a concept.
    return _SLOT.sub(lambda slot: values[slot[1]], template)


def _template(name: str) -> str:
    return (resources.files("socwise.report") / "templates" / name).read_text(encoding="utf-8")


def _paragraph(sentences: list[str]) -> str:
    lead, *rest = (_unbroken(escape(sentence)) for sentence in sentences)
    return f"<p><strong>{lead}</strong> {' '.join(rest)}</p>"


def _findings(found: list[Finding]) -> str:
    if all(one.cost is None for one in found):
        return ""
    label = "What the stochastic policy saves"
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{label}">{findings_table(found)}</div>'
    )


def _loop(result: Mapping[str, Any]) -> str:
    """What a closed loop consists of and how well [L]'s model fits it; nothing where there is none."""
    sentences = loop_sentences(result)
    if not sentences:
        return ""
    label = "The identified uncertainty model"
    text = "".join(f"<p>{_unbroken(escape(sentence))}</p>" for sentence in sentences)
    region = f'<div class="scroll" tabindex="0" role="region" aria-label="{label}">'
    return f"\n<h3>{label}</h3>\n{text}\n{region}{identified_table(result)}</div>"


def _thinned(numbers: Mapping[str, Any]) -> str:
    if numbers["points_per_stretch"] == 1:
        return ""
    stretch = number(numbers["stretch_s"], 0)
    return f"Each pair of points is the least and the greatest value within {stretch} s. "


def _unbroken(text: str) -> str:
    """Keep a number and its sign or unit on one line."""
    return text.replace("μ = ", "μ\u00a0=\u00a0").replace(" %", "\u00a0%")


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


def _json_in_html(value: object) -> str:
    """Return JSON that no HTML parser can mistake for the end of its element."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _script(source: str) -> str:
    return re.sub(r"</(script)", r"<\\/\1", source, flags=re.IGNORECASE)

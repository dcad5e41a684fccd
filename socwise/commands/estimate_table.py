"""Estimates on the screen: what the log is, a row for each estimator, and what they did not trust."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from socwise.commands.screen import new_table

if TYPE_CHECKING:
    from rich.table import Table

_PARAMETERS = (
    ("capacity_Ah", "capacity\n[Ah]", 1.0),
    ("resistance_ohm", "resistance\n[mΩ]", 1e3),
    ("relaxation_resistance_ohm", "relaxation\nR [mΩ]", 1e3),
    ("relaxation_capacitance_F", "relaxation\nC [kF]", 1e-3),
    ("current_bias_A", "current\noffset [mA]", 1e3),
)
_ABSENT = "–"
_HARMLESS = frozenset({"rest", "full"})
_DAY_S, _HOUR_S = 86400.0, 3600.0


def described(result: Mapping[str, Any]) -> list[str]:
    """Return lines that say what the log is and what was done to it."""
    data = result["data"]
    jitter = f" ± {data['jitter_s']:.3g} s" if data["jitter_s"] > 0.0 else " s"
    lines = [
        f"{data['source']}: {data['samples']:,} samples in {_length(data['duration_s'])}, one every"
        f" {data['step_s']:g}{jitter}; cell {result['cell']}"
    ]
    return lines + [f"note: {note}" for note in data["notes"]]


def soc_table(estimators: Sequence[Mapping[str, Any]]) -> Table:
    """Return a table with a row for each estimator: SOC, residual, trust and, if known, the SOC's error."""
    compared = any(entry["soc"]["rmse"] is not None for entry in estimators)
    headings = ["SOC at end\n[%]", "residual\nrms [mV]", "trusted\n[% of samples]"]
    table = new_table("estimator", *headings, *(["SOC error\nrms [%]"] if compared else []))
    for entry in estimators:
        soc = entry["soc"]
        cells = [
            _plus_minus(soc["final"], soc["sd"], 100.0),
            _number(entry["residual_rms_V"], 1e3, ".3g"),
            _number(entry["trusted_share"], 100.0, ".4g"),
        ]
        table.add_row(entry["name"], *cells, *([_number(soc["rmse"], 100.0, ".3g")] if compared else []))
    return table


def parameter_table(estimators: Sequence[Mapping[str, Any]]) -> Table | None:
    """Return a table of the parameters at the end, a column for each that is estimated; None without any."""
    shown = [
        one for one in _PARAMETERS if any(_known(entry["parameters"].get(one[0])) for entry in estimators)
    ]
    if not shown:
        return None
    table = new_table("estimator", *(heading for _, heading, _ in shown))
    for entry in estimators:
        known = {name: one for name, one in entry["parameters"].items() if _known(one)}
        if known:
            unknown = {"value": None, "sd": None}
            values = [(known.get(name, unknown), factor) for name, _, factor in shown]
            table.add_row(entry["name"], *(_plus_minus(v["value"], v["sd"], f) for v, f in values))
    return table


def mistrust(estimators: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a line for each estimator that did not trust all samples, with the reasons and their shares."""
    lines = []
    for entry in estimators:
        reasons = sorted(
            ((share, name) for name, share in entry["flags"].items() if name not in _HARMLESS), reverse=True
        )
        if reasons:
            listed = ", ".join(f"{name.replace('_', ' ')} {100.0 * share:.3g} %" for share, name in reasons)
            lines.append(f"{entry['name']} did not trust: {listed}")
    return [*lines, ""] if lines else []


def _plus_minus(value: float | None, sd: float | None, factor: float) -> str:
    """A value with its standard deviation, both to the second digit of the latter."""
    if value is None:
        return _ABSENT
    if sd is None or sd <= 0.0:
        return f"{factor * value:.4g}"
    digits = min(max(1 - _exponent(factor * sd), 0), 6)
    return f"{factor * value:.{digits}f} ± {factor * sd:.{digits}f}"


def _exponent(value: float) -> int:
    return int(f"{value:e}".partition("e")[2])


def _number(value: float | None, factor: float, form: str) -> str:
    return _ABSENT if value is None else f"{factor * value:{form}}"


def _known(parameter: Mapping[str, float | None] | None) -> bool:
    return parameter is not None and parameter["value"] is not None


def _length(duration_s: float) -> str:
    if duration_s >= 2.0 * _DAY_S:
        return f"{duration_s / _DAY_S:.4g} days"
    if duration_s >= 2.0 * _HOUR_S:
        return f"{duration_s / _HOUR_S:.4g} h"
    return f"{duration_s:.4g} s"

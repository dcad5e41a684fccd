"""[M] Fig 30: the parameters over ten days with two, three and four terms of the expansion."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from bms.cell import Cell
from bms.cell_tables import with_ocv
from bms.errors import BatteryWarning
from bms.ocv_polynomial import fit_polynomial_to_curve
from socwise.figures.style import INK, LIMIT, finish
from socwise.reproduce.battery_case import (
    DAY_S,
    EVERY,
    GRADIENT,
    NEWTON,
    OFF_DAYS,
    SEEDS,
    TABLE_7,
    Estimated,
    Parameter,
    battery_cell,
    estimate,
    estimate_many,
)
from socwise.reproduce.panels import COLORS, DASHED, legend_below, new_figure
from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import Progress
from socwise.reproduce.sources import mautc

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TERMS = (2, 3, 4)
Q, R, C_R, R_R = TABLE_7
LIMITS = {2: (0.5, 1.0, None, None), 3: (2.5, 2.5, 2.5, 2.5), 4: (1.0, 1.0, 1.0, 1.0)}
"""Largest errors in per cent, in the order of Table 7; the report only says well, poorly and close."""
MISSED_PERCENT = 4.0
TRANSIENT_S = 2.0 * DAY_S
SOC_PERCENT = 0.5
NEWTON_S, NEWTON_PERCENT = 6.0 * 3600.0, 1.0
_MARGIN = 0.8


def reproduce(*, jobs: int = 2, progress: Progress | None = None, realizations: int = SEEDS) -> Reproduction:
    """Estimate ten days with every N on the same realizations of the noise."""
    cases = [*((GRADIENT, terms) for terms in TERMS), (NEWTON, 3)]
    found = estimate_many(cases, realizations, jobs=jobs, progress=progress)
    runs = {terms: found[GRADIENT, terms] for terms in TERMS}
    rows = [row for terms in TERMS for row in _rows(terms, runs[terms])]
    rows += _newton_rows(found[NEWTON, 3])
    rows += _polynomial_rows()
    note = (
        f"Ten days at 1 s, off for the first, noise of 10 mA and 2 mV, {realizations} realizations: the"
        " rows hold the worst of them, in per cent of the true value; the picture shows the first, less"
        " the overshoot of the first hour. The report says that N = 2 finds Q and R but not C_r and R_r,"
        " that N = 3 comes close in all four, and that more terms gain little. The polynomial is the"
        " report's form of the OCV, fitted to ours and made monotone, for model and estimator alike."
        " Gauss-Newton steps on the same sums are not in the report."
    )
    return Reproduction(
        "mautc-fig30", mautc("Fig 30"), tuple(rows), note, lambda: draw({n: runs[n][0] for n in TERMS})
    )


def worst(runs: Sequence[Estimated], parameter: Parameter) -> float:
    """Largest error of a parameter after ten days, in per cent."""
    return max(abs(run.error_percent(parameter)) for run in runs)


def polynomial_cell() -> Cell:
    """Give the cell of Table 7 the report's form of an OCV: a polynomial of 6th order, here made monotone."""
    cell = battery_cell()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", BatteryWarning)
        fitted = fit_polynomial_to_curve(cell.ocv)
    return with_ocv(cell, fitted.to_curve(cell.ocv))


def _rows(terms: int, runs: Sequence[Estimated]) -> list[Row]:
    rows = []
    for parameter, limit in zip(TABLE_7, LIMITS[terms], strict=True):
        name, found = f"N = {terms}: largest error of {parameter.symbol}", worst(runs, parameter)
        if limit is None:
            rows.append(Row.shown(name, found, "%"))
        else:
            rows.append(Row.between(name, -float("inf"), limit, found, "%"))
    if None in LIMITS[terms]:
        missed = min(max(abs(run.error_percent(p)) for p in (C_R, R_R)) for run in runs)
        name = f"N = {terms}: least of the larger error of C_r and R_r"
        rows.append(Row.between(name, MISSED_PERCENT, float("inf"), missed, "%"))
    soc = 100.0 * max(run.worst_soc_error(TRANSIENT_S) for run in runs)
    name = f"N = {terms}: largest error of the SOC from day {TRANSIENT_S / DAY_S:g} on"
    rows.append(Row.between(name, -float("inf"), SOC_PERCENT, soc, "% SOC"))
    return rows


def _newton_rows(runs: Sequence[Estimated]) -> list[Row]:
    """Judge the Gauss-Newton step on the same sums from six hours after switching on until the end."""
    first = round((OFF_DAYS * DAY_S + NEWTON_S) / EVERY)
    rows = []
    for parameter in (Q, R):
        values = np.array([run.trace.parameters[parameter.name][first:] for run in runs])
        error = 100.0 * float(np.abs(values / parameter.model - 1.0).max())
        name = f"Gauss-Newton, N = 3: largest error of {parameter.symbol} 6 hours after switching on or later"
        rows.append(Row.between(name, -float("inf"), NEWTON_PERCENT, error, "%"))
    return rows


def _polynomial_rows() -> list[Row]:
    run = estimate(3, cell=polynomial_cell())
    return [
        Row.between(
            f"N = 3, OCV a polynomial of 6th order: error of {parameter.symbol}",
            -LIMITS[3][0],
            LIMITS[3][0],
            run.error_percent(parameter),
            "%",
        )
        for parameter in TABLE_7
    ]


def draw(runs: Mapping[int, Estimated]) -> Figure:
    """Draw the four parameters over time, one line an N.

    Parameters
    ----------
    runs : mapping of int to Estimated
        A run of each N, on the same noise.
    """
    figure = new_figure(9.0, 6.0)
    panels = figure.subplots(2, 2, sharex=True)
    for ax, parameter in zip(panels.flat, TABLE_7, strict=True):
        for (terms, run), color in zip(runs.items(), COLORS, strict=False):
            values = parameter.scale * run.trace.parameters[parameter.name]
            ax.plot(run.trace.time_s / DAY_S, values, color=color, linewidth=1.1, label=f"N = {terms}")
        ax.axhline(
            parameter.scale * parameter.model, color=INK, linewidth=0.9, linestyle=DASHED, label="true"
        )
        ax.axvline(OFF_DAYS, color=LIMIT, linewidth=0.8, linestyle=(0, (2, 2)), label="switched on")
        low, high = sorted(parameter.scale * value for value in (parameter.model, parameter.guess))
        ax.set_ylim(low - _MARGIN * (high - low), high + _MARGIN * (high - low))
        ax.set(ylabel=f"{_label(parameter)} [{parameter.unit}]", xlim=(0.0, run.trace.time_s[-1] / DAY_S))
        finish(ax)
    for ax in panels[-1]:
        ax.set_xlabel("time [days]")
    figure.align_ylabels()
    legend_below(figure, list(panels.flat), columns=5)
    return figure


def _label(parameter: Parameter) -> str:
    head, _, foot = parameter.symbol.partition("_")
    return f"${head}_{foot}$" if foot else f"${head}$"

"""[L] Figs 6 to 9 as pictures: SOC, its error, sqrt(p) and current of three realizations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ems.records import Case
from socwise.figures.style import LIMIT, PERCENT, draw, finish
from socwise.labels import concept_label
from socwise.reproduce.panels import COLORS, DASHED, legend_below, new_figure
from socwise.reproduce.sources import MU_NAMES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PAIR = 2
_THIN, _LINE = 0.6, 1.2


def shown(case: Case) -> list[int]:
    """Realizations that are drawn: the first one of each of the first three antithetic pairs."""
    return list(range(0, case.rollout.fuel_kg.size, _PAIR))[: len(COLORS)]


def draw_one(case: Case) -> Figure:
    """Draw SOC, error of the estimate, sqrt(p) and current of a case, from top to bottom."""
    figure = new_figure(9.0, 8.6)
    panels = figure.subplots(4, 1, sharex=True, height_ratios=(1.5, 1.0, 1.0, 1.2))
    _draw_soc(panels[0], case)
    _draw_error(panels[1], case)
    _draw_spread(panels[2], case)
    _draw_current(panels[3], case)
    panels[3].set_xlabel("time [s]")
    figure.suptitle(_title(case))
    figure.align_ylabels(panels)
    legend_below(figure, [panels[0]], columns=5)
    return figure


def draw_two(cases: Sequence[Case]) -> Figure:
    """Draw SOC and sqrt(p) of cases side by side, on common axes."""
    figure = new_figure(10.0, 5.8)
    panels = figure.subplots(
        2, len(cases), sharex=True, sharey="row", squeeze=False, height_ratios=(1.5, 1.0)
    )
    for column, case in enumerate(cases):
        _draw_soc(panels[0, column], case)
        _draw_spread(panels[1, column], case)
        panels[0, column].set_title(_title(case))
        panels[1, column].set_xlabel("time [s]")
    for ax in panels.flat:
        ax.label_outer()
    figure.align_ylabels(panels[:, 0])
    legend_below(figure, [panels[0, 0]], columns=5)
    return figure


def _title(case: Case) -> str:
    kind = f"{MU_NAMES[case.mu]} " if case.mu in MU_NAMES else ""
    return f"{concept_label(case.concept)}, {kind}μ = {case.mu:g}"


def _draw_soc(ax: Axes, case: Case) -> None:
    rollout = case.rollout
    for number, (row, color) in enumerate(zip(shown(case), COLORS, strict=False), 1):
        true, estimate = PERCENT * rollout.soc[row], PERCENT * rollout.soc_estimate[row]
        draw(ax, rollout.time_s, estimate, color=color, linewidth=_THIN, alpha=0.5)
        draw(ax, rollout.time_s, true, color=color, linewidth=_LINE, label=f"realization {number}")
    ax.plot([], [], color=LIMIT, linewidth=_THIN, label="thin: estimate")
    for place, limit in enumerate(case.window):
        label = None if place else "window"
        ax.axhline(PERCENT * limit, color=LIMIT, linewidth=0.9, linestyle=DASHED, label=label)
    _finish(ax, case, "SOC [%]")


def _draw_error(ax: Axes, case: Case) -> None:
    rollout = case.rollout
    for row, color in zip(shown(case), COLORS, strict=False):
        error = rollout.soc[row].astype(np.float64) - rollout.soc_estimate[row]
        draw(ax, rollout.time_s, PERCENT * error, color=color, linewidth=_THIN)
    _finish(ax, case, "true − estimate\n[% SOC]")


def _draw_spread(ax: Axes, case: Case) -> None:
    rollout = case.rollout
    for row, color in zip(shown(case), COLORS, strict=False):
        draw(ax, rollout.time_s, PERCENT * np.sqrt(rollout.variance[row]), color=color, linewidth=_THIN)
    ax.axhline(0.0, color=LIMIT, linewidth=0.6, zorder=1)
    _finish(ax, case, "√p [% SOC]")


def _draw_current(ax: Axes, case: Case) -> None:
    rollout = case.rollout
    for row, color in zip(shown(case), COLORS, strict=False):
        look = {"drawstyle": "steps-post", "linewidth": 0.4, "alpha": 0.8}
        draw(ax, rollout.time_s[:-1], rollout.current_A[row], color=color, **look)
    ax.axhline(0.0, color=LIMIT, linewidth=0.6)
    _finish(ax, case, "current [A],\n> 0 charges")


def _finish(ax: Axes, case: Case, ylabel: str) -> None:
    ax.set_ylabel(ylabel)
    ax.set_xlim(case.rollout.time_s[0], case.rollout.time_s[-1])
    finish(ax)

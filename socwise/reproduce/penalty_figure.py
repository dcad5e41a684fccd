"""[L] Fig 4: the penalties Gamma and Upsilon over the true SOC, and expected at an uncertain estimate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bms import PiecewiseLinear
from ems.concept import Concept, load_concept
from socwise.figures.style import LIMIT, finish
from socwise.reproduce.panels import COLORS, DASHED, legend_below, new_figure
from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import Progress
from socwise.reproduce.sources import CONCEPTS, larsson

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SQRT_P = 0.012
NOTE = (
    "The paper draws both without numbers; the presets' values are own choices, see the docs. Dashed is the"
    f" Beta expectation at sqrt(p) = {100.0 * SQRT_P:g} %: what the stochastic strategy pays at an estimate."
)
_OUTSIDE = 0.01
_MARGIN, _REACH = 0.03, 0.08
_JUST = 1e-6


def reproduce(*, jobs: int = 2, progress: Progress | None = None) -> Reproduction:
    """Check the shape of the penalties; ``jobs`` and ``progress`` are not used."""
    concepts = {name: load_concept(name) for name in CONCEPTS}
    rows = [row for name, concept in concepts.items() for row in _rows(name.upper(), concept)]
    return Reproduction("larsson-fig4", larsson("Fig 4"), tuple(rows), NOTE, lambda: _draw(concepts))


def expected(function: PiecewiseLinear, estimate: float) -> float:
    """Expectation of a penalty at an estimate, over a Beta belief of the figure's width."""
    return float(function.expectation(estimate, SQRT_P**2))


def _rows(who: str, concept: Concept) -> list[Row]:
    window, target = concept.window, concept.terminal.target_soc
    running, terminal = concept.window.penalty_kgps(), concept.terminal.penalty_kg()
    inside = float(np.abs(running(np.linspace(window.low + _JUST, window.high - _JUST, 101))).max())
    below, above = (1e3 * float(running(soc)) for soc in (window.low - _OUTSIDE, window.high + _OUTSIDE))
    short = 1e3 * float(terminal(target - _OUTSIDE))
    return [
        Row.near(
            f"{who}: Gamma inside {window.low:.0%} to {window.high:.0%} SOC", 0.0, 1e3 * inside, 0.0, "g/s"
        ),
        Row.holds(f"{who}: Gamma 1 % SOC below the window, above zero", below > 0.0, below, "g/s"),
        Row.holds(f"{who}: Gamma 1 % SOC above the window, above zero", above > 0.0, above, "g/s"),
        Row.holds(
            f"{who}: Upsilon 1 % SOC below its target of {target:.0%}, above zero", short > 0.0, short, "g"
        ),
        _smoothed(
            f"{who}: Gamma at the window's low end, true SOC known to sqrt(p)", running, window.low, "g/s"
        ),
        _smoothed(f"{who}: Upsilon at its target, true SOC known to sqrt(p)", terminal, target, "g"),
    ]


def _smoothed(name: str, function: PiecewiseLinear, edge: float, unit: str) -> Row:
    """At an edge the expectation is between the penalty on the edge and the one a sqrt(p) below it."""
    value = expected(function, edge)
    ok = float(function(edge)) < value < float(function(edge - SQRT_P))
    return Row.holds(f"{name}: smoothed out", ok, 1e3 * value, unit)


def _draw(concepts: Mapping[str, Concept]) -> Figure:
    figure = new_figure(8.0, 5.6)
    panels = figure.subplots(2, len(concepts), squeeze=False)
    for column, (name, concept) in enumerate(concepts.items()):
        window, target = concept.window, concept.terminal.target_soc
        soc = np.linspace(max(0.0, window.low - _MARGIN), min(1.0, window.high + _MARGIN), 1201)
        _draw_penalty(panels[0, column], soc, window.penalty_kgps(), (window.low, window.high))
        end = np.linspace(max(0.0, target - _REACH), min(1.0, target + _REACH), 1201)
        _draw_penalty(panels[1, column], end, concept.terminal.penalty_kg(), (target,))
        panels[0, column].set_title(name.upper())
        panels[1, column].set_xlabel("SOC [%]: true (solid), estimate (dashed)")
    panels[0, 0].set_ylabel("Γ [g/s]")
    panels[1, 0].set_ylabel("Υ [g]")
    legend_below(figure, list(panels.flat))
    return figure


def _draw_penalty(
    ax: Axes,
    soc: NDArray[np.float64],
    function: PiecewiseLinear,
    marks: tuple[float, ...],
) -> None:
    ax.plot(100.0 * soc, 1e3 * function(soc), color=COLORS[0], linewidth=1.5, label="at the true SOC")
    seen = function.expectation(soc, np.full_like(soc, SQRT_P**2))
    label = f"expected at the estimate, √p = {100.0 * SQRT_P:g} %"
    ax.plot(100.0 * soc, 1e3 * seen, color=COLORS[1], linewidth=1.2, linestyle=DASHED, label=label)
    for place, mark in enumerate(marks):
        name = None if place else "window, end target"
        ax.axvline(100.0 * mark, color=LIMIT, linewidth=0.8, linestyle=(0, (2, 2)), label=name)
    ax.set_xlim(100.0 * soc[0], 100.0 * soc[-1])
    ax.set_ylim(bottom=0.0)
    finish(ax)

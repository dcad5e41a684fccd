"""[L] Table 2 as a picture: published and own means over mu."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ems.records import Comparison
from ems.statistics import mean_and_error
from socwise.figures.style import INK, finish
from socwise.reproduce.panels import COLORS, DASHED, legend_below, new_figure
from socwise.reproduce.simulation import pick
from socwise.reproduce.sources import CONCEPTS, MUS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Published = Mapping[str, tuple[float, ...]]


def draw_table2(comparison: Comparison, fuel: Published, final: Published) -> Figure:
    """Draw fuel and final SOC estimate over mu, one row a concept, with the standard errors of ours.

    Parameters
    ----------
    comparison : Comparison
        Holds both concepts at the three mu.
    fuel, final : mapping of str to tuple of float
        Published values of each concept, in l/100 km and as a fraction.
    """
    figure = new_figure(8.0, 5.6)
    panels = figure.subplots(len(CONCEPTS), 2, sharex=True)
    for (left, right), concept in zip(panels, CONCEPTS, strict=True):
        cases = [pick(comparison, concept, mu) for mu in MUS]
        _draw_means(left, fuel[concept], [case.fuel_l_per_100km for case in cases])
        _draw_means(
            right,
            tuple(100.0 * value for value in final[concept]),
            [100.0 * case.rollout.soc_estimate[:, -1] for case in cases],
        )
        left.set_ylabel(f"{concept.upper()} fuel [l/100 km]")
        right.set_ylabel(f"{concept.upper()} final SOC estimate [%]")
    for ax in panels[-1]:
        ax.set_xlabel("μ")
    legend_below(figure, list(panels.flat))
    return figure


def _draw_means(ax: Axes, published: tuple[float, ...], values: list[NDArray[Any]]) -> None:
    means, errors = zip(*(mean_and_error(value) for value in values), strict=True)
    ax.plot(MUS, published, "o", linestyle=DASHED, color=INK, markerfacecolor="white", label="published")
    bars = np.array([0.0 if error is None else error for error in errors])
    look: dict[str, Any] = {
        "fmt": "s-",
        "color": COLORS[0],
        "capsize": 3.0,
        "markersize": 5.0,
        "label": "ours ± s.e.",
    }
    ax.errorbar(MUS, np.array(means), bars, **look)
    ax.set_xscale("log")
    ax.set_xticks(MUS, [f"{mu:g}" for mu in MUS])
    ax.set_xticks([], minor=True)
    ax.set_xlim(MUS[0] / 1.3, MUS[-1] * 1.3)
    ax.margins(y=0.15)
    finish(ax)

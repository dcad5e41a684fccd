"""One parameter of the cell over time, as several estimators believe it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from socwise.figures.estimate_style import (
    draw_band,
    draw_known,
    estimator_color,
    estimator_label,
    scaled_time,
)
from socwise.figures.style import LIMIT, TWO_SIGMA, finish, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from socwise.estimation import EstimateRun

PARAMETERS: dict[str, tuple[str, float, str]] = {
    "capacity_Ah": ("capacity", 1.0, "Ah"),
    "resistance_ohm": ("resistance", 1e3, "mΩ"),
    "relaxation_resistance_ohm": ("relaxation resistance", 1e3, "mΩ"),
    "relaxation_capacitance_F": ("relaxation capacitance", 1e-3, "kF"),
    "current_bias_A": ("current offset", 1e3, "mA"),
}
"""Name for people, factor and unit in which a parameter is shown."""
_START_SHARE = 0.1


def parameter_names(runs: Sequence[EstimateRun]) -> list[str]:
    """Return the parameters that any of the runs has a number for, in the usual order."""
    known = {
        name for run in runs for name, values in run.trace.parameters.items() if np.any(np.isfinite(values))
    }
    return [*(name for name in PARAMETERS if name in known), *sorted(known - PARAMETERS.keys())]


def plot_estimated_parameter(
    runs: Sequence[EstimateRun], name: str, nominal: float | None = None, ax: Axes | None = None
) -> Axes:
    """Plot a parameter of every estimator that has it, with a band of two standard deviations.

    Parameters
    ----------
    runs : sequence of EstimateRun
        At least one, all over the same log.
    name : str
        Such as ``capacity_Ah``.
    nominal : float, optional
        Value of the nominal cell, drawn as a line.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        The parameter over time. The axis is that of the values after the first tenth of the log: a band is
        wide before an estimator has seen anything.
    """
    ax = ax or new_axes()
    words, factor, unit_of_it = PARAMETERS.get(name, (name, 1.0, ""))
    shown = [] if nominal is None else [np.array([factor * nominal])]
    for run in runs:
        time, unit = scaled_time(run)
        if name not in run.trace.parameters:
            continue
        color = estimator_color(run.name)
        values, sd = factor * run.trace.parameters[name], factor * run.trace.deviations[name]
        draw_band(ax, time, values, sd, color=color, alpha=0.2)
        draw_known(ax, time, values, color=color, linewidth=0.9, label=f"{estimator_label(run.name)} ± 2 sd")
        shown += _later(values, sd)
    if nominal is not None:
        ax.axhline(factor * nominal, color=LIMIT, linewidth=0.9, linestyle=(0, (5, 3)), label="nominal")
    ax.set(xlabel=f"time [{unit}]", ylabel=f"{words} [{unit_of_it}]", xlim=(time[0], time[-1]))
    together = np.concatenate(shown) if shown else np.empty(0)
    if together.size:
        low, high = float(together.min()), float(together.max())
        pad = 0.08 * (high - low) or 0.05 * abs(high) or 1.0
        ax.set_ylim(low - pad, high + pad)
    return finish(ax)


def _later(values: NDArray[np.float64], sd: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Values and ends of the band after the first tenth, without NaN."""
    later = slice(int(_START_SHARE * values.size), None)
    spread = TWO_SIGMA * np.nan_to_num(sd[later], posinf=0.0)
    return [part[np.isfinite(part)] for part in (values[later] - spread, values[later] + spread)]

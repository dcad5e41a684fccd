"""State of charge over time, as several estimators believe it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from socwise.figures.estimate_style import (
    draw_band,
    draw_known,
    estimator_color,
    estimator_label,
    scaled_time,
)
from socwise.figures.style import INK, LIMIT, PERCENT, finish, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from socwise.estimation import EstimateRun


def plot_estimated_soc(runs: Sequence[EstimateRun], ax: Axes | None = None, truth: str = "log") -> Axes:
    """Plot the SOC of every estimator with a band of two standard deviations, and that of the log if there.

    Parameters
    ----------
    runs : sequence of EstimateRun
        At least one, all over the same log.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.
    truth : str
        What the SOC that is taken for true is called.

    Returns
    -------
    matplotlib.axes.Axes
        SOC in per cent over time.
    """
    ax = ax or new_axes()
    for run in runs:
        time, unit = scaled_time(run)
        color = estimator_color(run.name)
        soc, sd = PERCENT * run.trace.soc, PERCENT * np.sqrt(run.trace.variance)
        draw_band(ax, time, soc, sd, within=(0.0, PERCENT), color=color, alpha=0.2)
        draw_known(ax, time, soc, color=color, linewidth=0.9, label=f"{estimator_label(run.name)} ± 2 sd")
    if runs[0].soc_true is not None:
        true = PERCENT * runs[0].soc_true
        draw_known(ax, time, true, color=INK, linewidth=0.9, linestyle=(0, (4, 2)), label=truth)
    ax.set(xlabel=f"time [{unit}]", ylabel="SOC [%]", xlim=(time[0], time[-1]))
    return finish(ax)


def plot_soc_error(runs: Sequence[EstimateRun], ax: Axes | None = None) -> Axes:
    """Plot the error of every estimator against the SOC of the log, with two standard deviations as believed.

    Parameters
    ----------
    runs : sequence of EstimateRun
        At least one, over a log with a SOC.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        Estimate less the log's SOC, in per cent of SOC, over time.
    """
    ax = ax or new_axes()
    errors, bands = [0.0], []
    for run in runs:
        time, unit = scaled_time(run)
        if run.soc_true is None:
            continue
        color = estimator_color(run.name)
        error, sd = PERCENT * (run.trace.soc - run.soc_true), PERCENT * np.sqrt(run.trace.variance)
        errors.append(float(np.nanmax(np.abs(error))))
        bands.append(float(np.quantile(2.0 * sd, 0.9)))
        draw_band(ax, time, np.zeros_like(error), sd, color=color, alpha=0.15)
        draw_known(ax, time, error, color=color, linewidth=0.8, label=f"{estimator_label(run.name)} ± 2 sd")
    # The widest band of all would leave nothing to see of the others.
    reach = 1.1 * max(*errors, sorted(bands)[len(bands) // 2], 0.5)
    ax.set_ylim(-reach, reach)
    ax.axhline(0.0, color=LIMIT, linewidth=0.6, zorder=1)
    ax.set(xlabel=f"time [{unit}]", ylabel="SOC error [%]", xlim=(time[0], time[-1]))
    return finish(ax)

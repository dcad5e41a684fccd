"""Voltage residual of one estimator over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from socwise.figures.estimate_style import draw_known, estimator_color, estimator_label, scaled_time
from socwise.figures.style import LIMIT, finish, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from socwise.estimation import EstimateRun

MILLI = 1e3
_SHOWN = 0.999
_ROOM = 1.5


def plot_residual(run: EstimateRun, ax: Axes | None = None) -> Axes:
    """Plot measured minus expected voltage.

    Parameters
    ----------
    run : EstimateRun
        One estimator over a log.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        Residual in mV over time; 0.1 % of the samples, the farthest, may lie outside, and the title says how
        far.
    """
    ax = ax or new_axes()
    time, unit = scaled_time(run)
    residual_mV = MILLI * run.trace.residual_V
    draw_known(ax, time, residual_mV, color=estimator_color(run.name), linewidth=0.5)
    ax.axhline(0.0, color=LIMIT, linewidth=0.6, zorder=1)
    title = f"{estimator_label(run.name)}: rms {MILLI * run.residual_rms_V:.3g} mV"
    known = np.abs(residual_mV[np.isfinite(residual_mV)])
    if known.size:
        limit, farthest = _ROOM * float(np.quantile(known, _SHOWN)), float(known.max())
        if 0.0 < limit < farthest:
            ax.set_ylim(-limit, limit)
            title += f", farthest {farthest:.3g} mV"
    ax.set(xlabel=f"time [{unit}]", ylabel="residual [mV]", title=title, xlim=(time[0], time[-1]))
    return finish(ax)

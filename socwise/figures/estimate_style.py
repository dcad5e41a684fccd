"""What the figures of estimates share: colours of estimators, a scale of time, lines that may have holes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from socwise.figures.style import DRAWN_STRETCHES, TWO_SIGMA, draw
from socwise.thinning import stride_for

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from socwise.estimation import EstimateRun

Array = NDArray[np.float64]

# Okabe and Ito's palette, told apart with every common colour vision.
_COLORS = {
    "coulomb": "#555555",
    "ekf": "#0072B2",
    "ukf": "#56B4E9",
    "gpc_gradient": "#D55E00",
    "gpc_gauss_newton": "#E69F00",
    "gpc_ekf": "#009E73",
}
_OTHER = "#B5609A"
_LABELS = {
    "coulomb": "Coulomb counting",
    "ekf": "EKF",
    "ukf": "UKF",
    "gpc_gradient": "gPC gradient",
    "gpc_gauss_newton": "gPC Gauss-Newton",
    "gpc_ekf": "gPC-EKF",
}
_SCALES = ((2.0 * 86400.0, 86400.0, "d"), (2.0 * 3600.0, 3600.0, "h"), (0.0, 1.0, "s"))


def estimator_label(name: str) -> str:
    """Return an estimator's name for people."""
    return _LABELS.get(name, name.replace("_", " "))


def estimator_color(name: str) -> str:
    """Return an estimator's colour, the same in every figure."""
    return _COLORS.get(name, _OTHER)


def time_scale(duration_s: float) -> tuple[float, str]:
    """Return seconds in the unit in which a duration is best read, and the unit."""
    return next((length, unit) for least, length, unit in _SCALES if duration_s >= least)


def scaled_time(run: EstimateRun) -> tuple[Array, str]:
    """Return the times of a run and their unit."""
    time_s = run.trace.time_s
    length, unit = time_scale(float(time_s[-1] - time_s[0]))
    return time_s / length, unit


def draw_known(ax: Axes, time: Array, values: Array, **look: Any) -> None:
    """Draw a line through the values that are numbers; nothing where there is none."""
    known = np.isfinite(values)
    if np.any(known):
        draw(ax, time[known], values[known], **look)


def draw_band(
    ax: Axes,
    time: Array,
    values: Array,
    sd: Array,
    within: tuple[float, float] = (-np.inf, np.inf),
    **look: Any,
) -> None:
    """Fill two standard deviations around the values, where both are numbers, as far as they are possible."""
    known = np.flatnonzero(np.isfinite(values) & np.isfinite(sd))
    keep = known[:: stride_for(known.size, DRAWN_STRETCHES)]
    spread = TWO_SIGMA * sd[keep]
    low, high = np.clip((values[keep] - spread, values[keep] + spread), *within)
    ax.fill_between(time[keep], low, high, linewidth=0, **look)

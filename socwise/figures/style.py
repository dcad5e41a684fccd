"""What all figures share: axes without a window, line widths, greys, and checks of what is asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ems.records import Case
from socwise.labels import policy_style
from socwise.thinning import extremes, stride_for

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK = "#222222"
ESTIMATE = "#6B6B6B"
BAND = "#D0D0D0"
LIMIT = "#8A8A8A"
TWO_SIGMA = 2.0
PERCENT = 100.0
DRAWN_STRETCHES = 1000
"""Stretches of time told apart in a figure: more than a printed column can resolve."""


def new_axes(width_in: float = 7.0, height_in: float = 3.2) -> Axes:
    """Return the axes of a new figure that belongs to no window."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), layout="constrained").subplots()


def finish(ax: Axes) -> Axes:
    """Take the box off the axes and put a light grid behind the data."""
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(visible=True, color="#E6E6E6", linewidth=0.6)
    ax.set_axisbelow(True)
    return ax


def draw(ax: Axes, time_s: NDArray[np.float64], values: NDArray[np.floating], **look: Any) -> None:
    """Draw a line with the extremes of each stretch of time, so that long cycles stay small on disk."""
    keep = extremes(values, stride_for(values.size, DRAWN_STRETCHES))
    ax.plot(time_s[keep], values[keep], **look)


def case_title(case: Case) -> str:
    """Return the policy and mu, as a panel's title."""
    return f"{policy_style(case.policy).label}, μ = {case.mu:g}"


def check_realization(case: Case, realization: int) -> int:
    """Return the index of a realization if the case has it.

    Raises
    ------
    ValueError
        If it does not.
    """
    count = case.rollout.soc.shape[0]
    if not 0 <= realization < count:
        raise ValueError(f"realization {realization} is not one of 0 to {count - 1}")
    return realization

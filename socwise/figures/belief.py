"""State of charge, true and believed: trajectories, ensembles, errors, and how sure the estimator is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ems.records import Case
from socwise.figures.style import (
    BAND,
    DRAWN_STRETCHES,
    ESTIMATE,
    LIMIT,
    PERCENT,
    TWO_SIGMA,
    case_title,
    check_realization,
    draw,
    finish,
    new_axes,
)
from socwise.labels import policy_style
from socwise.thinning import stride_for

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Values = NDArray[np.floating]
_INNER, _OUTER = (0.25, 0.75), (0.05, 0.95)


def plot_soc(case: Case, realization: int = 0, ax: Axes | None = None) -> Axes:
    """Plot the true SOC and its estimate with a band of two standard deviations, and the allowed window.

    Parameters
    ----------
    case : Case
        Whose trajectories.
    realization : int
        Which one.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        SOC in per cent over time in s.

    Raises
    ------
    ValueError
        If there is no such realization.
    """
    ax = ax or new_axes()
    row, rollout = check_realization(case, realization), case.rollout
    estimate = PERCENT * rollout.soc_estimate[row]
    spread = TWO_SIGMA * PERCENT * np.sqrt(rollout.variance[row])
    low, high = estimate - spread, estimate + spread
    _fill(ax, rollout.time_s, low, high, color=BAND, linewidth=0, label="estimate ± 2√p")
    draw(ax, rollout.time_s, estimate, color=ESTIMATE, linewidth=0.8, label="estimate")
    color = policy_style(case.policy).color
    draw(ax, rollout.time_s, PERCENT * rollout.soc[row], color=color, linewidth=1.1, label="true")
    return _soc_axes(case, ax)


def plot_ensemble(case: Case, ax: Axes | None = None) -> Axes:
    """Plot the median of the true SOC over all realizations, with the middle 50 and 90 per cent of them.

    Parameters
    ----------
    case : Case
        Whose trajectories.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        SOC in per cent over time in s.
    """
    ax = ax or new_axes()
    keep = slice(None, None, stride_for(case.rollout.time_s.size, DRAWN_STRETCHES))
    time_s, color = case.rollout.time_s[keep], policy_style(case.policy).color
    levels = (_OUTER[0], _INNER[0], 0.5, _INNER[1], _OUTER[1])
    low, lower, median, upper, high = PERCENT * np.quantile(case.rollout.soc[:, keep], levels, axis=0)
    ax.fill_between(time_s, low, high, color=color, alpha=0.18, linewidth=0, label="5 to 95 %")
    ax.fill_between(time_s, lower, upper, color=color, alpha=0.40, linewidth=0, label="25 to 75 %")
    ax.plot(time_s, median, color=color, linewidth=1.1, label="median")
    return _soc_axes(case, ax)


def plot_error(case: Case, realization: int = 0, ax: Axes | None = None) -> Axes:
    """Plot the error of the estimate, and two standard deviations as the estimator believes them.

    Parameters
    ----------
    case : Case
        Whose trajectories.
    realization : int
        Which one.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        Estimate less truth, in per cent of SOC, over time in s.

    Raises
    ------
    ValueError
        If there is no such realization.
    """
    ax = ax or new_axes()
    row, rollout = check_realization(case, realization), case.rollout
    # The difference of two floats near 0.5 in single precision would show rounding.
    error = rollout.soc_estimate[row].astype(np.float64) - rollout.soc[row]
    spread = TWO_SIGMA * PERCENT * np.sqrt(rollout.variance[row])
    _fill(ax, rollout.time_s, -spread, spread, color=BAND, linewidth=0, label="± 2√p")
    color = policy_style(case.policy).color
    draw(ax, rollout.time_s, PERCENT * error, color=color, linewidth=0.8, label="estimate − true")
    ax.axhline(0.0, color=LIMIT, linewidth=0.6, zorder=1)
    ax.set(xlabel="time [s]", ylabel="SOC error [%]", title=case_title(case))
    ax.set_xlim(rollout.time_s[0], rollout.time_s[-1])
    return finish(ax)


def plot_spread(cases: Sequence[Case], ax: Axes | None = None) -> Axes:
    """Plot the standard deviation that the estimator believes, averaged over realizations, for each case.

    Parameters
    ----------
    cases : sequence of Case
        Cases of one concept and one mu.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        Root of the mean variance, in per cent of SOC, over time in s.
    """
    ax = ax or new_axes()
    policies = [case.policy for case in cases]
    for case in cases:
        spread = PERCENT * np.sqrt(case.rollout.variance.mean(axis=0, dtype=np.float64))
        style = policy_style(case.policy, policies)
        look = {"color": style.color, "linestyle": style.line, "label": style.label}
        draw(ax, case.rollout.time_s, spread, linewidth=1.3, **look)
    ax.set(xlabel="time [s]", ylabel="√p [% SOC]")
    # A limit set here would stop panels that share the axis from growing with the other cases.
    ax.axhline(0.0, color=LIMIT, linewidth=0.6, zorder=1)
    if cases:
        ax.set_xlim(cases[0].rollout.time_s[0], cases[0].rollout.time_s[-1])
    return finish(ax)


def _fill(ax: Axes, time_s: Values, low: Values, high: Values, **look: Any) -> None:
    keep = slice(None, None, stride_for(time_s.size, DRAWN_STRETCHES))
    ax.fill_between(time_s[keep], low[keep], high[keep], **look)


def _soc_axes(case: Case, ax: Axes) -> Axes:
    for limit, label in zip(case.window, ("window", None), strict=True):
        ax.axhline(PERCENT * limit, color=LIMIT, linewidth=0.9, linestyle=(0, (5, 3)), label=label)
    ax.set(xlabel="time [s]", ylabel="SOC [%]", title=case_title(case))
    ax.set_xlim(case.rollout.time_s[0], case.rollout.time_s[-1])
    return finish(ax)

"""What the powertrain does: battery current, engine state, and the cycle that is driven."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ems.records import Case
from socwise.figures.style import INK, LIMIT, case_title, check_realization, draw, finish, new_axes
from socwise.labels import policy_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

KMH_PER_MPS = 3.6
_ALTITUDE = "#8C6D00"
_BAR_HEIGHT = 0.62


def plot_current(case: Case, realization: int = 0, ax: Axes | None = None) -> Axes:
    """Plot the battery current, positive where it charges, and its mean absolute value.

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
        Current in A over time in s.

    Raises
    ------
    ValueError
        If there is no such realization.
    """
    ax = ax or new_axes()
    row, rollout = check_realization(case, realization), case.rollout
    color = policy_style(case.policy).color
    ax.axhline(0.0, color=LIMIT, linewidth=0.6)
    draw(ax, rollout.time_s[:-1], rollout.current_A[row], drawstyle="steps-post", color=color, linewidth=0.5)
    ax.set(
        xlabel="time [s]",
        ylabel="current [A], > 0 charges",
        title=f"{case_title(case)}: mean |current| {rollout.mean_abs_current_A[row]:.1f} A",
    )
    ax.set_xlim(rollout.time_s[0], rollout.time_s[-1])
    return finish(ax)


def plot_engine(cases: Sequence[Case], realization: int = 0, ax: Axes | None = None) -> Axes:
    """Draw when the engine runs, one row of bars a case, and how often it starts.

    Parameters
    ----------
    cases : sequence of Case
        Cases of one concept and one mu.
    realization : int
        Which one.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        One row a policy, over time in s.

    Raises
    ------
    ValueError
        If a case has no such realization.
    """
    ax = ax or new_axes()
    policies = [case.policy for case in cases]
    labels = []
    for place, case in enumerate(cases):
        row, rollout = check_realization(case, realization), case.rollout
        style = policy_style(case.policy, policies)
        bars = on_intervals(rollout.time_s, rollout.engine_on[row])
        ax.broken_barh(bars, (place - _BAR_HEIGHT / 2, _BAR_HEIGHT), facecolor=style.color, linewidth=0)
        starts = int(rollout.engine_starts[row])
        labels.append(f"{style.label}\n{starts} {'start' if starts == 1 else 'starts'}")
    ax.set_yticks(range(len(cases)), labels)
    ax.set_ylim(len(cases) - 0.4, -0.6)
    ax.set(xlabel="time [s]", title="engine on")
    if cases:
        ax.set_xlim(cases[0].rollout.time_s[0], cases[0].rollout.time_s[-1])
    finish(ax)
    ax.grid(visible=False, axis="y")
    return ax


def on_intervals(time_s: NDArray[np.float64], state: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return start and length, in s, of the intervals in which a state is on; it holds until the next sample.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Times of the samples; the last sample lasts no time.
    state : ndarray of bool, shape (n,)
        The state from each sample on.
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([False], state[:-1], [False])).astype(np.int8)))
    return [(float(time_s[a]), float(time_s[b] - time_s[a])) for a, b in edges.reshape(-1, 2)]


def plot_speed(
    time_s: NDArray[np.float64],
    speed_mps: NDArray[np.float64],
    altitude_m: NDArray[np.float64],
    ax: Axes | None = None,
) -> Axes:
    """Plot the speed of a cycle, and its altitude on a second axis where the road is not level.

    Parameters
    ----------
    time_s, speed_mps, altitude_m : ndarray, shape (n,)
        The cycle.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        Speed in km/h over time in s; the axes of the altitude in m are its twin.
    """
    ax = ax or new_axes(9.0, 3.2)
    draw(ax, time_s, KMH_PER_MPS * speed_mps, color=INK, linewidth=0.9)
    ax.set(xlabel="time [s]", ylabel="speed [km/h]", xlim=(time_s[0], time_s[-1]))
    ax.set_ylim(bottom=0.0)
    finish(ax)
    if np.ptp(altitude_m) > 0.0:
        twin = ax.twinx()
        draw(twin, time_s, altitude_m, color=_ALTITUDE, linewidth=1.2, linestyle=(0, (5, 2)))
        twin.set_ylabel("altitude [m], dashed", color=_ALTITUDE)
        twin.tick_params(axis="y", colors=_ALTITUDE)
        twin.spines[["top", "left"]].set_visible(False)
    return ax

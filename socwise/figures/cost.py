"""What it costs: fuel, penalties and shortfall of each policy, and paired differences between policies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ems.records import Case
from ems.statistics import mean_interval
from socwise.figures.scale import cut_of
from socwise.figures.style import INK, LIMIT, finish, new_axes
from socwise.labels import STOCHASTIC, policy_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_GROUP_WIDTH = 0.82
_GROUP_SPREAD = 0.6


def plot_cost_split(cases: Sequence[Case], ax: Axes | None = None) -> Axes:
    """Draw the mean realised cost as stacked bars, with the 95 % interval of the total.

    Parameters
    ----------
    cases : sequence of Case
        Cases of one concept; bars are grouped by mu.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        Cost in kg of fuel; below, fuel with engine starts, above it penalties and shortfall, hatched.
        Bars that would flatten the others are cut off and carry their value.
    """
    ax = ax or new_axes()
    policies, mus = list(dict.fromkeys(c.policy for c in cases)), sorted({c.mu for c in cases})
    width = _GROUP_WIDTH / max(len(policies), 1)
    cut = cut_of([float(case.rollout.cost_kg.mean()) for case in cases])
    for case in cases:
        place, rollout = policies.index(case.policy), case.rollout
        x = mus.index(case.mu) + (place - (len(policies) - 1) / 2) * width
        style = policy_style(case.policy, policies)
        fuel = float(rollout.fuel_kg.mean())
        extra = float(rollout.penalty_kg.mean() + rollout.shortfall_kg.mean())
        ax.bar(x, fuel, 0.9 * width, color=style.color)
        # A terminal penalty may be a credit, which goes below zero instead of over the fuel.
        bottom = fuel if extra >= 0.0 else 0.0
        ax.bar(x, extra, 0.9 * width, bottom, facecolor="white", edgecolor=style.color, hatch="////")
        total, half_width = mean_interval(rollout.cost_kg)
        if cut is None or total <= cut:
            ax.errorbar(x, total, half_width, color=INK, linewidth=1.2, capsize=3.0)
        else:
            ax.text(x, cut, f"↑\n{total:.3g}", ha="center", va="bottom", fontsize="small", color=style.color)
    if cut is not None:
        ax.set_ylim(top=cut)
    ax.set_xticks(range(len(mus)), [f"{mu:g}" for mu in mus])
    ax.set(xlabel="μ", ylabel="realised cost [kg fuel]")
    finish(ax)
    ax.grid(visible=False, axis="x")
    return ax


def plot_differences(cases: Sequence[Case], reference: str = STOCHASTIC, ax: Axes | None = None) -> Axes:
    """Draw the paired difference in realised cost between one policy and each other, with 95 % intervals.

    Parameters
    ----------
    cases : sequence of Case
        Cases of one concept, on common random numbers.
    reference : str
        The policy whose cost the others' is taken from; it is cheaper where the difference is negative.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        Difference in kg of fuel, one row for each mu and other policy.
    """
    ax = ax or new_axes()
    others = [name for name in dict.fromkeys(c.policy for c in cases) if name != reference]
    mus = sorted({c.mu for c in cases})
    by_key = {(c.mu, c.policy): c for c in cases}
    for place, other in enumerate(others):
        offset = (place - (len(others) - 1) / 2) * _GROUP_SPREAD / max(len(others), 1)
        style = policy_style(other, others)
        pairs = [
            (row, by_key[mu, reference].rollout.cost_kg - by_key[mu, other].rollout.cost_kg)
            for row, mu in enumerate(mus)
            if (mu, reference) in by_key and (mu, other) in by_key
        ]
        if not pairs:
            continue
        means, half_widths = np.array([mean_interval(difference) for _, difference in pairs]).T
        rows = np.array([row for row, _ in pairs], dtype=np.float64) + offset
        ax.errorbar(
            means,
            rows,
            xerr=half_widths,
            fmt="o",
            markersize=5,
            color=style.color,
            capsize=3,
            label=style.label,
        )
        for mean, row in zip(means, rows, strict=True):
            ax.annotate(
                f"{mean:+.2g}".replace("-", "−"),
                (mean, row),
                xytext=(0, 5),
                textcoords="offset points",
                ha="center",
                fontsize="x-small",
                color=style.color,
            )
    ax.axvline(0.0, color=LIMIT, linewidth=1.0)
    ax.set_yticks(range(len(mus)), [f"μ = {mu:g}" for mu in mus])
    ax.set_ylim(len(mus) - 0.5, -0.5)
    label = policy_style(reference).label
    ax.set_xlabel(f"cost of {label} less cost of the other [kg fuel]; < 0: {label} is cheaper")
    finish(ax)
    ax.grid(visible=False, axis="y")
    return ax

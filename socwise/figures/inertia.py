"""Estimated quantities of a vehicle over time, each with its band, and the truth where it is known."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from socwise.figures.estimate_style import draw_band, draw_known, time_scale
from socwise.figures.style import INK, TWO_SIGMA, finish, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from socwise.inertia import InertiaRun

DPI = 150
_STYLE: Any = {"font.size": 9.0, "axes.titlesize": 9.5}
_START_SHARE = 0.05
_LEAST_SHARE = 0.01

QUANTITIES: dict[str, tuple[str, str]] = {
    "position_m": ("position", "m"),
    "velocity_mps": ("velocity", "m/s"),
    "mass_kg": ("mass", "kg"),
    "pitch_inertia_kgm2": ("pitch inertia", "kg m²"),
    "roll_inertia_kgm2": ("roll inertia", "kg m²"),
    "cg_height_m": ("CG height", "m"),
    "cg_from_front_m": ("CG from front axle", "m"),
    "cg_from_left_m": ("CG from left track", "m"),
    "cg_over_roll_centre_m": ("CG over roll centre", "m"),
    "cg_over_pitch_centre_m": ("CG over pitch centre", "m"),
    "drag_kgpm": ("drag term C", "kg/m"),
    "mass_fl_kg": ("mass front left", "kg"),
    "mass_fr_kg": ("mass front right", "kg"),
    "mass_rl_kg": ("mass rear left", "kg"),
    "mass_rr_kg": ("mass rear right", "kg"),
}
"""Name for people and unit of a quantity."""
_LABELS = {
    "gpc": "gPC-EKF",
    "full_germ": "gPC-EKF, full germ",
    "report": "gPC-EKF, report",
    "gpc-report": "gPC-EKF, report",
    "unmodified": "gPC-EKF, unmodified",
    "rls-force": "RLS, force form",
    "rls-acceleration": "RLS, acceleration form",
    "ekf": "EKF",
    "ukf": "UKF",
}
_COLORS = {
    "gpc": "#0072B2",
    "full_germ": "#0072B2",
    "report": "#009E73",
    "gpc-report": "#009E73",
    "unmodified": "#D55E00",
    "rls-force": "#D55E00",
    "rls-acceleration": "#E69F00",
    "ekf": "#B5609A",
    "ukf": "#56B4E9",
}
_OTHER = "#555555"


def quantity_label(name: str) -> str:
    """Name of a quantity for people, with its unit."""
    words, unit = QUANTITIES.get(name, (name, ""))
    return f"{words} [{unit}]" if unit else words


def method_label(method: str) -> str:
    """Name of a method for people."""
    return _LABELS.get(method, method)


def method_color(method: str) -> str:
    """Colour of a method, told apart with every common colour vision."""
    return _COLORS.get(method, _OTHER)


def plot_quantity(runs: Sequence[InertiaRun], name: str, ax: Axes | None = None) -> Axes:
    """Plot a quantity as several methods estimate it, with a band of two standard deviations.

    Parameters
    ----------
    runs : sequence of InertiaRun
        At least one that has the quantity, over one log.
    name : str
        Such as ``mass_kg``.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        The axis is that of the estimates after the first twentieth of the log: before, they may be far off.
    """
    ax = ax or new_axes()
    having = [run for run in runs if name in run.estimate.names]
    first = having[0].estimate.time_s
    length, unit = time_scale(float(first[-1] - first[0]))
    shown = []
    for run in having:
        time = run.estimate.time_s / length
        values, sds = run.estimate.column(name)
        color = method_color(run.estimate.method)
        draw_band(ax, time, values, sds, color=color, alpha=0.18)
        label = f"{method_label(run.estimate.method)} ± 2 sd"
        draw_known(ax, time, values, color=color, linewidth=1.0, label=label)
        later = slice(int(_START_SHARE * values.size), None)
        last = TWO_SIGMA * sds[-1]
        shown += [values[later], values[-1:] - last, values[-1:] + last]
    true = having[0].course.get(name)
    if true is None and name in having[0].truth:
        true = np.full_like(first, having[0].truth[name])
    if true is not None:
        draw_known(ax, first / length, true, color=INK, linewidth=0.9, linestyle=(0, (4, 2)), label="true")
        shown.append(true)
    _fit_axis(ax, np.concatenate(shown))
    ax.set(xlabel=f"time [{unit}]", ylabel=quantity_label(name), xlim=(first[0] / length, first[-1] / length))
    return finish(ax)


def write_inertia_figures(runs: Sequence[InertiaRun], out: Path) -> list[Path]:
    """Draw every quantity of the first seed, a file for each model and scenario, PNG with 150 dpi.

    Returns
    -------
    list of Path
        The files. The same runs give the same bytes.
    """
    import matplotlib

    out.mkdir(parents=True, exist_ok=True)
    written = []
    with matplotlib.rc_context(_STYLE):
        for name, figure in _figures(runs):
            written.append(out / f"{name}.png")
            figure.savefig(written[-1], dpi=DPI)
    return written


def draw_quantities(runs: Sequence[InertiaRun], names: Sequence[str]) -> Figure:
    """Draw quantities one above the other, with one legend below.

    Parameters
    ----------
    runs : sequence of InertiaRun
        Over one log.
    names : sequence of str
        At least one.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 0.8 + 1.9 * len(names)), layout="constrained")
    panels = list(figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0])
    handles: dict[str, Any] = {}
    for ax, name in zip(panels, names, strict=True):
        plot_quantity(runs, name, ax)
        ax.label_outer()
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.align_ylabels()
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=3, frameon=False)
    return figure


def _figures(runs: Sequence[InertiaRun]) -> Iterator[tuple[str, Figure]]:
    for model, scenario in dict.fromkeys((run.model, run.scenario) for run in runs):
        alike = [run for run in runs if (run.model, run.scenario) == (model, scenario)]
        drawn = [run for run in alike if run.seed == alike[0].seed]
        names = dict.fromkeys(name for run in drawn for name in run.estimate.names)
        yield "-".join(part for part in (model, scenario) if part), draw_quantities(drawn, list(names))


def _fit_axis(ax: Axes, values: NDArray[np.float64]) -> None:
    values = values[np.isfinite(values)]
    if values.size:
        low, high = np.quantile(values, [0.002, 0.998])
        pad = max(0.1 * (high - low), _LEAST_SHARE * abs(high), 1e-9)
        ax.set_ylim(float(low - pad), float(high + pad))

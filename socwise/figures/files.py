"""The set of figures that goes with a comparison, as PNG and SVG files with reproducible bytes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ems.records import Case, Comparison
from socwise.figures.belief import plot_ensemble, plot_error, plot_soc, plot_spread
from socwise.figures.cost import plot_cost_split, plot_differences
from socwise.figures.identified import behaviour_of_case, plot_identified
from socwise.figures.operation import plot_current, plot_engine, plot_speed
from socwise.figures.style import ESTIMATE, INK, LIMIT
from socwise.labels import PERFECT_INFORMATION, STOCHASTIC, concept_label, middle, policy_style

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 150
WORTH_A_PROCESS = 1_000_000
"""Samples of the true SOC, over all cases, from which on another process is worth its start."""
_GREYS = frozenset({ESTIMATE, LIMIT})
_STYLE: dict[Any, Any] = {
    "svg.hashsalt": "socwise",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "hatch.linewidth": 0.7,
}


def write_figures(comparison: Comparison, out: Path, jobs: int = 1) -> list[Path]:
    """Draw every figure of a comparison and write each as PNG (150 dpi) and SVG.

    Parameters
    ----------
    comparison : Comparison
        What to draw.
    out : Path
        Folder for the files; created if absent.
    jobs : int
        Processes that draw, where there is enough to draw.

    Returns
    -------
    list of Path
        The files. The same comparison gives the same bytes.
    """
    import joblib

    out.mkdir(parents=True, exist_ok=True)
    shares = _shares(comparison, min(jobs, _samples(comparison) // WORTH_A_PROCESS))
    run = joblib.Parallel(n_jobs=len(shares), mmap_mode="r")
    written = run(joblib.delayed(_write)(comparison, share, out) for share in shares)
    return [path for paths in written for path in paths]


def _samples(comparison: Comparison) -> int:
    return sum(case.rollout.soc.size for case in comparison.cases)


def _shares(comparison: Comparison, processes: int) -> list[list[str]]:
    """Deal the names of the figures out, those of a concept alternately: they take about as long."""
    names = list(_figures(comparison))
    count = max(1, min(processes, len(names)))
    return [names[number::count] for number in range(count)]


def _write(comparison: Comparison, names: Sequence[str], out: Path) -> list[Path]:
    import matplotlib

    figures = _figures(comparison)
    written = []
    with matplotlib.rc_context(_STYLE):
        for name in names:
            figure = figures[name]()
            for suffix, metadata in ((".png", None), (".svg", {"Date": None})):
                path = out / f"{name}{suffix}"
                figure.savefig(path, dpi=DPI, metadata=metadata)
                # The layout found for the first file serves the second: finding it costs as much as drawing.
                figure.set_layout_engine("none")
                written.append(path)
    return written


def _figures(comparison: Comparison) -> dict[str, Callable[[], Figure]]:
    """What draws each figure, by its name."""
    figures: dict[str, Callable[[], Figure]] = {"cycle": partial(_cycle, comparison)}
    if not comparison.cases:
        return figures
    concepts = list(dict.fromkeys(case.concept for case in comparison.cases))
    figures["cost"] = partial(_cost, comparison, concepts)
    if STOCHASTIC in {case.policy for case in comparison.cases}:
        figures["differences"] = partial(_differences, comparison, concepts)
    for number, concept in enumerate(concepts, start=1):
        cases = [case for case in comparison.cases if case.concept == concept]
        tag = concept if concept in {"hev", "phev"} else f"concept{number}"
        count = len(cases[0].rollout.fuel_kg)
        figures |= {
            f"{tag}_soc": partial(_grid, cases, plot_soc, "SOC, true and estimated, first realization"),
            f"{tag}_ensemble": partial(_grid, cases, plot_ensemble, f"true SOC, all {count} realizations"),
            f"{tag}_error": partial(_grid, cases, plot_error, "error of the SOC estimate, first realization"),
            f"{tag}_uncertainty": partial(_uncertainty, cases),
            f"{tag}_operation": partial(_operation, cases),
        }
        if "closed_loop" in comparison.settings:
            figures[f"{tag}_identified"] = partial(_identified, comparison, cases)
    return figures


def _cycle(comparison: Comparison) -> Figure:
    figure = _new_figure(9.0, 3.2)
    ax = plot_speed(comparison.time_s, comparison.speed_mps, comparison.altitude_m, figure.subplots())
    ax.set_title(f"cycle {comparison.cycle_name}, {comparison.distance_m / 1e3:.1f} km")
    return figure


def _cost(comparison: Comparison, concepts: Sequence[str]) -> Figure:
    figure = _new_figure(4.6 * len(concepts), 4.0)
    panels = figure.subplots(1, len(concepts), squeeze=False)[0]
    for ax, concept in zip(panels, concepts, strict=True):
        plot_cost_split([case for case in comparison.cases if case.concept == concept], ax)
        # The pad leaves room for the values of bars that are cut off.
        ax.set_title(f"{concept_label(concept)}: mean realised cost, 95 % interval of the total", pad=26.0)
    _cost_legend(figure, [case.policy for case in comparison.cases])
    return figure


def _differences(comparison: Comparison, concepts: Sequence[str]) -> Figure:
    mus = {case.mu for case in comparison.cases}
    figure = _new_figure(4.8 * len(concepts), 1.6 + 1.0 * len(mus))
    panels = figure.subplots(1, len(concepts), squeeze=False)[0]
    for ax, concept in zip(panels, concepts, strict=True):
        plot_differences([case for case in comparison.cases if case.concept == concept], ax=ax)
        ax.set_title(f"{concept_label(concept)}: paired difference in cost")
        ax.set_xlabel("stochastic less other [kg fuel]; < 0: stochastic cheaper")
    _shared_legend(figure, panels)
    return figure


def _grid(cases: Sequence[Case], plot: Callable[..., Axes], title: str) -> Figure:
    """Draw one panel a case: rows are values of mu, columns policies."""
    mus, policies = sorted({c.mu for c in cases}), list(dict.fromkeys(c.policy for c in cases))
    figure = _new_figure(max(3.1 * len(policies), 5.0), 1.0 + 2.3 * len(mus))
    panels = figure.subplots(len(mus), len(policies), sharex=True, sharey=True, squeeze=False)
    for case in cases:
        plot(case, ax=panels[mus.index(case.mu), policies.index(case.policy)])
    for ax in panels.flat:
        ax.label_outer()
    figure.suptitle(f"{concept_label(cases[0].concept)}: {title}")
    _shared_legend(figure, list(panels.flat), neutral=True)
    return figure


def _uncertainty(cases: Sequence[Case]) -> Figure:
    mus = sorted({c.mu for c in cases})
    figure = _new_figure(7.0, 1.0 + 2.0 * len(mus))
    panels = figure.subplots(len(mus), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for ax, mu in zip(panels, mus, strict=True):
        plot_spread([case for case in cases if case.mu == mu], ax)
        ax.set_title(f"μ = {mu:g}")
        ax.label_outer()
    figure.suptitle(
        f"{concept_label(cases[0].concept)}: believed standard deviation of the SOC (root of mean variance)"
    )
    _shared_legend(figure, list(panels))
    return figure


def _operation(cases: Sequence[Case]) -> Figure:
    """Draw current and engine state of every policy at the middle mu, first realization."""
    mu = middle(sorted({c.mu for c in cases}))
    shown = [case for case in cases if case.mu == mu]
    heights = [*[1.5] * len(shown), 0.5 + 0.45 * len(shown)]
    figure = _new_figure(9.0, 0.8 + sum(heights))
    panels = figure.subplots(len(shown) + 1, 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for ax, case in zip(panels[:-1], shown, strict=True):
        plot_current(case, ax=ax)
        ax.set_ylabel("current [A]")
        ax.label_outer()
    currents = [np.abs(case.rollout.current_A[0]).max() for case in shown]
    for ax in panels[:-1]:
        ax.set_ylim(-1.08 * max(currents), 1.08 * max(currents))
    plot_engine(shown, ax=panels[-1])
    figure.suptitle(
        f"{concept_label(shown[0].concept)}: battery current (> 0 charges) and engine, first realization"
    )
    return figure


def _identified(comparison: Comparison, cases: Sequence[Case]) -> Figure:
    """Draw the identified model beside what the estimator did on the trip, driven by each policy."""
    from bms import Pack, UncertaintyModel
    from bms.uncertainty_fit import NAMES

    settings, concept = comparison.settings, cases[0].concept
    names = [entry["name"] for entry in settings["concepts"]]
    pack = Pack(**settings["packs"][names.index(concept)])
    found = settings["closed_loop"]["identified"][concept]
    model = UncertaintyModel(**{name: found[name]["value"] for name in NAMES})
    first = [case for case in cases if case.mu == cases[0].mu and case.policy != PERFECT_INFORMATION]
    figure = _new_figure(max(3.1 * len(first), 5.0), 3.3)
    panels = figure.subplots(1, max(len(first), 1), sharex=True, sharey=True, squeeze=False)[0]
    for ax, case in zip(panels, first, strict=False):
        plot_identified(behaviour_of_case(case), pack, model, ax)
        ax.set_title(policy_style(case.policy).label)
        ax.label_outer()
    figure.suptitle(f"{concept_label(concept)}: what the estimator claims, and the identified model")
    _shared_legend(figure, list(panels))
    return figure


def _new_figure(width_in: float, height_in: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), layout="constrained")


def _shared_legend(figure: Figure, panels: Sequence[Axes], neutral: bool = False) -> None:
    """Put one legend below all panels, so that it hides no data.

    ``neutral`` shows in black what each panel draws in its policy's own colour.
    """
    handles = {
        label: handle for ax in panels for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)
    }
    shown = [_in_black(handle) if neutral else handle for handle in handles.values()]
    if shown:
        figure.legend(shown, list(handles), loc="outside lower center", ncols=4, frameon=False)


def _in_black(handle: Artist) -> Artist:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    if isinstance(handle, Line2D):
        if handle.get_color() in _GREYS:
            return handle
        return Line2D([], [], color=INK, linewidth=handle.get_linewidth())
    return handle if handle.get_alpha() is None else Patch(color=INK, alpha=handle.get_alpha(), linewidth=0)


def _cost_legend(figure: Figure, policies: Sequence[str]) -> None:
    from matplotlib.patches import Patch

    styles = [policy_style(policy, policies) for policy in dict.fromkeys(policies)]
    handles = [Patch(facecolor=style.color, label=style.label) for style in styles]
    handles.append(Patch(facecolor=ESTIMATE, label="solid: fuel with engine starts"))
    handles.append(
        Patch(facecolor="white", edgecolor=ESTIMATE, hatch="////", label="hatched: penalties, shortfall")
    )
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)

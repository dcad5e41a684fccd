"""The set of figures that goes with estimates, as PNG files with reproducible bytes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from socwise.figures.estimate_parameters import parameter_names, plot_estimated_parameter
from socwise.figures.estimate_residual import plot_residual
from socwise.figures.estimate_soc import plot_estimated_soc, plot_soc_error

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from socwise.estimation import EstimateRun

DPI = 150
_STYLE: Any = {"font.size": 9.0, "axes.titlesize": 9.5}


def write_estimate_figures(
    runs: Sequence[EstimateRun], nominal: Mapping[str, float], out: Path, truth: str = "log"
) -> list[Path]:
    """Draw SOC, parameters and residuals, and write each as PNG (150 dpi).

    Parameters
    ----------
    runs : sequence of EstimateRun
        At least one, all over the same log.
    nominal : mapping of str to float
        Nominal parameters of the cell, by name.
    out : Path
        Folder for the files; created if absent.
    truth : str
        What the SOC that is taken for true is called.

    Returns
    -------
    list of Path
        The files. The same runs give the same bytes.
    """
    import matplotlib

    out.mkdir(parents=True, exist_ok=True)
    written = []
    with matplotlib.rc_context(_STYLE):
        for name, figure in _figures(runs, nominal, truth):
            written.append(out / f"{name}.png")
            figure.savefig(written[-1], dpi=DPI)
    return written


def _figures(
    runs: Sequence[EstimateRun], nominal: Mapping[str, float], truth: str
) -> Iterator[tuple[str, Figure]]:
    compared = runs[0].soc_true is not None
    figure, panels = _stack(2 if compared else 1, 3.0)
    plot_estimated_soc(runs, panels[0], truth)
    if compared:
        plot_soc_error(runs, panels[1])
    yield "soc", _with_legend(figure, panels)
    names = parameter_names(runs)
    if names:
        figure, panels = _stack(len(names), 2.0)
        for name, ax in zip(names, panels, strict=True):
            plot_estimated_parameter(runs, name, nominal.get(name), ax)
        yield "parameters", _with_legend(figure, panels)
    predicting = [run for run in runs if np.any(np.isfinite(run.trace.residual_V))]
    if predicting:
        figure, panels = _stack(len(predicting), 1.9)
        for run, ax in zip(predicting, panels, strict=True):
            plot_residual(run, ax)
            ax.label_outer()
        yield "residual", figure


def _stack(count: int, height_in: float) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 0.7 + height_in * count), layout="constrained")
    return figure, list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])


def _with_legend(figure: Figure, panels: Sequence[Axes]) -> Figure:
    """Put one legend below all panels, so that it hides no data."""
    handles: dict[str, Any] = {}
    for ax in panels:
        ax.label_outer()
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=4, frameon=False)
    return figure

"""What a plant did: current, voltage and, where it tells it, temperature over time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from socwise.figures.estimate_style import time_scale
from socwise.figures.style import INK, LIMIT, draw, finish

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from socwise.cosimulation import Drive

DPI = 150
_STYLE: Any = {"font.size": 9.0, "axes.titlesize": 9.5}


def plot_plant_drive(drive: Drive, title: str = "") -> Figure:
    """Plot a drive.

    Parameters
    ----------
    drive : Drive
        What the plant answered.
    title : str
        Put above it.

    Returns
    -------
    matplotlib.figure.Figure
        A panel for each quantity, over time.
    """
    from matplotlib.figure import Figure

    shown = [("current [A]", drive.current_A), ("voltage [V]", drive.voltage_V)]
    if drive.temperature_C is not None:
        shown.append(("temperature [°C]", drive.temperature_C))
    figure = Figure(figsize=(8.0, 0.7 + 1.9 * len(shown)), layout="constrained")
    panels = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    length_s, unit = time_scale(float(drive.time_s[-1]))
    time = drive.time_s / length_s
    for ax, (label, values) in zip(panels, shown, strict=True):
        draw(ax, time, values, color=INK, linewidth=0.6)
        ax.set(ylabel=label, xlim=(time[0], time[-1]))
        finish(ax)
    panels[0].axhline(0.0, color=LIMIT, linewidth=0.6, zorder=1)
    panels[0].set_title(title)
    panels[-1].set_xlabel(f"time [{unit}]")
    return figure


def write_plant_drive(drive: Drive, path: Path, title: str = "") -> None:
    """Write the plot as PNG, 150 dpi; the same drive gives the same bytes."""
    import matplotlib

    path.parent.mkdir(parents=True, exist_ok=True)
    with matplotlib.rc_context(_STYLE):
        plot_plant_drive(drive, title).savefig(path, dpi=DPI)

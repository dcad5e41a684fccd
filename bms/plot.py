"""Pictures of a pack: its open-circuit voltage, and how well its voltage tells the state of charge."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bms.pack import Pack

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_POINTS = 501


def plot_ocv(pack: Pack, ax: Axes | None = None) -> Axes:
    """Draw the open-circuit voltage over SOC, with the nodes of its table ([L] Fig 1).

    Parameters
    ----------
    pack : Pack
        Its curve is drawn.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        SOC in per cent, voltage in V.
    """
    ax = ax or new_axes()
    soc = np.linspace(0.0, 1.0, _POINTS)
    (line,) = ax.plot(100.0 * soc, pack.ocv(soc), label=pack.name)
    ax.plot(100.0 * pack.ocv.soc, pack.ocv.voltage_V, ".", markersize=3, color=line.get_color())
    ax.set(xlabel="SOC [%]", ylabel="open-circuit voltage [V]", xlim=(0.0, 100.0))
    ax.legend(loc="upper left")
    return ax


def plot_alpha(pack: Pack, ax: Axes | None = None) -> Axes:
    """Draw the variance of the voltage-derived SOC over SOC, as a share of its maximum ([L] eq 4, Fig 2).

    Parameters
    ----------
    pack : Pack
        Its alpha is drawn.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        SOC in per cent, alpha without unit.
    """
    ax = ax or new_axes()
    soc = np.linspace(0.0, 1.0, _POINTS)
    ax.plot(100.0 * soc, pack.ocv.alpha(soc), label=pack.name)
    ax.set(xlabel="SOC [%]", ylabel="alpha [-]", xlim=(0.0, 100.0), ylim=(0.0, 1.05))
    ax.legend(loc="lower center")
    return ax


def new_axes() -> Axes:
    """Make axes in a figure of their own, which no window shows."""
    from matplotlib.figure import Figure

    return Figure(layout="constrained").subplots()

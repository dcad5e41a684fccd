"""Pictures of ageing: the degradation map as a surface ([M] Fig 32), and fade over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from bms.ageing import AgeingHistory
from bms.degradation import DegradationMap
from bms.errors import BatteryError
from bms.plot import new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PERCENT_PER_DAY = 100.0 * 86400.0

_QUANTITIES = {
    "capacity": ("capacity_fade_per_s", "capacity fade [%/day]"),
    "resistance": ("resistance_growth_per_s", "resistance growth [%/day]"),
}


def plot_degradation_map(
    known: DegradationMap,
    ax: Axes | None = None,
    *,
    temperature_C: float | None = None,
    quantity: Literal["capacity", "resistance"] = "capacity",
    capacity_Ah: float | None = None,
) -> Axes:
    """Draw a degradation map over current and SOC at one temperature ([M] Fig 32).

    Parameters
    ----------
    known : DegradationMap
        The map; at least two currents and two SOCs.
    ax : matplotlib.axes.Axes, optional
        Where to draw: a surface on axes with ``projection="3d"`` (a new figure if not given), else filled
        contours.
    temperature_C : float, optional
        Where to cut the map; by default its middle node.
    quantity : {"capacity", "resistance"}
        What to draw.
    capacity_Ah : float, optional
        Draws the current as a C-rate of this capacity.

    Returns
    -------
    matplotlib.axes.Axes
        Current in A (or C-rate in 1/h), SOC in per cent, rate in per cent of the initial value per day.

    Raises
    ------
    BatteryError
        When the map has a single current or SOC, or the quantity is unknown.
    """
    if quantity not in _QUANTITIES:
        raise BatteryError(f"a degradation map has no {quantity!r}; known are {', '.join(_QUANTITIES)}")
    if known.current_A.size < 2 or known.soc.size < 2:
        raise BatteryError(f"a surface needs two currents and two SOCs or more; the map is {known.shape}")
    heat = float(known.temperature_C[known.shape[2] // 2]) if temperature_C is None else temperature_C
    rates = known.rates_per_s(known.current_A[:, None], known.soc[None, :], heat)
    label = _QUANTITIES[quantity][1]
    height = PERCENT_PER_DAY * rates[list(_QUANTITIES).index(quantity)]
    current = known.current_A / capacity_Ah if capacity_Ah else known.current_A
    x, y = np.meshgrid(current, 100.0 * known.soc, indexing="ij")
    axes: Any = ax or _solid_axes()
    if axes.name == "3d":
        axes.plot_surface(x, y, height, cmap="viridis", edgecolor="none")
        axes.set_zlabel(label)
    else:
        filled = axes.contourf(x, y, height, levels=16, cmap="viridis")
        axes.figure.colorbar(filled, ax=axes, label=label)
    axes.set_xlabel("C-rate [1/h]" if capacity_Ah else "current [A]")
    axes.set_ylabel("SOC [%]")
    axes.set_title(f"{known.source}, {heat:g} °C" if known.source else f"{heat:g} °C")
    drawn: Axes = axes
    return drawn


def plot_ageing(history: AgeingHistory, ax: Axes | None = None) -> Axes:
    """Draw what is left of the capacity, and the resistance if it grows, over time.

    Parameters
    ----------
    history : AgeingHistory
        What is drawn. An acceleration is declared in the title.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        Time in days, capacity and resistance in per cent of their initial values.
    """
    ax = ax or new_axes()
    days = history.time_s / 86400.0
    ax.plot(days, 100.0 * history.capacity_factor, label="capacity")
    if np.any(history.resistance_factor != 1.0):
        ax.plot(days, 100.0 * history.resistance_factor, label="resistance")
    ax.set(xlabel="time [days]", ylabel="share of the initial value [%]")
    if history.acceleration != 1.0:
        ax.set_title(f"ageing accelerated {history.acceleration:g} times")
    ax.legend(loc="best")
    return ax


def _solid_axes() -> Any:
    from matplotlib.figure import Figure

    return Figure(layout="constrained").add_subplot(projection="3d")

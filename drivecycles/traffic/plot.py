"""Pictures of traffic: speed at places, the time-space diagram, fans, errors, estimates and cycles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drivecycles.cycle import DriveCycle
from drivecycles.traffic.estimation import TrafficEstimate
from drivecycles.traffic.field import TrafficField
from drivecycles.traffic.uncertainty import Spread

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

KMH_PER_MPS = 3.6
SHOWN = {
    "free_flow_mps": ("free-flow speed [km/h]", 3.6),
    "optimum_mps": ("speed at capacity [km/h]", 3.6),
    "jam_per_m": ("jam density [veh/km]", 1e3),
    "critical_density_per_m": ("critical density [veh/km]", 1e3),
}
"""Parameters of a diagram: axis label, and what one SI unit is on it."""
_BAND = "#9DC3E6"
_TRUE = "#222222"
_TWO_SIGMA = 2.0


def _axes(ax: Axes | None, width_in: float = 7.0, height_in: float = 3.2) -> Axes:
    if ax is not None:
        return ax
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), layout="constrained").add_subplot()


def plot_locations(field: TrafficField, position_m: Sequence[float], ax: Axes | None = None) -> Axes:
    """Plot speed over time at places.

    Parameters
    ----------
    field : TrafficField
    position_m : sequence of float
        Places on the road.
    ax : matplotlib Axes, optional
        Where to draw; a new figure's if absent. No window is opened.

    Raises
    ------
    TrafficError
        When a place is outside the road.
    """
    ax = _axes(ax)
    for place in position_m:
        ax.plot(
            field.time_s, KMH_PER_MPS * field.speed_at(place), label=f"{place / 1e3:.4g} km", linewidth=1.2
        )
    ax.set(
        xlabel="time [s]", ylabel="speed [km/h]", xlim=(field.time_s[0], field.time_s[-1]), ylim=(0.0, None)
    )
    ax.legend(frameon=False)
    return ax


def plot_field(
    field: TrafficField, ax: Axes | None = None, cycles: Sequence[tuple[float, DriveCycle]] = ()
) -> Axes:
    """Plot the time-space diagram: speed over time and road, with trajectories over it.

    Parameters
    ----------
    field : TrafficField
    ax : matplotlib Axes, optional
        Where to draw; a new figure's if absent. The bar of colours goes beside it.
    cycles : sequence of (float, DriveCycle), optional
        Departures in the traffic's time, in seconds, and cycles from the start of the road on.
    """
    ax = _axes(ax, 7.5, 3.6)
    every = max(field.time_s.size // 800, 1)
    picture = ax.imshow(
        KMH_PER_MPS * field.speed_mps[::every].T,
        origin="lower",
        aspect="auto",
        cmap="RdYlGn",
        vmin=0.0,
        extent=(field.time_s[0], field.time_s[-1], 0.0, field.road.length_m / 1e3),
        interpolation="nearest",
    )
    for depart_s, cycle in cycles:
        ax.plot(depart_s + cycle.time_s, cycle.position_m / 1e3, color=_TRUE, linewidth=1.0)
    ax.set(xlabel="time [s]", ylabel="position [km]", ylim=(0.0, field.road.length_m / 1e3))
    ax.figure.colorbar(picture, ax=ax, label="speed [km/h]")
    return ax


def plot_fan(spread: Spread, place: int, ax: Axes | None = None) -> Axes:
    """Plot mean and quantiles over time at one of the places that a spread was kept at.

    Parameters
    ----------
    spread : Spread
        Of the speed; the band goes from its first quantile to its last.
    place : int
        Number of the place, from 0.
    ax : matplotlib Axes, optional
        Where to draw; a new figure's if absent.
    """
    ax = _axes(ax)
    low, high = (KMH_PER_MPS * spread.quantiles[at, :, place] for at in (0, -1))
    levels = spread.quantile_levels
    ax.fill_between(
        spread.time_s, low, high, color=_BAND, linewidth=0.0, label=f"{levels[0]:.0%} to {levels[-1]:.0%}"
    )
    ax.plot(spread.time_s, KMH_PER_MPS * spread.mean[:, place], color="tab:blue", linewidth=1.2, label="mean")
    ax.set(
        title=f"{spread.position_m[place] / 1e3:.4g} km",
        xlabel="time [s]",
        ylabel="speed [km/h]",
        xlim=(spread.time_s[0], spread.time_s[-1]),
    )
    ax.legend(frameon=False)
    return ax


def plot_errors(curves: Mapping[str, tuple[Array, Array]], ax: Axes | None = None) -> Axes:
    """Plot errors of a mean against model runs, on logarithmic axes.

    Parameters
    ----------
    curves : mapping of str to (ndarray, ndarray)
        Runs and errors in km/h, by method.
    ax : matplotlib Axes, optional
        Where to draw; a new figure's if absent.
    """
    ax = _axes(ax, 5.5, 4.0)
    for method, (runs, errors) in curves.items():
        ax.plot(runs, np.maximum(errors, 1e-12), marker="o", markersize=4.0, linewidth=1.2, label=method)
    ax.set(xlabel="model runs", ylabel="error of the mean [km/h]", xscale="log", yscale="log")
    ax.legend(frameon=False)
    return ax


def plot_parameter(
    estimate: TrafficEstimate, name: str, truth: float | None = None, ax: Axes | None = None
) -> Axes:
    """Plot the estimate of a parameter over time, with twice its standard deviation.

    Parameters
    ----------
    estimate : TrafficEstimate
    name : str
        One of its parameters.
    truth : float, optional
        Its true value, in SI units.
    ax : matplotlib Axes, optional
        Where to draw; a new figure's if absent.
    """
    ax = _axes(ax)
    column = estimate.names.index(name)
    label, scale = SHOWN.get(name, (name, 1.0))
    mean, reach = scale * estimate.mean[:, column], _TWO_SIGMA * scale * estimate.sd[:, column]
    ax.fill_between(estimate.time_s, mean - reach, mean + reach, color=_BAND, linewidth=0.0, label="± 2 sd")
    ax.plot(estimate.time_s, mean, color="tab:blue", linewidth=1.2, label="estimate")
    if truth is not None:
        ax.axhline(scale * truth, color=_TRUE, linewidth=0.9, linestyle="--", label="true")
    ax.set(xlabel="time [s]", ylabel=label)
    ax.legend(frameon=False)
    return ax


def plot_state(
    estimate: TrafficEstimate,
    at: int = -1,
    readings: tuple[Sequence[float], Array] | None = None,
    truth: TrafficField | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Plot the estimated speed along the road at one time, with what was read there and then.

    Parameters
    ----------
    estimate : TrafficEstimate
    at : int
        Number of the reading.
    readings : tuple of positions and speeds, optional
        In m and m/s, at that time.
    truth : TrafficField, optional
        The true traffic.
    ax : matplotlib Axes, optional
        Where to draw; a new figure's if absent.
    """
    ax = _axes(ax)
    place, mean = estimate.position_m / 1e3, KMH_PER_MPS * estimate.speed_mps[at]
    reach = _TWO_SIGMA * KMH_PER_MPS * estimate.speed_sd_mps[at]
    ax.fill_between(place, mean - reach, mean + reach, color=_BAND, linewidth=0.0, label="± 2 sd")
    ax.plot(place, mean, color="tab:blue", linewidth=1.2, label="estimate")
    if truth is not None:
        speed = truth.at(estimate.time_s[at])
        ax.plot(place, KMH_PER_MPS * speed, color=_TRUE, linewidth=0.9, linestyle="--", label="true")
    if readings is not None:
        where, read = np.asarray(readings[0]) / 1e3, KMH_PER_MPS * np.asarray(readings[1])
        ax.plot(where, read, "o", color="tab:orange", markersize=4.0, label="read")
    ax.set(title=f"{estimate.time_s[at]:.0f} s", xlabel="position [km]", ylabel="speed [km/h]")
    ax.legend(frameon=False)
    return ax


def plot_cycles(planned: DriveCycle, members: Sequence[DriveCycle], ax: Axes | None = None) -> Axes:
    """Plot the cycles of an ensemble over the road, and the planned one.

    Parameters
    ----------
    planned : DriveCycle
    members : sequence of DriveCycle
    ax : matplotlib Axes, optional
        Where to draw; a new figure's if absent.
    """
    ax = _axes(ax, 8.0, 3.4)
    for number, cycle in enumerate(members):
        label = f"{len(members)} cycles" if number == 0 else None
        ax.plot(
            cycle.position_m / 1e3, KMH_PER_MPS * cycle.speed_mps, color="#8FAADC", linewidth=0.6, label=label
        )
    ax.plot(
        planned.position_m / 1e3, KMH_PER_MPS * planned.speed_mps, color=_TRUE, linewidth=1.4, label="planned"
    )
    ax.set(xlabel="position [km]", ylabel="speed [km/h]", ylim=(0.0, None))
    ax.legend(frameon=False)
    return ax

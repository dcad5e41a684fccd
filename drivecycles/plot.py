"""Draw a cycle: speed over time, and the road under it."""

from typing import TYPE_CHECKING

import numpy as np

from drivecycles.cycle import DriveCycle

if TYPE_CHECKING:
    from matplotlib.axes import Axes

KMH_PER_MPS = 3.6


def plot_cycle(cycle: DriveCycle, ax: "Axes | None" = None) -> "Axes":
    """Plot speed in km/h over time, and altitude on a second axis where the road is not level.

    Parameters
    ----------
    cycle : DriveCycle
        What to draw; time counts from its first sample.
    ax : matplotlib Axes, optional
        Where to draw; a new figure's if absent. No window is opened.

    Returns
    -------
    matplotlib Axes
        The axes of the speed; the altitude's are its twin.
    """
    if ax is None:
        from matplotlib.figure import Figure

        ax = Figure(figsize=(9.0, 3.2), layout="constrained").add_subplot()
    time_s = cycle.time_s - cycle.time_s[0]
    ax.plot(time_s, KMH_PER_MPS * cycle.speed_mps, color="tab:blue", linewidth=1.0)
    ax.set(
        title=cycle.name,
        xlabel="time [s]",
        ylabel="speed [km/h]",
        xlim=(0.0, cycle.duration_s),
        ylim=(0.0, None),
    )
    if np.ptp(cycle.altitude_m) > 0:
        twin = ax.twinx()
        twin.plot(time_s, cycle.altitude_m, color="tab:brown", linewidth=1.0, linestyle="--")
        twin.set_ylabel("altitude [m]", color="tab:brown")
        twin.tick_params(axis="y", colors="tab:brown")
        ax.yaxis.label.set_color("tab:blue")
    return ax

"""Pictures of the maps: fuel consumption of the engine, efficiency of the motor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vehicle.engine import Engine
from vehicle.motor import Motor

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_RPM_PER_RADPS = 30.0 / np.pi
_BSFC_LEVELS_gpkWh = (205, 210, 215, 220, 230, 240, 260, 280, 320, 400, 500)
_EFFICIENCY_LEVELS = (0.7, 0.8, 0.85, 0.88, 0.9, 0.92, 0.94, 0.95, 0.96)
_GRID_POINTS = 161


def plot_engine_map(engine: Engine, ax: Axes | None = None) -> Axes:
    """Draw contours of brake specific fuel consumption below the torque limit.

    Parameters
    ----------
    engine : Engine
        Its map and limit are drawn.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        Speed in rpm, torque in Nm, contours in g/kWh.
    """
    ax = ax or _new_axes()
    limit = np.linspace(engine.idle_speed_radps, engine.max_speed_radps, _GRID_POINTS)
    most = engine.max_torque_Nm(limit)
    speed, torque = np.meshgrid(limit, np.linspace(0.02, 1.0, _GRID_POINTS) * most.max())
    consumption_gpkWh = 3.6e9 * engine.fuel_kgps(speed, torque) / (speed * torque)
    inside = np.ma.masked_where(torque > engine.max_torque_Nm(speed), consumption_gpkWh)
    lines = ax.contour(speed * _RPM_PER_RADPS, torque, inside, levels=_BSFC_LEVELS_gpkWh, cmap="viridis_r")
    ax.clabel(lines, fmt="%g")
    ax.plot(limit * _RPM_PER_RADPS, most, color="black", label="limit")
    ax.set(xlabel="speed [rpm]", ylabel="torque [Nm]", title="engine, g/kWh")
    ax.legend(loc="lower right")
    return ax


def plot_motor_map(motor: Motor, ax: Axes | None = None) -> Axes:
    """Draw contours of the motor's efficiency, converter excluded, driving and generating.

    Parameters
    ----------
    motor : Motor
        Its map and limits are drawn.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        Speed in rpm, torque in Nm, contours without unit.
    """
    ax = ax or _new_axes()
    limit = np.linspace(0.0, motor.max_speed_radps, _GRID_POINTS)
    most, least = motor.max_torque_Nm(limit), motor.min_torque_Nm(limit)
    speed, torque = np.meshgrid(limit[1:], np.linspace(least.min(), most.max(), 2 * _GRID_POINTS))
    shaft = speed * torque
    terminal = shaft + motor.loss_map(speed, torque)
    generating = np.divide(terminal, shaft, out=np.zeros_like(shaft), where=shaft < 0.0)
    efficiency = np.where(shaft > 0.0, shaft / np.where(shaft > 0.0, terminal, 1.0), generating)
    outside = (torque > motor.max_torque_Nm(speed)) | (torque < motor.min_torque_Nm(speed))
    inside = np.ma.masked_where(outside, efficiency)
    lines = ax.contour(speed * _RPM_PER_RADPS, torque, inside, levels=_EFFICIENCY_LEVELS, cmap="viridis")
    ax.clabel(lines, fmt="%g")
    ax.plot(limit * _RPM_PER_RADPS, most, color="black", label="limits")
    ax.plot(limit * _RPM_PER_RADPS, least, color="black")
    ax.set(xlabel="speed [rpm]", ylabel="torque [Nm]", title="motor efficiency")
    ax.legend(loc="upper right")
    return ax


def _new_axes() -> Axes:
    from matplotlib.figure import Figure

    return Figure(layout="constrained").subplots()

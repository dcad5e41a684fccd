"""Pictures of the maps."""

import subprocess
import sys

import numpy as np
import pytest

from vehicle import load_vehicle
from vehicle.plot import plot_engine_map, plot_motor_map


def test_importing_vehicle_leaves_matplotlib_out():
    code = "import sys, vehicle, vehicle.plot; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_engine_map_shows_limit_and_contours(tmp_path):
    engine = load_vehicle("hev").engine
    ax = plot_engine_map(engine)
    speed, torque = ax.lines[0].get_data()
    assert np.asarray(torque).max() == pytest.approx(engine.limit_torque_Nm.max(), rel=1e-3)
    assert np.asarray(speed).max() == pytest.approx(630.0 * 30.0 / np.pi)
    assert ax.get_xlabel() == "speed [rpm]"
    assert ax.get_ylabel() == "torque [Nm]"
    ax.figure.savefig(tmp_path / "engine.png")


def test_motor_map_draws_into_the_given_axes():
    from matplotlib.figure import Figure

    ax = Figure().subplots()
    assert plot_motor_map(load_vehicle("hev").motor, ax) is ax
    assert len(ax.lines) == 2
    assert len(ax.collections) == 1

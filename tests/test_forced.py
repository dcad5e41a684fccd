"""The SOC grid reaches where a descent alone carries the battery."""

import numpy as np
import pytest
from ems_cases import full_problem

from bms import load_pack
from drivecycles import DriveCycle
from ems import GridSettings, build_policy, build_problem, load_concept
from ems.forced import forced_rise


def test_the_rise_is_the_largest_over_any_part_of_the_trip():
    pack = load_pack("hev")
    per_step_W = 0.01 * float(np.asarray(pack.ocv(np.array([0.6])))[0]) * pack.capacity_C
    least = np.array([2.0, -5.0, 3.0, 4.0, -1.0, 2.0, -9.0, 1.0])
    power_W = per_step_W * np.stack([least, least + 1.0], axis=1)
    assert forced_rise(power_W, pack, 0.6, 1.0) == pytest.approx(0.08)
    assert forced_rise(power_W, pack, 0.6, 2.0) == pytest.approx(0.16)
    assert forced_rise(-np.abs(power_W), pack, 0.6, 1.0) == 0.0


@pytest.mark.parametrize("name", ["hev", "phev"])
def test_an_ordinary_road_leaves_the_grid_as_it_is_set(name):
    assert full_problem(name).settings == GridSettings()


def descent(height_m):
    """Ten minutes at 54 km/h, the second half downhill."""
    time_s = np.arange(601.0)
    speed_mps = np.clip(np.minimum(time_s, 600.0 - time_s) / 2.0, 0.0, 15.0)
    way_m = np.concatenate(([0.0], np.cumsum(0.5 * (speed_mps[1:] + speed_mps[:-1]))))
    altitude_m = np.interp(way_m, [0.0, 4300.0, way_m[-1]], [600.0, 600.0, 600.0 - height_m])
    return DriveCycle("descent", time_s, speed_mps, altitude_m=altitude_m)


def test_a_descent_widens_it_and_the_stochastic_policy_coasts_down():
    problem = build_problem(load_concept("hev"), descent(200.0))
    assert problem.settings.soc_margin > 0.3
    policy = build_policy("stochastic", problem)
    nodes = policy.solution.soc
    assert nodes[-1] == 1.0
    # Beyond the window the cost-to-go goes on to rise, so nothing is gained by going further.
    before = policy.solution.cost_to_go.stage(300)[0, 0]
    assert np.all(np.diff(before[nodes > problem.concept.window.high]) > 0.0)
    wider = build_policy(
        "stochastic",
        build_problem(load_concept("hev"), descent(200.0), settings=GridSettings(soc_margin=0.9)),
    )
    assert policy.value_kg == pytest.approx(wider.value_kg, rel=2e-3)

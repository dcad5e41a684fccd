"""Inverse simulation against closed forms."""

import math

import numpy as np
import pytest

from drivecycles import DriveCycle
from vehicle import Chassis, VehicleError, load_vehicle

CHASSIS = Chassis(mass_kg=1500.0, drag_area_m2=0.66, rolling_resistance=0.012, wheel_radius_m=0.3)
FRICTIONLESS = Chassis(mass_kg=1000.0, drag_area_m2=0.0, rolling_resistance=0.0, wheel_radius_m=0.25)


def test_coasting_demands_no_torque():
    rolling = CHASSIS.rolling_resistance * CHASSIS.gravity_mps2
    drag = 0.5 * CHASSIS.air_density_kgpm3 * CHASSIS.drag_area_m2 / CHASSIS.mass_kg
    time = np.arange(0.0, 60.0, 0.1)
    root = math.sqrt(rolling * drag)
    # v' = -rolling - drag v^2, from 30 m/s
    speed = math.sqrt(rolling / drag) * np.tan(math.atan(30.0 * math.sqrt(drag / rolling)) - root * time)
    _, _, _, torque = CHASSIS.wheel_demand(DriveCycle("coast", time, speed))
    assert np.abs(torque).max() < 1e-3


def test_constant_speed_climb_by_hand():
    time = np.arange(11.0)
    cycle = DriveCycle("climb", time, np.full(11, 20.0), 0.05 * 20.0 * time)
    step_s, speed, acceleration, torque = CHASSIS.wheel_demand(cycle)
    force = 0.6 * 0.66 * 400.0 + 1500.0 * 9.81 * (0.05 + 0.012 * math.sqrt(1 - 0.0025))
    assert step_s == 1.0
    np.testing.assert_array_equal(speed, 20.0)
    np.testing.assert_array_equal(acceleration, 0.0)
    np.testing.assert_allclose(torque, 0.3 * force, rtol=1e-12)


def test_work_without_friction_is_kinetic_and_potential_energy():
    time = np.arange(0.0, 30.5, 0.5)
    speed = 20.0 * np.sin(time / 30.0 * 1.2) ** 2
    altitude = 15.0 * (time / 30.0) ** 3
    step_s, mean, _, torque = FRICTIONLESS.wheel_demand(DriveCycle("hill", time, speed, altitude))
    work = np.sum(torque / 0.25 * mean) * step_s
    # the altitude of the first steps changes a little while the speed is near zero
    stored = 0.5 * 1000.0 * speed[-1] ** 2 + 1000.0 * 9.81 * 15.0
    assert work == pytest.approx(stored, rel=1e-9)


def test_rotating_parts_add_inertia_only():
    time = np.arange(4.0)
    cycle = DriveCycle("go", time, 2.0 * time)
    heavier = FRICTIONLESS.model_copy(update={"rotating_mass_factor": 1.1})
    _, _, _, torque = heavier.wheel_demand(cycle)
    np.testing.assert_allclose(torque, 0.25 * 1.1 * 1000.0 * 2.0)


def test_standing_demands_nothing_and_starting_does():
    demand = load_vehicle("hev").demand(DriveCycle("stop", np.arange(5.0), [0.0, 0.0, 2.0, 0.0, 0.0]))
    assert demand.wheel_torque_Nm[0] == demand.wheel_torque_Nm[3] == 0.0
    assert demand.speed_mps.tolist() == [0.0, 1.0, 1.0, 0.0]
    assert demand.wheel_torque_Nm[1] == pytest.approx(0.3 * (3000.0 + 0.012 * 1500 * 9.81 + 0.6 * 0.66))
    assert demand.wheel_torque_Nm[2] == pytest.approx(0.3 * (-3000.0 + 0.012 * 1500 * 9.81 + 0.6 * 0.66))
    assert demand.wheel_speed_radps[1] == pytest.approx(1.0 / 0.3)
    assert demand.distance_m == pytest.approx(2.0)
    assert demand.time_s.tolist() == [0.0, 1.0, 2.0, 3.0]


def test_demand_is_read_only():
    demand = load_vehicle("hev").demand(DriveCycle("go", np.arange(3.0), [0.0, 1.0, 2.0]))
    with pytest.raises(ValueError, match="read-only"):
        demand.wheel_torque_Nm[0] = 1.0


def test_uneven_time_says_resample():
    cycle = DriveCycle("log", [0.0, 1.0, 2.0, 4.0], [0.0, 1.0, 2.0, 3.0])
    with pytest.raises(VehicleError, match=r"'log'.*t = 0 s is 1 s.*resample\(1.0\)"):
        CHASSIS.wheel_demand(cycle)


@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_a_jump_in_altitude_is_refused(speed):
    cycle = DriveCycle("cliff", np.arange(4.0), np.full(4, speed), [0.0, 0.0, 3.0, 3.0])
    with pytest.raises(VehicleError, match=r"changes by 3 m over .* at t = 1 s"):
        CHASSIS.wheel_demand(cycle)


def test_too_fast_for_the_motor():
    cycle = DriveCycle("race", np.arange(3.0), [50.0, 60.0, 70.0])
    with pytest.raises(VehicleError, match=r"65\.0 m/s at t = 1 s.*allows 57\.1 m/s"):
        load_vehicle("hev").demand(cycle)

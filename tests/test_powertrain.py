"""The torque split by hand, on a vehicle with round numbers."""

import math

import numpy as np
import pytest

from drivecycles import DriveCycle
from vehicle import Chassis, Demand, Engine, Gearbox, Motor, Vehicle, VehicleError
from vehicle.maps import SpeedTorqueMap

LHV = 40e6
IDLE_KGPS = 1e-4
LOSS_W = 300.0
ENGINE_SPEED, ENGINE_TORQUE = np.array([50.0, 600.0]), np.array([0.0, 100.0])
MOTOR_SPEED, MOTOR_TORQUE = np.array([0.0, 1000.0]), np.array([-80.0, 80.0])


def fuel(speed, torque):
    # A bilinear function, so that interpolation is exact: 25 % efficiency on top of 10 Nm of friction.
    return speed * (torque + 10.0) / (0.25 * LHV)


VEHICLE = Vehicle(
    name="round",
    chassis=Chassis(mass_kg=1000.0, drag_area_m2=0.0, rolling_resistance=0.0, wheel_radius_m=0.5),
    gearbox=Gearbox(
        ratios=(4.0, 2.0),
        efficiency=0.9,
        final_drive_ratio=5.0,
        final_drive_efficiency=0.8,
        upshift_mps=(10.0,),
        downshift_mps=(8.0,),
    ),
    engine=Engine(
        fuel_map=SpeedTorqueMap(
            "fuel", ENGINE_SPEED, ENGINE_TORQUE, fuel(ENGINE_SPEED[:, None], ENGINE_TORQUE)
        ),
        limit_speed_radps=ENGINE_SPEED,
        limit_torque_Nm=np.array([100.0, 100.0]),
        idle_speed_radps=100.0,
        idle_fuel_kgps=IDLE_KGPS,
        lower_heating_value_Jpkg=LHV,
        fuel_density_kgpl=0.75,
    ),
    motor=Motor(
        loss_map=SpeedTorqueMap("loss", MOTOR_SPEED, MOTOR_TORQUE, np.full((2, 2), LOSS_W)),
        limit_speed_radps=MOTOR_SPEED,
        max_torque_Nm_at=np.array([80.0, 80.0]),
        min_torque_Nm_at=np.array([-60.0, -60.0]),
        converter_efficiency=0.9,
    ),
    auxiliary_W=100.0,
)


def demand(wheel_torque_Nm, wheel_speed_radps=20.0, gear=1):
    torque = np.atleast_1d(np.asarray(wheel_torque_Nm, dtype=float))
    speed = np.full(torque.shape, wheel_speed_radps)
    return Demand(
        time_s=np.arange(torque.size, dtype=float),
        step_s=1.0,
        speed_mps=0.5 * speed,
        acceleration_mps2=np.zeros_like(speed),
        wheel_torque_Nm=torque,
        wheel_speed_radps=speed,
        gear=np.full(torque.shape, gear),
    )


def test_shape_and_columns():
    table = VEHICLE.controls(demand([100.0, 50.0]), levels=4)
    for array in (
        table.fuel_kgps,
        table.battery_power_W,
        table.brake_W,
        table.shortfall_W,
        table.motor_torque_Nm,
    ):
        assert array.shape == (2, 7)
    np.testing.assert_allclose(table.engine_torque_Nm[:, :6], [[0, 0, 25, 50, 75, 100]] * 2)
    assert table.engine_on.tolist() == [False] + [True] * 6
    assert table.clutch_can_close.all()


def test_motor_alone_driving():
    table = VEHICLE.controls(demand(200.0))
    # 200 Nm / (5 * 0.8) = 50 Nm at 100 rad/s, 300 W of loss, 0.9 in the converter, 100 W of auxiliaries
    assert table.motor_torque_Nm[0, 0] == pytest.approx(50.0)
    assert table.battery_power_W[0, 0] == pytest.approx(-((5000.0 + 300.0) / 0.9 + 100.0))
    assert table.fuel_kgps[0, 0] == 0.0


def test_regeneration():
    table = VEHICLE.controls(demand(-250.0))
    # -250 Nm * 0.8 / 5 = -40 Nm at 100 rad/s
    assert table.motor_torque_Nm[0, 0] == pytest.approx(-40.0)
    assert table.battery_power_W[0, 0] == pytest.approx((4000.0 - 300.0) * 0.9 - 100.0)
    assert table.brake_W[0, 0] == 0.0


def test_braking_beyond_the_generator_uses_the_brakes():
    table = VEHICLE.controls(demand(-500.0))
    # the generator's 60 Nm hold back 60 * 5 / 0.8 = 375 Nm at the wheels
    assert table.motor_torque_Nm[0, 0] == -60.0
    assert table.brake_W[0, 0] == pytest.approx(125.0 * 20.0)
    assert table.shortfall_W[0, 0] == 0.0


def test_beyond_the_motor_is_a_shortfall():
    table = VEHICLE.controls(demand(400.0), levels=1)
    # 80 Nm give 320 Nm at the wheels; with 100 Nm * 2 * 0.9 from the engine there is enough
    assert table.shortfall_W[0, 0] == pytest.approx(80.0 * 20.0)
    assert table.shortfall_W[0, 2] == 0.0
    assert table.motor_torque_Nm[0, 2] == pytest.approx(100.0 - 180.0 + 20.0)


def test_engine_that_gives_too_much_meets_generator_and_brakes():
    table = VEHICLE.controls(demand(0.0), levels=1)
    # 180 Nm from the gearbox, 60 Nm into the generator, 120 Nm * 5 * 0.8 at the brakes
    assert table.motor_torque_Nm[0, 2] == -60.0
    assert table.brake_W[0, 2] == pytest.approx(480.0 * 20.0)


def test_engine_alone_leaves_the_motor_without_torque():
    table = VEHICLE.controls(demand(360.0), levels=3)
    assert table.engine_torque_Nm[0, -1] == pytest.approx(50.0)
    assert table.motor_torque_Nm[0, -1] == pytest.approx(0.0, abs=1e-12)
    assert table.fuel_kgps[0, -1] == pytest.approx(fuel(200.0, 50.0))
    assert table.battery_power_W[0, -1] == pytest.approx(-(300.0 / 0.9 + 100.0))


def test_engine_alone_is_clipped_to_what_the_engine_gives():
    table = VEHICLE.controls(demand([-100.0, 900.0]), levels=3)
    np.testing.assert_allclose(table.engine_torque_Nm[:, -1], [0.0, 100.0])


def test_idling_burns_fuel_and_moves_nothing():
    table = VEHICLE.controls(demand(200.0))
    assert table.fuel_kgps[0, 1] == IDLE_KGPS
    assert table.engine_torque_Nm[0, 1] == 0.0
    assert table.battery_power_W[0, 1] == table.battery_power_W[0, 0]


@pytest.mark.parametrize(
    ("wheel_speed", "gear", "closes"),
    [(0.0, 0, False), (4.9, 0, False), (5.1, 0, True), (9.9, 1, False), (29.9, 0, True), (30.1, 0, False)],
)
def test_the_clutch_closes_between_idle_and_greatest_speed(wheel_speed, gear, closes):
    table = VEHICLE.controls(demand(0.0, wheel_speed, gear), levels=2)
    assert table.clutch_can_close.tolist() == [closes]
    for array in (table.fuel_kgps, table.battery_power_W, table.engine_torque_Nm, table.motor_torque_Nm):
        assert (array[0, 2:] == array[0, 1]).all() == (not closes)


def test_standing_draws_losses_and_auxiliaries():
    cycle = DriveCycle("stand", np.arange(3.0), np.zeros(3))
    table = VEHICLE.controls(VEHICLE.demand(cycle))
    np.testing.assert_allclose(table.battery_power_W, -(300.0 / 0.9 + 100.0))
    assert (table.motor_torque_Nm == 0.0).all()


def test_battery_limits_trim_the_motor():
    both = VEHICLE.controls(
        demand([200.0, -250.0]), battery_discharge_limit_W=3100.0, battery_charge_limit_W=800.0
    )
    # discharging: (T w + 300) / 0.9 + 100 = 3100; charging: (-T w - 300) * 0.9 - 100 = 800
    np.testing.assert_allclose(both.motor_torque_Nm[:, 0], [24.0, -13.0])
    np.testing.assert_allclose(both.battery_power_W[:, 0], [-3100.0, 800.0])
    assert both.shortfall_W[0, 0] == pytest.approx((200.0 - 24.0 * 4.0) * 20.0)
    assert both.brake_W[1, 0] == pytest.approx((250.0 - 13.0 * 5.0 / 0.8) * 20.0)


def test_a_battery_without_power_leaves_the_motor_without_torque():
    table = VEHICLE.controls(demand(200.0), battery_discharge_limit_W=0.0)
    assert table.motor_torque_Nm[0, 0] == pytest.approx(0.0, abs=1e-9)
    assert table.shortfall_W[0, 0] == pytest.approx(4000.0)


def test_shortfall_reports_time_demand_and_limit():
    steps = demand([300.0, 1100.0, 0.0, 1200.0])
    # engine and motor together: (100 * 2 * 0.9 + 80) * 5 * 0.8 = 1040 Nm at 20 rad/s
    found = VEHICLE.shortfall(steps)
    assert [record.time_s for record in found] == [1.0, 3.0]
    assert [record.demand_W for record in found] == pytest.approx([22000.0, 24000.0])
    assert [record.limit_W for record in found] == pytest.approx([20800.0, 20800.0])
    expected = "at t = 3 s the cycle demands 24.0 kW at the wheels, this powertrain can give 20.8 kW"
    assert found[1].message() == expected


def test_a_weaker_battery_can_give_less():
    # (24 + 180) Nm * 5 * 0.8 = 816 Nm
    (found,) = VEHICLE.shortfall(demand([800.0, 830.0]), battery_discharge_limit_W=3100.0)
    assert (found.time_s, found.limit_W) == (1.0, pytest.approx(816.0 * 20.0))


def test_fuel_consumption():
    assert VEHICLE.fuel_l_per_100km(0.75, 50e3) == pytest.approx(2.0)
    with pytest.raises(VehicleError, match="needs a distance above 0, got 0 m"):
        VEHICLE.fuel_l_per_100km(0.75, 0.0)


@pytest.mark.parametrize("bad", [-1.0, math.nan])
def test_bad_arguments(bad):
    with pytest.raises(VehicleError, match="levels is 0, expected at least 1"):
        VEHICLE.controls(demand(0.0), levels=0)
    with pytest.raises(VehicleError, match=r"battery_discharge_limit_W is .*, expected a power >= 0 W"):
        VEHICLE.controls(demand(0.0), battery_discharge_limit_W=bad)

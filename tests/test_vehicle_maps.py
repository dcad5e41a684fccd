"""Interpolation, and reading maps from CSV."""

import dataclasses
import math

import numpy as np
import pytest

from vehicle import VehicleError, load_vehicle
from vehicle.maps import SpeedTorqueMap, read_map
from vehicle.tables import FUEL_RATE, LOSS

SPEED = np.array([0.0, 10.0, 15.0, 40.0])
TORQUE = np.array([-3.0, 0.0, 7.0])


def bilinear(speed, torque):
    return 50.0 + 2.0 * speed + 3.0 * torque + 0.25 * speed * torque


def grid(values=bilinear):
    return SpeedTorqueMap("demo", SPEED, TORQUE, values(SPEED[:, None], TORQUE[None, :]))


def test_exact_on_a_bilinear_function():
    rng = np.random.default_rng(1)
    speed, torque = rng.uniform(0.0, 40.0, (50, 1)), rng.uniform(-3.0, 7.0, (50, 6))
    np.testing.assert_allclose(grid()(speed, torque), bilinear(speed, torque), rtol=1e-13)


def test_exact_at_the_grid_points_and_corners():
    demo = grid(lambda w, t: np.abs(np.sin(w + 3.0 * t)))
    np.testing.assert_allclose(demo(SPEED[:, None], TORQUE[None, :]), demo.values, rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize(
    ("speed", "torque"), [(41.0, 0.0), (-0.1, 0.0), (5.0, 7.1), (5.0, -4.0), (math.nan, 0.0)]
)
def test_never_extrapolates(speed, torque):
    with pytest.raises(VehicleError, match=r"demo: .* lies outside the map, which covers"):
        grid()(np.array([5.0, speed]), np.array([1.0, torque]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"speed_radps": np.array([0.0, 10.0, 10.0, 40.0])},
            "speed_radps must be finite and strictly increasing",
        ),
        ({"torque_Nm": np.array([0.0])}, "torque_Nm needs at least two grid points"),
        ({"values": np.zeros((3, 3))}, r"shape \(3, 3\), the axes ask for \(4, 3\)"),
        ({"values": np.full((4, 3), math.nan)}, "expected a finite number >= 0"),
        ({"values": np.full((4, 3), -1.0)}, "at 0 rad/s and -3 Nm is -1"),
    ],
)
def test_bad_arrays(change, message):
    with pytest.raises(VehicleError, match=message):
        dataclasses.replace(grid(), **change)


def test_csv_in_any_order_and_in_other_units(tmp_path):
    rows = [f"{w},{t},{w * t / 10}" for t in (10, 0) for w in (600, 0, 1200)]
    path = tmp_path / "map.csv"
    path.write_text("# a comment\nspeed_rpm,torque_Nm,fuel_gps\n" + "\n".join(rows), encoding="utf-8-sig")
    read = read_map(path, FUEL_RATE)
    np.testing.assert_allclose(read.speed_radps, np.array([0.0, 20.0, 40.0]) * math.pi)
    np.testing.assert_array_equal(read.torque_Nm, [0.0, 10.0])
    np.testing.assert_allclose(read.values, [[0.0, 0.0], [0.0, 0.6], [0.0, 1.2]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected a header and at least one row"),
        (
            "speed,torque_Nm,loss_W\n0,0,0\n",
            "no column speed_radps or speed_rpm among speed, torque_Nm, loss_W",
        ),
        ("speed_rpm,torque_Nm,loss_W\n# note\n0,0,\n", "line 3: loss_W is '', expected a finite number"),
        ("speed_rpm,torque_Nm,loss_W\n0,0\n", "line 2: loss_W is ''"),
        (
            "speed_rpm,torque_Nm,loss_W\n0,0,0,05\n",
            "line 2: there are 4 values under 3 names; write decimals with a point",
        ),
        ("speed_rpm,torque_Nm,loss_W,\n# note\n0,0,,5\n", "line 3: there are 4 values under 3 names"),
        ("speed_rpm,torque_Nm,loss_W\n0,nan,1\n", "line 2: torque_Nm is 'nan'"),
        ("speed_rpm,torque_Nm,loss_W\n0,0,1\n0,1,1\n9,0,1\n", "9.* rad/s, 1 Nm occurs 0 times"),
        ("speed_rpm,torque_Nm,loss_W\n0,0,1\n0,0,1\n", "0 rad/s, 0 Nm occurs 2 times"),
    ],
)
def test_bad_csv(tmp_path, text, message):
    path = tmp_path / "map.csv"
    path.write_text(text)
    with pytest.raises(VehicleError, match=message):
        read_map(path, LOSS)


def test_empty_cells_at_the_end_are_no_values(tmp_path):
    rows = [f"{w},{t},1,, " for w in (0, 9) for t in (0, 1)]
    path = tmp_path / "map.csv"
    path.write_text("speed_radps,torque_Nm,loss_W\n" + "\n".join(rows))
    np.testing.assert_array_equal(read_map(path, LOSS).values, np.ones((2, 2)))


def test_missing_csv(tmp_path):
    with pytest.raises(VehicleError, match=r"cannot read the table .*nowhere\.csv"):
        read_map(tmp_path / "nowhere.csv", LOSS)


def test_engine_refuses_inconsistent_data():
    engine = load_vehicle("hev").engine
    with pytest.raises(VehicleError, match="idle_speed_radps is 10"):
        dataclasses.replace(engine, idle_speed_radps=10.0)
    with pytest.raises(VehicleError, match=r"the limits need .* 0 to 300 Nm"):
        dataclasses.replace(engine, limit_speed_radps=[80.0, 500.0], limit_torque_Nm=[300.0, 300.0])
    with pytest.raises(VehicleError, match=r"less than the work; check the header's unit"):
        thrifty = dataclasses.replace(engine.fuel_map, values=0.3 * engine.fuel_map.values)
        dataclasses.replace(engine, fuel_map=thrifty)


def test_engine_refuses_fuel_in_the_wrong_unit():
    """Grams read as kilograms: the efficiency is a thousandth of the map's best at its grid points."""
    engine = load_vehicle("hev").engine
    with pytest.raises(
        VehicleError,
        match=r"efficiency is 0\.04 %, at .* expected 5 % or more: check the header's unit",
    ):
        dataclasses.replace(
            engine, fuel_map=dataclasses.replace(engine.fuel_map, values=1e3 * engine.fuel_map.values)
        )
    thirsty = dataclasses.replace(engine.fuel_map, values=7.0 * engine.fuel_map.values)
    assert dataclasses.replace(engine, fuel_map=thirsty).fuel_map is thirsty


def test_an_engine_without_torque_has_no_efficiency():
    engine = load_vehicle("hev").engine
    none = dataclasses.replace(
        engine,
        fuel_map=dataclasses.replace(engine.fuel_map, values=1e3 * engine.fuel_map.values),
        limit_torque_Nm=np.zeros_like(engine.limit_torque_Nm),
    )
    assert none.max_power_W == 0.0


def test_motor_refuses_inconsistent_data():
    motor = load_vehicle("hev").motor
    with pytest.raises(VehicleError, match="min_torque_Nm <= 0 at every speed"):
        dataclasses.replace(motor, min_torque_Nm_at=-motor.min_torque_Nm_at)
    with pytest.raises(VehicleError, match="and the map must cover them"):
        dataclasses.replace(motor, max_torque_Nm_at=2.0 * motor.max_torque_Nm_at)

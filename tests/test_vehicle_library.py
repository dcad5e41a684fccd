"""Presets and vehicle files."""

import importlib.util
import shutil
from pathlib import Path

import numpy as np
import pytest

from vehicle import VehicleError, load_vehicle, vehicle_names

ROOT = Path(__file__).parents[1]
PRESETS = ROOT / "vehicle" / "presets"


@pytest.fixture
def folder(tmp_path):
    """A user's folder with a copy of the preset."""
    shutil.copytree(PRESETS, tmp_path / "mine")
    return tmp_path / "mine"


def edited(folder, old, new):
    text = (folder / "hev.toml").read_text()
    assert text.count(old) == 1
    path = folder / "car.toml"
    path.write_text(text.replace(old, new))
    return path


def maker():
    spec = importlib.util.spec_from_file_location("make_maps", ROOT / "tools" / "make_maps.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["hev", "phev"])
def test_presets_are_table_1(name):
    vehicle = load_vehicle(name)
    assert vehicle.name == name
    assert vehicle.chassis.mass_kg == 1500.0
    assert vehicle.chassis.drag_area_m2 == 0.66
    assert vehicle.chassis.rolling_resistance == 0.012
    assert vehicle.chassis.wheel_radius_m == 0.3
    assert vehicle.gearbox.ratios == (4.2, 2.5, 1.6, 1.1, 0.9)
    assert vehicle.gearbox.final_drive_ratio == 4.2
    assert vehicle.gearbox.efficiency == 0.97
    assert vehicle.gearbox.final_drive_efficiency == 0.95
    assert vehicle.motor.converter_efficiency == 0.95
    assert vehicle.engine.max_power_W == pytest.approx(50e3, rel=2e-3)
    assert vehicle.motor.max_power_W == pytest.approx(50e3, rel=2e-3)


def test_names_ignore_case_and_are_sorted():
    assert vehicle_names() == ("hev", "phev")
    assert load_vehicle("PHEV").name == "phev"


def test_preset_engine_is_like_a_hybrids():
    engine = load_vehicle("hev").engine
    speed, torque = np.meshgrid(np.linspace(85.0, 630.0, 110), np.linspace(1.0, 106.0, 106), indexing="ij")
    load = torque / engine.max_torque_Nm(speed)
    efficiency = np.where(load <= 1.0, engine.efficiency(speed, torque), 0.0)
    best = np.unravel_index(efficiency.argmax(), efficiency.shape)
    assert 0.39 < efficiency[best] < 0.405
    assert 0.6 < load[best] < 0.9
    assert 2000 < speed[best] * 30.0 / np.pi < 3500
    idle = engine.fuel_kgps(np.array(engine.idle_speed_radps), np.array(0.0))
    assert engine.idle_fuel_kgps == pytest.approx(float(idle), rel=0.02)


def test_preset_motor_peaks_at_96_percent_and_rests_without_loss():
    motor = load_vehicle("hev").motor
    speed, torque = np.meshgrid(np.linspace(10.0, 800.0, 80), np.linspace(2.0, 250.0, 125), indexing="ij")
    shaft = speed * torque
    efficiency = np.where(
        torque <= motor.max_torque_Nm(speed), shaft / (shaft + motor.loss_map(speed, torque)), 0
    )
    assert efficiency.max() == pytest.approx(0.96, abs=0.005)
    assert motor.electric_power_W(np.array(0.0), np.array(0.0)) == 0.0


def test_committed_maps_are_what_the_script_makes():
    made = maker().files()
    assert {path.name for path in (PRESETS / "maps").glob("*.csv")} == set(made)
    for name, text in made.items():
        assert (PRESETS / "maps" / name).read_text(encoding="utf-8") == text


def test_map_script_writes_its_files(tmp_path, capsys):
    module = maker()
    module.main(tmp_path / "maps")
    assert sorted(path.name for path in (tmp_path / "maps").iterdir()) == sorted(module.files())
    assert "engine_50kW_fuel.csv" in capsys.readouterr().out


def test_users_own_map_in_other_units(folder):
    lines = (folder / "maps" / "engine_50kW_fuel.csv").read_text().splitlines()[2:]
    cells = np.array([[float(x) for x in line.split(",")] for line in lines])
    cells[:, 0] *= 30.0 / np.pi
    cells[:, 2] *= 3.6
    text = "speed_rpm,torque_Nm,fuel_kgph\n" + "\n".join(",".join(map(repr, row)) for row in cells.tolist())
    (folder / "own.csv").write_text(text)
    own = load_vehicle(edited(folder, "maps/engine_50kW_fuel.csv", "own.csv")).engine
    preset = load_vehicle("hev").engine
    speed, torque = np.array([150.0, 333.0]), np.array([[10.0], [77.0]])
    np.testing.assert_allclose(own.fuel_kgps(speed, torque), preset.fuel_kgps(speed, torque), rtol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "mass_kg = 1500.0",
            "mass_kg = -3",
            r"chassis\.mass_kg = -3: .*greater than 0 \(Vehicle mass m, kg\)",
        ),
        ("mass_kg = 1500.0", "mass_kg = inf", r"chassis\.mass_kg = inf: .*finite"),
        ("mass_kg = 1500.0", "", r"the key chassis\.mass_kg is missing \(Vehicle mass m, kg\)"),
        (
            "mass_kg = 1500.0",
            "mass_kgs = 1500",
            r"unknown key chassis\.mass_kgs \(did you mean 'mass_kg'\?\)",
        ),
        ("auxiliary_W", "auxilary_w", r"unknown key auxilary_w \(did you mean 'auxiliary_W'\?\)"),
        ("efficiency = 0.97", "efficiency = 97", r"gearbox\.efficiency = 97: .*\(Gearbox efficiency, -\)"),
        ("[4.2, 2.5,", "[4.2, 4.3,", "gearbox: ratios must decrease from gear to gear"),
        ("[4.2, 2.5,", "[4.2, -1,", r"gearbox\.ratios\.1 = -1: .*greater than 0"),
        ("[chassis]", "[chassis", "is not valid TOML"),
        ("maps/engine_50kW_fuel.csv", "maps/none.csv", r"cannot read the table .*none\.csv"),
        ("idle_speed_radps = 85.0", "idle_speed_radps = 20.0", "idle_speed_radps is 20, it must lie within"),
    ],
)
def test_bad_vehicle_files(folder, old, new, message):
    with pytest.raises(VehicleError, match=message):
        load_vehicle(edited(folder, old, new))


def test_every_fault_is_listed(folder):
    path = edited(folder, "mass_kg = 1500.0", "mass_kg = 0\ncolour = 1")
    with pytest.raises(VehicleError) as caught:
        load_vehicle(path)
    assert [": unknown key" in line for line in str(caught.value).splitlines()] == [False, True]


def test_unknown_name_suggests():
    with pytest.raises(
        VehicleError, match=r"unknown vehicle 'pehv' \(did you mean 'phev'\?\); choose one of hev, phev"
    ):
        load_vehicle("pehv")


def test_missing_file(tmp_path):
    with pytest.raises(VehicleError, match=r"cannot read the vehicle file .*car\.toml"):
        load_vehicle(tmp_path / "car.toml")

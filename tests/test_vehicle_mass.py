"""A mass with a standard deviation: in a vehicle's file, in a concept, and as `--mass`."""

import json

import numpy as np
import pytest
from command_line import run, write_cycle

from drivecycles import DriveCycle
from ems.concept import load_concept, parse_concept
from ems.errors import EmsError
from socwise.commands.errors import CommandError
from socwise.commands.mass_option import mass_effects, mass_sentences, read_mass
from vehicle import VehicleError, load_vehicle
from vehicle.mass import mass_effect

STEADY = DriveCycle("steady", np.arange(101.0), np.full(101, 20.0))


def test_energy_of_a_steady_drive_changes_with_the_rolling_resistance():
    """On the level at constant speed the energy is distance times force, and dE/dm = f_r g d."""
    car = load_vehicle("hev").with_mass(1600.0, 40.0)
    found = mass_effect(car, STEADY)
    c = car.chassis
    rolling = c.rolling_resistance * c.gravity_mps2 * 2000.0
    air = 0.5 * c.air_density_kgpm3 * c.drag_area_m2 * 400.0 * 2000.0
    assert found.energy_sd_J == pytest.approx(40.0 * rolling, rel=1e-12)
    assert found.energy_J == pytest.approx(1600.0 * rolling + air, rel=1e-12)
    assert found.share == found.energy_sd_J / found.energy_J
    assert mass_effect(car.with_mass(1600.0), STEADY).energy_sd_J == 0.0


def test_a_cycle_that_stands_has_no_share():
    assert mass_effect(load_vehicle("hev"), DriveCycle("stand", np.arange(3.0), np.zeros(3))).share == 0.0


def test_a_vehicle_takes_another_mass_and_keeps_the_rest():
    car = load_vehicle("hev")
    other = car.with_mass(1873.0, 12.0)
    assert (other.chassis.mass_kg, other.chassis.mass_sd_kg) == (1873.0, 12.0)
    assert other.chassis.model_copy(update={"mass_kg": 1500.0, "mass_sd_kg": 0.0}) == car.chassis
    assert other.engine is car.engine
    for wrong in ((0.0, 1.0), (1500.0, -1.0), (np.nan, 0.0), (1500.0, np.inf)):
        with pytest.raises(VehicleError, match="must be above 0"):
            car.with_mass(*wrong)


def test_a_concept_gives_its_mass_to_its_vehicle():
    hev = load_concept("hev")
    assert hev.load_vehicle().chassis.mass_kg == 1500.0
    assert hev.with_mass(1700.0, 20.0).load_vehicle().chassis.mass_sd_kg == 20.0
    data = hev.model_dump(exclude_none=True)
    assert parse_concept(data | {"mass_kg": 1700.0}, "mine").mass_kg == 1700.0
    with pytest.raises(EmsError, match="mass_sd_kg belongs to mass_kg"):
        parse_concept(data | {"mass_sd_kg": 5.0}, "mine")


@pytest.fixture
def results(tmp_path, monkeypatch):
    """Write what `socwise inertia load-transfer` would, as far as the mass goes."""
    monkeypatch.chdir(tmp_path)

    def entry(model, method, value):
        return {"model": model, "method": method, "parameters": {"mass_kg": {"value": value, "sd": 9.0}}}

    rows = [entry("ltm", "gpc", 1800.0), entry("mltm", "gpc", 1810.0), entry("mltm", "ekf", 1820.0)]
    (tmp_path / "result.json").write_text(json.dumps({"estimates": rows}))
    (tmp_path / "ekf.json").write_text(json.dumps({"estimates": rows[2:]}))
    (tmp_path / "other.json").write_text("[1, 2]")
    write_cycle(tmp_path / "trip.csv")
    return tmp_path


@pytest.mark.parametrize(
    ("text", "mass"),
    [
        ("1873", (1873.0, 0.0)),
        ("1873,12", (1873.0, 12.0)),
        ("1.9e3, 5", (1900.0, 5.0)),
        ("result.json", (1810.0, 9.0)),
        ("result.json+320", (2130.0, 9.0)),
        (".", (1810.0, 9.0)),
    ],
)
def test_a_mass_is_a_number_or_what_was_estimated(results, text, mass):
    assert read_mass(text) == mass


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("heavy", "neither a number nor a file"),
        ("absent.json+3", "neither a number nor a file"),
        ("0", "give kg"),
        ("-5", "give kg"),
        ("nan", "give kg"),
        ("1500,20,3", "give kg"),
        ("1500,1600", "must be below the mass"),
        ("ekf.json", "holds no mass of a vehicle by the method gpc"),
        ("other.json", "is not a result of `socwise inertia`"),
        ("trip.csv", "is not a result of `socwise inertia`"),
    ],
)
def test_what_is_no_mass(results, text, part):
    with pytest.raises(CommandError, match="--mass") as caught:
        read_mass(text)
    assert part in str(caught.value)


def test_compare_drives_with_the_mass_and_says_what_its_sd_means(results, capsys):
    common = ("compare", "--concept", "hev", "--cycle", "trip.csv", "--mu", "0.002", "--realizations", 2)
    alone = ("--policy", "rule_based", "--json")
    light = json.loads(run(capsys, *common, *alone).out)
    heavy = json.loads(run(capsys, *common, *alone, "--mass", "1800,18").out)
    assert "mass" not in light
    (found,) = heavy["mass"]
    assert (found["concept"], found["mass_kg"], found["sd_kg"]) == ("hev", 1800.0, 18.0)
    expected = mass_effects([load_concept("hev").with_mass(1800.0, 18.0)], "trip.csv")["mass"][0]
    assert found == expected
    assert 0.0 < found["wheel_energy_MJ"]["sd"] < 0.01 * found["wheel_energy_MJ"]["value"]
    fuel = [one["cases"][0]["cost_kg"]["mean"] for one in (light, heavy)]
    assert fuel[1] > fuel[0]
    (said,) = mass_sentences(heavy)
    assert said.startswith("hev weighs 1800 kg ± 18, so the energy")
    manifest = json.loads((results / "results/compare/manifest.json").read_text())
    assert manifest["settings"]["concepts"][0]["mass_kg"] == 1800.0


def test_a_wrong_mass_is_refused_before_anything_is_computed(results, capsys):
    shown = run(capsys, "compare", "--mass", "1500,1600")
    assert (shown.code, shown.out) == (2, "")
    assert "must be below the mass" in shown.err
    assert not (results / "results").exists()

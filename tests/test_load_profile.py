"""Loads from files: current or power, on equal steps, with charge and energy kept."""

import numpy as np
import pytest

from bms.errors import BatteryError
from bms.load_profile import LoadProfile, read_profile, resample


def write(path, header, rows):
    lines = [header, *(",".join(str(cell) for cell in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


STEPS = [(float(k), float(np.sin(k))) for k in range(12)]


@pytest.mark.parametrize(
    ("header", "name", "factor"),
    [
        ("time_s,current_A", "current_A", 1.0),
        ("Time / s,Current / mA", "current_A", 1e-3),
        ("t [s],I [A]", "current_A", 1.0),
        ("time_s,power_kW", "power_W", 1e3),
        ("time (s),Battery Power (W)", "power_W", 1.0),
        ("time_s,P/W", "power_W", 1.0),
    ],
)
def test_headers_carry_quantity_and_unit(header, name, factor, tmp_path):
    profile = read_profile(write(tmp_path / "p.csv", header, STEPS))
    assert profile.step_s == 1.0
    assert profile.is_power == (name == "power_W")
    wanted = factor * np.sin(np.arange(11.0))
    np.testing.assert_allclose(getattr(profile, name), wanted, rtol=1e-12, atol=1e-15)


def test_a_current_goes_before_a_power_unless_the_power_is_named(tmp_path):
    rows = [(k, 1.0, 300.0) for k in range(12)]
    path = write(tmp_path / "p.csv", "time_s,current_A,power_W", rows)
    assert not read_profile(path).is_power
    assert read_profile(path, columns={"power": "power_W"}).load[0] == 300.0


def test_columns_by_name_and_the_other_sign(tmp_path):
    path = write(tmp_path / "p.csv", "Zeit,Strom", [(60.0 * k, 2000.0 * k) for k in range(12)])
    columns = {"time": "Zeit:s", "current": "Strom:mA"}
    profile = read_profile(path, columns=columns, discharge_positive=True)
    assert profile.step_s == 60.0
    np.testing.assert_allclose(profile.current_A, -2.0 * np.arange(11.0))
    assert any("sign" in note for note in profile.notes)


def test_charge_is_kept_on_steps_of_any_length():
    rng = np.random.default_rng(5)
    time_s = np.concatenate(([0.0], np.cumsum(rng.uniform(0.1, 3.0, 200))))
    load = rng.normal(size=201)
    total = float(np.sum(load[:-1] * np.diff(time_s)))
    for step_s in (time_s[-1] / 7.0, time_s[-1] / 1000.0):
        held = resample(time_s, load, step_s)
        assert held.sum() * step_s == pytest.approx(total, abs=1e-9)


def test_a_load_holds_until_the_next_sample():
    held = resample(np.array([0.0, 2.0, 3.0, 4.0]), np.array([1.0, 5.0, 7.0, 99.0]), 1.0)
    np.testing.assert_allclose(held, [1.0, 1.0, 5.0, 7.0])


def test_the_step_is_a_multiple_of_the_plants(tmp_path):
    path = write(tmp_path / "p.csv", "time_s,current_A", [(0.7 * k, 1.0) for k in range(40)])
    assert read_profile(path, unit_s=0.5).step_s == 0.5
    assert read_profile(path, unit_s=2.0).step_s == 2.0
    assert read_profile(path, step_s=3.5).step_s == 3.5


def test_a_hole_keeps_the_load_before_it(tmp_path):
    rows = [(k, "" if k in (0, 5) else k) for k in range(12)]
    profile = read_profile(write(tmp_path / "p.csv", "time_s,current_A", rows))
    assert profile.current_A[0] == 0.0
    assert profile.current_A[5] == 4.0
    assert "missing in 2 samples" in profile.notes[-1]


@pytest.mark.parametrize(
    ("header", "columns", "message"),
    [
        ("time_s,foo", {}, "no current or power column"),
        ("foo,current_A", {}, "no time column"),
        ("time_s,current", {}, "unit behind a colon"),
        ("time_s,current_A", {"current": "Strom"}, "no column 'Strom'"),
        ("time_s,Last", {"power": "Last"}, "no unit of a power"),
    ],
)
def test_what_is_missing_is_named(header, columns, message, tmp_path):
    with pytest.raises(BatteryError, match=message):
        read_profile(write(tmp_path / "p.csv", header, STEPS), columns=columns)


def test_loads_that_are_none():
    with pytest.raises(BatteryError, match="one of the two"):
        LoadProfile(step_s=1.0)
    with pytest.raises(BatteryError, match="one number for every step"):
        LoadProfile(step_s=1.0, current_A=np.array([1.0, np.nan]))
    with pytest.raises(BatteryError, match="longer than the load"):
        resample(np.array([0.0, 1.0]), np.ones(2), 2.0)

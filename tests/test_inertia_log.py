"""A user's log of a drive: columns by name and unit, and a clear word on what cannot be used."""

import gzip

import numpy as np
import pytest

from vehicle import VehicleError
from vehicle.inertia.log_columns import CHANNELS, UNITS, find_columns
from vehicle.inertia.log_file import constant, read_table
from vehicle.inertia.read_log import CORNER_AZ, ESSENTIAL, REQUIRED, read_log, read_mass_spring

N = 40
UNIT_OF = {
    "time": "s",
    "force": "N",
    "acceleration": "mps2",
    "angular acceleration": "radps2",
    "speed": "mps",
    "position": "m",
}


def signals(model):
    """Channels of a model with values of their own, the time with equal steps."""
    rng = np.random.default_rng(5)
    found = {name: np.round(rng.normal(3.0, 1.0, N), 4) for name in REQUIRED[model]}
    for name in ("az", *CORNER_AZ):
        if name in found:
            found[name] += 6.8
    found["time"] = np.round(0.01 * np.arange(N), 4)
    return found


def header_of(name):
    return f"{name}_{UNIT_OF[CHANNELS[name][0]]}"


def write(path, columns, mark=","):
    lines = [mark.join(columns)]
    lines += [mark.join(str(cell) for cell in row) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def log(tmp_path):
    """Give a function that writes the log of a model, with changes by channel, and returns its path."""

    def made(model="mltm", rename=None, **changes):
        found = signals(model) | changes
        return write(tmp_path / "log.csv", {(rename or {}).get(n, header_of(n)): v for n, v in found.items()})

    return made


@pytest.mark.parametrize(
    ("cell", "channel", "factor"),
    [
        ("force_fl_N", "force_fl", 1.0),
        ("Force FL [kN]", "force_fl", 1e3),
        ("SF front left / N", "force_fl", 1.0),
        ("rear right strut force (kN)", "force_rr", 1e3),
        ("Ax[g]", "ax", 9.80665),
        ("lateral acceleration [m/s^2]", "ay", 1.0),
        ("az_mps2", "az", 1.0),
        ("az_rl_mps2", "az_rl", 1.0),
        ("Vertical acceleration fr (m/s²)", "az_fr", 1.0),
        ("pitch acceleration [deg/s2]", "pitch", np.pi / 180.0),
        ("roll_radps2", "roll", 1.0),
        ("Vehicle-Speed/km/h", "speed", 1.0 / 3.6),
        ("t [ms]", "time", 1e-3),
        ("x_mm", "position", 1e-3),
    ],
)
def test_headers_are_read_with_their_units(cell, channel, factor):
    found = find_columns(["other", cell], [channel])[channel]
    assert (found.index, found.header) == (1, cell)
    assert found.factor == pytest.approx(factor)


def test_a_corner_is_not_the_centre_of_gravity():
    cells = ["az_fl_mps2", "az_fr_mps2", "az_rl_mps2", "az_rr_mps2"]
    assert find_columns(cells, (), ["az"]) == {}
    found = find_columns(cells, [f"az_{corner}" for corner in ("rr", "fl")])
    assert (found["az_rr"].index, found["az_fl"].index) == (3, 0)


def test_the_users_names_go_first():
    cells = ["force_fl_N", "P1", "gain (kN)"]
    given = {"force_fl": "gain", "force_fr": "P1:kN"}
    found = find_columns(cells, ["force_fl", "force_fr"], given=given)
    assert [(one.index, one.factor) for one in found.values()] == [(2, 1e3), (1, 1e3)]


@pytest.mark.parametrize(
    ("cells", "given", "parts"),
    [
        (["force_fr_N"], {}, ["no column for force_fl", "'force_fr_N'", "--column force_fl=NAME:N"]),
        (["forc_fl_N"], {}, ["is it 'forc_fl_N'?"]),
        (["force_fl"], {}, ["'force_fl'", "has no unit", "N, kN"]),
        (["force_fl [lbf]"], {}, ["unit 'lbf'", "none of N, kN"]),
        (["force_fl_N", "Force FL [N]"], {}, ["both hold force_fl", "--column force_fl=NAME"]),
        (["a", "b"], {"force_fl": "c:N"}, ["'c'", "is not there", "'a', 'b'"]),
        (["a", "a"], {"force_fl": "a:N"}, ["is there 2 times"]),
        (["a"], {"force_f": "a:N"}, ["no channel is called 'force_f'", "did you mean 'force_fl'?"]),
    ],
)
def test_headers_that_cannot_be_used(cells, given, parts):
    with pytest.raises(VehicleError) as caught:
        find_columns(cells, ["force_fl"], given=given)
    assert [part for part in parts if part not in str(caught.value)] == []


def test_every_channel_has_units_and_no_name_is_shared():
    names = [name for _, several in CHANNELS.values() for name in several]
    assert len(names) == len(set(names))
    assert {kind for kind, _ in CHANNELS.values()} == set(UNITS)


@pytest.mark.parametrize("model", REQUIRED)
def test_a_log_becomes_the_record_that_estimators_take(log, model):
    wanted = signals(model)
    found, table = read_log(log(model), model)
    np.testing.assert_array_equal(found.time_s, wanted["time"])
    for place, corner in enumerate(("fl", "fr", "rl", "rr")):
        np.testing.assert_array_equal(found.forces_N[:, place], wanted[f"force_{corner}"])
    np.testing.assert_array_equal(found.ay_mps2, wanted["ay"])
    if model == "mltm":
        np.testing.assert_array_equal(found.corner_az_mps2[:, 2], wanted["az_rl"])
    assert (table.notes, table.doubts) == ((), ())
    assert set(ESSENTIAL[model]) < set(REQUIRED[model]) == set(table.headers)


def test_separators_decimal_commas_units_and_compression_change_nothing(tmp_path, log):
    expected, _ = read_log(log("ltm"), "ltm")
    values = signals("ltm")
    scaled = {
        "Zeit": 1e3 * values["time"],
        **{f"Force {c.upper()} [kN]": 1e-3 * values[f"force_{c}"] for c in ("fl", "fr", "rl", "rr")},
        "ax [g]": values["ax"] / 9.80665,
        "ay [m/s2]": values["ay"],
        "az [m/s2]": values["az"],
        "speed [km/h]": 3.6 * values["speed"],
    }
    text = write(tmp_path / "other.csv", scaled, ";").read_text().replace(".", ",")
    (tmp_path / "other.csv.gz").write_bytes(gzip.compress(f"# a comment\n{text}".encode()))
    found, table = read_log(tmp_path / "other.csv.gz", "ltm", {"time": "Zeit:ms"})
    for name in ("time_s", "forces_N", "ax_mps2", "speed_mps"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-12)
    assert table.headers["time"] == "Zeit"


def test_rows_that_lack_a_value_are_left_out_and_told_of(log):
    ay = signals("mltm")["ay"].astype(object)
    ay[7], ay[20] = "", "NaN"
    found, table = read_log(log(ay=ay), "mltm")
    assert found.time_s.size == N - 2
    assert not np.isin(0.07, found.time_s)
    assert table.notes == ("2 of 40 rows lack a value of ay, the first in line 9; they were left out",)


def test_a_gap_in_time_is_told_of(log):
    time = 0.01 * np.arange(N) + 12.0 * (np.arange(N) >= 30)
    _, table = read_log(log(time=time), "mltm")
    assert len(table.doubts) == 1
    assert (
        "1 gap(s) in time, the longest 12 s before line 32, while a step is usually 0.01 s" in table.doubts[0]
    )


def test_signals_that_never_change_are_told_of_where_something_else_is_found(log):
    _, table = read_log(log(ay=np.zeros(N), speed=np.full(N, 10.0)), "mltm")
    assert [doubt.split(":")[0] for doubt in table.doubts] == [
        "ay does not change",
        "the speed does not change",
    ]
    _, table = read_log(log("ride", ay=np.zeros(N)), "ride")
    assert table.doubts == ()
    _, table = read_log(log("ride", ax=np.ones(N), ay=np.zeros(N)), "ride")
    assert table.doubts[0].startswith("ax and ay do not change")


def text_at(place, word):
    column = signals("mltm")["ay"].astype(object)
    column[place] = word
    return column


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        ({"force_rl": np.full(N, 4800.0)}, ["force_rl ('force_rl_N') is 4800 throughout", "nothing can be"]),
        ({"ay": text_at(3, "1.2.3")}, ["line 5", "ay ('ay_mps2') is '1.2.3'", "no number"]),
        ({"ay": np.where(np.arange(N) < 15, np.nan, 1.0)}, ["15 of 40 rows lack a value of ay", "fifth"]),
        ({"ay": np.full(N, np.nan)}, ["ay ('ay_mps2') is missing in every row"]),
        ({"time": -0.01 * np.arange(N)}, ["line 3", "time goes from", "must increase"]),
        ({"time": np.r_[0.0, 0.01 * np.arange(N - 1)]}, ["line 3", "time goes from 0 to 0 s"]),
    ],
)
def test_values_that_cannot_be_used(log, changes, parts):
    path = log(**changes)
    with pytest.raises(VehicleError) as caught:
        read_log(path, "mltm")
    assert [part for part in (str(path), *parts) if part not in str(caught.value)] == []


AZ = signals("ltm")["az"]
FORCE = signals("ltm")["force_rl"]


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        ({"az": -AZ}, ["az ('az_mps2') is -9.", "z points down: turn the sign"]),
        ({"az": AZ - 9.81}, ["gravity was taken off", "add 9.81 m/s2"]),
        ({"az": AZ / 9.81}, ["the unit is g: --column az='az_mps2':g"]),
        ({"az": -AZ / 9.81}, ["the unit is g", "turn its sign"]),
        ({"az": AZ * 9.81}, ["in m/s2 and not in g: --column az='az_mps2':m/s2"]),
        ({"az": AZ / 2.0}, ["check its unit, its offset"]),
        ({"force_rl": -FORCE}, ["force_rl ('force_rl_N') is -", "turn the sign"]),
        ({"force_rl": FORCE - 3.0}, ["force_rl ('force_rl_N') is", "static load was taken off"]),
    ],
)
def test_wrong_signs_units_and_missing_gravity_are_named(log, changes, parts):
    path = log("ltm", **changes)
    with pytest.raises(VehicleError) as caught:
        read_log(path, "ltm")
    assert [part for part in (str(path), *parts) if part not in str(caught.value)] == []


def test_a_corner_upside_down_is_named_and_its_advice_can_be_taken(log):
    az = signals("mltm")["az_rl"]
    with pytest.raises(VehicleError, match=r"az_rl \('az_rl_mps2'\) .*z points down"):
        read_log(log(az_rl=-az), "mltm")
    path = log(az_rl=az / 9.80665)
    found, _ = read_log(path, "mltm", {"az_rl": "az_rl_mps2:g"})
    np.testing.assert_allclose(found.corner_az_mps2[:, 2], az)


def test_ride_needs_neither_gravity_nor_static_load(log):
    values = signals("ride")
    taken = {name: column - column.mean() for name, column in values.items() if name != "time"}
    found, _ = read_log(log("ride", **taken), "ride")
    assert found.forces_N.mean() == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        (None, ["there is no file"]),
        (b"", ["holds no data", "time_s,force_fl_N"]),
        (b"time_s,position_m\n", ["holds no data"]),
        (b"\xff\xfet\x00", ["not UTF-8"]),
        (b"time_s,position_m\n0,1\n1,2\n", ["2 whole samples", "at least 10"]),
    ],
)
def test_files_that_cannot_be_used(tmp_path, content, parts):
    path = tmp_path / "bad.csv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(VehicleError) as caught:
        read_mass_spring(path)
    assert [part for part in parts if part not in str(caught.value)] == []


def test_a_damaged_archive_and_a_folder_say_so(tmp_path):
    (tmp_path / "log.csv.gz").write_bytes(b"no archive")
    for path in (tmp_path / "log.csv.gz", tmp_path):
        with pytest.raises(VehicleError, match="cannot read"):
            read_table(path, ["time"])


def test_a_log_needs_its_time(log):
    with pytest.raises(VehicleError, match="channel 'time'"):
        read_table(log(), ["ax"])


def test_positions_of_a_mass_are_read(tmp_path):
    path = write(tmp_path / "m.csv", {"t [s]": 0.1 * np.arange(N), "x [mm]": np.arange(N) % 7})
    found, _ = read_mass_spring(path, None, 500.0)
    np.testing.assert_allclose(found.position_m, 1e-3 * (np.arange(N) % 7))
    assert found.stiffness_Npm == 500.0


def test_constant_is_exact():
    assert constant(np.full(5, 1e4))
    assert not constant(np.array([1e4, 1e4, 1e4 + 1e-6]))

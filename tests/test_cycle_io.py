"""Reading a user's CSV: what is accepted, and one clear message for everything else."""

from pathlib import Path

import numpy as np
import pytest

from drivecycles import CycleError, DriveCycle, read_csv


def write(tmp_path: Path, text: str, encoding: str = "utf-8") -> Path:
    path = tmp_path / "trip.csv"
    path.write_bytes(text.encode(encoding))
    return path


def read(tmp_path: Path, text: str, encoding: str = "utf-8") -> DriveCycle:
    return read_csv(write(tmp_path, text, encoding))


@pytest.mark.parametrize(
    ("header", "factor"),
    [
        ("time_s,speed_mps", 1.0),
        ("time [s], speed [m/s]", 1.0),
        ("Time (s),Speed (km/h)", 1 / 3.6),
        ("time / s,speed / km/h", 1 / 3.6),
        ("time/s,speed/(km/h)", 1 / 3.6),
        ("TIME_S,VELOCITY_KPH", 1 / 3.6),
        ("t [s],v [kmh]", 1 / 3.6),
        ("t_s,vehicle speed [km/h]", 1 / 3.6),
        ("time_s,speed_km_h", 1 / 3.6),
        ("time_s,speed_mph", 0.44704),
    ],
)
def test_units_in_the_header(tmp_path: Path, header: str, factor: float) -> None:
    cycle = read(tmp_path, f"{header}\n0,0\n1,36\n2,18.5\n")
    assert cycle.name == "trip"
    assert cycle.time_s.tolist() == [0, 1, 2]
    assert cycle.speed_mps == pytest.approx(np.array([0, 36, 18.5]) * factor, rel=1e-15)


@pytest.mark.parametrize(("unit", "factor"), [("s", 1), ("min", 60), ("h", 3600), ("ms", 1e-3)])
def test_time_units(tmp_path: Path, unit: str, factor: float) -> None:
    step = 1.0 / factor
    cycle = read(tmp_path, f"time_{unit},speed_mps\n0,1\n{step!r},1\n{2 * step!r},1\n")
    assert cycle.step_s == pytest.approx(1.0)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_separators_comments_blank_lines_and_byte_order_mark(
    tmp_path: Path, separator: str, newline: str
) -> None:
    lines = [
        "# my trip; in May, uphill",
        "",
        "time_s,note,speed_kmh",
        "0,x,0",
        "# pause",
        "1,,36",
        "",
        "2,y,72",
    ]
    text = newline.join(line if line.startswith("#") else line.replace(",", separator) for line in lines)
    cycle = read(tmp_path, text, "utf-8-sig")
    assert cycle.speed_mps == pytest.approx([0, 10, 20])


def test_quoted_cells(tmp_path: Path) -> None:
    cycle = read(tmp_path, '"time [s]","note, long","speed [m/s]"\n"0","a, b","1"\n1,c,"2.5"\n')
    assert cycle.speed_mps.tolist() == [1, 2.5]


def test_empty_first_cell_of_a_tab_separated_file_keeps_its_place(tmp_path: Path) -> None:
    cycle = read(tmp_path, "note\ttime_s\tspeed_mps\n\t0\t1\n\t1\t2\n")
    assert cycle.time_s.tolist() == [0, 1]


def test_other_columns_are_ignored(tmp_path: Path) -> None:
    cycle = read(
        tmp_path,
        "time_of_day,time_s,T [degC],speed_limit_kmh,speed_mps,torque\n9h,0,20,50,1,\n9h,1,20,50,2,\n",
    )
    assert cycle.speed_mps.tolist() == [1, 2]


def test_altitude_in_feet(tmp_path: Path) -> None:
    cycle = read(tmp_path, "time_s,speed_mps,elevation [ft]\n0,10,100\n1,10,101\n2,10,100\n")
    assert cycle.altitude_m == pytest.approx([30.48, 30.7848, 30.48])
    assert cycle.grade == pytest.approx([0.03048, -0.03048])


@pytest.mark.parametrize("column", ["grade", "grade [-]", "grade_1", "slope (fraction)"])
def test_grade_is_rise_over_run(tmp_path: Path, column: str) -> None:
    cycle = read(tmp_path, f"time_s,speed_mps,{column}\n" + "".join(f"{t},10,0.05\n" for t in range(11)))
    sine = 0.05 / np.sqrt(1 + 0.05**2)
    assert cycle.altitude_m[-1] == pytest.approx(100.0 * sine, rel=1e-12)
    assert cycle.grade == pytest.approx(np.full(10, sine))


def test_grade_in_percent_and_mean_of_both_ends(tmp_path: Path) -> None:
    cycle = read(tmp_path, "time_s,speed_mps,grade_%\n0,10,0\n1,10,6\n2,10,0\n")
    assert cycle.grade == pytest.approx(np.full(2, np.sin(np.arctan(0.03))))


def test_altitude_is_used_where_a_grade_is_given_too(tmp_path: Path) -> None:
    cycle = read(tmp_path, "time_s,speed_mps,grade,altitude_m\n0,10,0.1,7\n1,10,0.1,7\n")
    assert cycle.altitude_m.tolist() == [7, 7]


def test_fast_and_uneven_logs(tmp_path: Path) -> None:
    time = np.round(np.cumsum(np.random.default_rng(1).uniform(0.05, 0.15, 500)), 3)
    text = "time_s,speed_mps\n" + "".join(f"{t},{5 + t / 10:.4f}\n" for t in time)
    cycle = read(tmp_path, text)
    assert not cycle.is_uniform
    uniform = cycle.resample(0.1)
    assert uniform.step_s == pytest.approx(0.1)
    # Speed is linear in time, so the distance has a closed form.
    t0, t1 = time[0], time[-1]
    assert cycle.distance_m == pytest.approx(5 * (t1 - t0) + (t1**2 - t0**2) / 20, rel=1e-4)


GOOD = "time_s,speed_mps\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty; the first row must name the columns"),
        ("# only a comment\n", "is empty"),
        ("time_s,rpm\n0,1\n", "there is no speed column among 'time_s', 'rpm'"),
        ("speed_mps\n0\n", "there is no time column"),
        ("0,0\n1,5\n", "there is no time column among '0', '0'"),
        ("time,speed_mps\n0,0\n1,1\n", r"column 'time' has no unit.*'time_s': s, "),
        ("time_s,speed\n0,0\n1,1\n", "column 'speed' has no unit.*m/s, mps, km/h, kmh, kph, mph"),
        ("time_s,speed_mps,altitude\n0,0,1\n", "column 'altitude' has no unit.*'altitude_m': m, ft"),
        ("time_s,speed_knots\n0,0\n", "has the unit 'knots'; speed may be in m/s"),
        ("time_s,speed [km/hr]\n0,0\n", r"has the unit 'km/hr'.*did you mean 'km/h'\?"),
        ("time_s,speed_mps,speed_kmh\n0,0,0\n", "'speed_mps' and 'speed_kmh' both hold speed; keep one"),
        (GOOD, r"holds 0 sample\(s\)"),
        (GOOD + "0,1\n", r"holds 1 sample\(s\); a cycle needs at least 2"),
        ("# c\n" + GOOD + "\n0,0\n1,abc\n", "line 5: the speed 'abc' is not a number"),
        (GOOD + "0,0\n1,NaN\n2,0\n", "line 3: speed is nan; every value must be a finite number"),
        (GOOD + "0,0\n1,\n2,0\n", "line 3: the speed is missing"),
        (GOOD + "0,0\n1\n", "line 3: the speed is missing"),
        (
            "time_s;speed_mps\n0;0\n1;1,5\n",
            "line 3: the speed '1,5' is not a number .write decimals with a point",
        ),
        (GOOD + "0,0\n2,1\n1,1\n", "line 4: time goes from 2 to 1 s"),
        (GOOD + "0,0\n1,1\n1,1\n", "line 4: time goes from 1 to 1 s"),
        (GOOD + "0,0\n1,-0.2\n2,0\n", "line 3: speed is -0.2 m/s; speed must be 0 or more"),
        (GOOD + "0,0\n1,101\n2,0\n", "line 3: speed is 101 m/s, more than 100 m/s; check the unit"),
        (
            GOOD + "0,0\n1,1\n2,1\n9,1\n10,1\n",
            "line 5: 7 s have passed.*5 s are the most.*fill the gap, resample",
        ),
        (
            "time_s,speed_mps,altitude_m\n0,9,0\n1,9,30\n",
            "line 3: altitude goes from 0 to 30 m over 9 m of road",
        ),
        ("time_s,speed_mps,grade\n0,9,0\n1,9,2.5\n", "line 3: grade is 2.5, beyond 0.5"),
    ],
)
def test_bad_files(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(CycleError, match=message) as caught:
        read_csv(path)
    assert str(caught.value).startswith(str(path))


def test_gap_limit_scales_with_the_log_and_can_be_set(tmp_path: Path) -> None:
    slow = read(tmp_path, GOOD + "0,1\n10,1\n20,1\n60,1\n")
    assert slow.duration_s == 60
    pause = GOOD + "".join(f"{t / 10},1\n" for t in [*range(20), 38, 39])
    assert read(tmp_path, pause).duration_s == pytest.approx(3.9)
    with pytest.raises(
        CycleError, match=r"1\.9 s have passed since the sample before, while 1 s are the most"
    ):
        read_csv(write(tmp_path, pause), max_step_s=1.0)
    with pytest.raises(CycleError, match="line 3: 3 s have passed"):
        read_csv(write(tmp_path, GOOD + "0,1\n3,1\n3.1,1\n3.2,1\n"))


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(CycleError, match=r"there is no file .*nowhere\.csv; check the path"):
        read_csv(tmp_path / "nowhere.csv")
    with pytest.raises(CycleError, match="cannot read"):
        read_csv(tmp_path)
    with pytest.raises(CycleError, match="not UTF-8 text"):
        read(tmp_path, GOOD + "0,0\n1,1\n# Straße", "utf-16")


def test_name_can_be_given(tmp_path: Path) -> None:
    assert read_csv(write(tmp_path, GOOD + "0,0\n1,1\n"), name="commute").name == "commute"


def test_decimal_commas_do_not_pass_for_further_columns(tmp_path: Path) -> None:
    path = tmp_path / "trip.csv"
    path.write_text("time [s],speed [km/h]\n0,0\n1,7,5\n2,9\n", encoding="utf-8")
    with pytest.raises(
        CycleError, match=r"line 3: there are 3 values under 2 names; write decimals with a point"
    ):
        read_csv(path)
    path.write_text("time [s],speed [km/h]\n0,0,\n1,7, \n", encoding="utf-8")
    assert len(read_csv(path)) == 2

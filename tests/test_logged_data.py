"""Logs of every make: columns, units, signs, holes and gaps come out in SI, and what is wrong is named."""

import gzip
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bms.cells import load_cell
from bms.errors import BatteryError
from bms.log_checks import check_cell, wrong_sign
from bms.log_columns import QUANTITIES, UNITS, find_columns, split_header
from bms.log_moments import seconds_of
from bms.log_text import BLOCK_BYTES
from bms.logged_data import LoggedData, read_log

CURRENT = [0.0, 1.5, 1.5, -2.0, -2.0, 0.0, 0.5, 0.5, -1.0, 0.0, 0.25, 0.0]
VOLTAGE = [3.30, 3.33, 3.33, 3.26, 3.26, 3.30, 3.31, 3.31, 3.28, 3.30, 3.305, 3.30]
N = len(CURRENT)


def text(header, *columns, mark=",", end="\n"):
    """A file of a header and columns of anything."""
    rows = [header, *(mark.join(str(cell) for cell in row) for row in zip(*columns, strict=True))]
    return end.join([*rows, ""])


@pytest.fixture
def log(tmp_path):
    """Write text or bytes to a file and read it as a log."""

    def read(content, name="log.csv", **options):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_log(path, **options)

    return read


def refused(log, content, *parts, **options):
    with pytest.raises(BatteryError) as caught:
        log(content, **options)
    assert [part for part in ("log.csv", *parts) if part not in str(caught.value)] == []


@pytest.mark.parametrize(
    "header",
    [
        "Test Time / s,Current / A,Voltage / V",
        "test_time_second,current_ampere,voltage_volt",
        "time_s,current_A,voltage_V",
        "Test_Time(s),Current(A),Voltage(V)",
        "time/s,I/A,Ecell/V",
        "t [s],I [A],U [V]",
        "Time (sec),Current (Amps),Voltage (Volts)",
        "Time s,<I>/A,Cell Voltage / V",
        '"Test Time / s","Current / A","Voltage / V"',
    ],
)
def test_headers_of_many_makes(log, header):
    found = log(text(header, range(N), CURRENT, VOLTAGE))
    np.testing.assert_array_equal(found.time_s, np.arange(N))
    np.testing.assert_array_equal(found.current_A, CURRENT)
    np.testing.assert_array_equal(found.voltage_V, VOLTAGE)
    assert (found.temperature_C, found.soc_true, found.notes, found.doubts) == (None, None, (), ())


def test_units_become_si(log):
    minutes, mA, mV = np.arange(N) / 60.0, 1e3 * np.array(CURRENT), 1e3 * np.array(VOLTAGE)
    header = "t [min];I(mA);Voltage_mV;Temp / K;SOC [%]"
    found = log(text(header, minutes, mA, mV, [298.15] * N, np.linspace(50, 61, N), mark=";"))
    np.testing.assert_allclose(found.time_s, np.arange(N), rtol=1e-14)
    np.testing.assert_allclose(found.current_A, CURRENT, rtol=1e-14)
    np.testing.assert_allclose(found.voltage_V, VOLTAGE, rtol=1e-14)
    np.testing.assert_allclose(found.temperature_C, 25.0)
    np.testing.assert_allclose(found.soc_true, np.linspace(0.5, 0.61, N))
    warm = log(text("time_s,I_A,U_V,T [degF]", range(N), CURRENT, VOLTAGE, [77.0] * N))
    np.testing.assert_allclose(warm.temperature_C, 25.0)


def test_columns_of_the_users_own(log):
    content = text("Zeit,Strom,U-Zelle,Messzeit (h)", range(N), CURRENT, VOLTAGE, range(N))
    names = {"time": "zeit:ms", "current": "Strom:mA", "voltage": "U-Zelle:V"}
    found = log(content, columns=names)
    np.testing.assert_allclose(found.time_s, 1e-3 * np.arange(N))
    np.testing.assert_allclose(found.current_A, 1e-3 * np.array(CURRENT))
    assert found.headers == {"time": "Zeit", "current": "Strom", "voltage": "U-Zelle"}
    assert log(content, columns=names | {"time": "Messzeit (h)"}).step_s == 3600.0
    assert log(content, columns=names | {"time": "messzeit"}).step_s == 3600.0
    # The user's unit goes before the header's.
    assert log(content, columns=names | {"time": "Messzeit (h):s"}).step_s == 1.0


def test_the_preferred_column_is_taken():
    header = [
        "Date_Time",
        "Step_Time(s)",
        "Test_Time(s)",
        "Current(A)",
        "Voltage(V)",
        "Ambient Temperature / degC",
    ]
    found = find_columns([*header, "Surface Temperature T1 / degC"])
    assert {column.quantity: column.index for column in found.values()} == {
        "time": 2, "current": 3, "voltage": 4, "temperature": 6,
    }  # fmt: skip
    assert find_columns([*header, "T"], given={"temperature": "none"}).keys() == {
        "time",
        "current",
        "voltage",
    }


@given(
    st.sampled_from(sorted(QUANTITIES)).flatmap(
        lambda q: st.tuples(st.just(q), st.sampled_from(QUANTITIES[q]), st.sampled_from(sorted(UNITS[q])))
    ),
    st.sampled_from(["{} / {}", "{} [{}]", "{}({})", "{}/{}", "{} ({})"]),
)
def test_every_name_is_found_with_every_unit(chosen, form):
    quantity, name, unit = chosen
    if not unit:
        return
    assert split_header(form.format(name, unit), quantity) == (name, unit)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_comments_marks_and_ends_of_lines(log, end):
    rows = text("time_s;current_A;voltage_V", range(N), CURRENT, VOLTAGE, mark=";", end=end)
    lines = rows.split(end)
    content = end.join(["# cell 7", "", lines[0], *lines[1:4], "# a pause", "", *lines[4:], ";;", ""])
    found = log(b"\xef\xbb\xbf" + content.encode())
    np.testing.assert_array_equal(found.current_A, CURRENT)


@pytest.mark.parametrize("mark", [";", "\t"])
def test_decimal_commas(log, mark):
    rows = text(f"t [s]{mark}I [A]{mark}U [V]", range(N), CURRENT, VOLTAGE, mark=mark).replace(".", ",")
    np.testing.assert_array_equal(log(rows).voltage_V, VOLTAGE)


def test_lines_of_a_cycler_above_the_header(log):
    rows = text("time/s\tEcell/V\t<I>/mA", range(N), VOLTAGE, 1e3 * np.array(CURRENT), mark="\t")
    above = "EC-Lab ASCII FILE\r\nNb header lines : 5\r\n\r\nUser :\r\n"
    np.testing.assert_allclose(log(above + rows).current_A, CURRENT)
    lines = rows.split("\n")
    lines[4] = lines[4].replace("\t3.", "\tx")
    refused(log, above + "\n".join(lines), "line 9", "voltage is 'x26'")


def test_a_degree_sign_of_western_windows_and_a_compressed_file(log):
    content = text("time_s,I_A,U_V,T (°C)", range(N), CURRENT, VOLTAGE, [21.5] * N)
    np.testing.assert_array_equal(log(content.encode("cp1252")).temperature_C, 21.5)
    np.testing.assert_array_equal(log(gzip.compress(content.encode()), "log.bdf.gz").voltage_V, VOLTAGE)


@pytest.mark.parametrize("hole", ["", "nan", "NaN", "NULL", " ", "--"])
def test_holes_stay_and_are_counted(log, hole):
    current, voltage = [str(value) for value in CURRENT], [str(value) for value in VOLTAGE]
    current[3] = voltage[5] = voltage[-1] = hole
    found = log(text("time_s,current_A,voltage_V", range(N), current, voltage))
    assert np.flatnonzero(np.isnan(found.current_A)).tolist() == [3]
    assert np.flatnonzero(np.isnan(found.voltage_V)).tolist() == [5, N - 1]
    assert np.delete(found.voltage_V, [5, N - 1]).tolist() == np.delete(VOLTAGE, [5, N - 1]).tolist()
    assert found.notes == (
        "the current is missing in 1 of 12 samples",
        "the voltage is missing in 2 of 12 samples",
    )


def test_neighbouring_holes(log):
    rows = [
        "time_s,a,current_A,b,voltage_V",
        *(f"{k},,{CURRENT[k]},,{VOLTAGE[k]}" for k in range(N - 1)),
        "11,,,,",
    ]
    found = log("\n".join(rows))
    assert np.isnan(found.current_A[-1])
    assert np.isnan(found.voltage_V[-1])
    assert found.current_A[:-1].tolist() == CURRENT[:-1]


def test_infinities_are_holes(log):
    found = log(text("time_s,current_A,voltage_V", range(N), [*CURRENT[:-1], "inf"], VOLTAGE))
    assert np.isnan(found.current_A[-1])


def test_the_sign_can_be_turned_and_is_doubted(log):
    content = text("time_s,current_A,voltage_V", range(N), [-value for value in CURRENT], VOLTAGE)
    assert "--discharge-positive" in log(content).doubts[0]
    turned = log(content, discharge_positive=True)
    np.testing.assert_array_equal(turned.current_A, CURRENT)
    assert turned.doubts == ()
    assert "sign" in turned.notes[0]


def test_noise_alone_casts_no_doubt_on_the_sign():
    rng = np.random.default_rng(3)
    assert not any(wrong_sign(rng.normal(0, 1, 100), rng.normal(3.3, 1, 100)) for _ in range(200))


def test_a_current_without_sign_is_doubted(log):
    content = text("time_s,current_A,voltage_V", range(N), np.abs(CURRENT), np.linspace(3.2, 3.3, N))
    assert "only ever charges" in " ".join(log(content).doubts)


def test_dates_and_clocks(log):
    stamps = [f"2024-05-01T23:59:{50 + k:02d}.500+02:00" for k in range(10)]
    stamps += ["2024-05-01 22:00:00.500Z", "2024-05-02T00:00:01.500+02:00"]
    found = log(text("Date Time,current_A,voltage_V", stamps, CURRENT, VOLTAGE))
    np.testing.assert_allclose(found.time_s, np.arange(N))
    assert found.notes == ("time counts from the first sample, 2024-05-01T21:59:50.500 UTC",)
    clock = [f"{99 + k // 2}:{30 * (k % 2):02d}:00.25" for k in range(N)]
    assert log(text("t,current_A,voltage_V", clock, CURRENT, VOLTAGE)).step_s == 1800.0
    unix = log(text("Unix Time / s,current_A,voltage_V", 1.7e9 + np.arange(N), CURRENT, VOLTAGE))
    assert (unix.time_s[0], unix.duration_s) == (0.0, N - 1.0)


@pytest.mark.parametrize(
    ("cell", "seconds"),
    [
        ("1970-01-02", 86400.0),
        ("1970-01-01T01:00:00+01:00", 0.0),
        ("100:00:01.5", 360001.5),
        ("0:01:00", 60.0),
    ],
)
def test_seconds_of(cell, seconds):
    assert seconds_of(cell) == seconds


def test_steps_jitter_and_gaps(log):
    time_s = np.array([0, 1, 2, 3, 4, 5, 60, 61, 62, 63, 200, 201.0])
    found = log(text("time_s,current_A,voltage_V", time_s, CURRENT, VOLTAGE))
    assert found.step_s == 1.0
    assert [(gap.start_s, gap.length_s) for gap in found.gaps] == [(5.0, 55.0), (63.0, 137.0)]
    assert "2 gaps" in found.notes[0]
    assert "137 s, begins at 63 s" in found.notes[0]
    even = log(text("time_s,current_A,voltage_V", np.arange(N), CURRENT, VOLTAGE))
    assert (even.jitter_s, even.gaps) == (0.0, ())
    uneven = LoggedData(np.cumsum(np.tile([0.9, 1.1], 50)), np.zeros(100), np.ones(100))
    assert uneven.jitter_s == pytest.approx(0.1)


def test_of_samples_at_the_same_time_the_last_is_kept(log):
    time_s = [0, 1, 2, 2, 3, 4, 5, 6, 7, 8, 9, 10]
    found = log(text("time_s,current_A,voltage_V", time_s, CURRENT, VOLTAGE))
    np.testing.assert_array_equal(found.time_s, range(11))
    np.testing.assert_array_equal(found.current_A, [*CURRENT[:2], *CURRENT[3:]])
    assert found.notes == (
        "1 samples have the same time as the next one (first in line 4); the last of each was kept",
    )


def test_a_line_cut_short_by_a_power_failure(log):
    content = text("time_s,current_A,voltage_V", range(N), CURRENT, VOLTAGE) + "12,0.2"
    found = log(content)
    assert (len(found), found.notes) == (N, ("the last line is not complete and was left out",))


def test_many_blocks_are_one_log(log):
    rng = np.random.default_rng(0)
    n = BLOCK_BYTES // 20
    current = np.round(rng.normal(0, 2, n), 4)
    current[-1] = np.nan
    rows = text("time_s,current_A,voltage_V", range(n), current.tolist(), [3.3125] * n)
    assert len(rows) > BLOCK_BYTES
    done = []
    found = log(rows, progress=lambda seen, size: done.append(seen / size))
    np.testing.assert_array_equal(found.current_A, current)
    assert done[-1] == 1.0
    assert len(done) > 1
    lines = rows.split("\n")
    lines[n - 5] = lines[n - 5].replace(",3.3125", ",3.3x")
    refused(log, "\n".join(lines), f"line {n - 4}", "'3.3x'")


def test_a_later_start(log):
    current, voltage = [*range(7), *CURRENT], [*VOLTAGE[:7], *VOLTAGE]
    found = log(text("time_s,current_A,voltage_V,soc", np.arange(19) + 100, current, voltage, [0.5] * 19))
    later = found.after(2.5)
    np.testing.assert_array_equal(later.time_s, np.arange(103, 119))
    np.testing.assert_array_equal(later.current_A, current[3:])
    assert later.soc_true.size == 16
    assert len(found.after(9.0)) == 10
    for start in (19.0, 1e6, -1.0, float("nan")):
        with pytest.raises(BatteryError, match="leaves nothing"):
            found.after(start)
    with pytest.raises(BatteryError, match=r"leaves 9 of the 19 samples.*at least 10"):
        found.after(10.0)


def test_what_is_left_out_is_not_spoken_of(log):
    n = 60
    time_s = np.arange(n) + 500 * (np.arange(n) >= 10)
    current = (np.where(np.arange(n) < 20, 1.0, -1.0) + 0.001 * (np.arange(n) % 2)).tolist()
    current[3] = current[40] = ""
    rows = text("time_s,current_A,voltage_V", time_s, current, np.linspace(3.3, 3.2, n))
    whole = log(rows + "999,0.2")
    assert whole.notes == (
        "the last line is not complete and was left out",
        "the current is missing in 2 of 60 samples",
        "1 gap longer than 5 times the usual step of 1 s; the longest, of 501 s, begins at 9 s",
    )
    assert whole.doubts == ()
    later = whole.after(515.0)
    assert later.notes == (
        "the last line is not complete and was left out",
        "the current is missing in 1 of 45 samples",
    )
    assert later.doubts == ()
    (doubt,) = whole.after(525.0).doubts
    assert "only ever discharges" in doubt
    turned = log(rows, discharge_positive=True, columns={"current": "current_A"}).after(525.0)
    assert "turned" in turned.notes[0]
    assert "only ever charges" in turned.doubts[0]


def test_a_log_cannot_be_changed_and_does_not_lock_what_it_was_made_of():
    mine = np.arange(3.0)
    made = LoggedData(mine, np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match="read-only"):
        made.time_s[0] = 1.0
    mine[0] = -1.0
    with pytest.raises(BatteryError, match=re.escape("current_A has the shape (2,)")):
        LoggedData(mine, np.zeros(2), np.zeros(3))


ROWS = text("HEADER", range(N), CURRENT, VOLTAGE)


@pytest.mark.parametrize(
    ("header", "columns", "parts"),
    [
        ("time_s,current_A,spannung", {}, ["no voltage column", "'spannung'", "--voltage U:mV"]),
        ("time_s,Curent / A,voltage_V", {}, ["no current column", "is it 'Curent / A'?"]),
        ("time_s,Strom [mA],voltage_V", {}, ["no current column", "is it 'Strom [mA]'?"]),
        (
            "time_s,current_A,voltage",
            {},
            ["'voltage' has no unit", "--voltage 'voltage':mV", "known: V, volt"],
        ),
        ("time,current_A,voltage_V", {}, ["'time' has no unit", "--time 'time':ms"]),
        ("time_s,current [mAh],voltage_V", {}, ["unit 'mAh'", "did you mean 'mA'?"]),
        ("time_s,current_A,temp", {"voltage": "temp"}, ["'temp' has no unit for the voltage"]),
        ("time_s,current_A,U", {"voltage": "V1"}, ["no column 'V1' for the voltage", "'U'"]),
        ("time_s,I (mA),u_V", {"current": "I(mA)"}, ["did you mean 'I (mA)'?"]),
        ("time_s,I_A,u_V", {"current": "I_A:bar"}, ["unit 'bar'"]),
        ("time_s,current_A,current_mA", {}, ["both hold the current"]),
        ("time_s,current_A,voltage_V", {"voltage": "none"}, ["no column 'none'"]),
    ],
)
def test_bad_columns(log, header, columns, parts):
    refused(log, ROWS.replace("HEADER", header), *parts, columns=columns)


def test_a_column_that_is_not_needed_can_be_left_out(log):
    content = text("time_s,current_A,voltage_V,Temperature", range(N), CURRENT, VOLTAGE, [25] * N)
    refused(log, content, "'Temperature' has no unit", "--temperature none")
    assert log(content, columns={"temperature": "none"}).temperature_C is None
    assert log(content, columns={"temperature": "temperature:degC"}).temperature_C[0] == 25.0


@pytest.mark.parametrize(
    ("line", "row", "parts"),
    [
        (5, "3,abc,3.3", ["line 5", "the current is 'abc'"]),
        (5, "3,1.5", ["line 5", "2 cells", "3 columns", "voltage ('voltage_V')"]),
        (5, ",1.5,3.3", ["line 5", "the time is missing"]),
        (5, "nan,1.5,3.3", ["line 5", "the time is missing ('nan')"]),
        (5, "inf,1.5,3.3", ["line 5", "the time is inf"]),
        (5, "3,1.5 A,3.3", ["line 5", "'1.5 A'"]),
        (7, "3.5,0,3.3", ["line 7", "time goes back from 4 to 3.5 s", "sort"]),
        (5, "01.05.2024 12:00,0,3.3", ["line 5", "2024-05-01T12:00:00"]),
    ],
)
def test_bad_rows(log, line, row, parts):
    lines = text("time_s,current_A,voltage_V", range(N), CURRENT, VOLTAGE).split("\n")
    lines[line - 1] = row
    refused(log, "\n".join(lines), *parts)


def test_lines_are_counted_with_comments_and_blanks(log):
    lines = text("time_s,current_A,voltage_V", range(N), CURRENT, VOLTAGE).split("\n")
    lines[6] = "3,0,3.3"
    content = "\n".join(["# a comment", "", lines[0], "", *lines[1:3], "# another", *lines[3:]])
    refused(log, content, "line 11: time goes back from 4 to 3 s")


def test_a_clock_that_starts_anew(log):
    time_s = [*range(6), *range(6)]
    refused(log, text("time_s,current_A,voltage_V", time_s, CURRENT, VOLTAGE), "line 8", "back from 5 to 0 s")


def test_a_clock_too_coarse(log):
    n = 100
    content = text("time_s,current_A,voltage_V", np.arange(n) // 10, [0.1] * n, [3.3] * n)
    refused(log, content, "90 of 100 samples repeat the time", "more digits")


@pytest.mark.parametrize(
    ("values", "parts"),
    [
        ({"voltage": [3300] * N}, ["3300 V", "looks like mV", "--voltage 'voltage_V':mV"]),
        ({"voltage": [0.0033] * N}, ["0.0033 V"]),
        ({"current": [""] * N}, ["the current is missing in every row"]),
        ({"soc": np.linspace(10, 90, N)}, ["10 to 90", "per cent", "--soc 'soc':%"]),
        (
            {"celsius": [298.15] * N},
            ["298.15 degC, which looks like K", "--temperature 'temperature_C':K", "--temperature none"],
        ),
        ({"celsius": [-248.0] * N}, ["-248 degC", "looks like degC rather than K", "'temperature_C':degC"]),
    ],
)
def test_values_that_no_battery_has(log, values, parts):
    given = {"current": CURRENT, "voltage": VOLTAGE, "soc": [0.5] * N, "celsius": [25.0] * N} | values
    refused(log, text("time_s,current_A,voltage_V,soc,temperature_C", range(N), *given.values()), *parts)


@pytest.mark.parametrize("celsius", [[-60.0] * N, [150.0] * N, [25.0] * 7 + [999.0] * 5, [""] * N])
def test_a_temperature_that_can_be_or_is_wrong_now_and_then_is_read(log, celsius):
    found = log(text("time_s,current_A,voltage_V,temperature_C", range(N), CURRENT, VOLTAGE, celsius))
    assert found.temperature_C.size == N


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        (b"", ["holds no data"]),
        (b"time_s,current_A,voltage_V\n", ["holds no data"]),
        (b"# only\n# comments\n", ["holds no data"]),
        (b"time_s,current_A,voltage_V\n1,2,3\n", ["1 samples", "at least 10"]),
        ("time_s,current_A,voltage_V\n1,2,3\n".encode("utf-16"), ["not UTF-8"]),
        (b"\x00\x01\x02", ["not UTF-8"]),
    ],
)
def test_files_that_are_no_logs(log, content, parts):
    refused(log, content, *parts)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(BatteryError, match=r"there is no file .*absent\.csv"):
        read_log(tmp_path / "absent.csv")
    with pytest.raises(BatteryError, match="is a folder"):
        read_log(tmp_path)
    (tmp_path / "log.gz").write_bytes(b"not compressed")
    with pytest.raises(BatteryError, match=r"cannot read .*log\.gz"):
        read_log(tmp_path / "log.gz")


def test_a_log_of_another_cell(log):
    cell = load_cell("lfp-2ah")
    good = log(text("time_s,current_A,voltage_V", range(N), CURRENT, VOLTAGE))
    check_cell(good, cell)
    pack = log(text("time_s,current_A,voltage_V", range(N), CURRENT, 12 * np.array(VOLTAGE)))
    with pytest.raises(BatteryError, match=r"39\.6 V.*--series \(about 12 in series\?\)"):
        check_cell(pack, cell)
    check_cell(pack, cell.scaled(series=12))
    milli = log(text("time_s,current_A,voltage_V", range(N), 1e3 * np.array(CURRENT), VOLTAGE))
    with pytest.raises(BatteryError, match=r"is it mA\?.*--current 'current_A':mA"):
        check_cell(milli, cell)

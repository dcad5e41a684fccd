"""Bad input: one clear message on standard error, exit code 2, no traceback, nothing half-written."""

import shutil

import pytest
from command_line import preset_text, run, tree, write_cycle

import vehicle.library

HEADER = "time_s,speed_kmh\n"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A folder with a good cycle, a regular file and a folder that is not ours."""
    monkeypatch.chdir(tmp_path)
    write_cycle(tmp_path / "trip.csv")
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "thesis.txt").write_text("years of work")
    return tmp_path


def refuse(capsys, folder, *arguments):
    """Run a command that must fail, and return its message."""
    before = tree(folder)
    shown = run(capsys, *arguments)
    assert shown.code == 2
    assert shown.out == ""
    assert shown.err.startswith("socwise: ")
    assert "Traceback" not in shown.err
    assert tree(folder) == before
    return shown.err


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--cycle", "hwfett"], ["'hwfett'", "did you mean 'hwfet'?"]),
        (["--cycle", "hwfet+udss"], ["'udss'", "did you mean 'ftp72'?"]),
        (["--cycle", "nowhere.csv"], ["nowhere.csv", "check the path"]),
        (["--cycle", "hwfet+"], ["empty part"]),
        (["--concept", "pehv"], ["'pehv'", "did you mean 'phev'?"]),
        (["--concept", "hev,"], ["--concept", "empty item"]),
        (["--concept", "hev,hev"], ["'hev' is given twice"]),
        (["--concept", "mine.toml"], ["cannot read", "mine.toml"]),
        (["--policy", "stohastic"], ["'stohastic'", "did you mean 'stochastic'?"]),
        (["--policy", "stochastic,rules"], ["'rules'", "did you mean 'rule_based'?"]),
        (["--policy", "stochastic,stochastic"], ["given twice"]),
        (["--mu", "-1"], ["--mu is '-1'", "zero or positive", "such as 0.002"]),
        (["--mu=-1,2"], ["--mu is '-1'"]),
        (["--mu", "0.002,-0.1"], ["--mu is '-0.1'"]),
        (["--mu", "nan"], ["--mu is 'nan'"]),
        (["--mu", "inf"], ["--mu is 'inf'"]),
        (["--mu", "small"], ["--mu is 'small'", "must be a number"]),
        (["--mu", "0.002,0.002"], ["given twice"]),
        (["--realizations", "0"], ["0 realizations", "at least 1"]),
        (["--realizations", "-5"], ["-5 realizations"]),
        (["--realizations", "1000000000000"], ["not enough memory", "fewer realizations"]),
        (["--seed", "-1"], ["seed is -1"]),
        (["--plant", "ecm", "--estimator", "model"], ["--plant ecm", "such as ekf"]),
        (["--plant", "cell.fmu"], ["there is no file cell.fmu"]),
        (["--plant", "model", "--estimator", "ukf"], ["--estimator ukf", "--plant ecm or an FMU"]),
        (["--out", "trip.csv"], ["it is a file", "--out"]),
        (["--out", "trip.csv/below/it"], ["is a file", "--out"]),
        (["--out", "notes"], ["holds no results of socwise", "thesis.txt", "nothing was touched"]),
    ],
)
def test_compare_refuses(capsys, folder, arguments, parts):
    complete = [*arguments] if "--cycle" in arguments else ["--cycle", "trip.csv", *arguments]
    message = refuse(capsys, folder, "compare", *complete)
    assert [part for part in parts if part not in message] == []


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        ("time_s,speed\n0,0\n1,1\n", ["speed", "unit"]),
        (f"{HEADER}0,0\n2,1\n1,2\n", ["line 4", "time"]),
        (f"{HEADER}0,0\n1,nan\n2,0\n", ["line 3", "speed"]),
        (f"{HEADER}0,0\n1,-3\n2,0\n", ["line 3", "speed", "-"]),
        (f"{HEADER}0,0\n1,3\n2,4\n3,5\n60,0\n", ["line 6", "gap"]),
        (f"{HEADER}0,0\n1,\n2,0\n", ["line 3", "missing"]),
        ("", ["empty"]),
    ],
    ids=["no unit", "decreasing time", "NaN", "negative speed", "gap", "empty cell", "empty file"],
)
def test_a_bad_cycle_file(capsys, folder, content, parts):
    (folder / "bad.csv").write_text(content)
    for command in (["compare", "--cycle"], ["solve", "--cycle"], ["cycles", "show"], ["cycles", "plot"]):
        message = refuse(capsys, folder, *command, "bad.csv")
        assert [part for part in ["bad.csv", *parts] if part not in message] == []


def test_a_cycle_that_only_stands(capsys, folder, monkeypatch):
    """It is refused before anything is solved; `solve` needs no distance."""

    def never(*_):
        raise AssertionError("solved")

    monkeypatch.setattr("ems.compare._run", never)
    (folder / "wait.csv").write_text(HEADER + "".join(f"{second},0\n" for second in range(20)))
    message = refuse(capsys, folder, "compare", "--concept", "hev", "--cycle", "wait.csv")
    assert "the cycle 'wait' only stands" in message
    assert "take a cycle that moves" in message
    monkeypatch.setattr("ems.closed.compare._Task", never)
    loop = ("--plant", "ecm", "--estimator", "ekf")
    assert "the cycle 'wait' only stands" in refuse(
        capsys, folder, "compare", "--concept", "hev", "--cycle", "wait.csv", *loop
    )
    shown = run(capsys, "solve", "--concept", "hev", "--cycle", "wait.csv", "--out", "wait.nc")
    assert shown.code == 0


@pytest.mark.parametrize("command", ["compare", "solve"])
def test_a_vehicle_too_weak_for_the_cycle(capsys, folder, command):
    message = refuse(capsys, folder, command, "--cycle", "us06")
    for part in ("'hev' cannot follow 'us06'", "at t = ", "kW at the wheels", "--on-infeasible limit"):
        assert part in message


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("low = 0.55", "low = -0.1", ["window.low", "-0.1", "greater than or equal to 0"]),
        ("high = 0.75", "high = 1.2", ["window.high", "1.2", "less than or equal to 1"]),
        ("high = 0.75", "high = 0.5", ["low 0.55 must be below its high 0.5"]),
        ("initial_soc = 0.65", "initial_soc = 0.8", ["initial_soc 0.8 is outside the window"]),
        ("initial_soc = 0.65", "initial_sco = 0.65", ["initial_sco"]),
        ("low = 0.55", "low = 0.55\nlower = 1", ["window.lower"]),
        ('name = "hev"', "name = ", ["not valid TOML"]),
        ('vehicle = "hev"', 'vehicle = "hve"', ["'hve'", "did you mean 'hev'?"]),
        ('pack = "hev"', 'pack = "phevv"', ["'phevv'", "did you mean 'phev'?"]),
        ('pack = "hev"', 'pack = "absent.toml"', ["absent.toml"]),
    ],
)
def test_a_bad_concept_file(capsys, folder, old, new, parts):
    text = preset_text()
    assert f"\n{old}\n" in text
    (folder / "mine.toml").write_text(text.replace(f"\n{old}\n", f"\n{new}\n"))
    message = refuse(capsys, folder, "compare", "--concept", "mine.toml", "--cycle", "trip.csv")
    assert [part for part in parts if part not in message] == []


def test_a_vehicle_file_with_an_unknown_key(capsys, folder):
    shutil.copytree(vehicle.library._PRESETS / "maps", folder / "maps")
    car = (vehicle.library._PRESETS / "hev.toml").read_text()
    assert "mass_kg" in car
    (folder / "car.toml").write_text(car.replace("mass_kg", "mas_kg"))
    (folder / "mine.toml").write_text(preset_text().replace('vehicle = "hev"', 'vehicle = "car.toml"'))
    message = refuse(capsys, folder, "compare", "--concept", "mine.toml", "--cycle", "trip.csv")
    assert "unknown key chassis.mas_kg (did you mean 'mass_kg'?)" in message


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--policy", "rule_based"], ["nothing to solve", "choose stochastic"]),
        (["--policy", "perfect"], ["'perfect'", "did you mean 'perfect_information'?"]),
        (["--concept", "both"], ["takes one"]),
        (["--mu", "0.001,0.002"], ["takes one value"]),
        (["--mu", "-2"], ["--mu is '-2'"]),
        (["--out", "policy.npz"], ["must end in .nc"]),
        (["--out", "trip.csv/policy.nc"], ["is a file", "--out"]),
        (["--out", "folder.nc"], ["it is a folder"]),
        (["--out", "other.nc"], ["no policy file of socwise"]),
    ],
)
def test_solve_refuses(capsys, folder, arguments, parts):
    (folder / "folder.nc").mkdir()
    (folder / "other.nc").write_bytes(b"CDF\x01 of somebody else")
    message = refuse(capsys, folder, "solve", "--cycle", "trip.csv", *arguments)
    assert [part for part in parts if part not in message] == []


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["report", "absent"], ["there is no folder absent"]),
        (["report", "notes"], ["holds no results of socwise"]),
        (["report", "trip.csv"], ["trip.csv"]),
        (["cycles", "show", "wltc3"], ["'wltc3'", "did you mean"]),
        (["cycles", "plot", "hwfet", "--out", "picture.gif"], ["must end in .png or .svg or .pdf"]),
        (["cycles", "plot", "hwfet", "--out", "notes"], ["must end in"]),
        (["cycles", "plot", "hwfet", "--out", "trip.csv/a.png"], ["is a file"]),
        (["reproduce", "larsson-tabel2"], ["'larsson-tabel2'", "did you mean 'larsson-table2'?"]),
        (["reproduce", "larsson-table1", "nothing"], ["'nothing'"]),
        (["reproduce", "larsson-fig5", "--out", "trip.csv"], ["trip.csv", "is a file"]),
    ],
)
def test_the_other_commands_refuse(capsys, folder, arguments, parts):
    message = refuse(capsys, folder, *arguments)
    assert [part for part in parts if part not in message] == []

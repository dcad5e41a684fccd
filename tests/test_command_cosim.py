"""`socwise cosim`: inspect, probe and run with real FMUs, from the command line."""

import csv
import json
import math
import re
import shlex

import numpy as np
import pytest
from command_line import run, tree, write_cycle
from fmu_files import build_fmu, fmu_cell, mapping_text, needs_compiler

from bms.estimators.catalogue import make_estimator
from bms.estimators.gate import Sensors
from bms.log_checks import wrong_sign
from bms.logged_data import read_log
from socwise.estimation import run_estimator

pytestmark = needs_compiler

SECONDS = 240


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    build_fmu(tmp_path, file="plant.fmu")
    (tmp_path / "m.toml").write_text(mapping_text(), encoding="utf-8")
    (tmp_path / "cell.toml").write_text(cell_text(fmu_cell()), encoding="utf-8")
    rows = [f"{k},{3.0 * math.sin(k / 9.0):.6f}" for k in range(SECONDS + 1)]
    (tmp_path / "load.csv").write_text("\n".join(["time_s,current_A", *rows]) + "\n", encoding="utf-8")
    return tmp_path


def cell_text(cell):
    """A cell as TOML."""
    data = cell.model_dump(exclude_none=True)
    pairs, hysteresis = data.pop("relaxation"), data.pop("hysteresis")
    lines = [f"{key} = {json.dumps(value)}" for key, value in data.items()]
    for name, table in [*(("[relaxation]", pair) for pair in pairs), ("hysteresis", hysteresis)]:
        lines += [f"[{name}]", *(f"{key} = {value}" for key, value in table.items() if value is not None)]
    return "\n".join(lines) + "\n"


def cosim(capsys, *arguments, plant="plant.fmu", mapping="m.toml"):
    """A run in this process, without noise."""
    usual = ["--mapping", mapping, "--cell", "cell.toml", "--profile", "load.csv"]
    quick = ["--isolate", "no", "--noise", "no"]
    return run(capsys, "cosim", plant, *usual, *quick, *arguments)


def table(path):
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def test_a_drive_cycle_for_a_load(capsys, folder):
    """A pack that is large enough follows the car; its charge goes with the cycle's energy."""
    write_cycle(folder / "hill.csv")
    scale = {"scale": {"series": 83, "parallel": 10}, "pack": {"capacity_Ah": 25.0, "resistance_ohm": 0.1}}
    (folder / "p.toml").write_text(mapping_text(**scale), encoding="utf-8")
    usual = ["--mapping", "p.toml", "--cell", "cell.toml", "--isolate", "no", "--noise", "no", "--out", "c"]
    usual += ["--estimator", "coulomb"]
    done = run(capsys, "cosim", "plant.fmu", *usual, "--cycle", "hill.csv", "--start-soc", 0.6)
    assert done.code == 0, done.err
    assert "phev on" in done.out
    seen = table(folder / "c" / "log.csv")
    assert seen["time_s"].size == 61
    assert seen["soc"][-1] < 0.6


def test_inspect_writes_a_mapping_that_probe_takes(capsys, folder):
    done = run(capsys, "cosim", "inspect", "plant.fmu", "--out", "first.toml")
    assert done.code == 0, done.err
    assert re.search(r"FMI +2\.0", done.out)
    assert "co-simulation" in done.out
    assert "model-exchange" in done.out
    text = (folder / "first.toml").read_text("utf-8")
    assert text.count("# guess") > 5
    done = run(capsys, "cosim", "probe", "plant.fmu", "--mapping", "first.toml", "--isolate", "no")
    assert done.code == 1
    assert 'set positive = "charge" in [drive]' in " ".join(done.out.split())
    (folder / "first.toml").write_text(text.replace('"discharge"', '"charge"'), encoding="utf-8")
    probe = ["cosim", "probe", "plant.fmu", "--mapping", "first.toml", "--isolate", "no"]
    done = run(capsys, *probe, "--write", "--json")
    assert done.code == 0, done.err
    measured = json.loads(done.out)
    assert measured["ok"] is True
    mended = (folder / "first.toml").read_text("utf-8")
    assert re.search(rf"^resistance_ohm = {measured['resistance_ohm']:.6g} ", mended, re.MULTILINE)
    assert "# guess" in mended


def test_the_next_command_can_be_copied_whatever_the_file_is_called(capsys, folder):
    (folder / "plant.fmu").rename(folder / "my cell's.fmu")
    done = run(capsys, "cosim", "inspect", "my cell's.fmu", "--out", "to be checked.toml")
    last = done.out.strip().splitlines()[-1]
    words = ["socwise", "cosim", "probe", "my cell's.fmu", "--mapping", "to be checked.toml"]
    assert shlex.split(last) == words


def test_inspect_in_json(capsys, folder):
    done = run(capsys, "cosim", "inspect", "plant.fmu", "--json")
    found = json.loads(done.out)
    assert {one["kind"] for one in found["interfaces"]} == {"co-simulation", "model-exchange"}
    assert found["guess"]["drive"]["variable"] == "current"
    assert found["mapping"] is None
    assert found["runs_here"] is True


def test_inspect_never_writes_over_a_mapping_unasked(capsys, folder):
    before = (folder / "m.toml").read_text("utf-8")
    done = run(capsys, "cosim", "inspect", "plant.fmu", "--out", "m.toml")
    assert done.code == 2
    assert "--force" in done.err
    assert (folder / "m.toml").read_text("utf-8") == before
    assert run(capsys, "cosim", "inspect", "plant.fmu", "--out", "m.toml", "--force").code == 0
    assert (folder / "m.toml").read_text("utf-8") != before


def test_a_wrong_sign_stops_before_anything_is_run(capsys, folder):
    (folder / "w.toml").write_text(mapping_text(positive="discharge"), encoding="utf-8")
    done = cosim(capsys, "--out", "c", mapping="w.toml")
    assert done.code == 2
    assert 'set positive = "charge" in [drive]' in done.err
    assert not (folder / "c").exists()


def test_a_crash_names_the_step(capsys, folder):
    build_fmu(folder, file="plant.fmu", fault="error", fault_time=100.0)
    done = cosim(capsys, "--out", "c")
    assert done.code == 2
    assert "in step 101 of 240" in done.err or "in step 100 of 240" in done.err
    assert not (folder / "c").exists()


def test_what_is_shown_and_written(capsys, folder):
    """And the log that is written is one for `socwise estimate`, which says the same of it."""
    more = ["--estimator", "coulomb,ekf", "--current-sd", 0.01, "--out", "c"]
    done = cosim(capsys, *more)
    assert done.code == 0, done.err
    assert re.search(r"Battery: FMI 2\.0, co-simulation, in this process", done.out)
    assert re.search(r"the FMU: SOC from 70 to \d\d\.\d+ %", done.out)
    for name in ("coulomb", "ekf"):
        assert re.search(rf"^{name} ", done.out, re.MULTILINE)
    written = set(tree(folder / "c"))
    assert {"log.csv", "ekf.nc", "summary.csv", "figures/plant.png", "figures/soc.png"} <= written
    manifest = json.loads((folder / "c" / "manifest.json").read_text("utf-8"))
    assert set(manifest["files"]) == {name for name in written if (folder / "c" / name).is_file()}
    assert manifest["settings"]["mapping"]["drive"]["role"] == "current"
    own = json.loads((folder / "c" / "result.json").read_text("utf-8"))["estimators"][1]
    log = read_log(folder / "c" / "log.csv")
    assert wrong_sign(log.current_A, log.voltage_V) is False
    sensors = Sensors(holds="until", current_sd_A=0.01)
    again = run_estimator(make_estimator("ekf", fmu_cell(), soc=0.5, soc_sd=0.3, sensors=sensors), log)
    assert again.soc == pytest.approx(own["soc"]["final"], abs=1e-6)
    assert again.soc_rmse == pytest.approx(own["soc"]["rmse"], rel=1e-4)


def test_the_same_seed_gives_the_same_bytes(capsys, folder):
    """But for timings; isolation and the words of the command change nothing."""
    usual = ["--mapping", "m.toml", "--cell", "cell.toml", "--profile", "load.csv", "--estimator", "coulomb"]
    first = run(capsys, "cosim", *usual, "plant.fmu", "--isolate", "no", "--out", "a")
    second = run(capsys, "cosim", "run", "plant.fmu", *usual, "--isolate", "yes", "--out", "b")
    assert (first.code, second.code) == (0, 0), first.err + second.err
    a, b = tree(folder / "a"), tree(folder / "b")
    for name in ("log.csv", "coulomb.nc", "summary.csv", "figures/soc.png", "figures/plant.png"):
        assert a[name] == b[name], name


def test_help_and_a_misspelt_command(capsys):
    shown = run(capsys, "cosim", "--help")
    assert shown.code == 0
    for word in ("inspect", "probe", "run", "may be left out"):
        assert word in shown.out
    misspelt = run(capsys, "cosim", "inspct", "plant.fmu")
    assert misspelt.code == 2
    assert "inspect" in misspelt.err


BAD = {
    "no load": ([], "--profile DATA.csv"),
    "two loads": (["--profile", "load.csv", "--cycle", "wltc-3b"], "give one of the two"),
    "per cent": (["--profile", "load.csv", "--start-soc", "80"], "not per cent"),
    "no such file": (["--profile", "lod.csv"], "there is no file lod.csv"),
    "no such estimator": (["--profile", "load.csv", "--estimator", "efk"], "did you mean 'ekf'"),
    "no such cell": (["--profile", "load.csv", "--cell", "a132-26650"], "did you mean 'a123-26650'"),
    "another cell": (["--profile", "load.csv", "--series", "90"], "series"),
    "no such mapping": (["--profile", "load.csv", "--mapping", "n.toml"], "cannot read the mapping file"),
    "a step between": (["--profile", "load.csv", "--step", "1.5"], "whole multiple"),
    "a step of a cycle": (["--cycle", "wltc-3b", "--step", "2"], "leave it out"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_clear_message(case, capsys, folder):
    arguments, message = BAD[case]
    usual = ["--mapping", "m.toml", "--cell", "cell.toml", "--isolate", "no", "--out", "c"]
    done = run(capsys, "cosim", "plant.fmu", *usual, *arguments)
    assert done.code == 2
    assert message in done.err
    assert "Traceback" not in done.err
    assert "\n\n" not in done.err.strip()
    assert not (folder / "c").exists()


def test_a_place_that_was_not_filled_in(capsys, folder):
    (folder / "q.toml").write_text(mapping_text(voltage={"variable": "?"}), encoding="utf-8")
    done = run(capsys, "cosim", "probe", "plant.fmu", "--mapping", "q.toml")
    assert done.code == 2
    assert "'?'" in done.err
    assert "[voltage]" in done.err


@pytest.mark.parametrize("command", ["inspect", "probe"])
def test_a_file_that_is_no_fmu(command, capsys, folder):
    (folder / "no.fmu").write_text("hello", encoding="utf-8")
    mapping = ["--mapping", "m.toml"] if command == "probe" else []
    for name, words in {"no.fmu": "is not an FMU", "none.fmu": "none.fmu"}.items():
        done = run(capsys, "cosim", command, name, *mapping)
        assert done.code == 2
        assert words in done.err
        assert "Traceback" not in done.err

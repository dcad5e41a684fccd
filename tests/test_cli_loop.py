"""`socwise compare` and `identify-uncertainty` with a closed loop, end to end on a short cycle."""

import json
import tomllib

import numpy as np
import pytest
from command_line import preset_text, run, tree, write_cycle
from fmu_files import build_fmu, mapping_text, needs_compiler

from bms import load_pack
from bms.pack_cell import cell_from_pack
from drivecycles import load_cycle
from ems import load_concept
from ems.closed import ClosedLoop, FmuSource, Scatter, Training, compare_closed
from ems.concept import parse_concept
from socwise.commands.loop_options import names_of

HEV = ("--concept", "hev", "--cycle", "trip.csv", "--realizations", 4, "--training", "train.csv")
HEV = (*HEV, "--training-realizations", 3, "--jobs", 1)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_cycle(tmp_path / "trip.csv")
    write_cycle(tmp_path / "train.csv", 90)
    return tmp_path


def test_a_closed_loop_in_numbers_words_and_pictures(capsys, folder):
    chosen = ("stochastic", "certainty_equivalent")
    shown = run(
        capsys, "compare", "--plant", "ecm", "--estimator", "gpc-gradient", *HEV, "--out", "r",
        "--policy", ",".join(chosen),
    )  # fmt: skip
    assert (shown.code, shown.err) == (0, "")
    assert "Plant: ecm; estimator: gpc_gradient." in shown.out
    assert "HEV, identified on train in 3" in shown.out and "mu = " in shown.out
    found = json.loads((folder / "r" / "result.json").read_text(encoding="utf-8"))
    usual = {"schema", "seed", "cycle", "cases", "paired"}
    assert set(found) == usual | {"plant", "estimator", "identified", "dropped"}
    assert [case["policy"] for case in found["cases"]] == list(chosen)
    page = (folder / "r" / "report.html").read_text(encoding="utf-8")
    assert "The identified uncertainty model" in page and "gpc_gradient" in page
    files = tree(folder / "r")
    assert {"figures/hev_identified.png", "figures/hev_identified.svg"} <= set(files)
    settings = json.loads(files["manifest.json"])["settings"]
    assert settings["closed_loop"]["scatter"]["capacity_sd"] == 0.02
    # The page can be written again from the files.
    assert run(capsys, "report", "r").code == 0
    assert (folder / "r" / "report.html").read_text(encoding="utf-8") == page


def test_either_option_closes_the_loop():
    assert names_of(None, None) == names_of("model", "model") == ("model", "model")
    assert names_of(None, "coulomb") == ("ecm", "coulomb")
    assert names_of("ecm", None) == ("ecm", "ekf")
    assert names_of("mine.fmu", None) == ("mine.fmu", "ekf")


def test_cell_scatter_sensors_options_and_mu(capsys, folder):
    shown = run(
        capsys, "compare", "--plant", "ecm", *HEV, "--policy", "rule_based", "--json", "--out", "r",
        "--cell", "a123-26650", "--scatter", "capacity_sd=0.1", "--sensors", "current_bias_sd_A=0.5",
        "--option", "current_bias=true", "--mu", "0.01",
    )  # fmt: skip
    assert (shown.code, shown.err) == (0, "")
    found = json.loads(shown.out)
    assert (found["plant"], found["estimator"]) == ("ecm", "ekf")
    assert [case["mu"] for case in found["cases"]] == [0.01] != found["identified"]["hev"]["mu"]["value"]
    settings = json.loads((folder / "r" / "manifest.json").read_text(encoding="utf-8"))["settings"]
    loop = settings["closed_loop"]
    assert loop["cell"] == "a123-26650" and loop["cells"][0]["series"] == 58
    assert (loop["scatter"]["capacity_sd"], loop["sensors"]["current_bias_sd_A"]) == (0.1, 0.5)
    assert loop["estimator_options"] == {"current_bias": True}


def test_identify_uncertainty_writes_what_a_concept_takes(capsys, folder):
    shown = run(
        capsys, "identify-uncertainty", "--concept", "phev", "--estimator", "coulomb", "--cycle", "train.csv",
        "--realizations", 4, "--jobs", 1, "--out", "u",
    )  # fmt: skip
    assert (shown.code, shown.err) == (0, "")
    assert "PHEV" in shown.out and "squared error over the claimed variance" in shown.out
    assert set(tree(folder / "u")) == {"phev.toml", "phev.png", "uncertainty.json"}
    text = (folder / "u" / "phev.toml").read_text(encoding="utf-8")
    told = tomllib.loads(text)["uncertainty"]
    before = preset_text("phev")
    cut = before.index("[uncertainty]"), before.index("[rule_based]")
    concept = parse_concept(tomllib.loads(before[: cut[0]] + text + before[cut[1] :]), "own.toml")
    assert concept.uncertainty.model_dump() == told
    found = json.loads((folder / "u" / "uncertainty.json").read_text(encoding="utf-8"))
    assert found["identified"]["phev"]["beta"]["value"] == told["beta"]


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--plant", "model", "--estimator", "ekf"], ["takes a voltage", "--plant ecm"]),
        (["--plant", "ecm", "--estimator", "model"], ["takes a noisy SOC", "such as ekf"]),
        (["--estimator", "ekff"], ["no estimator is called 'ekff'", "did you mean 'ekf'?"]),
        (["--plant", "ecn"], ["--plant is 'ecn'", "model, ecm, or the path of an .fmu file"]),
        (["--plant", "gone.fmu"], ["there is no file gone.fmu"]),
        (["--plant", "mine.fmu"], ["needs --mapping", "socwise cosim inspect"]),
        (["--mapping", "m.toml"], ["--mapping is for a closed loop"]),
        (["--cell", "a123-26650"], ["--cell is for a closed loop"]),
        (["--training", "larsson"], ["--training is for a closed loop"]),
        (["--plant", "ecm", "--mapping", "m.toml"], ["--mapping is for a plant that comes as an FMU"]),
        (["--plant", "ecm", "--isolate", "no"], ["--isolate is for a plant that comes as an FMU"]),
        (["--plant", "ecm", "--cell", "a123-26560"], ["'a123-26560'", "did you mean 'a123-26650'?"]),
        (["--plant", "ecm", "--option", "terms"], ["--option is 'terms'", "KEY=VALUE"]),
        (["--plant", "ecm", "--option", "terms=3"], ["unknown key terms"]),
        (["--plant", "ecm", "--scatter", "capacity=1"], ["unknown key capacity", "capacity_sd"]),
        (["--plant", "ecm", "--sensors", "voltage_sd_V=-1"], ["--sensors does not fit", "voltage_sd_V"]),
        (["--plant", "ecm", "--training", "larson"], ["'larson'", "did you mean 'larsson'?"]),
        (["--plant", "ecm", "--realizations", "0"], ["0 realizations", "at least 1"]),
        (["--plant", "ecm", "--mu", "-1"], ["--mu is '-1'"]),
        (["--plant", "ecm", "--seed", "-1"], ["seed is -1"]),
        (["--plant", "ecm", "--cell", "nmc-lgm50"], ["cannot follow", "take a stronger vehicle or pack"]),
    ],
)
def test_what_does_not_go_together_is_refused(capsys, folder, arguments, parts):
    (folder / "mine.fmu").write_bytes(b"")
    before = tree(folder)
    shown = run(capsys, "compare", "--concept", "hev", "--cycle", "trip.csv", "--jobs", 1, *arguments)
    assert (shown.code, shown.out) == (2, "")
    assert shown.err.startswith("socwise: ") and "Traceback" not in shown.err
    for part in parts:
        assert part in shown.err
    assert tree(folder) == before


@needs_compiler
@pytest.mark.parametrize("isolate", [True, False], ids=["isolated", "in process"])
def test_an_fmu_of_the_circuit_gives_what_the_circuit_gives(folder, isolate):
    concept, trip, training = load_concept("hev"), load_cycle("trip.csv"), load_cycle("train.csv")
    cell = cell_from_pack(concept.load_pack())
    build_fmu(folder, cell=cell, kind="cs", file="hev.fmu")
    (folder / "hev.toml").write_text(mapping_text(cell=cell), encoding="utf-8")
    alike = Scatter(capacity_sd=0.0, resistance_sd=0.0, relaxation_sd=0.0, time_sd=0.0)
    circuit, foreign = (
        compare_closed(
            [concept], trip, ClosedLoop(plant=plant, scatter=alike), Training(training, 3),
            policies=["rule_based", "perfect_information"], realizations=3, jobs=1,
        )
        for plant in ("ecm", FmuSource(folder / "hev.fmu", folder / "hev.toml", isolate))
    )  # fmt: skip
    assert foreign.settings["plant"] == "hev.fmu"
    for ours, theirs in zip(circuit.cases, foreign.cases, strict=True):
        assert theirs.mu == pytest.approx(ours.mu, rel=1e-3)
        for name in ("soc", "soc_estimate", "current_A", "variance"):
            assert np.allclose(getattr(theirs.rollout, name), getattr(ours.rollout, name), atol=1e-6)
        assert np.ptp(ours.rollout.soc) > 0.01


@needs_compiler
def test_a_comparison_with_an_fmu(capsys, folder):
    cell = cell_from_pack(load_pack("hev"))
    build_fmu(folder, cell=cell, kind="cs", file="hev.fmu", fmi="3.0")
    (folder / "hev.toml").write_text(mapping_text(cell=cell), encoding="utf-8")
    shown = run(
        capsys, "compare", "--plant", "hev.fmu", "--mapping", "hev.toml", *HEV, "--policy", "rule_based",
        "--json", "--out", "r",
    )  # fmt: skip
    assert (shown.code, shown.err) == (0, "")
    assert (json.loads(shown.out)["plant"], json.loads(shown.out)["dropped"]) == ("hev.fmu", [])


@needs_compiler
def test_an_fmu_of_another_battery_is_refused(capsys, folder):
    """By its capacity, or by its voltage; and one whose current has the wrong sign by the probe."""
    build_fmu(folder, kind="cs", file="cell.fmu")
    common = ("compare", "--plant", "cell.fmu", "--mapping", "cell.toml", *HEV, "--policy", "rule_based")
    (folder / "cell.toml").write_text(mapping_text(), encoding="utf-8")
    shown = run(capsys, *common)
    assert shown.code == 2
    assert "gives the pack 2.5 Ah" in shown.err and "give the FMU's cell by --cell" in shown.err
    cell = cell_from_pack(load_pack("hev"))
    build_fmu(folder, cell=cell, kind="cs", file="cell.fmu", positive="discharge")
    (folder / "cell.toml").write_text(mapping_text(cell=cell), encoding="utf-8")
    shown = run(capsys, *common)
    assert shown.code == 2
    assert "does not behave as the mapping says" in shown.err and "discharge" in shown.err

"""`socwise traffic` and `socwise compare --cycle traffic:...`, end to end on a short road."""

import json

import numpy as np
import pytest
from command_line import run, tree
from scipy.io import netcdf_file
from traffic_cases import SMALL, changed

from drivecycles import load_cycle
from ems import load_concept
from socwise.commands.compare_traffic import traffic_comparison

REPORT = 'duration_s = 240.0\nscheme = "report"'


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(SMALL, encoding="utf-8")
    return tmp_path


def test_run_counts_vehicles_and_draws_the_road(capsys, folder):
    shown = run(capsys, "traffic", "run", "small.toml", "--out", "r")
    assert (shown.code, shown.err) == (0, "")
    assert "Capacity 3375 veh/h, demand 1500 veh/h" in shown.out
    assert set(tree(folder / "r")) == {
        "result.json", "manifest.json", "field.nc", "figures", "figures/speed.png", "figures/time_space.png"
    }  # fmt: skip
    with netcdf_file(folder / "r" / "field.nc", mmap=False) as file:
        speed = np.array(file.variables["speed_mps"][:])
    found = run(capsys, "traffic", "run", "small.toml", "--out", "r", "--json")
    result = json.loads(found.out)
    assert result["locations"][0]["speed_mps"]["end"] == pytest.approx(speed[-1, 5])
    assert result["imbalance_veh"] < 1e-10 and result["courant"] <= 1.0


def test_uncertainty_by_every_method(capsys, folder):
    methods = ["mc", "antithetic", "lhs", "sobol", "gpc"]
    options = ("--method", ",".join(methods), "--runs", 64, "--json", "--out", "r")
    shown = run(capsys, "traffic", "uncertainty", "small.toml", *options)
    assert (shown.code, shown.err) == (0, "")
    results = json.loads(shown.out)["results"]
    assert [found["method"] for found in results] == methods
    files = tree(folder / "r")
    for found in results:
        assert found["runs"] == (25 if found["method"] == "gpc" else 64)
        place = found["locations"][0]
        assert place["quantiles_mps"]["0.05"] < place["mean_mps"] < place["quantiles_mps"]["0.95"]
        assert place["mean_mps"] == pytest.approx(21.66, abs=4.0 * place["sd_mps"] / 8.0)
        assert place["sobol"]["free_flow_mps"]["total"] > 0.9
        assert {f"figures/fan_{found['method']}.png", f"{found['method']}.nc"} <= set(files)


@pytest.mark.slow
def test_errors_against_runs_and_several_methods(capsys, folder):
    shown = run(
        capsys, "traffic", "uncertainty", "small.toml", "--method", "gpc,mc", "--errors", "--out", "r"
    )
    assert (shown.code, shown.err) == (0, "")
    assert "gpc, 25 runs" in shown.out and "mc, 1024 runs" in shown.out
    curves = json.loads((folder / "r" / "result.json").read_text(encoding="utf-8"))["errors"]
    assert curves["gpc"]["rms_error_kmh"][1] < 0.1 * curves["mc"]["rms_error_kmh"][-1]
    assert (folder / "r" / "figures" / "errors.png").is_file()


def test_estimate_from_a_synthetic_log_and_from_a_file(capsys, folder):
    shown = run(capsys, "traffic", "estimate", "small.toml", "--seeds", 3, "--out", "r")
    assert (shown.code, shown.err) == (0, "")
    assert "free-flow speed [km/h]" in shown.out and "NEES" in shown.out
    first = json.loads((folder / "r" / "result.json").read_text(encoding="utf-8"))["estimates"][0]
    for name, limit in (("free_flow_mps", 0.02), ("jam_per_m", 0.15)):
        assert abs(first["parameters"][name]["error"]) < limit
    # The log that was made is one that can be given.
    again = run(
        capsys,
        "traffic",
        "estimate",
        "small.toml",
        "--data",
        folder / "r" / "readings.csv",
        "--json",
        "--out",
        "s",
    )
    second = json.loads(again.out)["estimates"][0]
    assert second["parameters"]["jam_per_m"]["value"] == pytest.approx(
        first["parameters"]["jam_per_m"]["value"], rel=1e-6
    )
    assert second["parameters"]["jam_per_m"]["truth"] is None and second["nees"] is None


CORRELATED = """
[[correlation]]
parameters = ["free_flow_kmh", "jam_per_km"]
value = 0.5
"""


def test_correlated_parameters_have_no_index_and_are_told_why(capsys, folder):
    (folder / "both.toml").write_text(SMALL + CORRELATED, encoding="utf-8")
    shown = run(capsys, "traffic", "uncertainty", "both.toml", "--out", "r")
    assert (shown.code, shown.err) == (0, "")
    said = " ".join(shown.out.split())
    assert "note: no Sobol indices" in said and "S free-flow" not in said and "S: total" not in said
    result = json.loads((folder / "r" / "result.json").read_text(encoding="utf-8"))
    assert all(place["sobol"] is None for place in result["results"][0]["locations"])
    assert len(result["notes"]) == 1 and "are correlated" in result["notes"][0]
    shown = run(capsys, "traffic", "uncertainty", "small.toml", "--out", "s", "--json")
    assert json.loads(shown.out)["notes"] == []


JAMMED = """
name = "jammed"
[road]
length_km = 6.0
cells = 40
[diagram]
kind = "triangular"
free_flow_kmh = 90.0
critical_density_per_km = 40.0
jam_per_km = 250.0
[demand]
time_s = [0.0, 300.0]
flow_vehph = [2000.0, 2600.0]
[[bottleneck]]
position_km = 4.0
capacity_vehph = 1800.0
start_s = 120.0
end_s = 600.0
[run]
duration_s = 1500.0
initial_per_km = 20.0
[detectors]
position_km = [0.5, 2.0, 3.5, 5.5]
noise_kmh = 2.0
guess = {free_flow_kmh = 72.0, jam_per_km = JAM}
"""


@pytest.mark.parametrize(("jam", "honest"), [(300.0, False), (220.0, True)])
def test_an_over_confident_estimate_says_so_from_its_readings_alone(capsys, folder, jam, honest):
    """From above the jam density is lost; the readings show it where no truth is known."""
    (folder / "jammed.toml").write_text(JAMMED.replace("JAM", str(jam)), encoding="utf-8")
    made = run(capsys, "traffic", "estimate", "jammed.toml", "--out", "r", "--json")
    truth = json.loads(made.out)["estimates"][0]["parameters"]["jam_per_m"]
    assert (abs(truth["error"]) < 0.05) == honest
    log = ("--data", folder / "r" / "readings.csv", "--out", "s")
    shown = run(capsys, "traffic", "estimate", "jammed.toml", *log)
    assert shown.code == 0
    assert ("note: NIS" in shown.out and "detectors.guess" in shown.out) != honest
    result = json.loads((folder / "s" / "result.json").read_text(encoding="utf-8"))
    assert (result["nis"]["verdict"] == "over-confident") != honest
    assert (result["notes"] == []) == honest


def test_a_first_guess_that_cannot_be_is_told_with_the_keys_of_the_file(capsys, folder):
    text = changed('kind = "greenshields"', 'kind = "greenberg"\noptimum_kmh = 70.0')
    (folder / "bad.toml").write_text(text.replace("[detectors]", "[detectors]\nguess = {optimum_kmh = 95.0}"))
    shown = run(capsys, "traffic", "estimate", "bad.toml", "--out", "r")
    assert shown.code == 2
    assert "detectors.guess (free_flow_kmh = 90," in shown.err and "optimum_kmh = 95)" in shown.err
    assert "give detectors.guess other values" in shown.err


def test_cycles_are_files_that_every_command_drives(capsys, folder):
    shown = run(capsys, "traffic", "cycles", "small.toml", "--seed", 2, "--out", "r", "--json")
    assert (shown.code, shown.err) == (0, "")
    result = json.loads(shown.out)
    assert [one["name"] for one in result["members"]] == ["small-1", "small-2", "small-3"]
    cycle = load_cycle(folder / "r" / "cycles" / "small-2.csv")
    assert cycle.duration_s == result["members"][1]["duration_s"]
    assert cycle.distance_m == pytest.approx(2000.0, rel=0.01)
    assert load_cycle(folder / "r" / "cycles" / "planned.csv").duration_s == result["planned"]["duration_s"]
    before = tree(folder / "r")
    assert run(capsys, "traffic", "cycles", "small.toml", "--seed", 2, "--out", "r").code == 0
    assert tree(folder / "r") == before


def test_compare_judges_on_the_ensemble(capsys, folder):
    shown = run(
        capsys, "compare", "--cycle", "traffic:small.toml", "--concept", "hev", "--mu", 0.002, "--out", "r",
        "--jobs", 1,
    )  # fmt: skip
    assert (shown.code, shown.err) == (0, "")
    said = " ".join(shown.out.split())
    assert "3 cycles of 2.0 km through uncertain traffic" in said and "of 3 cycles" in said
    result = json.loads((folder / "r" / "result.json").read_text(encoding="utf-8"))
    assert [case["realizations"] for case in result["cases"]] == [6] * 4
    assert result["ensemble"]["cycles"] == len(result["ensemble"]["members"]) == 3
    versus = [pair["versus"] for pair in result["ensemble"]["paired"]]
    assert versus == ["certainty_equivalent", "perfect_information", "rule_based"]
    assert result["cycle"]["name"] == "small"
    assert (folder / "r" / "report.html").is_file()


def test_half_of_the_realizations_is_the_number_of_cycles():
    options = {"realizations": 4, "policies": ["rule_based"], "mus": [0.002], "jobs": 1}
    found = traffic_comparison([load_concept("hev")], "traffic:small.toml", options, None)
    assert len(found.settings["ensemble"]["members"]) == 2
    assert found.cases[0].rollout.soc.shape[0] == 4
    assert found.settings["ensemble"]["scenario"]["name"] == "small"


@pytest.mark.slow
def test_twenty_cycles_through_a_jam_end_to_end(capsys, folder):
    shown = run(capsys, "compare", "--cycle", "traffic:commute", "--mu", 0.002, "--out", "r", "--json")
    assert (shown.code, shown.err) == (0, "")
    result = json.loads(shown.out)
    assert result["ensemble"]["cycles"] == 20
    for pair in result["paired"]:
        if pair["versus"] == "certainty_equivalent" and pair["concept"] == "hev":
            assert pair["cost_kg"]["ci95"][1] < 0.0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (("duration_s = 240.0", "duration_s = 240.0\nstep_s = 5.0"), "Courant number"),
        (("free_flow_kmh = 90.0", "free_flow_kmh = 0.0"), "must be positive"),
        (("sd = 5.0", "sd = 30.0"), "reaches below zero"),
        (("[0.3, 1.0, 1.7]", "[0.3, -1.0, 1.7]"), "a detector at -1000 m is outside the road"),
        (("name =", "nam ="), "did you mean 'name'"),
    ],
)
def test_a_bad_scenario_is_one_message_and_exit_code_2(capsys, folder, changes, said):
    (folder / "bad.toml").write_text(changed(*changes), encoding="utf-8")
    for command in (("traffic", "run", "bad.toml"), ("compare", "--cycle", "traffic:bad.toml")):
        shown = run(capsys, *command, "--out", "r")
        assert (shown.code, shown.out) == (2, "")
        assert said in shown.err and "Traceback" not in shown.err
        assert not (folder / "r").exists()


@pytest.mark.filterwarnings("default")
def test_a_demand_above_capacity_is_warned_of_and_handled(capsys, folder):
    (folder / "busy.toml").write_text(changed("flow_vehph = 1500.0", "flow_vehph = 5000.0"), encoding="utf-8")
    shown = run(capsys, "traffic", "run", "busy.toml", "--out", "r", "--json")
    assert shown.code == 0 and "warning: the demand reaches 5000 veh/h" in shown.err
    result = json.loads(shown.out)
    assert result["refused_veh"] == pytest.approx((5000.0 - 3375.0) / 3600.0 * 240.0)


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("command", ["run", "uncertainty", "estimate", "cycles"])
def test_a_scheme_that_blows_up_says_so(capsys, folder, command):
    busy = changed("flow_vehph = 1500.0", "flow_vehph = 4000.0", "duration_s = 240.0", REPORT)
    (folder / "busy.toml").write_text(busy, encoding="utf-8")
    shown = run(capsys, "traffic", command, "busy.toml", "--out", "r")
    assert (shown.code, shown.out) == (2, "")
    assert "blew up" in shown.err and "Traceback" not in shown.err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("traffic", "run", "comute"), "did you mean 'commute'"),
        (("traffic", "uncertainty", "small.toml", "--method", "sobl"), "did you mean 'sobol'"),
        (("traffic", "uncertainty", "small.toml", "--method", "mc,mc"), "twice"),
        (("traffic", "uncertainty", "small.toml", "--method", "mc", "--order", 3), "--order is for"),
        (("traffic", "uncertainty", "small.toml", "--method", "sobol", "--runs", 3), "runs, got 3"),
        (("traffic", "estimate", "small.toml", "--data", "none.csv"), "cannot read the readings none.csv"),
        (("traffic", "estimate", "small.toml", "--data", "x.csv", "--seeds", 2), "leave one out"),
        (("traffic", "cycles", "small.toml", "--cycles", 1), "two cycles or more"),
        (("compare", "--cycle", "traffic:"), "give traffic:NAME"),
        (("compare", "--cycle", "traffic:small.toml", "--realizations", 5), "give an even number"),
        (("compare", "--cycle", "traffic:small.toml", "--plant", "ecm"), "--plant model"),
    ],
)
def test_bad_options_are_one_message_and_exit_code_2(capsys, arguments, said):
    shown = run(capsys, *arguments, "--out", "r")
    assert (shown.code, shown.out) == (2, "")
    assert said in shown.err and "Traceback" not in shown.err

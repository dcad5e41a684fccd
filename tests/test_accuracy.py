"""The grid that is chosen for an accuracy leaves an error below it."""

import json
from functools import cache

import pytest
from command_line import run, write_cycle
from ems_cases import short_cycle

from drivecycles import load_cycle
from ems import GridSettings, build_policy, build_problem, load_concept
from ems.accuracy import choose_grid
from ems.errors import EmsError

FINE = GridSettings(
    soc_step=0.00125,
    deterministic_soc_step=1e-4,
    variance_rows=32,
    process_levels=24,
    torque_levels=80,
    soc_margin=0.4,
)


def maker(concept, cycle, **uncertainty):
    def make(settings):
        problem = build_problem(concept, cycle, settings=settings, on_infeasible="limit")
        changed = problem.uncertainty.model_copy(update=uncertainty)
        return type(problem)(**{**vars(problem), "uncertainty": changed})

    return make


def narrow(concept):
    """Half the window, penalties ten times as steep."""
    window = concept.window
    middle, half = (window.low + window.high) / 2.0, (window.high - window.low) / 4.0
    steep = {"low": middle - half, "high": middle + half}
    changed = concept.model_copy(update={"window": window.model_copy(update=steep), "initial_soc": middle})
    changed._folder = concept._folder
    return changed


@cache
def true_value(name, policy):
    return build_policy(policy, maker(load_concept(name), short_cycle(240))(FINE)).value_kg


@pytest.mark.parametrize("accuracy", [0.01, pytest.param(0.001, marks=pytest.mark.slow)])
@pytest.mark.parametrize("policy", ["stochastic", "certainty_equivalent", "perfect_information"])
@pytest.mark.parametrize("name", ["hev", "phev"])
def test_the_error_is_below_what_was_asked_for(name, policy, accuracy):
    make = maker(load_concept(name), short_cycle(240))
    choice = choose_grid(make, policy, accuracy)
    assert choice.reached
    assert choice.policy.value_kg == pytest.approx(true_value(name, policy), rel=accuracy)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["narrow", "small drift", "us06"])
@pytest.mark.parametrize("name", ["hev", "phev"])
def test_the_error_is_below_what_was_asked_for_in_hard_cases(name, case):
    concept, cycle = load_concept(name), load_cycle("us06" if case == "us06" else "hwfet")
    drift = {"gamma": 1e-8, "beta": 4e-9} if case == "small drift" else {}
    make = maker(narrow(concept) if case == "narrow" else concept, cycle, **drift)
    choice = choose_grid(make, "stochastic", 0.003)
    assert choice.reached
    true = build_policy("stochastic", make(FINE)).value_kg
    assert choice.policy.value_kg == pytest.approx(true, rel=0.003)


def test_what_cannot_be_reached_is_not_said_to_be(monkeypatch):
    monkeypatch.setattr("ems.accuracy.FINEST", dict.fromkeys(FINE.model_dump(), 0) | {"soc_step": 0.004})
    choice = choose_grid(maker(load_concept("hev"), short_cycle(240)), "stochastic", 1e-5)
    assert not choice.reached
    assert choice.estimated_error > 1e-5


@pytest.mark.parametrize("accuracy", [0.0, 0.5, float("nan")])
def test_an_accuracy_out_of_range_is_refused(accuracy):
    with pytest.raises(EmsError, match=r"relative error of the value that is allowed, 1e-05 to 0\.1"):
        choose_grid(maker(load_concept("hev"), short_cycle(60)), "stochastic", accuracy)


def test_a_policy_without_a_grid_is_refused():
    with pytest.raises(EmsError, match="has no grid; choose stochastic, certainty_equivalent"):
        choose_grid(maker(load_concept("hev"), short_cycle(60)), "rule_based", 0.01)


def test_the_command_reports_the_estimate(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_cycle(tmp_path / "trip.csv")
    asked = ("solve", "--cycle", "trip.csv", "--accuracy", "0.003", "--out", "p.nc")
    done = run(capsys, *asked, "--json")
    found = json.loads(done.out)
    assert done.code == 0
    assert found["accuracy"]["asked"] == 0.003
    assert found["accuracy"]["reached"]
    assert found["accuracy"]["estimated_error"] == pytest.approx(sum(found["accuracy"]["parts"].values()))
    assert found["grid"]["variance_rows"] == found["accuracy"]["settings"]["variance_rows"]
    assert 0.0 < found["memory_MB"] < found["expected_peak_memory_MB"] < 256.0
    done = run(capsys, *asked)
    assert done.code == 0
    assert "0.30% of the value: reached" in " ".join(done.out.split())
    done = run(capsys, "solve", "--cycle", "trip.csv", "--accuracy", "3", "--out", "p.nc")
    assert done.code == 2
    assert "such as 0.003" in " ".join(done.err.split())


def test_what_does_not_fit_in_memory_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_cycle(tmp_path / "trip.csv")
    monkeypatch.setattr("ems.memory.available_bytes", lambda: 1000)
    done = run(capsys, "solve", "--cycle", "trip.csv", "--out", "p.nc")
    assert done.code == 2
    assert "of memory, and 0.0 GB are available; take a larger soc_step" in " ".join(done.err.split())


def test_a_file_that_could_not_be_written_is_refused_before_the_solve(tmp_path, monkeypatch, capsys):
    """A long trip's cost-to-go is solved in parts, but its file holds all of it."""
    monkeypatch.chdir(tmp_path)
    write_cycle(tmp_path / "trip.csv")
    monkeypatch.setattr("ems.memory.available_bytes", lambda: 3_500_000)
    done = run(capsys, "solve", "--cycle", "trip.csv", "--out", "p.nc")
    assert done.code == 2
    assert "to write the cost-to-go over 201 SOC nodes" in " ".join(done.err.split())
    assert not (tmp_path / "p.nc").exists()

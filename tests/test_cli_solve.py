"""`socwise solve`: the file alone is enough to act as the policy does."""

import json

import numpy as np
import pytest
from command_line import run, tree, write_cycle
from scipy.io import netcdf_file

from bms import SocBelief
from drivecycles import load_cycle
from ems import build_policy, build_problem, load_concept


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_cycle(tmp_path / "trip.csv")
    return tmp_path


def read(path):
    """Read a policy file: attributes and arrays, as anybody without socwise would."""
    with netcdf_file(path, "r", mmap=False) as file:
        arrays = {name: np.array(variable[:]) for name, variable in file.variables.items()}
        return dict(file._attributes), arrays


def solved(policy):
    problem = build_problem(load_concept("hev"), load_cycle("trip.csv"))
    return build_policy(policy, problem.with_mu(0.002))


def act(attributes, arrays, step, soc, engine_on):
    """One step of a policy that acts on the estimate alone, from its file: current, look-up, least cost."""
    columns = np.arange(1, arrays["battery_power_W"].shape[1]) if engine_on else np.array([0])
    power = arrays["battery_power_W"][step, columns]
    ocv, discharge, charge, low, high = (
        np.interp(soc, arrays["soc"], arrays[name])
        for name in (
            "ocv_V",
            "discharge_resistance_ohm",
            "charge_resistance_ohm",
            "least_current_A",
            "greatest_current_A",
        )
    )
    ohm = np.where(power < 0.0, discharge, charge)
    wanted = (np.sqrt(np.maximum(ocv**2 + 4.0 * ohm * power, 0.0)) - ocv) / (2.0 * ohm)
    current = np.clip(wanted, low, high)
    withheld_W = np.where(wanted < low, current * (ocv + ohm * current) - power, 0.0)
    after_soc = soc + attributes["step_s"] * current / attributes["capacity_C"]
    after = np.array(
        [np.interp(after_soc, arrays["soc"], arrays["cost_to_go_kg"][step + 1, e, 0]) for e in (0, 1)]
    )
    if not engine_on:
        after[1] += attributes["start_fuel_kg"]
    cost = (
        arrays["stage_cost_kg"][step, columns]
        + withheld_W * attributes["step_s"] * attributes["shortfall_kg_per_MJ"] * 1e-6
        + after.min(axis=0)
    )
    best = int(np.argmin(cost))
    return int(columns[best]), int(after[1, best] < after[0, best])


def test_the_file_alone_acts_as_the_policy_does(capsys):
    shown = run(
        capsys, "solve", "--cycle", "trip.csv", "--policy", "certainty-equivalent", "--mu", "0.002",
        "--out", "p.nc",
    )  # fmt: skip
    assert (shown.code, shown.err) == (0, "")
    attributes, arrays = read("p.nc")
    assert attributes["acts_on"] == b"estimate"
    assert attributes["look_up"] == b"linear"
    policy = solved("certainty_equivalent")
    rng = np.random.default_rng(5)
    states = [(int(rng.integers(0, 60)), rng.uniform(0.5, 0.8), bool(rng.integers(0, 2))) for _ in range(200)]
    ours = [act(attributes, arrays, step, soc, engine_on) for step, soc, engine_on in states]
    theirs = [tuple(policy.act(SocBelief(soc, 1e-4), step, on)) for step, soc, on in states]
    assert ours == theirs
    assert len(set(ours)) > 5


@pytest.mark.parametrize(
    ("name", "acts_on"), [("stochastic", b"estimate and variance"), ("perfect_information", b"truth")]
)
def test_the_file_holds_the_solution(capsys, folder, name, acts_on):
    shown = run(
        capsys,
        "solve",
        "--cycle",
        "trip.csv",
        "--policy",
        name,
        "--mu",
        "0.002",
        "--out",
        "new/p.nc",
        "--json",
    )
    assert (shown.code, shown.err) == (0, "")
    summary = json.loads(shown.out)
    attributes, arrays = read("new/p.nc")
    policy = solved(name)
    assert np.array_equal(arrays["cost_to_go_kg"], policy.solution.cost_to_go_kg)
    assert np.array_equal(arrays["battery_power_W"], policy.problem.stages.power_W)
    assert attributes["acts_on"] == acts_on
    assert attributes["value_kg"] == summary["value_kg"] == policy.value_kg
    settings = json.loads(attributes["settings"])
    assert settings["concept"]["window"]["low"] == 0.55
    stages, engines, rows, nodes = arrays["cost_to_go_kg"].shape
    assert summary["grid"] == {
        "stages": stages,
        "engine_states": engines,
        "variance_rows": rows,
        "soc_nodes": nodes,
        "controls": arrays["battery_power_W"].shape[1],
    }
    assert (arrays["soc"].size, arrays["variance"].size) == (nodes, rows)
    assert (summary["concept"], summary["policy"], summary["mu"]) == ("hev", name, 0.002)
    assert summary["cycle"]["duration_s"] == 60.0
    # The value at the start, looked up in the file: nodes and rows enclose the belief.
    row = int(np.argmin(np.abs(arrays["variance"] - 0.01**2)))
    start = arrays["cost_to_go_kg"][0, 0, row] + arrays["offset_kg"][0]
    assert np.interp(0.65, arrays["soc"], start) == pytest.approx(policy.value_kg, rel=0.1)
    assert set(tree(folder)) == {"new", "new/p.nc", "trip.csv"}


def test_the_measurement_variance_is_mu_times_alpha_for_a_sure_estimate(capsys):
    """Row p = 0 of the table is no expectation at all: mu alpha(SOC), [L] eq 10, and alpha is at most 1."""
    assert run(capsys, "solve", "--cycle", "trip.csv", "--mu", "0.006", "--out", "p.nc").code == 0
    _, arrays = read("p.nc")
    alpha = load_concept("hev").load_pack().ocv.alpha(arrays["soc"])
    assert arrays["variance"][0] == 0.0
    assert arrays["measurement_variance"][0] == pytest.approx(0.006 * alpha, rel=1e-9)


def test_the_same_bytes_and_an_earlier_policy_is_replaced(capsys, folder):
    arguments = ("solve", "--cycle", "trip.csv", "--policy", "perfect_information", "--out", "p.nc")
    shown = run(capsys, *arguments)
    assert shown.code == 0
    assert "The policy is in p.nc" in shown.out
    first = (folder / "p.nc").read_bytes()
    assert run(capsys, *arguments).code == 0
    assert (folder / "p.nc").read_bytes() == first
    # Without --mu the concept's own holds.
    assert read("p.nc")[0]["mu"] == load_concept("hev").uncertainty.mu
    assert run(capsys, *arguments, "--concept", "phev").code == 0
    assert (folder / "p.nc").read_bytes() != first

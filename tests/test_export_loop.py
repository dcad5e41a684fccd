"""A whole cycle with an exported BMS, and with BMS and EMS both exported, against the loop in Python."""

import json
import subprocess
from functools import cache

import numpy as np
import pytest
from command_line import run
from ems_cases import full_problem
from export_fmus import Slave, fmu_of, run_alone
from fmu_files import needs_compiler

from bms.cells import load_cell
from bms.estimators.catalogue import estimator_names, make_estimator
from bms.estimators.gate import Sensors
from bms.export.c_source import export_c
from bms.pack_cell import cell_from_pack
from bms.plants.ecm import EcmPlant, Factors
from drivecycles import load_cycle
from ems import GridSettings, build_policy, build_problem, load_concept
from ems.export.c_source import REFUSALS, export_policy

pytestmark = needs_compiler
BOTH = pytest.mark.parametrize("version", [2, 3])

CURRENT_SD_A, VOLTAGE_SD_V = 0.2, 0.3
SENSORS = Sensors(holds="until", current_sd_A=CURRENT_SD_A, voltage_sd_V=VOLTAGE_SD_V)
START = {"soc": 0.6, "soc_sd": 0.08}


@cache
def coarse_policy():
    settings = GridSettings(soc_step=0.01, deterministic_soc_step=0.005, variance_rows=5, torque_levels=7)
    problem = build_problem(load_concept("hev"), load_cycle("ftp72"), settings=settings)
    return build_policy("stochastic", problem)


def battery(policy):
    """The concept's pack as a cell, and a specimen that is not what the BMS was told."""
    cell = cell_from_pack(policy.problem.pack)
    return cell, EcmPlant(cell, 0.67, factors=Factors(capacity=0.93, resistance=1.1))


class Sensed:
    """What the sensors of one drive say; the same noise for whoever asks."""

    def __init__(self, plant, steps):
        self.plant = plant
        self.noise = np.random.default_rng(11).normal(size=(steps, 2)) * (CURRENT_SD_A, VOLTAGE_SD_V)

    def step(self, k, power_W):
        found = self.plant.step(power_W, 0.0, 1.0)
        return found.current_A + self.noise[k, 0], found.voltage_V + self.noise[k, 1], found.temperature_C


@cache
def drive_in_python(policy, estimator):
    """Rows of (SOC, variance, control, power, current, voltage, temperature); the belief is that before."""
    cell, plant = battery(policy)
    bms = make_estimator(estimator, cell, sensors=SENSORS, **START)
    sensed, engine_on, rows = Sensed(plant, policy.problem.steps), False, []
    for k in range(policy.problem.steps):
        belief = bms.belief
        action = policy.act(belief, k, engine_on)
        power_W = policy.problem.stages.power_W[k, action.control]
        sample = sensed.step(k, power_W)
        rows.append((belief.mean, belief.variance, action.control, power_W, *sample))
        bms.update(sample[0], sample[1], 1.0, sample[2])
        engine_on = bool(action.engine_next)
    return np.array(rows), bms


def bms_block(policy, estimator):
    cell, _ = battery(policy)
    return export_c(make_estimator(estimator, cell, sensors=SENSORS, **START), "bms")


def check_bms(policy, estimator, version, tmp_path, tmp_path_factory):
    rows, bms = drive_in_python(policy, estimator)
    path = fmu_of(bms_block(policy, estimator), version, tmp_path_factory)
    steps = len(rows)
    inputs = {
        "time": np.arange(steps + 1.0),
        **{
            name: np.append(rows[:, column], rows[-1, column])
            for name, column in (("current_A", 4), ("voltage_V", 5), ("temperature_C", 6))
        },
    }
    problems, result = run_alone(path, tmp_path, inputs=inputs, stop=float(steps))
    assert problems == []
    belief = np.vstack([rows[:, :2], [bms.belief.mean, bms.belief.variance]])
    assert result["soc"] == pytest.approx(belief[:, 0], rel=0.0, abs=1e-9)
    assert result["soc_variance"] == pytest.approx(belief[:, 1], rel=0.0, abs=1e-9)
    for name, value in bms.parameters.items():
        assert result[name][-1] == pytest.approx(value.value, rel=1e-9)
        assert result[f"{name}_sd"][-1] == pytest.approx(value.sd, rel=1e-9)
    # It had something to find out, and found it.
    assert belief[0, 0] == pytest.approx(0.6)
    if estimator == "ekf":
        assert bms.belief.mean == pytest.approx(battery_end(policy, estimator), abs=0.03)


def battery_end(policy, estimator):
    """True SOC at the end of the drive."""
    rows, _ = drive_in_python(policy, estimator)
    _, plant = battery(policy)
    for power_W in rows[:, 3]:
        plant.step(float(power_W), 0.0, 1.0)
    return plant.soc


@BOTH
def test_an_estimator_over_a_whole_cycle_where_socwise_is_not(version, tmp_path, tmp_path_factory):
    check_bms(coarse_policy(), "ekf", version, tmp_path, tmp_path_factory)


@pytest.mark.slow
@BOTH
@pytest.mark.parametrize("estimator", [name for name in estimator_names() if name != "ekf"])
def test_every_estimator_over_a_whole_cycle(estimator, version, tmp_path, tmp_path_factory):
    check_bms(coarse_policy(), estimator, version, tmp_path, tmp_path_factory)


def check_loop(policy, estimator, versions, tmp_path, tmp_path_factory):
    rows, _ = drive_in_python(policy, estimator)
    source = export_policy(policy)
    ems = Slave(
        fmu_of(source.block, versions[1], tmp_path_factory, timing=source.timing, refusals=REFUSALS),
        versions[1],
        tmp_path / "ems",
    )
    bms = Slave(
        fmu_of(bms_block(policy, estimator), versions[0], tmp_path_factory), versions[0], tmp_path / "bms"
    )
    for slave in (ems, bms):
        slave.instantiate().start()
    sensed, found = Sensed(battery(policy)[1], len(rows)), []
    for k in range(len(rows)):
        soc, variance = bms.get("soc"), bms.get("soc_variance")
        ems.set(soc=soc, soc_variance=variance)
        ems.step(float(k), 1.0)
        power_W = ems.get("battery_power_W")
        sample = sensed.step(k, power_W)
        bms.set(current_A=sample[0], voltage_V=sample[1], temperature_C=sample[2])
        bms.step(float(k), 1.0)
        found.append((soc, variance, ems.get("control"), power_W, *sample))
    for slave in (ems, bms):
        slave.fmu.terminate()
        slave.fmu.freeInstance()
    found = np.array(found)
    assert np.array_equal(found[:, 2], rows[:, 2])
    assert found == pytest.approx(rows, rel=1e-9, abs=1e-9)
    assert len(set(rows[:, 2])) > 4


def test_bms_and_ems_both_exported_close_the_loop_as_python_does(tmp_path, tmp_path_factory):
    """One of each version of FMI, and the plant between them: nothing drifts apart over 1,370 steps."""
    check_loop(coarse_policy(), "ekf", (3, 2), tmp_path, tmp_path_factory)


@pytest.mark.slow
@pytest.mark.parametrize("concept", ["hev", "phev"])
def test_the_loop_on_the_default_cycle(concept, tmp_path, tmp_path_factory):
    policy = build_policy("stochastic", full_problem(concept))
    check_loop(policy, "gpc_ekf", (2, 3), tmp_path, tmp_path_factory)


def test_the_bms_command(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments = ("export", "bms", "--cell", "lfp-2ah", "--estimator", "gpc-ekf", "--soc0", "0.3")
    shown = run(capsys, *arguments, "--form", "c,fmu2", "--out", "there", "--json")
    assert (shown.code, shown.err) == (0, "")
    told = json.loads(shown.out)
    assert told["parameters"] == ["soc_start", "soc_sd_start"]
    assert sorted(path.name for path in (tmp_path / "there").iterdir()) == ["bms-fmi2.fmu", "bms.c", "bms.h"]
    problems, result = run_alone(tmp_path / "there" / "bms-fmi2.fmu", tmp_path, stop=1.0)
    assert problems == []
    belief = make_estimator("gpc_ekf", load_cell("lfp-2ah"), soc=0.3, soc_sd=0.3).belief
    assert (result["soc"][0], result["soc_variance"][0]) == pytest.approx((0.3, belief.variance), rel=1e-12)
    for more, says in (
        (("--estimator", "ekff"), "did you mean 'ekf'"),
        (("--step", "0"), "--step is 0"),
        (("--soc0", "30"), "--soc0 is 30"),
        (("--option", "nonsense=1"), "unknown key nonsense"),
        (("--name", "int"), "cannot be called 'int'"),
        (("--form", ""), "empty item"),
    ):
        shown = run(capsys, *arguments, *more)
        assert shown.code == 2
        assert says in shown.err


def test_the_bms_command_writes_a_replay(capsys, tmp_path, monkeypatch):
    """The command that it prints compiles a program that finds C and Python alike, and can find otherwise."""
    monkeypatch.chdir(tmp_path)
    rows = [f"{k},{2.0 * np.sin(k / 30.0):.4f},{3.3 + 0.05 * np.sin(k / 30.0):.4f}" for k in range(300)]
    (tmp_path / "log.csv").write_text("time_s,current_A,voltage_V\n" + "\n".join(rows) + "\n")
    arguments = ("--cell", "lfp-2ah", "--form", "c", "--holds", "from", "--replay", "log.csv", "--out", "o")
    shown = run(capsys, "export", "bms", *arguments)
    assert shown.code == 0, shown.err
    command = shown.err.partition("on this log: ")[2].strip()
    assert "-std=c99" in command
    assert subprocess.run(command, shell=True, capture_output=True).returncode == 0
    expected = tmp_path / "o" / "bms_replay.csv"
    lines = expected.read_text().splitlines()
    last = lines[-1].split(",")
    last[4] = repr(float(last[4]) + 1e-6)
    expected.write_text("\n".join([*lines[:-1], ",".join(last)]) + "\n")
    assert subprocess.run(command, shell=True, capture_output=True).returncode == 1

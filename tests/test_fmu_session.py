"""From a file and a mapping to realizations in SI: starts, bookkeeping, sign, order of calls, cleaning up."""

import gc
import tempfile
from pathlib import Path

import numpy as np
import pytest
from fmu_files import build_fmu, fmu_cell, mapping_text, needs_compiler

from bms.errors import BatteryError
from bms.plants.ecm import EcmPlant
from bms.plants.fmu.archive import unpack
from bms.plants.fmu.channel import Wiring
from bms.plants.fmu.errors import FmuCrash, FmuError
from bms.plants.fmu.in_process import open_channel
from bms.plants.fmu.mapping import load_mapping
from bms.plants.fmu.restore import comes_back, same
from bms.plants.fmu.roles import work_out
from bms.plants.fmu.session import open_fmu
from bms.plants.fmu.settle import trial_profile

pytestmark = needs_compiler
STEPS = 40
ROLES = ("drive", "voltage", "current", "temperature", "soc", "initial_soc")


@pytest.fixture
def opened(tmp_path, monkeypatch):
    """Open FMUs in this process, each closed in the end; nothing may be left of their folders."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    sessions = []

    def open_one(path, text=None, **mapping):
        file = Path(path).with_suffix(".toml")
        file.write_text(text or mapping_text(**mapping), encoding="utf-8")
        sessions.append(open_fmu(path, load_mapping(file), isolate=False))
        return sessions[-1]

    open_one.temporary = temporary
    yield open_one
    for session in sessions:
        session.close()
        session.close()
    assert list(temporary.iterdir()) == []


def powers_W(steps=STEPS, seed=1):
    return np.repeat(np.random.default_rng(seed).normal(0.0, 25.0, steps // 4), 4).tolist()


def run(plant, demand_W, step_s=1.0):
    return [plant.step(power, 0.0, step_s) for power in demand_W]


def test_charge_is_counted_where_no_output_tells_the_soc(opened, tmp_path):
    """The counted SOC is the integral of the measured current, and the FMU's own."""
    path = build_fmu(tmp_path)
    told, counted = opened(path).start(0.5), opened(path, soc=None).start(0.5)
    seen = run(told, powers_W())
    again = run(counted, powers_W())
    assert seen == again
    charge_As = sum(each.current_A for each in again)
    assert counted.soc == pytest.approx(0.5 + charge_As / (3600.0 * fmu_cell().capacity_Ah), abs=1e-14)
    assert counted.soc == pytest.approx(told.soc, abs=1e-12)


def test_power_is_met_at_the_start_of_a_step(opened, tmp_path):
    """I (V0 + R I) = P with the V0 that the FMU had; the rest is relaxation within the step."""
    plant = opened(build_fmu(tmp_path)).start(0.5)
    ohm = fmu_cell().resistance_ohm
    for power_W in powers_W():
        open_V = plant.voltage_V - ohm * plant.current_A
        seen = plant.step(power_W, 0.0, 1.0)
        assert seen.current_A * (open_V + ohm * seen.current_A) == pytest.approx(
            power_W, rel=1e-12, abs=1e-12
        )
        assert (plant.voltage_V, plant.current_A) == (seen.voltage_V, seen.current_A)
        assert seen.withheld_W == 0.0


def test_more_power_than_there_is_is_withheld(opened, tmp_path):
    """Beyond the maximum-power point, V0^2 / 4 R, what is missing is told."""
    plant = opened(build_fmu(tmp_path)).start(0.5)
    open_V, ohm = plant.voltage_V, fmu_cell().resistance_ohm
    seen = plant.step(-500.0, 0.0, 1.0)
    assert seen.current_A == pytest.approx(-open_V / (2.0 * ohm))
    assert seen.withheld_W == pytest.approx(500.0 - open_V**2 / (4.0 * ohm))


@pytest.mark.parametrize("drive", ["current", "power"])
def test_carrying_a_current_is_carrying_it(drive, opened, tmp_path):
    plant = opened(build_fmu(tmp_path, drive=drive), role=drive).start(0.5)
    reference = EcmPlant(fmu_cell(), 0.5)
    for current_A in (2.0, 2.0, -3.0, 0.0):
        seen, expected = plant.carry(current_A, 1.0), reference.carry(current_A, 1.0)
        assert seen.current_A == pytest.approx(current_A, abs=1e-9)
        assert seen.voltage_V == pytest.approx(expected.voltage_V, abs=1e-9)


def test_a_voltage_input_follows_the_power_closer_with_shorter_steps(opened, tmp_path):
    """The current moves under the voltage, and so the power by the end of a step: an error of first order."""
    path = build_fmu(tmp_path, drive="voltage")
    errors = []
    for step_s in (1.0, 0.5, 0.125):
        plant = opened(path, role="voltage", step_s=step_s).start(0.5)
        found_W = []
        for power_W in powers_W():
            plant.step(power_W, 0.0, 1.0)
            found_W.append(plant.voltage_V * plant.current_A)
        errors.append(np.abs(np.array(found_W) - powers_W()).max())
    assert errors[1] / errors[0] == pytest.approx(0.5, rel=0.2)
    assert errors[2] / errors[0] == pytest.approx(0.125, rel=0.2)


def test_first_outputs_that_are_zero_are_learnt(opened, tmp_path):
    late, prompt = (
        opened(build_fmu(tmp_path, zeros_first=zeros, file=f"{zeros}.fmu")).start(0.6)
        for zeros in (True, False)
    )
    assert late.voltage_V == pytest.approx(prompt.voltage_V, abs=1e-12)
    assert late.soc == pytest.approx(0.6)
    assert run(late, powers_W()) == run(prompt, powers_W())


def test_a_start_without_a_soc_is_the_fmus_own(opened, tmp_path):
    fmu = opened(build_fmu(tmp_path, initial_soc=0.31))
    assert fmu.start().soc == pytest.approx(0.31)
    assert fmu.start(0.8).soc == pytest.approx(0.8)
    assert fmu.start(None).soc == pytest.approx(0.31)


@pytest.mark.parametrize("soc", [-0.1, 1.1, 60.0, float("nan")])
def test_a_soc_that_is_none_is_refused(soc, opened, tmp_path):
    with pytest.raises(FmuError, match="give a fraction"):
        opened(build_fmu(tmp_path)).start(soc)


def test_a_soc_that_cannot_be_set_is_refused(opened, tmp_path):
    path = build_fmu(tmp_path, initial_soc=0.4)
    fmu = opened(path, initial_soc=None)
    assert fmu.start(0.4).soc == pytest.approx(0.4)
    with pytest.raises(FmuError, match=r"map \[initial_soc\]"):
        fmu.start(0.5)
    blind = opened(path, initial_soc=None, soc=None)
    assert blind.start(0.4).soc == 0.4
    with pytest.raises(FmuError, match="nothing tells at which SOC"):
        blind.start()


def test_a_voltage_that_is_none_is_refused(opened, tmp_path):
    with pytest.raises(FmuError, match="no voltage even after a step"):
        opened(
            build_fmu(tmp_path, declare="no"),
            units=dict(zip(ROLES, ("A", "V", "A", "K", "1", "1"), strict=True)),
            voltage={"variable": "crossings", "unit": "V"},
        ).start(0.5)


def test_one_realization_at_a_time(opened, tmp_path):
    fmu = opened(build_fmu(tmp_path))
    first = fmu.start(0.5)
    second = fmu.start(0.5)
    with pytest.raises(FmuError, match="another one was started"):
        first.step(1.0, 0.0, 1.0)
    second.step(1.0, 0.0, 1.0)
    fmu.close()
    with pytest.raises(FmuError, match="closed"):
        second.step(1.0, 0.0, 1.0)
    with pytest.raises(FmuError, match="open it again"):
        fmu.start(0.5)


def test_a_step_has_to_be_made_of_whole_ones(opened, tmp_path):
    plant = opened(build_fmu(tmp_path), step_s=0.5).start(0.5)
    plant.step(1.0, 0.0, 1.0)
    plant.step(1.0, 0.0, 0.5)
    for step_s in (0.75, 0.2, 0.0):
        with pytest.raises(FmuError, match="whole multiple"):
            plant.step(1.0, 0.0, step_s)
    plant.step(1.0, 0.0, 2.5)


def test_a_cell_that_is_flat_ends_the_realization(opened, tmp_path):
    plant = opened(build_fmu(tmp_path)).start(0.5)
    with pytest.raises(FmuCrash, match="beyond empty"):
        plant.carry(-400.0, 1.0)


def test_a_forgotten_session_cleans_up(opened, tmp_path):
    file = tmp_path / "m.toml"
    file.write_text(mapping_text(), encoding="utf-8")
    session = open_fmu(build_fmu(tmp_path), load_mapping(file), isolate=False)
    assert len(list(opened.temporary.iterdir())) == 1
    del session
    gc.collect()
    assert list(opened.temporary.iterdir()) == []


def test_nothing_is_left_of_one_that_cannot_be_opened(opened, tmp_path):
    with pytest.raises(BatteryError):
        opened(build_fmu(tmp_path), voltage={"variable": "volts"})
    assert list(opened.temporary.iterdir()) == []


def test_factors_hold_unit_sign_and_scale(opened, tmp_path):
    """100 cells in series and 4 strings, milliampere, positive when discharging."""
    units = {"drive": "mA", "voltage": "mV", "soc": "%"}
    path = build_fmu(tmp_path, positive="discharge", units=units)
    fmu = opened(path, positive="discharge", scale={"series": 100, "parallel": 4})
    roles = work_out(fmu.description, fmu.mapping)
    assert roles.drive.to_raw(4.0) == pytest.approx(-1000.0)
    assert roles.voltage is not None
    assert roles.voltage.conversion.to_si(3600.0) == pytest.approx(360.0)
    assert roles.initial_soc is not None
    assert roles.initial_soc.to_raw(0.25) == pytest.approx(25.0)
    profile = trial_profile(roles, 10.0, 100.0)
    assert profile == pytest.approx([-25.0, -25.0, 0.0, 25.0, 25.0])


@pytest.mark.parametrize(("fault", "expected"), [("none", True), ("reset_keeps", False)])
def test_an_fmu_comes_back_or_does_not(fault, expected, tmp_path):
    with unpack(build_fmu(tmp_path, fault=fault)) as folder:
        channel = open_channel(folder, Wiring("co-simulation", "current", ("voltage", "soc")))
        assert comes_back(channel, (), [1.0, -1.0]) is expected
        channel.close()


def test_equality_of_runs():
    nan = float("nan")
    assert same([1.0, nan], [1.0, nan])
    assert not same([1.0, nan], [1.0, 2.0])
    assert not same([1.0], [1.0, 1.0])
    assert same([1.0], [1.0 + 1e-13])
    assert not same([1.0], [1.0 + 1e-11])
    assert same([1e6], [1e6 + 1e-7])
    assert not same([1e6], [1e6 + 1e-5])


@pytest.mark.parametrize("drive", ["current", "power", "voltage"])
@pytest.mark.parametrize("load", [float("nan"), float("inf"), float("-inf")])
def test_a_load_that_is_no_number_does_not_reach_the_fmu(load, drive, opened, tmp_path):
    plant = opened(build_fmu(tmp_path, drive=drive), role=drive).start(0.5)
    with pytest.raises(FmuError, match="give a finite one"):
        plant.step(load, 0.0, 1.0)
    with pytest.raises(FmuError, match="whole multiple"):
        plant.step(1.0, 0.0, load)
    assert plant.step(1.0, 0.0, 1.0).voltage_V > 3.0

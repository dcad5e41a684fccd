"""A plant along a load: what its sensors see does not depend on how the FMU is dressed."""

import math

import numpy as np
import pytest
from fmu_files import build_fmu, fmu_cell, mapping_text, needs_compiler
from fmu_sessions import session

from bms.estimators.catalogue import make_estimator
from bms.estimators.gate import Sensors
from bms.load_profile import LoadProfile
from bms.logged_data import read_log
from bms.plants.ecm import EcmPlant
from bms.plants.fmu.errors import FmuCrash
from socwise.cosimulation import SensorFaults, drive_plant, measured, write_log
from socwise.estimation import run_estimator

pytestmark = needs_compiler

SECONDS = 240
CURRENT_A = 3.0 * np.sin(np.arange(SECONDS) / 9.0)
LOAD = LoadProfile(step_s=1.0, current_A=CURRENT_A)
UNITS = {"drive": "mA", "voltage": "mV", "soc": "%", "temperature": "degC", "current": "mA"}
DRESSES = {
    "discharge positive": ({"positive": "discharge"}, {"positive": "discharge"}),
    "other units": ({"fmi": "3.0", "units": UNITS}, {}),
    "no units": (
        {"units": UNITS, "declare": "no", "positive": "discharge"},
        {"units": UNITS | {"initial_soc": "%"}, "positive": "discharge"},
    ),
    "zeros first": ({"fmi": "3.0", "zeros_first": True}, {}),
    "no current": ({"outputs": ("voltage", "soc", "temperature")}, {"current": None}),
}


def driven(path, load=LOAD, soc=0.6, **mapping):
    with session(path, isolate=False, **mapping) as fmu:
        return drive_plant(fmu.start(soc), load)


@pytest.mark.parametrize("dress", DRESSES)
def test_the_clothes_of_an_fmu_do_not_matter(dress, tmp_path):
    built, mapped = DRESSES[dress]
    usual = driven(build_fmu(tmp_path, file="usual.fmu"))
    other = driven(build_fmu(tmp_path, file="other.fmu", **built), **mapped)
    for name in ("current_A", "voltage_V", "soc", "temperature_C"):
        np.testing.assert_allclose(getattr(other, name), getattr(usual, name), atol=1e-9, err_msg=name)


def test_the_charge_of_the_load_arrives(tmp_path):
    drive = driven(build_fmu(tmp_path))
    np.testing.assert_allclose(drive.current_A[1:], CURRENT_A, atol=1e-12)
    soc = 0.6 + np.concatenate(([0.0], np.cumsum(CURRENT_A))) / 9000.0
    np.testing.assert_allclose(drive.soc, soc, atol=1e-12)
    assert drive.ranges()["soc"] == [drive.soc[0], drive.soc[-1]]


def test_a_counted_soc_is_that_of_the_fmu(tmp_path):
    """Of an FMU that keeps its SOC to itself the charge is counted, from the SOC that it was started at."""
    told = driven(build_fmu(tmp_path, file="told.fmu"))
    silent = build_fmu(tmp_path, file="silent.fmu", outputs=("voltage", "current", "temperature"))
    with session(silent, mapping_text(soc=None), isolate=False) as fmu:
        counted = drive_plant(fmu.start(0.6), LOAD)
    np.testing.assert_allclose(counted.soc, told.soc, atol=1e-12)


def test_a_pack_is_its_cell(tmp_path):
    """20 in series and 3 in parallel under three times the current: the cell's SOC, 20 times its voltage."""
    path = build_fmu(tmp_path)
    one = driven(path)
    triple = LoadProfile(step_s=1.0, current_A=3.0 * CURRENT_A)
    scale = {"scale": {"series": 20, "parallel": 3}, "pack": {"capacity_Ah": 7.5, "resistance_ohm": 0.08}}
    many = driven(path, triple, **scale)
    np.testing.assert_allclose(many.soc, one.soc, atol=1e-12)
    np.testing.assert_allclose(many.voltage_V, 20.0 * one.voltage_V, rtol=1e-12)
    np.testing.assert_allclose(many.current_A, 3.0 * one.current_A, atol=1e-12)


@pytest.mark.parametrize("role", ["current", "power"])
def test_a_power_is_carried_as_our_own_circuit_does(role, tmp_path):
    power_W = np.where(np.arange(SECONDS) % 40 < 20, -20.0, 10.0)
    drive = driven(build_fmu(tmp_path, drive=role), LoadProfile(step_s=1.0, power_W=power_W), role=role)
    ours = EcmPlant(fmu_cell(), 0.6)
    seen = [ours.step(float(power), 0.0, 1.0) for power in power_W]
    np.testing.assert_allclose(drive.current_A[1:], [one.current_A for one in seen], rtol=0.02)
    np.testing.assert_allclose(drive.soc[-1], ours.soc, atol=1e-4)


def test_estimators_that_know_the_cell_and_the_start_stay_with_the_fmu(tmp_path):
    """The same circuit on both sides: nothing but rounding may be between them."""
    drive = driven(build_fmu(tmp_path))
    log = measured(drive, SensorFaults(), np.random.default_rng(0), "test")
    for name, least in (("coulomb", 1e-9), ("ekf", 1e-4)):
        sensors = Sensors(holds="until")
        run = run_estimator(make_estimator(name, fmu_cell(), soc=0.6, soc_sd=1e-3, sensors=sensors), log)
        assert run.soc_rmse < least
    assert run.residual_rms_V < 1e-5


def test_sensors_add_what_they_are_asked_for(tmp_path):
    drive = driven(build_fmu(tmp_path))
    faults = SensorFaults(current_sd_A=0.02, voltage_sd_V=0.003, current_offset_A=0.5)
    log = measured(drive, faults, np.random.default_rng(1), "test")
    error_A, error_V = log.current_A - drive.current_A, log.voltage_V - drive.voltage_V
    assert np.mean(error_A) == pytest.approx(0.5, abs=4.0 * 0.02 / math.sqrt(SECONDS))
    assert np.std(error_A) == pytest.approx(0.02, rel=0.2)
    assert np.std(error_V) == pytest.approx(0.003, rel=0.2)
    again = measured(drive, faults, np.random.default_rng(1), "test")
    np.testing.assert_array_equal(again.voltage_V, log.voltage_V)
    np.testing.assert_array_equal(log.soc_true, drive.soc)


def test_a_log_is_read_as_it_was_written(tmp_path):
    log = measured(driven(build_fmu(tmp_path)), SensorFaults(), np.random.default_rng(0), "test")
    write_log(log, tmp_path / "log.csv")
    again = read_log(tmp_path / "log.csv")
    for name in ("time_s", "current_A", "voltage_V", "temperature_C", "soc_true"):
        np.testing.assert_allclose(getattr(again, name), getattr(log, name), rtol=1e-8, atol=1e-12)
    assert again.doubts == ()


def test_an_empty_battery_is_mentioned(tmp_path):
    drain = LoadProfile(step_s=1.0, current_A=np.full(500, -10.0))
    path = build_fmu(tmp_path)
    drive = driven(path, drain, soc=0.5)
    log = measured(drive, SensorFaults(), np.random.default_rng(0), "test", ("first",))
    assert log.notes[0] == "first"
    assert "empty" in log.notes[1] or "leaves 0 to 1" in log.notes[1]


def test_a_crash_says_when(tmp_path):
    path = build_fmu(tmp_path, fault="error", fault_time=100.0)
    with pytest.raises(FmuCrash, match=r"in step 10[01] of 240"):
        driven(path)

"""What every estimator has in common: the base's checks, members, the loop's face, coulomb counting."""

import math

import numpy as np
import pytest
from battery_cases import drive_current_A, linear_cell

from bms.cells import load_cell
from bms.errors import BatteryError
from bms.estimators.catalogue import estimator_names, make_estimator
from bms.estimators.gate import Sensors
from bms.estimators.members import run_members
from bms.flags import Flag
from bms.measurement import Measurement
from bms.simulation import simulate, simulate_members


def noisy_log(cell, n=1500, seed=0, soc=0.5):
    rng = np.random.default_rng(seed)
    current = drive_current_A(n, seed)
    run = simulate(cell, current, soc=soc)
    return current + rng.normal(0.0, 0.01, n), run.voltage_V + rng.normal(0.0, 0.002, n), run.soc


@pytest.mark.parametrize("name", estimator_names())
def test_members_are_estimators_of_their_own(name):
    cell = load_cell("nmc-lgm50")
    current = drive_current_A(600, seed=1)
    many = simulate_members(cell, current, soc=[0.4, 0.5, 0.6], capacity_factor=[0.9, 1.0, 1.1])
    rng = np.random.default_rng(2)
    voltage = many.voltage_V + rng.normal(0.0, 0.002, many.voltage_V.shape)
    together = run_members(
        [make_estimator(name, cell) for _ in range(3)], current, voltage, every=50, threads=2
    )
    for i in range(3):
        alone = make_estimator(name, cell).run(current, voltage[i], every=50)
        assert np.array_equal(together.soc[i], alone.soc)
        assert np.array_equal(together.variance[i], alone.variance)
        for key, values in alone.parameters.items():
            assert np.array_equal(together.parameters[key][i], values)


def test_members_must_fit_together():
    cell = load_cell("lfp-2ah")
    one = make_estimator("coulomb", cell)
    with pytest.raises(BatteryError, match="one estimator or more"):
        run_members([], [0.0], [3.3])
    with pytest.raises(BatteryError, match="of one kind"):
        run_members([one, make_estimator("gpc_gradient", cell)], [0.0], [3.3])
    with pytest.raises(BatteryError, match=r"\(3, 1\) for 1"):
        run_members([one], np.zeros((3, 1)), [3.3])
    # They would share their memory, and each would go on where the other stopped.
    with pytest.raises(BatteryError, match=r"twice.*estimator\.copy\(\)"):
        run_members([one, make_estimator("coulomb", cell), one], [0.0], [3.3])
    run_members([one, one.copy()], [0.0], [3.3])


@pytest.mark.parametrize("name", estimator_names())
@pytest.mark.parametrize("cell_name", ["nmc-lgm50", "a123-26650"])
@pytest.mark.parametrize("series", [24, 96])
def test_a_pack_is_its_cell_though_beliefs_be_given_up(series, cell_name, name):
    """All volts times the cells in series: the same belief, whatever lies and holes there are."""
    cell = load_cell(cell_name)
    rng = np.random.default_rng(3)
    current = np.repeat(rng.normal(-0.1, 0.6, 720), 10) * cell.capacity_Ah
    run = simulate(cell, current, soc=0.7)
    current += rng.normal(0.0, 0.01, current.size)
    voltage = run.voltage_V + rng.normal(0.0, 0.002, current.size)
    voltage[2400:3600] += 0.15
    voltage[4000:4600] = math.nan
    current[5000:5400] = math.nan
    one = make_estimator(name, cell, soc=0.6, soc_sd=0.1).run(current, voltage)
    sensors = Sensors(voltage_sd_V=0.002 * series)
    pack = make_estimator(name, cell.scaled(series=series), soc=0.6, soc_sd=0.1, sensors=sensors)
    many = pack.run(current, series * voltage)
    if name != "coulomb":
        assert np.any(one.flags & int(Flag.MISMATCH))
    np.testing.assert_allclose(many.soc, one.soc, atol=1e-7)
    np.testing.assert_allclose(many.variance, one.variance, atol=1e-7)
    assert np.array_equal(many.flags, one.flags)


@pytest.mark.parametrize("name", estimator_names())
def test_a_loop_observes_what_update_takes(name):
    """Currents that hold until their sample: the same charge, one sample earlier."""
    cell = load_cell("lfp-2ah")
    until = Sensors(holds="until")
    observed = make_estimator(name, cell, sensors=until)
    updated = make_estimator(name, cell, sensors=until)
    for current, voltage in zip(*noisy_log(cell, 50)[:2], strict=True):
        belief = observed.observe(Measurement(current, voltage_V=voltage, temperature_C=24.0), 1.0)
        assert belief == updated.update(current, voltage, 1.0, 24.0)
    with pytest.raises(BatteryError, match="estimator 'model'"):
        observed.observe(Measurement(1.0, soc_from_voltage=0.5), 1.0)
    with pytest.raises(BatteryError, match="until"):
        make_estimator(name, cell).observe(Measurement(1.0, voltage_V=3.3), 1.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1.0, 2.0], [3.3]), "2 currents and 1 voltages"),
        (([], []), "one row of numbers"),
        (([1.0, 1.0], [3.3, 3.3], [1.0, -1.0]), "sample 1 is -1 s"),
        (([1.0, 1.0], [3.3, 3.3], [1.0, 1.0, 1.0]), "for 2 samples"),
    ],
)
def test_logs_that_do_not_fit_are_refused(arguments, message):
    with pytest.raises(BatteryError, match=message):
        make_estimator("coulomb", load_cell("lfp-2ah")).run(*arguments)


def test_time_that_runs_back_is_refused():
    estimator = make_estimator("coulomb", load_cell("lfp-2ah"))
    with pytest.raises(BatteryError, match="run"):
        estimator.run([1.0, 1.0, 1.0], [3.3, 3.3, 3.3], time_s=[0.0, 2.0, 1.0])
    with pytest.raises(BatteryError, match="is nan s"):
        estimator.update(1.0, 3.3, math.nan)
    with pytest.raises(BatteryError, match="every must be"):
        estimator.run([1.0], [3.3], every=0)


def test_unknown_estimators_get_a_suggestion():
    with pytest.raises(BatteryError, match="did you mean 'gpc_gradient'"):
        make_estimator("gpc-gradent", load_cell("lfp-2ah"))
    assert make_estimator("gpc-gradient", load_cell("lfp-2ah")).name == "gpc_gradient"
    with pytest.raises(BatteryError, match="load_cell"):
        make_estimator("ekf", "lfp-2ah")
    with pytest.raises(BatteryError, match="standard deviation of the SOC"):
        make_estimator("coulomb", load_cell("lfp-2ah"), soc_sd=-0.1)


def test_progress_is_reported_up_to_the_last_sample():
    done = []
    n = 450_001
    make_estimator("coulomb", linear_cell()).run(np.zeros(n), np.full(n, 3.2), every=7, progress=done.append)
    assert done == sorted(done)
    assert done[-1] == n
    assert len(done) == 3


def test_coulomb_counts_charge_and_its_doubt():
    """Closed forms: white noise, offset and capacity error add up as the module says."""
    cell, n = linear_cell(), 3600
    sensors = Sensors(current_sd_A=0.02)
    current = np.full(n, 1.0) + np.tile([1e-6, -1e-6], n // 2)
    estimator = make_estimator(
        "coulomb", cell, soc=0.3, soc_sd=0.01, sensors=sensors, bias_sd_A=0.005, capacity_share=0.03
    )
    passed = np.arange(n) * 1.0
    voltage = cell.ocv(0.3 + passed / 7200.0) + 0.019 * current + np.tile([1e-4, -1e-4], n // 2)
    trace = estimator.run(current, voltage)
    np.testing.assert_allclose(trace.soc, 0.3 + passed / 7200.0, atol=1e-9)
    expected = (
        1e-4 + 0.02**2 * passed / 7200.0**2 + (0.005 * passed / 7200.0) ** 2 + (0.03 * passed / 7200.0) ** 2
    )
    np.testing.assert_allclose(trace.variance, expected, rtol=1e-6)


def test_coulomb_doubts_its_count_while_the_voltage_contradicts_and_only_then():
    """On a linear curve 30 mV of model error and 3 sd are 12 % of SOC; a count off by more is doubted."""
    cell, n = linear_cell(), 3000
    noise = np.random.default_rng(1).normal(0.0, 1e-3, (2, n))
    for off, doubted in ((0.11, False), (0.3, True), (-0.27, True)):
        estimator = make_estimator("coulomb", cell, soc=0.5 + off, soc_sd=0.02)
        trace = estimator.run(-0.5 + noise[0], cell.ocv(0.5 - np.arange(n) / 14400.0) - 0.0095 + noise[1])
        assert np.any(trace.flags & Flag.MISMATCH) == doubted
        # The count stays what it is; its doubt grows to what the contradiction calls for, and no further.
        assert trace.soc[-1] == pytest.approx(0.5 + off - n / 14400.0, abs=1e-3)
        sd = np.sqrt(trace.variance[-1])
        assert ((abs(off) - 0.06) / 3.0 < sd + 0.002 < 0.3) if doubted else sd < 0.025


def test_coulomb_believes_a_rest_as_far_as_the_curve_is_steep():
    """At rest on a linear curve 5 mV are 1 % of SOC: the Kalman weight of that against the count."""
    cell = linear_cell()
    estimator = make_estimator("coulomb", cell, soc=0.5, soc_sd=0.02, rest_doubt_V=0.005, bias_sd_A=0.0)
    noise = np.random.default_rng(0).normal(0.0, 1e-6, 3700)
    estimator.run(noise, 3.0 + 0.5 * 0.6 + noise)
    gain = 0.02**2 / (0.02**2 + 0.01**2)
    assert estimator.belief.mean == pytest.approx(0.5 + gain * 0.1, abs=1e-4)
    assert estimator.belief.variance == pytest.approx((1.0 - gain) * 0.02**2, rel=1e-3)


def test_coulomb_is_not_misled_where_the_curve_is_flat():
    cell = load_cell("a123-26650")
    estimator = make_estimator("coulomb", cell, soc=0.5, soc_sd=0.02)
    noise = np.random.default_rng(0).normal(0.0, 1e-6, 3700)
    estimator.run(noise, float(cell.ocv(0.6)) + noise)
    assert estimator.belief.mean == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("name", estimator_names())
@pytest.mark.parametrize("soc", [0.0, 1.0])
def test_beliefs_stay_beliefs_at_the_ends(name, soc):
    """Driven beyond empty and full."""
    cell = load_cell("lfp-2ah")
    current = np.full(4000, 2.0 if soc else -2.0) + np.random.default_rng(0).normal(0.0, 0.01, 4000)
    voltage = simulate(cell, current, soc=soc).voltage_V
    trace = make_estimator(name, cell, soc=soc, soc_sd=0.1).run(current, voltage)
    assert np.all((trace.soc >= 0.0) & (trace.soc <= 1.0))
    assert np.all((trace.variance >= 0.0) & (trace.variance <= 1.0 / 12.0 + 1e-12))


@pytest.mark.parametrize("name", estimator_names())
def test_parameters_come_with_their_covariance(name):
    cell = load_cell("lfp-2ah")
    current, voltage, _ = noisy_log(cell, 3000)
    estimator = make_estimator(name, cell, soc=0.5)
    for _ in range(2):
        found = estimator.covariance
        deviations = np.array([parameter.sd for parameter in estimator.parameters.values()])
        assert found.shape == (deviations.size, deviations.size)
        np.testing.assert_allclose(np.sqrt(np.diag(found)), deviations, rtol=1e-9)
        if deviations.size:
            correlation = found / np.outer(deviations, deviations)
            assert np.linalg.eigvalsh(correlation).min() > -1e-9
            np.testing.assert_allclose(found, found.T)
        estimator.run(current, voltage, every=1000)
    if deviations.size:
        assert np.abs(correlation - np.eye(deviations.size)).max() > 0.01


def test_the_covariance_covers_that_of_many_seeds():
    """R and R_r of Gauss-Newton over 60 seeds of the noise, with five terms and no error of the model."""
    cell, n = load_cell("nmc-lgm50").with_values(thermal=None), 3600
    rng = np.random.default_rng(5)
    current = drive_current_A(n, seed=6, rms_A=4.0)
    voltage = simulate(cell, current, soc=0.5).voltage_V
    silent = Sensors(current_sd_A=0.0)
    found, believed = [], []
    for _ in range(60):
        estimator = make_estimator(
            "gpc_gauss_newton", cell, soc=0.5, soc_sd=0.05, terms=5, sensors=silent, model_error_V=0.0
        )
        estimator.run(current, voltage + rng.normal(0.0, 0.002, n), every=n)
        found.append([parameter.value for parameter in estimator.parameters.values()])
        believed.append(estimator.covariance)
    seen, told = np.cov(np.array(found).T), np.mean(believed, axis=0)
    for i in (1, 2):
        assert told[i, i] > 0.7 * seen[i, i]
    correlation = seen[1, 2] / np.sqrt(seen[1, 1] * seen[2, 2])
    assert told[1, 2] / np.sqrt(told[1, 1] * told[2, 2]) == pytest.approx(correlation, abs=0.35)


@pytest.mark.parametrize("name", [name for name in estimator_names() if name != "coulomb"])
def test_a_cell_warms_up_where_its_temperature_is_not_measured(name):
    """Resistances fall in the heat of the load: known by the thermal node, they leave no residual."""
    cell = load_cell("a123-26650").with_values(hysteresis=None)
    current = 7.0 * drive_current_A(7200, seed=3)
    run = simulate(cell, current, soc=0.5)
    assert run.temperature_C[-1] > 35.0
    rng = np.random.default_rng(1)
    current = current + rng.normal(0.0, 0.01, current.size)
    voltage = run.voltage_V + rng.normal(0.0, 0.002, current.size)
    fixed = cell.with_values(thermal=None)
    if name.startswith("gpc_g"):
        options = {"soc": 0.5, "soc_sd": 0.02, "start_after_s": 1e9}
    else:
        options = {"soc": 0.5, "soc_sd": 0.02, "estimate": ()}
    left = [
        np.sqrt(
            np.nanmean(make_estimator(name, nominal, **options).run(current, voltage).residual_V[-600:] ** 2)
        )
        for nominal in (cell, fixed)
    ]
    assert left[0] < 0.0025
    assert left[1] > 5.0 * left[0]

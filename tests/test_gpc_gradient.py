"""The report's recursive gPC estimator: against its equations written out, its published figures, honesty."""

import naive_bms
import numpy as np
import pytest
from battery_cases import drive_current_A, linear_cell

from bms.cells import load_cell
from bms.errors import BatteryError
from bms.estimators.catalogue import make_estimator
from bms.estimators.gate import Sensors
from bms.flags import Flag
from bms.simulation import simulate, simulate_members

GUESS = {
    "capacity_Ah": 2.2,
    "resistance_ohm": 0.010,
    "relaxation_resistance_ohm": 0.010,
    "relaxation_capacitance_F": 3000.0,
}
TRUTH = {
    "capacity_Ah": 2.0,
    "resistance_ohm": 0.008,
    "relaxation_resistance_ohm": 0.011,
    "relaxation_capacitance_F": 2700.0,
}
TABLE_8 = np.array([2e-14, 1e-8, 1e-10, 1e-5, 100.0])


def measured(cell, n, seed=0, soc=0.6, current_sd_A=0.01, voltage_sd_V=0.002):
    current = drive_current_A(n, seed)
    run = simulate(cell, current, soc=soc)
    rng = np.random.default_rng(seed + 1000)
    return (
        current + current_sd_A * rng.normal(size=n),
        run.voltage_V + voltage_sd_V * rng.normal(size=n),
        run.soc,
    )


@pytest.mark.parametrize("terms", [1, 2, 3, 4])
def test_the_kernel_is_the_reports_update_law(terms):
    """Eqs 73-85 in Legendre polynomials, term by term; the kernel works in the eigenbasis."""
    cell = load_cell("lfp-2ah")
    current, voltage, _ = measured(cell, 3000)
    start = (1 / 7920.0, 0.010, 1 / 3000.0, (1 / 30.0 - 0.04) / 0.02, 0.5 * 7920.0)
    gains = TABLE_8 * [30.0, 30.0, 30.0, 30.0, 3.0]  # so that 3,000 samples move the parameters visibly
    twin = naive_bms.gpc_gradient(cell.ocv, current, voltage, start, (0.02, 0.06), gains, terms, 0.9999)
    estimator = make_estimator(
        "gpc_gradient",
        cell,
        soc=0.5,
        terms=terms,
        forgetting=0.9999,
        initial=GUESS,
        sigma_per_s=(0.02, 0.06),
        gains=dict(zip(("alpha", "resistance", "beta", "xi", "x10"), gains, strict=True)),
    )
    trace = estimator.run(current, voltage)
    alpha, resistance, beta, xi, _, soc = twin.T
    assert abs(1 / alpha[-1] / 7920.0 - 1.0) > 0.005
    assert abs(resistance[-1] / 0.010 - 1.0) > 0.05
    for name, value in {
        "capacity_Ah": 1 / (3600.0 * alpha),
        "resistance_ohm": resistance,
        "relaxation_capacitance_F": 1 / beta,
        "relaxation_resistance_ohm": beta / (0.04 + 0.02 * xi),
    }.items():
        np.testing.assert_allclose(trace.parameters[name], value, rtol=1e-8)
    np.testing.assert_allclose(trace.soc, soc, atol=1e-10)


@pytest.mark.parametrize("name", ["gpc_gradient", "gpc_gauss_newton"])
@pytest.mark.parametrize("cell", ["lfp-2ah", "a123-26650"])
def test_running_equals_updating_to_the_bit(name, cell):
    cell = load_cell(cell)
    current, voltage, _ = measured(cell, 700)
    voltage[100], current[200], voltage[300] = np.nan, np.inf, 9.0
    time_s = np.cumsum(np.random.default_rng(0).choice([1.0, 0.5, 90.0], 700, p=[0.8, 0.19, 0.01]))
    options = {"soc": 0.4, "start_after_s": 50.0, "current_bias": True, "every_s": 7.0}
    warm = np.linspace(20.0, 30.0, 700)
    batch = make_estimator(name, cell, **options)
    trace = batch.run(current, voltage, time_s=time_s, temperature_C=warm)
    single = make_estimator(name, cell, **options)
    steps = np.diff(time_s, prepend=time_s[0])
    for k in range(700):
        belief = single.update(current[k], voltage[k], steps[k], warm[k])
        assert (belief.mean, belief.variance, int(single.flags)) == (
            trace.soc[k],
            trace.variance[k],
            trace.flags[k],
        )
    assert single.parameters == batch.parameters
    assert np.array_equal(single._memory, batch._memory, equal_nan=True)


def test_kept_rows_carry_the_flags_in_between():
    cell = load_cell("lfp-2ah")
    current, voltage, _ = measured(cell, 100)
    voltage[33] = np.nan
    every = make_estimator("gpc_gradient", cell).run(current, voltage)
    tenth = make_estimator("gpc_gradient", cell).run(current, voltage, every=10)
    assert np.array_equal(tenth.soc, every.soc[::10])
    assert np.array_equal(tenth.time_s, every.time_s[::10])
    assert np.flatnonzero(every.flags).tolist() == [33]
    assert np.flatnonzero(tenth.flags).tolist() == [4]


def test_one_term_is_the_deterministic_relaxation():
    """With one term and no noise, started at the truth, nothing is left to learn."""
    cell = linear_cell()
    current, voltage, soc = measured(cell, 2000, current_sd_A=0.0, voltage_sd_V=0.0)
    estimator = make_estimator("gpc_gradient", cell, soc=0.6, terms=1, sigma_per_s=(0.02, 2 / 29.7 - 0.02))
    trace = estimator.run(current, voltage)
    np.testing.assert_allclose(trace.residual_V, 0.0, atol=1e-12)
    np.testing.assert_allclose(trace.soc, soc, atol=1e-12)
    for name, value in TRUTH.items():
        assert estimator.parameters[name].value == pytest.approx(value, rel=1e-9)


def test_gauss_newton_solves_the_linear_problem_exactly():
    """A linear OCV without noise is least squares with one solution; five terms truncate nothing visible."""
    cell = linear_cell()
    current, voltage, soc = measured(cell, 7200, current_sd_A=0.0, voltage_sd_V=0.0)
    estimator = make_estimator("gpc_gauss_newton", cell, soc=0.4, terms=5, initial=GUESS)
    trace = estimator.run(current, voltage)
    assert trace.soc[-1] == pytest.approx(soc[-1], abs=1e-4)
    for name, value in TRUTH.items():
        assert estimator.parameters[name].value == pytest.approx(value, rel=2e-3)


def test_an_offset_of_the_current_sensor_is_found():
    cell = load_cell("nmc-lgm50")
    offset_A, n = 0.05, 24 * 3600
    current, voltage, soc = measured(cell, n, soc=0.5)
    with_bias = make_estimator("gpc_gauss_newton", cell, soc=0.5, soc_sd=0.05, current_bias=True)
    with_bias.run(current + offset_A, voltage, every=600)
    found = with_bias.parameters["current_bias_A"]
    assert found.value == pytest.approx(offset_A, abs=max(3 * found.sd, 0.005))
    assert with_bias.belief.mean == pytest.approx(soc[-1], abs=0.01)


def test_a_step_is_never_too_long():
    """Gains a million times too large and ten times the current: the quadratic form bounds the step."""
    cell = load_cell("lfp-2ah")
    current, voltage, _ = measured(cell, 4000)
    gains = dict(zip(("alpha", "resistance", "beta", "xi", "x10"), 1e6 * TABLE_8, strict=True))
    estimator = make_estimator("gpc_gradient", cell, soc=0.5, gains=gains, initial=GUESS)
    trace = estimator.run(current, voltage)
    assert np.sqrt(np.mean(trace.residual_V[-500:] ** 2)) < 0.004
    assert estimator.parameters["resistance_ohm"].value == pytest.approx(0.008, rel=0.1)


def test_gains_follow_the_cell():
    """Five cells in parallel are one large cell: same relative errors at every sample."""
    cell = load_cell("lfp-2ah")
    current, voltage, _ = measured(cell, 3000)
    large = cell.scaled(parallel=5)
    sensors = Sensors(current_sd_A=0.05)
    ones = make_estimator("gpc_gradient", cell.with_values(capacity_Ah=2.2), soc=0.4)
    fives = make_estimator("gpc_gradient", large.with_values(capacity_Ah=11.0), soc=0.4, sensors=sensors)
    small, big = ones.run(current, voltage), fives.run(5.0 * current, voltage)
    np.testing.assert_allclose(big.soc, small.soc, atol=1e-9)
    for name, factor in zip(TRUTH, (5.0, 0.2, 0.2, 5.0), strict=True):
        np.testing.assert_allclose(big.parameters[name], factor * small.parameters[name], rtol=1e-9)


@pytest.mark.parametrize("series", [24, 96])
def test_gains_follow_the_cells_in_series(series):
    cell = load_cell("lfp-2ah")
    current, voltage, _ = measured(cell, 3000)
    options = {"soc": 0.4, "soc_sd": 0.2, "current_bias": True}
    pack = make_estimator(
        "gpc_gradient",
        cell.scaled(series=series),
        sensors=Sensors(voltage_sd_V=0.002 * series),
        **options,
    )
    one = make_estimator("gpc_gradient", cell, **options).run(current, voltage)
    many = pack.run(current, series * voltage)
    np.testing.assert_allclose(many.soc, one.soc, atol=1e-12)
    np.testing.assert_allclose(many.variance, one.variance, atol=1e-12)
    for name, factor in zip(TRUTH, (1.0, series, series, 1.0 / series), strict=True):
        np.testing.assert_allclose(many.parameters[name], factor * one.parameters[name], rtol=1e-10)
    np.testing.assert_allclose(
        many.parameters["current_bias_A"], one.parameters["current_bias_A"], atol=1e-12
    )


@pytest.mark.parametrize("name", ["gpc_gradient", "gpc_gauss_newton"])
def test_reported_deviations_cover_the_errors(name):
    """24 h of 30 cells of unknown parameters: NEES of the SOC over the last hours."""
    cell, members, n = load_cell("lfp-2ah"), 30, 24 * 3600
    rng = np.random.default_rng(7)
    current = drive_current_A(n, seed=8)
    factors = {
        key: 1.0 + 0.08 * rng.uniform(-1.0, 1.0, members)
        for key in ("capacity_factor", "resistance_factor", "relaxation_factor", "time_factor")
    }
    starts = rng.uniform(0.55, 0.7, members)
    many = simulate_members(cell, current, soc=starts, **factors)
    inside = []
    for i in range(members):
        estimator = make_estimator(
            name, cell, soc=float(starts[i] + rng.normal(0.0, 0.05)), soc_sd=0.05, terms=4
        )
        noisy = current + rng.normal(0.0, 0.01, n), many.voltage_V[i] + rng.normal(0.0, 0.002, n)
        trace = estimator.run(*noisy, every=3600)
        error = trace.soc[2:] - many.soc[i, ::3600][2:]
        inside.append(np.abs(error) <= 2.0 * np.sqrt(trace.variance[2:]))
    assert np.mean(inside) >= 0.9


def test_the_variance_grows_when_the_model_is_wrong():
    """Two pairs and hysteresis behind the terminals, one pair and 5 % more resistance in the estimator."""
    cell = load_cell("lfp-2ah")
    wrong = cell.with_values(resistance_ohm=1.05 * cell.resistance_ohm)
    pair = cell.relaxation[0].model_dump(exclude_none=True)
    plant = cell.with_values(
        relaxation=(pair, {"resistance_ohm": 0.006, "time_constant_s": 900.0}),
        hysteresis={"voltage_V": 0.008, "rate": 60.0},
    )
    current = drive_current_A(12 * 3600, seed=3)
    rng = np.random.default_rng(4)
    noise = rng.normal(0.0, 0.002, current.size)
    for name in ("gpc_gradient", "gpc_gauss_newton"):
        deviations = []
        for truth, model in ((cell, cell), (plant, wrong)):
            run = simulate(truth, current, soc=0.6)
            # Without the error that is always allowed for, so that what residuals show is seen alone.
            estimator = make_estimator(name, model, soc=0.6, soc_sd=0.05, model_error_V=0.0)
            trace = estimator.run(current, run.voltage_V + noise, every=600)
            late = slice(36, None)
            error = trace.soc[late] - run.soc[::600][late]
            sd = np.sqrt(trace.variance[late])
            assert np.mean(np.abs(error) <= 2.0 * sd) >= 0.95, name
            deviations.append(sd.mean())
        assert deviations[1] > 3.0 * deviations[0], name


@pytest.mark.parametrize("name", ["gpc_gradient", "gpc_gauss_newton"])
def test_refused_voltages_put_the_counted_charge_in_doubt(name):
    # The current stays where it was as a charge begins: its reading is a lie that no jump gives away.
    cell = load_cell("lfp-2ah")
    rng = np.random.default_rng(3)
    true_A = np.repeat(rng.normal(-0.7, 1.1, 360), 10)
    true_A[2400:] = 1.0
    run = simulate(cell, true_A, soc=0.8)
    read_A = true_A + 0.01 * rng.normal(size=true_A.size)
    read_A[2400:2600] = -2.7
    voltage_V = run.voltage_V + 0.002 * rng.normal(size=true_A.size)
    trace = make_estimator(name, cell, soc=0.8, soc_sd=0.03).run(read_A, voltage_V)
    error, sd = np.abs(trace.soc - run.soc), np.sqrt(trace.variance)
    lied = slice(2415, 2600)
    assert np.all(trace.flags[lied] & int(Flag.OUTLIER))
    assert error[2599] > 0.08
    assert np.all(error[lied] <= np.maximum(2.0 * sd[lied], 0.03))
    # A voltage that is off for seconds is the voltage's fault.
    voltage_V[2000:2008] += 0.1
    spiked = make_estimator(name, cell, soc=0.8, soc_sd=0.03).run(read_A, voltage_V)
    assert spiked.variance[2008] == pytest.approx(trace.variance[2008], rel=0.05)


def test_full_charge_and_rest_correct_the_count():
    cell = load_cell("lfp-2ah")
    up = np.r_[np.full(3000, 1.0), np.full(7000, 0.05)]
    run = simulate(cell, up, soc=0.5)
    full_V = cell.full_charge_voltage_V
    voltage = np.where(np.arange(up.size) > 9000, full_V + 0.01, run.voltage_V)
    voltage = voltage + np.random.default_rng(0).normal(0.0, 1e-4, up.size)
    # The report's gradient alone would need hours for this error.
    estimator = make_estimator("gpc_gradient", cell, soc=0.3, soc_sd=0.2, start_after_s=1e9)
    before = estimator.copy()
    before.run(up[:9000], voltage[:9000])
    estimator.run(up, voltage)
    assert before.belief.mean < 0.85
    assert estimator.belief.mean == pytest.approx(1.0, abs=0.01)
    assert estimator.belief.variance < before.belief.variance / 10.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"terms": 0}, "terms"),
        ({"forgetting": 1.5}, "forgetting"),
        ({"sigma_per_s": (0.05, 0.02)}, "low < high"),
        ({"sigma_per_s": (0.05, 0.06)}, "outside sigma_per_s"),
        ({"initial": {"capacity_Ah": -1.0}}, "greater than 0"),
        ({"term": 3}, "did you mean 'terms'"),
        ({"soc": 50.0}, "fraction"),
    ],
)
def test_bad_options_are_explained(options, message):
    with pytest.raises(BatteryError, match=message):
        make_estimator("gpc_gradient", load_cell("lfp-2ah"), **options)


def test_a_cell_without_relaxation_is_refused():
    with pytest.raises(BatteryError, match="no relaxation pair"):
        make_estimator("gpc_gradient", linear_cell(relaxation=()))

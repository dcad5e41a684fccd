"""Circuits found again from simulated pulse tests: exactly without noise, within their intervals with it."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2
from scipy.stats import t as student

from bms import BatteryError
from bms.cells import load_cell
from bms.errors import BatteryWarning
from bms.identify import identify_pulse
from bms.pulse_guess import responses
from bms.pulse_model import spline_of
from bms.simulation import simulate

NOISE_V = 1e-3


def pulse_test(cell, steps, soc=0.53):
    """Rest, discharge, rest, half as long a charge, rest; every ``steps`` has its own length."""
    n = steps.size
    current = np.zeros(n)
    current[n // 20 : n // 3] = -cell.capacity_Ah
    current[n // 2 : 5 * n // 8] = cell.capacity_Ah
    return simulate(cell, current, steps, soc=soc)


def identify(run, cell, voltage_V=None, **options):
    measured = run.voltage_V if voltage_V is None else voltage_V
    return identify_pulse(
        run.time_s, run.current_A, measured, capacity_Ah=cell.capacity_Ah, ocv=cell.ocv, **options
    )


@pytest.fixture(scope="module")
def lfp():
    return load_cell("lfp-2ah")


@pytest.fixture(scope="module")
def nmc():
    return load_cell("nmc-lgm50").with_values(thermal=None)


def truth(cell):
    found = {"resistance_ohm": cell.resistance_ohm}
    for k, pair in enumerate(cell.relaxation, 1):
        time_s = pair.time_constant_s or pair.resistance_ohm * pair.capacitance_F
        found |= {
            f"relaxation_{k}_resistance_ohm": pair.resistance_ohm,
            f"relaxation_{k}_time_constant_s": time_s,
        }
    return found


@pytest.mark.parametrize("soc", [0.53, None])
@pytest.mark.parametrize("name", ["lfp", "nmc"])
def test_without_noise_the_circuit_is_found_exactly(name, soc, request):
    """Uneven steps, one and two pairs, initial SOC known and sought."""
    cell = request.getfixturevalue(name)
    pairs = len(cell.relaxation)
    steps = np.random.default_rng(3).uniform(0.5, 1.5, 300) * (1.0 if pairs == 1 else 4.0)
    found = identify(pulse_test(cell, steps), cell, pairs=pairs, soc=soc)
    expected = truth(cell) | ({"soc": 0.53} if soc is None else {})
    assert found.parameters == pytest.approx(expected, rel=1e-6)
    assert found.residual_rms_V < 1e-9
    assert found.unidentifiable == ()


def test_intervals_hold_the_truth_as_often_as_they_say(lfp):
    """40 seeds: some 95 % of 120 intervals, and the normalised squared errors follow chi-square."""
    run = pulse_test(lfp, np.ones(240))
    expected = truth(lfp)
    inside, squares = 0, 0.0
    for seed in range(40):
        noise = NOISE_V * np.random.default_rng(seed).standard_normal(240)
        found = identify(run, lfp, run.voltage_V + noise, soc=0.53)
        inside += sum(low <= expected[name] <= high for name, (low, high) in found.intervals.items())
        error = found.values - np.array(list(expected.values()))
        squares += float(error @ np.linalg.solve(found.covariance, error))
    assert 108 <= inside <= 119
    assert chi2.ppf(0.0005, 120) < squares < chi2.ppf(0.9995, 120)


def test_covariance_equals_that_of_another_least_squares(lfp):
    """scipy on the simulated cell, derivatives by differences: no casadi, no recursion of ours."""
    run = pulse_test(lfp, np.ones(240))
    measured = run.voltage_V + NOISE_V * np.random.default_rng(7).standard_normal(240)

    def residual(guess):
        pair = {"resistance_ohm": guess[1], "time_constant_s": guess[2]}
        cell = lfp.with_values(resistance_ohm=guess[0], relaxation=(pair,))
        return simulate(cell, run.current_A, 1.0, soc=guess[3]).voltage_V - measured

    other = least_squares(
        residual, [0.01, 0.01, 20.0, 0.5], x_scale=[0.01, 0.01, 10.0, 0.1], method="lm", xtol=1e-14
    )
    found = identify(run, lfp, measured)
    np.testing.assert_allclose(found.values, other.x, rtol=1e-4)
    spread = 2.0 * other.cost / (240 - 4)
    covariance = spread * np.linalg.inv(other.jac.T @ other.jac)
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), np.sqrt(np.diag(covariance)), rtol=0.01)
    low, high = found.intervals["resistance_ohm"]
    assert high - low == pytest.approx(
        2.0 * student.ppf(0.975, 236) * found.deviations["resistance_ohm"], rel=1e-12
    )
    assert found.residual_rms_V == pytest.approx(NOISE_V, rel=0.15)


def test_a_wider_level_gives_wider_intervals(lfp):
    run = pulse_test(lfp, np.ones(240))
    measured = run.voltage_V + NOISE_V * np.random.default_rng(1).standard_normal(240)
    narrow = identify(run, lfp, measured, soc=0.53, level=0.5).intervals["resistance_ohm"]
    wide = identify(run, lfp, measured, soc=0.53, level=0.99).intervals["resistance_ohm"]
    ratio = student.ppf(0.995, 237) / student.ppf(0.75, 237)
    assert wide[1] - wide[0] == pytest.approx(ratio * (narrow[1] - narrow[0]), rel=1e-9)


def test_the_spline_is_the_monotone_cubic(lfp):
    """Exact, nodes included; evaluated by scipy."""
    from scipy.interpolate import BSpline

    knots, coefficients = spline_of(lfp.ocv)
    spline = BSpline(knots, coefficients, 3)
    soc = np.concatenate((np.linspace(0.0, 1.0, 1001), lfp.ocv.soc))
    np.testing.assert_allclose(spline(soc), lfp.ocv(soc), rtol=1e-13)
    np.testing.assert_allclose(spline(soc[1:-1], 1), lfp.ocv.slope_V(soc[1:-1]), rtol=1e-9, atol=1e-9)


def test_first_responses_are_closed_form():
    """Constant 2 A into 1 ohm: 2 (1 - exp(-t / tau)), whatever the steps."""
    steps = np.array([1.0, 0.5, 3.0, 10.0])
    times = np.array([2.0, 30.0])
    elapsed = np.concatenate(([0.0], np.cumsum(steps)))
    expected = 2.0 * (1.0 - np.exp(-elapsed[:, None] / times))
    np.testing.assert_allclose(responses(steps, np.full(5, 2.0), times), expected, rtol=1e-14)


def test_a_cell_takes_the_found_circuit(nmc, lfp):
    run = pulse_test(nmc, np.full(300, 4.0))
    found = identify(run, nmc, pairs=2, soc=0.53)
    cell = found.apply_to(nmc.with_values(resistance_ohm=0.05, relaxation=()))
    again = simulate(cell, run.current_A, 4.0, soc=0.53)
    np.testing.assert_allclose(again.voltage_V, run.voltage_V, atol=1e-8)
    np.testing.assert_allclose(found.voltage_V, run.voltage_V, atol=1e-8)
    assert len(identify(pulse_test(lfp, np.ones(240)), lfp, soc=0.53).apply_to(nmc).relaxation) == 1


def test_a_second_pair_that_is_not_there_is_not_made_up(lfp):
    """A one-pair cell fitted with two: what the data cannot tell has no finite variance."""
    run = pulse_test(lfp, np.ones(240))
    measured = run.voltage_V + NOISE_V * np.random.default_rng(2).standard_normal(240)
    with pytest.warns(BatteryWarning, match="does not determine"):
        found = identify(run, lfp, measured, pairs=2, soc=0.53)
    assert found.unidentifiable
    assert all(found.deviations[name] == np.inf for name in found.unidentifiable)
    assert "resistance_ohm" not in found.unidentifiable


def test_an_initial_soc_cannot_be_told_on_a_level_ocv(lfp):
    """The OCV does not change, so neither does the voltage: a direction without any effect."""
    level = lfp.with_values(ocv_V=tuple(np.interp(lfp.soc, [0.0, 0.2, 0.8, 1.0], [2.5, 3.3, 3.3, 3.6])))
    run = pulse_test(level, np.ones(240))
    with pytest.warns(BatteryWarning, match="does not determine soc"):
        found = identify(run, level)
    assert found.unidentifiable == ("soc",)
    assert found.parameters["resistance_ohm"] == pytest.approx(0.008, rel=1e-6)


def test_a_circuit_that_does_not_follow_is_remarked_on(nmc):
    run = pulse_test(nmc, np.full(300, 4.0))
    measured = run.voltage_V + 1e-4 * np.random.default_rng(0).standard_normal(300)
    with pytest.warns(BatteryWarning, match="residuals are correlated"):
        found = identify(run, nmc, measured, pairs=1, soc=0.53)
    assert found.correlation > 0.5


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"pairs": 3}, "pairs must be 1 or 2"),
        ({"soc": 53.0}, "not per cent"),
        ({"level": 95.0}, "0.95 is usual"),
        ({"capacity_Ah": 0.0}, "capacity_Ah must be positive"),
        ({"capacity_Ah": 0.01}, "more than all"),
        ({"capacity_Ah": 0.2, "soc": 0.1}, "outside"),
        ({"current_A": np.ones(240)}, "no pulse"),
        ({"current_A": np.ones(239)}, "rows of one length"),
        ({"voltage_V": np.full(240, np.nan)}, "holds NaN"),
        ({"time_s": np.zeros(240)}, "increase strictly"),
    ],
)
def test_bad_tests_are_refused(lfp, change, said):
    run = pulse_test(lfp, np.ones(240))
    given = {
        "time_s": run.time_s,
        "current_A": run.current_A,
        "voltage_V": run.voltage_V,
        "capacity_Ah": 2.0,
        "ocv": lfp.ocv,
    }
    with pytest.raises(BatteryError, match=said):
        identify_pulse(**(given | change))


def test_too_few_samples_are_refused(lfp):
    with pytest.raises(BatteryError, match="need 6 samples or more, got 5"):
        identify_pulse(
            np.arange(5.0), [0.0, 1.0, 1.0, 0.0, 0.0], np.full(5, 3.3), capacity_Ah=2.0, ocv=lfp.ocv
        )


def test_casadi_is_imported_when_it_is_needed_and_missed_in_plain_words(lfp, monkeypatch):
    code = "import sys, bms.identify, bms.pulse_model; sys.exit('casadi' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    run = pulse_test(lfp, np.ones(240))
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(BatteryError, match="pip install"):
        identify(run, lfp, soc=0.53)

"""Little noise, and little learnt: the value keeps above its floor, and rows do not alternate."""

import dataclasses

import numpy as np
import pytest
from ems_cases import full_problem, short_problem, without_noise

from drivecycles import load_cycle
from ems import build_policy, build_problem, load_concept
from ems._sdp import damp_rows
from ems.floor import TOLERANCE, floor_kg
from ems.footprint import footprint
from ems.policies import stochastic
from ems.resolution import Resolution, belief_resolution, finer, row_damping, settled_spreads


def with_noise(problem, **uncertainty):
    return dataclasses.replace(problem, uncertainty=problem.uncertainty.model_copy(update=uncertainty))


def value_kg(problem, resolution):
    return stochastic._value_kg(problem, stochastic._solve(problem, resolution))


def test_an_error_that_falls_with_the_spacing_leaves_the_true_value_above_the_floor():
    for order in (1.0, 1.5, 2.0, 4.0):
        assert floor_kg(2.0 + 0.3, 2.0 + 0.3 * 0.5**order) <= 2.0
    assert floor_kg(2.0, 2.0) == pytest.approx(2.0 * (1.0 - TOLERANCE))
    assert floor_kg(-2.0, -2.0) == pytest.approx(-2.0 * (1.0 + TOLERANCE))


def test_only_a_wide_innovation_is_sure():
    problem = full_problem("hev")
    assert belief_resolution(problem).sure
    doubtful = belief_resolution(with_noise(problem, gamma=0.0, beta=4e-8, mu=0.05))
    assert doubtful == Resolution(0.0025, cubic=True, sure=False)
    cubic = [Resolution(0.0025 / parts, cubic=True) for parts in (2, 3, 5)]
    last = Resolution(0.0005, cubic=False)
    assert list(finer(problem, doubtful)) == [doubtful, *cubic, last]
    third = Resolution(0.0025 / 3, cubic=True, sure=False)
    assert list(finer(problem, third)) == [third, cubic[2], last]


def test_a_value_below_the_floor_is_not_believed():
    """On HWFET, where cubic look-ups on the usual grid lose 0.5 % though the belief spans five cells."""
    problem = build_problem(load_concept("hev"), load_cycle("hwfet"), on_infeasible="limit")
    problem = with_noise(problem, gamma=0.0, beta=4e-8, mu=0.05)
    true = value_kg(problem, Resolution(0.0005, cubic=True))
    assert value_kg(problem, belief_resolution(problem)) < 0.997 * true
    policy = build_policy("stochastic", problem)
    assert policy.value_kg == pytest.approx(true, rel=1e-3)
    assert policy.solution.grid.soc_step == pytest.approx(0.00125)
    # The memory that is foreseen is that of the finest that may be tried.
    assert footprint(problem, "stochastic").nodes > 3 * policy.solution.shape[3] / 2


def test_where_no_trial_holds_the_operators_cannot_overshoot(monkeypatch):
    monkeypatch.setattr(stochastic, "floor_kg", lambda coarse, half: float("inf"))
    problem = with_noise(short_problem("hev"), gamma=0.0, beta=4e-8, mu=0.05)
    policy = build_policy("stochastic", problem)
    assert policy.value_kg == value_kg(problem, Resolution(problem.settings.soc_step / 5, cubic=False))


def test_damping_leaves_what_is_smooth_and_takes_what_alternates():
    rows, spare = 8, np.empty((8, 3))
    p = np.arange(rows)[:, None] ** 2 * np.ones(3)  # rows are uniform in sqrt(p)
    smooth = 2.0 + 0.3 * p
    value = smooth.copy()
    damp_rows(0.1, value, spare)
    np.testing.assert_allclose(value, smooth, rtol=1e-13)
    value = smooth + 0.01 * (-1.0) ** np.arange(rows)[:, None]
    damp_rows(0.1, value, spare)
    np.testing.assert_allclose((value - smooth)[:-2, 0], 0.009 * (-1.0) ** np.arange(rows - 2), rtol=1e-12)
    np.testing.assert_array_equal(
        (value - smooth)[-2:, 0], (smooth + 0.01 * (-1.0) ** np.arange(rows)[:, None] - smooth)[-2:, 0]
    )


def test_rows_are_damped_as_the_variance_drifts_through_them():
    problem = full_problem("phev")
    by_mu = [row_damping(problem.with_mu(mu), 0.0025) for mu in (2e-3, 0.02, 0.05, 0.3, 100.0)]
    assert by_mu[0] == 0.05
    assert by_mu == sorted(by_mu, reverse=True)
    assert 0.0 < by_mu[-1] < 0.01
    drift = problem.uncertainty.process_variance(20.0, 1.0)
    _, belief = settled_spreads(problem.with_mu(0.3))
    assert by_mu[3] == pytest.approx(0.5 * drift / (2.0 * belief * 0.0025))
    assert row_damping(without_noise(problem), 0.0025) == 0.0


def test_what_says_little_costs_more_than_what_is_known():
    """At 0.02 the PHEV was promised 0.705 kg, less than with perfect information."""
    problem = full_problem("phev").with_mu(0.02)
    assert (
        build_policy("stochastic", problem).value_kg > build_policy("perfect_information", problem).value_kg
    )


@pytest.mark.slow
@pytest.mark.parametrize("mu", [0.02, 0.05, 0.3])
def test_a_measurement_that_says_little_costs_what_finer_rows_say(mu):
    problem = full_problem("phev").with_mu(mu)
    finer_rows = problem.settings.model_copy(update={"variance_rows": 32})
    coarse = build_policy("stochastic", problem).value_kg
    fine = build_policy("stochastic", dataclasses.replace(problem, settings=finer_rows)).value_kg
    assert coarse == pytest.approx(fine, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("beta", "mu"), [(1.6e-8, 0.017), (1e-9, 0.001), (1e-7, 1.0)])
def test_little_noise_on_the_long_way(beta, mu):
    """Without noise the HEV's optimum is 1.546 kg; the first case came out as 1.528."""
    problem = with_noise(full_problem("hev"), gamma=0.0, beta=beta, mu=mu)
    true = value_kg(problem, Resolution(0.0005, cubic=True))
    assert build_policy("stochastic", problem).value_kg == pytest.approx(true, rel=2e-3)

"""The SOC-uncertainty model of [L] eqs 1 to 13."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from bms import BatteryError, PiecewiseLinear, SocBelief, UncertaintyModel, load_pack
from bms.uncertainty import gain, innovation_spread, next_variance, posterior_variance, steady_variance

VARIANCE = st.floats(1e-9, 1e-1)


def variance_with_gain(k, p, measurement, drift):
    """First line of [L] eq 7: any gain, not only the best."""
    return (1.0 - k) ** 2 * p + drift + k**2 * measurement


@settings(deadline=None, max_examples=100)
@given(p=VARIANCE, measurement=VARIANCE, drift=VARIANCE, k=st.floats(-0.5, 1.5))
def test_gain_minimises_the_next_variance(p, measurement, drift, k):
    best = next_variance(p, measurement, drift)
    assert best == pytest.approx(variance_with_gain(gain(p, measurement), p, measurement, drift), rel=1e-9)
    # Second line of [L] eq 7: the excess is the square of the gain's error.
    excess = (p + measurement) * (k - gain(p, measurement)) ** 2
    assert variance_with_gain(k, p, measurement, drift) - best == pytest.approx(excess, rel=1e-6, abs=1e-15)


@settings(deadline=None, max_examples=100)
@given(p=VARIANCE, measurement=VARIANCE)
def test_a_measurement_never_hurts_and_variance_is_not_lost(p, measurement):
    posterior = posterior_variance(p, measurement)
    assert 0.0 < posterior <= min(p, measurement)
    # Total variance: what the estimate moves by is what the error loses.
    assert posterior + innovation_spread(p, measurement) ** 2 == pytest.approx(p, rel=1e-12)


def test_limits_of_the_gain():
    assert gain(0.0, 0.0) == 0.0
    assert gain(0.0, 1e-3) == 0.0
    assert gain(1e-3, 0.0) == 1.0
    assert gain(1, 1) == 0.5
    np.testing.assert_allclose(gain([0, 1, 3], 1), [0.0, 0.5, 0.75])


def test_certainty_stays_and_a_perfect_sensor_restores_it():
    assert next_variance(0.0, 2e-3, 0.0) == 0.0
    assert next_variance(0.0, 2e-3, 1e-6) == 1e-6
    assert innovation_spread(0.0, 2e-3) == 0.0
    # mu = 0: measured exactly, the estimate moves by the whole error.
    assert posterior_variance(4e-4, 0.0) == 0.0
    assert innovation_spread(4e-4, 0.0) == pytest.approx(2e-2)
    exact = UncertaintyModel(mu=0.0)
    assert exact.measurement_variance(0.6, 4e-4, load_pack("hev").ocv.alpha) == 0.0


def test_an_uninformative_sensor_leaves_the_drift_alone():
    assert next_variance(1e-4, 1e12, 3e-6) == pytest.approx(1.03e-4)


@settings(deadline=None, max_examples=50)
@given(
    measurement=st.floats(1e-6, 1e-1), drift=st.floats(1e-7, 1e-3), start=st.sampled_from([0.0, 1e-5, 1e-1])
)
def test_the_recursion_settles_at_the_fixed_point(measurement, drift, start):
    steady = steady_variance(measurement, drift)
    assert next_variance(steady, measurement, drift) == pytest.approx(steady, rel=1e-12)
    p = np.asarray(start)
    # Near the fixed point the error shrinks by (1 - K)^2 a step, with K of about sqrt(drift / measurement).
    for _ in range(int(20.0 / gain(steady, measurement)) + 20):
        p = next_variance(p, measurement, drift)
    assert p == pytest.approx(steady, rel=1e-6)


def test_process_variance_grows_with_current_either_way_and_with_time():
    model = UncertaintyModel()
    np.testing.assert_allclose(model.process_variance([-20.0, 0.0, 20.0], 1.0), [8.8e-6, 1e-6, 8.8e-6])
    assert model.process_variance(20.0, 0.5) == pytest.approx(4.4e-6)


def test_defaults_are_those_of_the_paper():
    model = UncertaintyModel()
    assert (model.gamma, model.beta, model.mu) == (1e-6, 3.9e-7, 2e-3)


def test_steady_state_of_the_hev_is_what_the_prototype_found():
    """ERRATA, [L] Fig 2: sqrt(p) of some 0.9, 1.2, 1.5 % for mu = 0.7, 2, 6e-3, at a mean |i| of 20 A."""
    alpha = load_pack("hev").ocv.alpha
    for mu, expected in ((0.7e-3, 0.009), (2e-3, 0.012), (6e-3, 0.015)):
        model = UncertaintyModel(mu=mu)
        p = np.asarray(0.0)
        for _ in range(400):
            w = model.measurement_variance(0.65, p, alpha)
            p = next_variance(p, w, model.process_variance(23.0, 1.0))
        assert np.sqrt(p) == pytest.approx(expected, abs=0.0008)
        assert p == pytest.approx(steady_variance(w, model.process_variance(23.0, 1.0)), rel=1e-6)


def test_measurement_variance_averages_alpha_over_the_belief():
    model = UncertaintyModel(mu=2e-3)
    line = PiecewiseLinear.continuous([0.0, 1.0], [0.2, 1.0])
    # Of a straight alpha only the mean matters.
    np.testing.assert_allclose(
        model.measurement_variance(0.6, [0.0, 1e-4, 1e-2], line), 2e-3 * 0.68, rtol=1e-12
    )
    peak = PiecewiseLinear.continuous([0.0, 0.6, 1.0], [0.0, 1.0, 0.0])
    certain, vague = model.measurement_variance(0.6, [0.0, 1e-2], peak)
    assert certain == 2e-3
    assert vague < certain


@pytest.mark.parametrize("current_A", [0.0, -25.0])
def test_variance_is_what_simulated_errors_have(current_A):
    """[L] eq 6 by Monte Carlo for a constant alpha: e' = (1 - K) e + d - K w."""
    model = UncertaintyModel(mu=2e-3)
    rng = np.random.default_rng(7)
    n, drift, measurement = 40_000, model.process_variance(current_A, 1.0), 2e-3 * 0.8
    p = np.asarray(1e-4)
    error = rng.normal(0.0, np.sqrt(p), n)
    for _ in range(40):
        k = gain(p, measurement)
        d, w = rng.normal(0.0, np.sqrt([[drift], [measurement]]), (2, n))
        error = (1.0 - k) * error + d - k * w
        p = next_variance(p, measurement, drift)
    # The variance of a sample variance is 2 p^2 / n; the mean has p / n.
    assert np.var(error) == pytest.approx(p, rel=4.0 * np.sqrt(2.0 / n))
    assert abs(error.mean()) < 4.0 * np.sqrt(p / n)


def test_the_estimate_moves_with_the_innovation_spread():
    """[L] eq 5 by Monte Carlo: the correction K (y - s) deviates by p / sqrt(p + sigma_w^2)."""
    rng = np.random.default_rng(11)
    p, measurement, n = 3e-4, 1.2e-3, 40_000
    innovation = rng.normal(0.0, np.sqrt(p), n) + rng.normal(0.0, np.sqrt(measurement), n)
    moved = gain(p, measurement) * innovation
    assert moved.std() == pytest.approx(innovation_spread(p, measurement), rel=4.0 / np.sqrt(2.0 * n))


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"mu": -1e-3}, "mu"),
        ({"gamma": np.nan}, "gamma"),
        ({"beta": np.inf}, "beta"),
        ({"sigma": 1.0}, "sigma"),
    ],
)
def test_bad_parameters_are_refused_by_name(parameters, said):
    with pytest.raises(ValidationError, match=said):
        UncertaintyModel(**parameters)


def test_beliefs_are_checked():
    belief = SocBelief(0.65, 1e-4)
    assert (belief.mean, belief.variance) == (0.65, 1e-4)
    for mean in (-0.01, 65.0, np.nan):
        with pytest.raises(BatteryError, match=r"outside \[0, 1\]"):
            SocBelief(mean, 1e-4)
    for variance in (-1e-9, np.nan):
        with pytest.raises(BatteryError, match="variance"):
            SocBelief(0.65, variance)

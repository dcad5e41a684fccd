"""Smoothing weights are the Gaussian expectation of the cubic interpolant."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from ems.smoothing import smoothing_weights


@pytest.mark.parametrize("rho", [1e-3, 0.3, 1.0, 2.7, 7.5])
def test_weights_reproduce_the_moments_of_a_gaussian(rho):
    step = 0.01
    weights = smoothing_weights(np.full((1, 3), rho * step), step)[0, :, 1]
    x = np.arange(-(weights.size // 2), weights.size // 2 + 1) * step
    assert weights.sum() == pytest.approx(1.0, abs=1e-12)
    assert weights @ x == pytest.approx(0.0, abs=1e-12)
    assert weights @ x**2 == pytest.approx((rho * step) ** 2, rel=2e-5)
    assert weights @ x**3 == pytest.approx(0.0, abs=1e-12)


def test_no_spread_is_the_identity_and_rows_are_independent():
    weights = smoothing_weights(np.array([[0.0, 0.0], [0.02, 0.0]]), 0.01)
    middle = weights.shape[1] // 2
    assert np.array_equal(weights[0, middle], [1.0, 1.0])
    assert np.count_nonzero(weights[0]) == 2
    assert np.array_equal(weights[1, :, 1], np.eye(1, weights.shape[1], middle)[0])


def cardinal(x):
    x = abs(x)
    if x < 1.0:
        return 1.0 - 0.5 * x - x**2 + 0.5 * x**3
    return 1.0 - 11.0 / 6.0 * x + x**2 - x**3 / 6.0 if x < 2.0 else 0.0


@pytest.mark.parametrize("rho", [0.4, 1.6])
def test_each_weight_is_an_integral_over_the_cardinal_function(rho):
    weights = smoothing_weights(np.full((1, 1), rho), 1.0)[0, :, 0]
    middle = weights.size // 2
    for t in range(-3, 4):
        integral = sum(
            quad(lambda x, t=t: cardinal(x - t) * norm.pdf(x, scale=rho), a, a + 1.0)[0]
            for a in range(t - 2, t + 2)
        )
        assert weights[middle + t] == pytest.approx(integral, abs=1e-6)

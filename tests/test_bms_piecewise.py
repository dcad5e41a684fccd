"""The closed-form Beta expectation of [L] eqs 10-13 against quadrature, and its limits."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, stats

from bms import BatteryError, PiecewiseLinear, load_pack
from bms.piecewise import LARGEST_RELATIVE_VARIANCE, POINT_MASS_VARIANCE
from gpc import beta_rule

WINDOW = PiecewiseLinear(np.array([0.55, 0.75]), np.array([1.0, 0.0]), np.array([0.0, 1.0]))
"""0 inside the HEV's window, 1 outside: all jump."""

TENT = PiecewiseLinear.continuous([0.0, 0.4, 1.0], [0.2, 1.0, -0.5])

SAWTOOTH = PiecewiseLinear(
    np.array([0.1, 0.3, 0.6, 0.95]), np.array([2.0, -1.0, 0.5, 3.0]), np.array([0.0, 0.5, -2.0, 1.0])
)


def shapes(mean, variance):
    """Shape parameters a and b, [L] eqs 12 and 13."""
    precision = mean * (1.0 - mean) / variance - 1.0
    return mean * precision, (1.0 - mean) * precision


def by_quadrature(function, mean, variance):
    """The expectation, by adaptive quadrature of every piece and with the weight's end singularities."""
    a, b = shapes(mean, variance)
    norm = np.exp(-stats.beta.logpdf(0.5, a, b) - (a + b - 2.0) * np.log(2.0))
    knots = sorted({0.0, 1.0, *function.soc.tolist(), *np.linspace(0.0, 1.0, 9).tolist()})
    total = 0.0
    for low, high in pairwise(knots):
        # The density's powers at 0 and 1 are the rule's own weight, the rest is smooth inside a piece.
        powers = (a - 1.0 if low == 0.0 else 0.0, b - 1.0 if high == 1.0 else 0.0)

        def smooth(x, low=low, high=high):
            x = np.clip(x, low, high)
            rest = (1.0 if low == 0.0 else x ** (a - 1.0)) * (1.0 if high == 1.0 else (1.0 - x) ** (b - 1.0))
            inside = np.clip(x, np.nextafter(low, 2.0), np.nextafter(high, -1.0))
            return float(function(inside)) * rest

        if powers == (0.0, 0.0):
            part = integrate.quad(smooth, low, high, epsabs=1e-13, epsrel=1e-12)[0]
        else:
            part = integrate.quad(smooth, low, high, weight="alg", wvar=powers, epsabs=1e-13, epsrel=1e-12)[0]
        total += part
    return total / norm


@pytest.mark.parametrize("function", [WINDOW, TENT, SAWTOOTH], ids=["window", "tent", "sawtooth"])
@pytest.mark.parametrize("mean", [0.03, 0.3, 0.55, 0.8, 0.97])
@pytest.mark.parametrize("share", [0.01, 0.2, 0.7, 0.9])
def test_expectation_equals_adaptive_quadrature(function, mean, share):
    variance = share * mean * (1.0 - mean)
    expected = by_quadrature(function, mean, variance)
    assert function.expectation(mean, variance) == pytest.approx(expected, rel=1e-8, abs=1e-9)


@pytest.mark.parametrize("name", ["hev", "phev"])
def test_expectation_of_alpha_equals_gauss_jacobi(name):
    alpha = load_pack(name).ocv.alpha
    for mean in (0.05, 0.3, 0.65, 0.9):
        for deviation in (0.005, 0.015, 0.04):
            nodes, weights = beta_rule(*shapes(mean, deviation**2), 60)
            # 60 points see a function with a kink at every per cent only to this accuracy.
            closed = alpha.expectation(mean, deviation**2)
            assert closed == pytest.approx(weights @ alpha(nodes), rel=5e-4)


def test_a_line_and_its_expectation_share_the_mean():
    line = PiecewiseLinear.continuous([0.0, 0.2, 0.5, 1.0], [1.0, 1.4, 2.0, 3.0])
    mean, variance = np.meshgrid([0.01, 0.2, 0.65, 0.99], [1e-16, 1e-9, 1e-5, 1e-3, 9e-3])
    np.testing.assert_allclose(line.expectation(mean, variance), 1.0 + 2.0 * mean, rtol=1e-13)


def test_a_jump_counts_the_tail_probability():
    a, b = shapes(0.65, 0.03**2)
    outside = stats.beta.cdf(0.55, a, b) + stats.beta.sf(0.75, a, b)
    assert WINDOW.expectation(0.65, 0.03**2) == pytest.approx(outside, rel=1e-12)


def test_no_variance_is_the_value_at_the_mean_and_the_way_there_is_smooth():
    for mean in (0.0, 0.2, 0.4, 0.9, 1.0):
        assert TENT.expectation(mean, 0.0) == TENT(mean)
    # At a kink f exceeds its average by half the change of slope times the mean absolute deviation.
    change = (1.0 - 0.2) / 0.4 + 1.5 / 0.6
    for variance in (1e-8, 1e-10, 1e-12, 2.0 * POINT_MASS_VARIANCE):
        drop = TENT(0.4) - TENT.expectation(0.4, variance)
        assert drop == pytest.approx(0.5 * change * np.sqrt(2.0 * variance / np.pi), rel=1e-3)


def test_a_point_mass_on_a_jump_takes_the_lower_limit():
    assert WINDOW.expectation([0.55, 0.75], 0.0) == pytest.approx([0.0, 0.0])
    assert SAWTOOTH([0.1, 0.3, 0.6, 0.95]) == pytest.approx([0.0, -1.0, -2.0, 1.0])


def test_the_largest_variance_is_two_spikes():
    """At p = s (1 - s) all mass sits on 0 and 1; the variance is clipped just short of it."""
    mean = np.array([0.02, 0.3, 0.65, 0.98])
    clipped = LARGEST_RELATIVE_VARIANCE * mean * (1.0 - mean)
    for variance in (mean * (1.0 - mean), 0.3 * np.ones(4), 1e3 * np.ones(4)):
        np.testing.assert_array_equal(TENT.expectation(mean, variance), TENT.expectation(mean, clipped))
    spikes = (1.0 - mean) * TENT(0.0) + mean * TENT(1.0)
    np.testing.assert_allclose(TENT.expectation(mean, 1.0), spikes, atol=0.02)


@pytest.mark.parametrize("mean", [1e-6, 1e-3, 1.0 - 1e-3, 1.0 - 1e-6])
def test_a_spike_at_an_end_keeps_mass_and_mean(mean):
    """Shape parameters far below 1 put a density's pole on an end."""
    for share in (1e-6, 0.1, 0.5, 0.99):
        variance = share * mean * (1.0 - mean)
        ones = PiecewiseLinear.continuous([0.0, 0.5, 1.0], [1.0, 1.0, 1.0])
        line = PiecewiseLinear.continuous([0.0, 0.01, 0.99, 1.0], [0.0, 0.01, 0.99, 1.0])
        assert ones.expectation(mean, variance) == pytest.approx(1.0, rel=1e-13)
        assert line.expectation(mean, variance) == pytest.approx(mean, rel=1e-12)


@settings(deadline=None, max_examples=150)
@given(
    mean=st.floats(0.0, 1.0),
    variance=st.floats(0.0, 0.3),
    values=st.lists(st.floats(-10.0, 10.0), min_size=5, max_size=5),
)
def test_expectation_stays_between_the_extremes_and_is_linear(mean, variance, values):
    nodes = [0.0, 0.25, 0.5, 0.8, 1.0]
    f = PiecewiseLinear.continuous(nodes, values)
    g = PiecewiseLinear.continuous(nodes, np.sin(values))
    both = PiecewiseLinear.continuous(nodes, 2.0 * np.asarray(values) - np.sin(values))
    slack = 1e-9
    average = float(f.expectation(mean, variance))
    assert min(values) - slack <= average <= max(values) + slack
    combined = 2.0 * average - float(g.expectation(mean, variance))
    assert float(both.expectation(mean, variance)) == pytest.approx(combined, abs=1e-8)


@settings(deadline=None, max_examples=100)
@given(mean=st.floats(0.01, 0.99), share=st.floats(1e-6, 0.9))
def test_a_convex_function_is_worth_more_under_uncertainty(mean, share):
    """Jensen, and more so the wider the belief."""
    bowl = PiecewiseLinear.continuous([0.0, 0.55, 0.75, 1.0], [1.0, 0.0, 0.0, 2.0])
    spread = mean * (1.0 - mean)
    wide, narrow = bowl.expectation(mean, [share * spread, 0.5 * share * spread])
    assert wide >= narrow - 1e-12
    assert narrow >= bowl(mean) - 1e-12


def test_expectation_broadcasts_and_keeps_scalars():
    mean, variance = np.linspace(0.1, 0.9, 7), np.array([[0.0], [1e-4], [1e-2]])
    table = TENT.expectation(mean, variance)
    assert table.shape == (3, 7)
    assert table[2, 4] == TENT.expectation(mean[4], 1e-2)
    assert TENT.expectation(0.5, 1e-3).shape == ()


def test_nan_is_not_mistaken_for_certainty():
    assert np.isnan(TENT.expectation(0.5, np.nan))
    assert np.isnan(TENT.expectation(np.nan, 1e-4))


def test_values_between_nodes_on_nodes_and_beyond():
    points = np.array([-0.1, 0.05, 0.1, 0.2, 0.45, 0.6, 0.775, 0.95, 0.97, 1.2])
    expected = [2.0, 2.0, 0.0, -0.5, 0.5, -2.0, 0.5, 1.0, 1.0, 1.0]
    np.testing.assert_allclose(SAWTOOTH(points), expected, atol=1e-15)


def test_one_node_is_a_step():
    step = PiecewiseLinear(np.array([0.25]), np.array([4.0]), np.array([1.0]))
    np.testing.assert_array_equal(step([0.0, 0.25, 0.5]), [4.0, 1.0, 1.0])
    a, b = shapes(0.3, 0.01)
    assert step.expectation(0.3, 0.01) == pytest.approx(1.0 + 3.0 * stats.beta.cdf(0.25, a, b), rel=1e-12)


@pytest.mark.parametrize(
    ("soc", "value", "said"),
    [
        ([], [], "increase strictly"),
        ([0.0, 0.5, 0.5, 1.0], [0.0, 1.0, 2.0, 3.0], "increase strictly"),
        ([[0.0, 1.0]], [[0.0, 1.0]], "increase strictly"),
        ([0.0, 1.0], [0.0, np.nan], "2 finite numbers"),
        ([0.0, 1.0], [0.0, 1.0, 2.0], "2 finite numbers"),
        ([0.0, np.inf], [0.0, 1.0], "2 finite numbers"),
    ],
)
def test_bad_tables_are_refused(soc, value, said):
    with pytest.raises(BatteryError, match=said):
        PiecewiseLinear.continuous(soc, value)


def test_tables_cannot_be_changed_afterwards():
    source = np.array([0.0, 1.0])
    line = PiecewiseLinear.continuous(source, source)
    source[1] = 7.0
    assert line(1.0) == 1.0
    with pytest.raises(ValueError, match="read-only"):
        line.left[0] = 1.0

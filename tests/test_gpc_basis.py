"""Orthonormal families and their Gauss rules."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import special, stats

from gpc import ChaosError, Hermite, Jacobi, Legendre, beta_rule

FAMILIES = [Legendre(), Hermite(), Jacobi(1.0, 1.0), Jacobi(0.5, 0.5), Jacobi(2.5, 0.3), Jacobi(40.0, 7.0)]


def moment(family, degree):
    """E[x^degree] in closed form or by an independent recurrence."""
    if isinstance(family, Hermite):
        return 0.0 if degree % 2 else float(special.factorial2(degree - 1)) if degree else 1.0
    if isinstance(family, Legendre):
        return 0.0 if degree % 2 else 1.0 / (degree + 1)
    beta = [
        np.prod([(family.a + i) / (family.a + family.b + i) for i in range(j)]) for j in range(degree + 1)
    ]
    return sum(special.comb(degree, j) * 2.0**j * (-1.0) ** (degree - j) * beta[j] for j in range(degree + 1))


@pytest.mark.parametrize("family", FAMILIES, ids=repr)
def test_polynomials_are_orthonormal(family):
    nodes, weights = family.gauss(20)
    psi = family.evaluate(nodes, 19)
    np.testing.assert_allclose((psi * weights) @ psi.T, np.eye(20), atol=1e-10)


@pytest.mark.parametrize("family", FAMILIES, ids=repr)
def test_gauss_rule_is_exact_up_to_degree_2n_minus_1_and_not_beyond(family):
    n = 5
    nodes, weights = family.gauss(n)
    assert weights.sum() == pytest.approx(1.0, abs=1e-15)
    assert np.all(weights > 0.0)
    assert np.all(np.diff(nodes) > 0.0)
    for degree in range(2 * n):
        exact = moment(family, degree)
        assert weights @ nodes**degree == pytest.approx(exact, rel=1e-11, abs=1e-12)
    # The error at degree 2n is E[pi_n^2], the product of the recurrence's b.
    norm = np.prod(family.recurrence(n + 1)[1])
    assert moment(family, 2 * n) - weights @ nodes ** (2 * n) == pytest.approx(norm, rel=1e-6, abs=1e-11)


def test_known_nodes_and_weights():
    nodes, weights = Legendre().gauss(3)
    np.testing.assert_allclose(nodes, [-np.sqrt(0.6), 0.0, np.sqrt(0.6)], atol=1e-14)
    np.testing.assert_allclose(weights, [5 / 18, 8 / 18, 5 / 18], rtol=1e-14)
    nodes, weights = Hermite().gauss(3)
    np.testing.assert_allclose(nodes, [-np.sqrt(3.0), 0.0, np.sqrt(3.0)], atol=1e-14)
    np.testing.assert_allclose(weights, [1 / 6, 2 / 3, 1 / 6], rtol=1e-14)
    # The arcsine density is Chebyshev's: equal weights at the cosines.
    nodes, weights = Jacobi(0.5, 0.5).gauss(6)
    np.testing.assert_allclose(nodes, np.cos(np.pi * (2 * np.arange(6, 0, -1) - 1) / 12), atol=1e-14)
    np.testing.assert_allclose(weights, np.full(6, 1 / 6), rtol=1e-12)


def test_one_point_is_the_mean():
    assert Legendre().gauss(1)[0] == pytest.approx([0.0])
    nodes, weights = beta_rule(3.0, 1.0, 1)
    assert nodes == pytest.approx([0.75])
    assert weights == pytest.approx([1.0])


def test_polynomials_are_the_classical_ones_scaled():
    x = np.linspace(-1.0, 1.0, 11)
    legendre = Legendre().evaluate(x, 6)
    hermite = Hermite().evaluate(3.0 * x, 6)
    jacobi = Jacobi(2.5, 0.7).evaluate(x, 6)
    for k in range(7):
        np.testing.assert_allclose(legendre[k], np.sqrt(2 * k + 1) * special.eval_legendre(k, x), atol=1e-13)
        classical = special.eval_hermitenorm(k, 3.0 * x) / np.sqrt(special.factorial(k))
        np.testing.assert_allclose(hermite[k], classical, atol=1e-11)
        ratio = jacobi[k] / special.eval_jacobi(k, -0.3, 1.5, x)
        np.testing.assert_allclose(ratio, ratio[0], rtol=1e-10)


def test_the_uniform_density_is_beta_1_1():
    for mine, other in zip(Jacobi(1.0, 1.0).recurrence(30), Legendre().recurrence(30), strict=True):
        np.testing.assert_allclose(mine, other, rtol=1e-14, atol=1e-16)


def test_hermite_rule_against_numpy_at_a_high_order():
    nodes, weights = Hermite().gauss(60)
    theirs, their_weights = np.polynomial.hermite_e.hermegauss(60)
    np.testing.assert_allclose(nodes, theirs, atol=1e-11)
    np.testing.assert_allclose(weights, their_weights / np.sqrt(2.0 * np.pi), rtol=1e-9)


@settings(deadline=None, max_examples=60)
@given(a=st.floats(1e-3, 1e4), b=st.floats(1e-3, 1e4))
def test_beta_rule_has_the_moments_of_the_distribution(a, b):
    nodes, weights = beta_rule(a, b, 4)
    mean, variance, skewness = stats.beta.stats(a, b, moments="mvs")
    assert np.all((nodes >= 0.0) & (nodes <= 1.0))
    assert weights @ nodes == pytest.approx(mean, rel=1e-12)
    centred = nodes - mean
    assert weights @ centred**2 == pytest.approx(variance, rel=1e-8)
    assert weights @ centred**3 == pytest.approx(skewness * variance**1.5, rel=1e-6, abs=1e-7 * variance**1.5)


def test_beta_rule_integrates_a_smooth_function():
    nodes, weights = beta_rule(2.0, 5.0, 20)
    # E[exp(t B)] is Kummer's function.
    assert weights @ np.exp(1.7 * nodes) == pytest.approx(special.hyp1f1(2.0, 7.0, 1.7), rel=1e-14)


def test_evaluate_keeps_the_shape_of_its_points():
    points = np.linspace(-1.0, 1.0, 6).reshape(2, 3)
    assert Legendre().evaluate(points, 4).shape == (5, 2, 3)
    assert Hermite().evaluate(0.3, 0).shape == (1,)


@pytest.mark.parametrize("family", FAMILIES, ids=repr)
def test_slopes_are_those_of_the_polynomials(family):
    """Against the power series that the polynomials' values at a few points determine."""
    degree = 6
    x = np.linspace(-0.95, 0.95, 13)
    psi, slope = family.evaluate_with_derivative(x, degree)
    np.testing.assert_array_equal(psi, family.evaluate(x, degree))
    for k in range(degree + 1):
        series = np.polynomial.Polynomial.fit(x, psi[k], k, domain=[-1.0, 1.0])
        np.testing.assert_allclose(slope[k], series.deriv()(x), rtol=1e-8, atol=1e-8 * np.abs(slope[k]).max())


def test_slopes_in_closed_form():
    x = np.linspace(-1.0, 1.0, 9)
    # P_k'(1) = k (k + 1) / 2, and He_k' = k He_(k-1).
    slope = Legendre().evaluate_with_derivative(1.0, 5)[1]
    k = np.arange(6)
    np.testing.assert_allclose(slope, np.sqrt(2 * k + 1) * k * (k + 1) / 2, rtol=1e-13)
    psi, slope = Hermite().evaluate_with_derivative(x, 5)
    np.testing.assert_allclose(slope[1:], np.sqrt(k[1:, np.newaxis]) * psi[:-1], atol=1e-13)
    np.testing.assert_array_equal(slope[0], 0.0)


@pytest.mark.parametrize(
    ("family", "frozen"),
    [
        (Legendre(), stats.uniform(-1.0, 2.0)),
        (Hermite(), stats.norm()),
        (Jacobi(0.5, 0.5), stats.beta(0.5, 0.5, -1.0, 2.0)),
        (Jacobi(2.5, 0.3), stats.beta(2.5, 0.3, -1.0, 2.0)),
        (Jacobi(4000.0, 700.0), stats.beta(4000.0, 700.0, -1.0, 2.0)),
    ],
    ids=["legendre", "hermite", "jacobi-half", "jacobi-skewed", "jacobi-narrow"],
)
def test_the_random_variable_is_that_of_the_polynomials(family, frozen):
    x = np.linspace(-1.5, 1.5, 300)
    np.testing.assert_allclose(family.density(x), frozen.pdf(x), rtol=1e-9, atol=1e-300)
    np.testing.assert_allclose(family.density(np.array([-1.0, 1.0])), frozen.pdf([-1.0, 1.0]), rtol=1e-9)
    assert family.support == pytest.approx(frozen.support())
    draws = family.sample(np.random.default_rng(3), 4000)
    assert draws.shape == (4000,)
    # Kolmogorov and Smirnov: a wrong family would give zero.
    assert stats.kstest(draws, frozen.cdf).pvalue > 1e-3


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: Jacobi(0.0, 1.0), "a must be positive and finite, got 0.0"),
        (lambda: Jacobi(1.0, float("nan")), "b must be positive and finite, got nan"),
        (lambda: Legendre().gauss(0), "1 point or more, got 0"),
        (lambda: Hermite().evaluate(0.0, -1), "0 or more, got -1"),
        (lambda: Hermite().evaluate_with_derivative(0.0, -1), "0 or more, got -1"),
    ],
)
def test_bad_parameters_are_named(call, said):
    with pytest.raises(ChaosError, match=said):
        call()

"""Galerkin operators against quadrature over the germ of the exact solution, and closed forms."""

from math import factorial

import numpy as np
import pytest
from scipy.integrate import quad

from gpc import (
    ChaosError,
    Hermite,
    Jacobi,
    Legendre,
    germ_matrix,
    multiplication,
    sample_germs,
    total_order,
    triple_products,
    uncertain_decay,
)

FAMILIES = [Legendre(), Hermite(), Jacobi(2.0, 3.5)]
RATE, SLOPE = 0.04, 0.02  # ERRATA, [M] eqs 66-68: the rate of relaxation lies in [0.02, 0.06] 1/s


def response(rate, time_s, current):
    """Solution from rest of x' = -rate x + current."""
    return current * -np.expm1(-rate * time_s) / rate


@pytest.mark.parametrize("family", FAMILIES, ids=repr)
def test_the_germ_matrix_is_an_expectation(family):
    nodes, weights = family.gauss(9)
    psi = family.evaluate(nodes, 7)
    np.testing.assert_allclose(germ_matrix(family, 8), (psi * weights * nodes) @ psi.T, atol=1e-12)


def test_operators_are_those_of_the_report_in_an_orthonormal_basis():
    """[M] eqs 75, 76 for the classical Legendre polynomials, by integration; psi_i = sqrt(2 i + 1) P_i."""
    system = uncertain_decay(Legendre(), 3, RATE, SLOPE)
    classical = [np.polynomial.Legendre.basis(i) for i in range(3)]
    for i, p in enumerate(classical):
        square = quad(lambda x, p=p: p(x) ** 2, -1.0, 1.0)[0]
        assert system.input[i] == pytest.approx(quad(p, -1.0, 1.0)[0] / square, abs=1e-14)
        for j, q in enumerate(classical):
            product = quad(lambda x, p=p, q=q: x * p(x) * q(x), -1.0, 1.0)[0]
            a = -RATE * (i == j) - SLOPE * product / square
            scale = np.sqrt((2 * i + 1) / (2 * j + 1))
            assert system.state[i, j] * scale == pytest.approx(a, abs=1e-14)


def test_one_term_is_the_deterministic_equation():
    phi, gamma = uncertain_decay(Legendre(), 1, RATE, SLOPE).hold(7.0)
    assert phi[0, 0] == pytest.approx(np.exp(-RATE * 7.0), rel=1e-14)
    assert gamma[0] == pytest.approx(response(RATE, 7.0, 1.0), rel=1e-14)


def test_without_uncertainty_every_order_is_the_deterministic_equation():
    phi, gamma = uncertain_decay(Hermite(), 4, RATE, 0.0).hold(7.0)
    np.testing.assert_allclose(phi, np.exp(-RATE * 7.0) * np.eye(4), rtol=1e-13, atol=1e-16)
    np.testing.assert_allclose(gamma, [response(RATE, 7.0, 1.0), 0.0, 0.0, 0.0], rtol=1e-13, atol=1e-16)


@pytest.mark.parametrize("family", [Legendre(), Jacobi(2.0, 3.5)], ids=repr)
@pytest.mark.parametrize("terms", [2, 3, 6])
def test_at_the_gauss_nodes_the_expansion_is_exact(family, terms):
    """Under a current that changes every step; nothing is truncated at these nodes."""
    step_s, currents = 3.0, [1.0, -2.0, 0.0, 5.0, 0.3]
    phi, gamma = uncertain_decay(family, terms, RATE, SLOPE).hold(step_s)
    nodes, _ = family.gauss(terms)
    coefficients, exact = np.zeros(terms), np.zeros(terms)
    for current in currents:
        coefficients = phi @ coefficients + gamma * current
        rate = RATE + SLOPE * nodes
        exact = np.exp(-rate * step_s) * exact + response(rate, step_s, current)
    np.testing.assert_allclose(coefficients @ family.evaluate(nodes, terms - 1), exact, rtol=1e-12)


@pytest.mark.parametrize("family", [Legendre(), Jacobi(2.0, 3.5)], ids=repr)
def test_coefficients_converge_to_those_of_the_exact_solution(family):
    """The step response projected on the basis by quadrature over the germ."""
    time_s, terms = 60.0, (1, 2, 3, 4, 6, 8)
    nodes, weights = family.gauss(40)
    solution = response(RATE + SLOPE * nodes, time_s, 2.0)
    errors = []
    for n in terms:
        gamma = uncertain_decay(family, n, RATE, SLOPE).hold(time_s)[1]
        exact = family.evaluate(nodes, n - 1) @ (weights * solution)
        errors.append(np.abs(2.0 * gamma - exact).max() / exact[0])
    assert errors[0] > 1e-3
    assert np.all(np.diff(np.log(errors)) < -1.0)
    assert errors[-1] < 1e-8


def test_moments_equal_monte_carlo():
    time_s, draws = 60.0, 20_000
    gamma = uncertain_decay(Legendre(), 5, RATE, SLOPE).hold(time_s)[1]
    germs = sample_germs([Legendre()], np.random.default_rng(11), draws)[:, 0]
    sample = response(RATE + SLOPE * germs, time_s, 1.0)
    centred = sample - sample.mean()
    assert abs(gamma[0] - sample.mean()) < 3.0 * sample.std() / np.sqrt(draws)
    assert abs(np.sum(gamma[1:] ** 2) - sample.var()) < 3.0 * np.std(centred**2) / np.sqrt(draws)


def test_holding_twice_is_holding_over_a_double_step():
    system = uncertain_decay(Legendre(), 4, RATE, SLOPE)
    phi, gamma = system.hold(2.5)
    double, twice = system.hold(5.0)
    np.testing.assert_allclose(phi @ phi, double, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(phi @ gamma + gamma, twice, rtol=1e-12, atol=1e-15)
    none, nothing = system.hold(0.0)
    np.testing.assert_array_equal(none, np.eye(4))
    np.testing.assert_array_equal(nothing, 0.0)


def test_triple_products_of_hermite_polynomials():
    """i! j! k! / ((s-i)! (s-j)! (s-k)!) with s = (i+j+k)/2 where a triangle exists, else 0."""
    n = 6
    products = triple_products((Hermite(),), total_order(1, n - 1))
    for i, j, k in np.ndindex(n, n, n):
        s, odd = divmod(i + j + k, 2)
        exact = 0.0
        if not odd and s >= max(i, j, k):
            root = np.sqrt(float(factorial(i) * factorial(j) * factorial(k)))
            exact = root / (factorial(s - i) * factorial(s - j) * factorial(s - k))
        assert products[i, j, k] == pytest.approx(exact, rel=1e-11, abs=1e-11)


def test_triple_products_in_several_germs_are_expectations():
    families, indices = (Legendre(), Jacobi(2.0, 3.5)), total_order(2, 3)
    products = triple_products(families, indices)
    one, two = (triple_products((f,), total_order(1, 3)) for f in families)
    for i, j, k in [(0, 0, 0), (1, 1, 3), (4, 5, 9), (2, 8, 8), (6, 3, 1)]:
        a, b = indices[[i, j, k]].T
        assert products[i, j, k] == pytest.approx(one[tuple(a)] * two[tuple(b)], abs=1e-13)
    np.testing.assert_allclose(products[:, :, 0], np.eye(10), atol=1e-12)
    np.testing.assert_allclose(products, products.transpose(2, 0, 1), atol=1e-12)


def test_an_uncertain_rate_in_one_germ_is_the_tridiagonal_operator():
    for family in FAMILIES:
        a, b = family.recurrence(2)
        rate = np.array([RATE + SLOPE * a[0], SLOPE * np.sqrt(b[1]), 0.0, 0.0])
        matrix = multiplication((family,), total_order(1, 3), rate)
        np.testing.assert_allclose(-matrix, uncertain_decay(family, 4, RATE, SLOPE).state, atol=1e-14)


def test_multiplication_multiplies_polynomials():
    """(1 + x + 2 y) (3 x - y), whose product is of the order kept."""
    families, indices = (Legendre(), Hermite()), total_order(2, 2)
    x = np.array([0.0, 1.0 / np.sqrt(3.0), 0.0, 0.0, 0.0, 0.0])
    y = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    one = np.eye(6)[0]
    product = multiplication(families, indices, one + x + 2.0 * y) @ (3.0 * x - y)
    # 3 x - y + 3 x^2 + 5 x y - 2 y^2, with E[x^2] = 1/3, E[y^2] = 1
    by_hand = (
        3.0 * x
        - y
        + np.array(
            [
                3.0 / 3.0 - 2.0,
                0.0,
                0.0,
                3.0 * 2.0 / (3.0 * np.sqrt(5.0)),
                5.0 / np.sqrt(3.0),
                -2.0 * np.sqrt(2.0),
            ]
        )
    )
    np.testing.assert_allclose(product, by_hand, atol=1e-13)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: germ_matrix(Legendre(), 0), "1 term or more, got 0"),
        (lambda: uncertain_decay(Legendre(), -1, 1.0, 0.1), "1 term or more, got -1"),
        (lambda: uncertain_decay(Legendre(), 3, float("nan"), 0.1), "must be finite"),
        (lambda: uncertain_decay(Legendre(), 3, 1.0, 0.1).hold(-1.0), "0 or more and finite, got -1.0"),
        (lambda: triple_products((Legendre(),), total_order(2, 1)), "1 families do not fit"),
        (lambda: triple_products((Legendre(),) * 7, total_order(7, 5)), "too many triple products"),
        (lambda: multiplication((Legendre(),), total_order(1, 2), [1.0]), "each of the 3 terms"),
    ],
)
def test_bad_parameters_are_named(call, said):
    with pytest.raises(ChaosError, match=said):
        call()

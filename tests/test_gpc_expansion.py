"""Moments, Sobol indices, samples and densities against closed forms and Monte Carlo."""

import numpy as np
import pytest
from scipy import stats

from gpc import (
    ChaosError,
    Expansion,
    Hermite,
    Jacobi,
    Legendre,
    affine_coefficients,
    quadrature,
    sample_germs,
    total_order,
)

MIXED = (Legendre(), Hermite(), Jacobi(2.0, 3.0))


def expand(families, order, function, points=None):
    """Expansion by quadrature of a function of the germs, one argument each."""
    chaos = quadrature(families, total_order(len(families), order), points)
    return Expansion.of(chaos, function(*chaos.nodes.T))


def test_moments_of_lines_are_those_of_the_variables():
    centre, spread = np.array([4.0, -1.0, 0.5, 7.0]), np.array([2.0, 3.0, -1.5, 0.0])
    indices = total_order(3, 2)
    coefficients = affine_coefficients(MIXED, indices, centre, spread, [0, 1, 2, 0])
    line = Expansion(MIXED, indices, coefficients)
    # B of Beta(2, 3) has mean 2/5 and variance 1/25, and the germ is 2 B - 1.
    np.testing.assert_allclose(line.mean, [4.0, -1.0, 0.5 - 1.5 * (-0.2), 7.0], rtol=1e-14)
    np.testing.assert_allclose(line.variance, [4.0 / 3.0, 9.0, 1.5**2 * 4.0 / 25.0, 0.0], rtol=1e-14)
    germs = np.array([[0.3, -1.0, 0.8], [-1.0, 2.0, 0.0]])
    followed = np.column_stack([germs, np.zeros(2)])
    np.testing.assert_allclose(line(germs), centre + spread * followed, rtol=1e-13)


def test_a_legendre_half_range_is_divided_by_the_root_of_three():
    """ERRATA, [M] eq 20: a coefficient 30 of P1 is 30 / sqrt 3 in the orthonormal basis."""
    coefficients = affine_coefficients((Legendre(),), total_order(1, 2), [200.0], [30.0], [0])
    np.testing.assert_allclose(coefficients[:, 0], [200.0, 30.0 / np.sqrt(3.0), 0.0], rtol=1e-15)


def test_covariance_is_that_of_the_outputs():
    x_and_y = expand((Legendre(), Hermite()), 2, lambda x, y: np.stack([x + y, x - 2.0 * y, x * y], axis=-1))
    np.testing.assert_allclose(
        x_and_y.covariance,
        [[4.0 / 3.0, 1.0 / 3.0 - 2.0, 0.0], [1.0 / 3.0 - 2.0, 1.0 / 3.0 + 4.0, 0.0], [0.0, 0.0, 1.0 / 3.0]],
        atol=1e-13,
    )
    np.testing.assert_allclose(np.diagonal(x_and_y.covariance), x_and_y.variance, atol=1e-14)
    table = Expansion((Legendre(),), total_order(1, 1), np.arange(12.0).reshape(2, 2, 3))
    assert table.mean.shape == table.variance.shape == (2, 3)
    assert table.covariance.shape == (2, 3, 2, 3)
    assert table.covariance[0, 1, 1, 2] == 7.0 * 11.0


def test_sobol_indices_of_a_polynomial():
    """x + 2 y + 3 x y + z^2 - 1/3: variances 1/3, 4/3, 1 (interaction) and 4/45."""
    chaos = expand((Legendre(),) * 3, 2, lambda x, y, z: x + 2.0 * y + 3.0 * x * y + z**2)
    parts = np.array([1.0 / 3.0, 4.0 / 3.0, 4.0 / 45.0])
    variance = parts.sum() + 1.0
    assert chaos.variance == pytest.approx(variance, rel=1e-13)
    np.testing.assert_allclose(chaos.first_order, parts / variance, rtol=1e-12)
    np.testing.assert_allclose(chaos.total, np.add(parts, [1.0, 1.0, 0.0]) / variance, rtol=1e-12)
    assert chaos.sobol(0, 1) == chaos.sobol(1, 0) == pytest.approx(1.0 / variance, rel=1e-12)
    assert chaos.sobol(0, 2) == pytest.approx(0.0, abs=1e-25)


def test_sobol_indices_of_ishigami():
    """sin x + 7 sin^2 y + 0.1 z^4 sin x on [-pi, pi]^3; its variances are known in closed form."""
    a, b = 7.0, 0.1

    def ishigami(u, v, w):
        x, y, z = np.pi * u, np.pi * v, np.pi * w
        return np.sin(x) + a * np.sin(y) ** 2 + b * z**4 * np.sin(x)

    chaos = expand((Legendre(),) * 3, 14, ishigami, 18)
    first = np.array([0.5 * (1.0 + b * np.pi**4 / 5.0) ** 2, a**2 / 8.0, 0.0])
    together = b**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    variance = first.sum() + together
    assert chaos.mean == pytest.approx(a / 2.0, rel=1e-9)
    assert chaos.variance == pytest.approx(variance, rel=1e-6)
    np.testing.assert_allclose(chaos.first_order, first / variance, atol=1e-6)
    np.testing.assert_allclose(chaos.total, np.add(first, [together, 0.0, together]) / variance, atol=1e-6)
    assert chaos.sobol(0, 2) == pytest.approx(together / variance, rel=1e-5)


def test_shares_add_up_to_one_per_output():
    coefficients = np.random.default_rng(1).standard_normal((10, 2))
    coefficients[1:, 1] = 0.0
    chaos = Expansion((Legendre(), Hermite()), total_order(2, 3), coefficients)
    shares = chaos.sobol(0) + chaos.sobol(1) + chaos.sobol(0, 1)
    np.testing.assert_allclose(shares, [1.0, 0.0], rtol=1e-13)
    assert np.all(chaos.total >= chaos.first_order)
    assert chaos.total.shape == (2, 2)


def test_rounding_is_no_variance():
    """Projecting a constant leaves coefficients of 1e-15 or so, whose shares would be noise."""
    plan = quadrature(MIXED, total_order(3, 4))
    values = np.full((plan.nodes.shape[0], 2), 90.0 / 3.6)
    values[:, 1] += 1e-6 * plan.nodes[:, 0]
    chaos = Expansion.of(plan, values)
    assert 0.0 < chaos.variance[0] < 1e-24
    np.testing.assert_array_equal(chaos.varies, [False, True])
    np.testing.assert_array_equal(chaos.total[:, 0], 0.0)
    np.testing.assert_allclose(chaos.total[:, 1], [1.0, 0.0, 0.0], atol=1e-9)
    flat = Expansion(chaos.families, chaos.indices, chaos.coefficients[:, 0])
    with pytest.raises(ChaosError, match="without variance"):
        flat.density(25.0, np.random.default_rng(0))


def test_order_zero_is_the_deterministic_model():
    """One term, one node: the model at the mean of the germs."""
    chaos = expand(MIXED, 0, lambda x, y, z: np.exp(x) + y + z)
    assert chaos.mean == pytest.approx(np.exp(0.0) + 0.0 - 0.2, rel=1e-14)
    assert chaos.variance == 0.0
    np.testing.assert_array_equal(chaos.total, 0.0)


def test_moments_equal_monte_carlo():
    def model(x, y, z):
        return np.exp(0.3 * y) * np.sin(1.0 + x) / (2.0 + z)

    draws = 40_000
    chaos = expand(MIXED, 6, model, 9)
    sample = model(*sample_germs(MIXED, np.random.default_rng(5), draws).T)
    spread = (sample - sample.mean()) ** 2
    assert abs(chaos.mean - sample.mean()) < 3.0 * sample.std() / np.sqrt(draws)
    assert abs(chaos.variance - sample.var()) < 3.0 * spread.std() / np.sqrt(draws)


def test_moments_converge_with_the_order():
    """exp(s y) of a normal y is log-normal."""
    s = 0.6
    exact = np.exp(s**2) * np.expm1(s**2)
    errors = [
        abs(expand((Hermite(),), n, lambda y: np.exp(s * y), 30).variance - exact) for n in (1, 2, 4, 6, 8)
    ]
    assert np.all(np.diff(np.log(errors)) < -1.5)
    assert errors[-1] < 1e-6 * exact


def test_samples_are_the_expansion_at_random_germs():
    chaos = expand(MIXED, 2, lambda x, y, z: np.stack([x * y, z + y], axis=-1))
    sample = chaos.sample(np.random.default_rng(7), 30_000)
    assert sample.shape == (30_000, 2)
    np.testing.assert_allclose(np.cov(sample.T), chaos.covariance, atol=0.03)
    np.testing.assert_array_equal(sample, chaos(sample_germs(MIXED, np.random.default_rng(7), 30_000)))
    assert np.any(sample != chaos.sample(np.random.default_rng(8), 30_000))


def test_density_of_a_line():
    indices, x = total_order(1, 3), np.linspace(-3.0, 12.0, 31)
    for family, frozen in [
        (Legendre(), stats.uniform(2.0, 5.0)),
        (Hermite(), stats.norm(4.5, 2.5)),
        (Jacobi(2.0, 3.0), stats.beta(2.0, 3.0, 2.0, 5.0)),
    ]:
        line = Expansion((family,), indices, affine_coefficients((family,), indices, [4.5], [2.5], [0])[:, 0])
        inside = np.abs(x - 2.0) + np.abs(x - 7.0) > 1e-9
        np.testing.assert_allclose(line.density(x[inside]), frozen.pdf(x[inside]), rtol=1e-9, atol=1e-15)


def test_density_of_a_square_has_two_branches_and_a_pole():
    y = np.array([-0.5, 0.01, 0.3, 0.99, 1.2, 4.0])
    uniform = expand((Legendre(),), 2, lambda x: x**2)
    np.testing.assert_allclose(
        uniform.density(y), np.where((y > 0.0) & (y < 1.0), 0.5 / np.sqrt(np.abs(y)), 0.0), rtol=1e-9
    )
    normal = expand((Hermite(),), 2, lambda x: x**2)
    np.testing.assert_allclose(normal.density(y), stats.chi2(1).pdf(y), rtol=1e-9)
    assert normal.density(0.0) == np.inf or normal.density(0.0) > 1e6


def test_density_of_a_smooth_map():
    """exp(0.3 y) of a normal y; the expansion is as good as its order."""
    x = np.linspace(0.6, 1.7, 12)
    chaos = expand((Hermite(),), 8, lambda y: np.exp(0.3 * y), 20)
    np.testing.assert_allclose(chaos.density(x), stats.lognorm(0.3).pdf(x), rtol=1e-4)
    assert chaos.density(x.reshape(3, 4)).shape == (3, 4)


def test_density_in_several_germs_is_that_of_a_sample():
    total = expand((Hermite(), Hermite()), 1, lambda x, y: 3.0 * x + 4.0 * y + 1.0)
    x = np.linspace(-14.0, 16.0, 25)
    density = total.density(x, np.random.default_rng(2))
    np.testing.assert_allclose(
        density, stats.norm(1.0, 5.0).pdf(x), atol=0.03 * stats.norm(1.0, 5.0).pdf(1.0)
    )


LINE = Expansion((Legendre(),), total_order(1, 1), [1.0, 2.0])


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: Expansion((Legendre(),), total_order(1, 1), [1.0]), "counts the 2 terms"),
        (lambda: Expansion((Legendre(),), total_order(1, 1), [1.0, np.nan]), "the model failed at a node"),
        (lambda: Expansion(MIXED, total_order(1, 1), [1.0, 2.0]), "3 families do not fit"),
        (lambda: LINE.sobol(1), "no germ 1; germs are numbered 0 to 0"),
        (lambda: LINE.sobol(), "name one germ"),
        (lambda: LINE.sample(np.random.default_rng(0), 0), "1 draw or more"),
        (lambda: Expansion((Legendre(),), total_order(1, 1), [1.0, 0.0]).density(1.0), "without variance"),
        (lambda: Expansion((Legendre(),), total_order(1, 1), np.ones((2, 3))).density(1.0), "pick one"),
        (lambda: Expansion(MIXED, total_order(3, 1), np.ones(4)).density(1.0), "give a numpy Generator"),
        (lambda: affine_coefficients(MIXED, total_order(3, 1), [1.0], [1.0, 2.0], [0]), "one entry per"),
        (lambda: affine_coefficients(MIXED, total_order(3, 1), [1.0], [1.0], [3]), "no germ 3"),
        (lambda: affine_coefficients(MIXED, total_order(3, 0), [1.0], [1.0], [2]), "linear term of germ 2"),
    ],
)
def test_bad_parameters_are_named(call, said):
    with pytest.raises(ChaosError, match=said):
        call()

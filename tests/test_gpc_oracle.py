"""The same numbers from chaospy, where it is installed."""

import numpy as np
import pytest

from gpc import (
    Expansion,
    Hermite,
    Jacobi,
    Legendre,
    basis_matrix,
    quadrature,
    sample_germs,
    tensor_grid,
    total_order,
)

chaospy = pytest.importorskip("chaospy")


def germs_of(number):
    """Families by turns, and the same random variables there."""
    families = [[Legendre(), Hermite(), Jacobi(2.0, 3.0)][k % 3] for k in range(number)]
    theirs = {
        Legendre: lambda: chaospy.Uniform(-1.0, 1.0),
        Hermite: lambda: chaospy.Normal(0.0, 1.0),
        Jacobi: lambda: chaospy.Beta(2.0, 3.0, -1.0, 1.0),
    }
    return tuple(families), chaospy.J(*(theirs[type(family)]() for family in families))


def rows_of(indices, number, order):
    """Our row of each of their terms, which stand in another order."""
    row = {tuple(degrees): i for i, degrees in enumerate(indices.tolist())}
    theirs = chaospy.glexindex(0, order + 1, number, graded=True, reverse=True)
    return [row[tuple(degrees)] for degrees in np.asarray(theirs).reshape(-1, number).tolist()]


@pytest.mark.parametrize(("number", "order"), [(1, 5), (2, 5), (3, 5), (4, 4), (5, 5), (7, 2), (7, 5)])
def test_bases_agree(number, order):
    families, joint = germs_of(number)
    indices = total_order(number, order)
    germs = sample_germs(families, np.random.default_rng(0), 20)
    theirs = chaospy.generate_expansion(order, joint, normed=True, graded=True, reverse=True)(*germs.T)
    ours = basis_matrix(families, indices, germs).T[rows_of(indices, number, order)]
    np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-10)


def test_gauss_rules_agree():
    families, joint = germs_of(3)
    nodes, weights = tensor_grid(families, 5)
    theirs, their_weights = chaospy.generate_quadrature(4, joint, rule="gaussian")
    assert theirs.shape == (3, 125)
    ours, order = np.lexsort(np.round(nodes.T, 9)), np.lexsort(np.round(theirs, 9))
    np.testing.assert_allclose(nodes[ours], theirs.T[order], atol=1e-10)
    np.testing.assert_allclose(weights[ours], their_weights[order], rtol=1e-9)


def expansion_of(number, order, terms=None):
    """Two outputs of random coefficients, in all terms or in some, and the same as their polynomials."""
    families, joint = germs_of(number)
    indices = total_order(number, order)
    rng = np.random.default_rng(number + 10 * order)
    coefficients = rng.standard_normal((indices.shape[0], 2))
    if terms is not None:
        coefficients[rng.permutation(indices.shape[0])[terms:]] = 0.0
    basis = chaospy.generate_expansion(order, joint, normed=True, graded=True, reverse=True)
    theirs = coefficients[rows_of(indices, number, order)]
    kept = [np.flatnonzero(column) for column in theirs.T]
    outputs = [chaospy.sum(basis[k] * column[k]) for k, column in zip(kept, theirs.T, strict=True)]
    return Expansion(families, indices, coefficients), outputs, joint


def slow(*sizes):
    return [pytest.param(*size, marks=pytest.mark.slow) for size in sizes]


@pytest.mark.parametrize(
    ("number", "order", "terms"),
    [(2, 5, None), (3, 4, None), (4, 3, None), (5, 5, 12), (7, 5, 6), *slow((5, 4, None), (7, 5, 30))],
)
def test_moments_agree(number, order, terms):
    """Theirs takes minutes for all of 792 terms: some are drawn."""
    ours, outputs, joint = expansion_of(number, order, terms)
    np.testing.assert_allclose(ours.mean, [chaospy.E(p, joint) for p in outputs], rtol=1e-10, atol=1e-10)
    covariance = chaospy.Cov(chaospy.polynomial(outputs), joint)
    np.testing.assert_allclose(ours.covariance, covariance, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(ours.variance, [chaospy.Var(p, joint) for p in outputs], rtol=1e-10)


@pytest.mark.parametrize(
    ("number", "order", "terms"),
    [
        (2, 5, None),
        (3, 2, None),
        (4, 1, None),
        (5, 2, 6),
        *slow(
            (7, 2, None), (4, 5, 8), (3, 5, None), (5, 5, 12), (6, 5, 10), (7, 3, 10), (7, 4, 10), (7, 5, 10)
        ),
    ],
)
def test_sobol_indices_agree(number, order, terms):
    ours, outputs, joint = expansion_of(number, order, terms)
    # One output: theirs takes seconds for seven germs.
    np.testing.assert_allclose(ours.first_order[:, 0], chaospy.Sens_m(outputs[0], joint), atol=1e-10)
    np.testing.assert_allclose(ours.total[:, 0], chaospy.Sens_t(outputs[0], joint), atol=1e-10)


def test_projections_agree():
    families, joint = germs_of(3)
    indices = total_order(3, 4)

    def model(x, y, z):
        return np.exp(0.3 * y + 0.2 * x) / (2.0 + z)

    chaos = quadrature(families, indices, 7)
    ours = Expansion.of(chaos, model(*chaos.nodes.T))
    terms = chaospy.generate_expansion(4, joint, normed=True, graded=True, reverse=True)
    nodes, weights = chaospy.generate_quadrature(6, joint, rule="gaussian")
    fitted = chaospy.fit_quadrature(terms, nodes, weights, model(*nodes))
    germs = sample_germs(families, np.random.default_rng(4), 50)
    np.testing.assert_allclose(ours(germs), fitted(*germs.T), rtol=1e-9, atol=1e-10)

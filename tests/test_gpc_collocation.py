"""Node matrices, grids, the choice of nodes, and projection."""

import numpy as np
import pytest
from scipy import special

from gpc import (
    ChaosError,
    Hermite,
    Jacobi,
    Legendre,
    basis_matrix,
    collocate,
    hyperbolic,
    quadrature,
    regression,
    selected_nodes,
    tensor_grid,
    total_order,
)

MIXED = (Legendre(), Hermite(), Jacobi(2.0, 3.0))


def test_the_basis_is_the_product_of_one_variable_polynomials():
    germs = np.array([[0.3, -1.2], [-0.8, 0.1]])
    x, y = germs.T
    by_hand = [
        np.ones(2),
        np.sqrt(3.0) * x,
        y,
        np.sqrt(5.0) * (3.0 * x**2 - 1.0) / 2.0,
        np.sqrt(3.0) * x * y,
        (y**2 - 1.0) / np.sqrt(2.0),
    ]
    matrix = basis_matrix((Legendre(), Hermite()), total_order(2, 2), germs)
    np.testing.assert_allclose(matrix, np.transpose(by_hand), atol=1e-14)
    assert basis_matrix(MIXED, total_order(3, 1), np.zeros((4, 5, 3))).shape == (4, 5, 4)


def test_the_tensor_grid_integrates_products():
    nodes, weights = tensor_grid(MIXED, [2, 3, 4])
    assert nodes.shape == (24, 3)
    assert weights.sum() == pytest.approx(1.0, abs=1e-15)
    x, y, z = nodes.T
    # E[x^2] E[y^4] E[B^3] with z = 2 B - 1 and B of Beta(2, 3): 2*3*4 / (5*6*7).
    assert weights @ (x**2 * y**4 * (0.5 * (1.0 + z)) ** 3) == pytest.approx(
        3.0 / 3.0 * 24.0 / 210.0, rel=1e-13
    )


def test_the_basis_is_orthonormal_on_the_grid():
    indices = total_order(3, 4)
    nodes, weights = tensor_grid(MIXED, 5)
    matrix = basis_matrix(MIXED, indices, nodes)
    np.testing.assert_allclose((matrix.T * weights) @ matrix, np.eye(indices.shape[0]), atol=1e-12)


@pytest.mark.parametrize(("germs", "published"), [(4, 3.8), (7, 7.8)])
def test_selected_nodes_are_as_many_as_terms_and_well_conditioned(germs, published):
    """From the Gauss-3 grid at order 2; ERRATA states the condition of an unweighted choice."""
    families, indices = (Legendre(),) * germs, total_order(germs, 2)
    chosen = collocate(families, indices)
    assert chosen.nodes.shape == (indices.shape[0], germs)
    assert chosen.condition < published
    assert np.isin(np.round(chosen.nodes, 12), np.round([-np.sqrt(0.6), 0.0, np.sqrt(0.6)], 12)).all()
    assert np.unique(chosen.nodes, axis=0).shape == chosen.nodes.shape
    more = collocate(families, indices, 2 * indices.shape[0])
    assert more.condition < chosen.condition
    np.testing.assert_array_equal(more.nodes[: indices.shape[0]], chosen.nodes)


def test_nodes_are_added_where_the_determinant_grows_most():
    families, indices = (Legendre(), Hermite()), total_order(2, 2)
    grid = tensor_grid(families, 3)[0]
    first, last = np.split(selected_nodes(families, indices, 7), [6])

    def determinant(node):
        matrix = basis_matrix(families, indices, np.vstack([first, node]))
        return np.linalg.det(matrix.T @ matrix)

    left = [node for node in grid if not np.any(np.all(first == node, axis=1))]
    assert determinant(last[0]) == pytest.approx(max(determinant(node) for node in left), rel=1e-12)


def test_all_nodes_of_the_grid_can_be_asked_for():
    families, indices = (Legendre(), Hermite()), total_order(2, 2)
    nodes, grid = selected_nodes(families, indices, 9), tensor_grid(families, 3)[0]
    np.testing.assert_array_equal(nodes[np.lexsort(nodes.T)], grid[np.lexsort(grid.T)])


@pytest.mark.parametrize(
    "setup",
    [
        lambda f, i: collocate(f, i),
        lambda f, i: collocate(f, i, 2 * i.shape[0]),
        lambda f, i: quadrature(f, i),
        lambda f, i: quadrature(f, i, 6),
    ],
    ids=["as many as terms", "twice as many", "Gauss", "finer Gauss"],
)
@pytest.mark.parametrize("indices", [total_order(3, 3), hyperbolic(3, 4, 0.6)], ids=["total", "hyperbolic"])
def test_projection_recovers_a_polynomial(setup, indices):
    chaos = setup(MIXED, indices)
    wanted = np.random.default_rng(0).standard_normal((indices.shape[0], 2, 3))
    np.testing.assert_allclose(chaos.inverse @ chaos.matrix, np.eye(indices.shape[0]), atol=1e-10)
    np.testing.assert_allclose(chaos.project(chaos.at_nodes(wanted)), wanted, atol=1e-10)


def test_both_projections_of_a_smooth_function_converge_to_its_coefficients():
    """exp(s x) in a normal germ: coefficient k is s^k exp(s^2 / 2) / sqrt(k!)."""
    s, order = 0.4, 6
    k = np.arange(order + 1)
    exact = s**k * np.exp(0.5 * s**2) / np.sqrt(special.factorial(k))
    families, indices = (Hermite(),), total_order(1, order)
    by_quadrature = quadrature(families, indices, 25)
    np.testing.assert_allclose(
        by_quadrature.project(np.exp(s * by_quadrature.nodes[:, 0])), exact, atol=1e-13
    )
    coarse = collocate(families, indices)
    error = coarse.project(np.exp(s * coarse.nodes[:, 0])) - exact
    assert 0.0 < np.abs(error).max() < 1e-4


def test_regression_is_least_squares():
    families, indices = (Legendre(),), total_order(1, 2)
    nodes = np.linspace(-1.0, 1.0, 9)[:, np.newaxis]
    values = np.exp(nodes[:, 0])
    chaos = regression(families, indices, nodes)
    fitted = np.polynomial.Legendre.fit(nodes[:, 0], values, 2, domain=[-1.0, 1.0]).coef
    np.testing.assert_allclose(chaos.project(values) * np.sqrt([1.0, 3.0, 5.0]), fitted, rtol=1e-12)


def test_an_ill_conditioned_node_matrix_is_refused():
    families, indices = (Legendre(),), total_order(1, 2)
    close = np.array([[0.0], [0.1], [0.2]])
    with pytest.raises(ChaosError, match=r"condition number .*, more than 50.*selected_nodes"):
        regression(families, indices, close)
    assert regression(families, indices, close, most_ill=1e4).condition > 50.0
    with pytest.raises(ChaosError, match="condition number"):
        regression(families, indices, np.zeros((4, 1)))


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: basis_matrix(MIXED, total_order(2, 1), np.zeros((1, 3))), "3 families do not fit"),
        (lambda: basis_matrix(MIXED, total_order(3, 1), np.zeros((1, 2))), "must have 3 entries"),
        (lambda: basis_matrix(MIXED, total_order(3, 1)[1:], np.zeros(3)), "first row is the constant"),
        (lambda: tensor_grid((), 2), "at least one"),
        (lambda: tensor_grid(MIXED, [2, 2]), "each of the 3 germs"),
        (lambda: tensor_grid(MIXED, 0), "1 point or more, got 0"),
        (lambda: tensor_grid((Legendre(),) * 12, 9), "too many to hold"),
        (lambda: selected_nodes(MIXED, total_order(3, 2), 9), "between the 10 terms and the 27 points"),
        (lambda: selected_nodes(MIXED, total_order(3, 2), 28), "got 28"),
        (lambda: selected_nodes((Legendre(),) * 7, total_order(7, 5)), "too large"),
        (
            lambda: regression(MIXED, total_order(3, 2), np.zeros((9, 3))),
            "10 terms need at least as many nodes",
        ),
        (lambda: quadrature(MIXED, total_order(3, 2), 2), r"at least \[3, 3, 3\] Gauss points"),
        (lambda: quadrature((Legendre(),) * 7, total_order(7, 5)), "too large"),
    ],
)
def test_bad_parameters_are_named(call, said):
    with pytest.raises(ChaosError, match=said):
        call()

"""Index sets: how many terms, which, and in what order."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpc import ChaosError, count_terms, hyperbolic, total_order


@given(germs=st.integers(1, 5), order=st.integers(0, 5))
def test_total_order_holds_every_row_once(germs, order):
    indices = total_order(germs, order)
    wanted = {row for row in product(range(order + 1), repeat=germs) if sum(row) <= order}
    assert indices.shape == (count_terms(germs, order), germs)
    assert {tuple(row) for row in indices.tolist()} == wanted


def test_known_numbers_of_terms():
    """[M] eq 8; 15 and 36 are the report's four and seven parameters at order 2."""
    assert [count_terms(d, 2) for d in (1, 4, 7)] == [3, 15, 36]
    assert count_terms(7, 5) == 792
    assert total_order(3, 0).tolist() == [[0, 0, 0]]


@pytest.mark.parametrize("q", [1.0, 0.7, 0.4])
def test_rows_are_graded_and_linear_terms_follow_the_constant(q):
    indices = hyperbolic(4, 5, q)
    assert np.all(np.diff(indices.sum(axis=1)) >= 0)
    assert indices[0].tolist() == [0, 0, 0, 0]
    np.testing.assert_array_equal(indices[1:5], np.eye(4))


def test_within_a_degree_the_earlier_germ_comes_first():
    assert total_order(2, 2).tolist() == [[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]]


def test_the_hyperbolic_cross_drops_interactions():
    np.testing.assert_array_equal(hyperbolic(3, 4, 1.0), total_order(3, 4))
    # (1 + 1)^(1/q) is 4 for q = 1/2: the bound itself belongs to the set.
    assert [1, 1] in hyperbolic(2, 4, 0.5).tolist()
    assert [1, 1] not in hyperbolic(2, 4, 0.49).tolist()
    cross = hyperbolic(2, 5, 0.5)
    wanted = [row for row in total_order(2, 5).tolist() if np.sqrt(row).sum() ** 2 <= 5 + 1e-9]
    assert cross.tolist() == wanted
    # In the limit only powers of single germs are left, up to the full order.
    assert hyperbolic(3, 4, 0.01).shape[0] == 1 + 3 * 4


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: total_order(0, 2), "1 germ or more, got 0"),
        (lambda: total_order(2, -1), "0 or more, got -1"),
        (lambda: total_order(30, 10), "more than 1000000; lower the order"),
        (lambda: hyperbolic(2, 3, 0.0), r"\(0, 1\], got 0.0"),
        (lambda: hyperbolic(2, 3, float("nan")), "got nan"),
    ],
)
def test_bad_parameters_are_named(call, said):
    with pytest.raises(ChaosError, match=said):
        call()

r"""Which products of one-variable polynomials an expansion keeps.

A term of a chaos in d germs is a row :math:`i = (i_1 \ldots i_d)` of degrees; its polynomial is
:math:`\Psi_i(\xi) = \prod_k \psi_{i_k}(\xi_k)` ([M] eq 7, with degrees from 0 and a bound on their sum,
ERRATA).

- total order PO keeps :math:`\sum_k i_k \le PO`: :math:`S = (d + PO)! / (d!\, PO!)` terms ([M] eq 8);
- the hyperbolic cross keeps :math:`(\sum_k i_k^q)^{1/q} \le PO` with :math:`0 < q \le 1`: q = 1 is total
  order, and a smaller q drops products of many germs first (Blatman and Sudret, J. Comput. Phys. 230, 2011).

Rows are graded: by total degree, and among equals the earlier germ first. So row 0 is the constant and row
1 + k the linear term of germ k, whatever the order and q (for PO > 0).
"""

from __future__ import annotations

from math import comb

import numpy as np
from numpy.typing import NDArray

from gpc.errors import ChaosError

Indices = NDArray[np.int64]

MOST_TERMS = 1_000_000
"""An index set beyond this is refused: a slip in the order or the number of germs, hardly ever a wish."""


def count_terms(germs: int, order: int) -> int:
    """Count the terms of total degree up to ``order`` in ``germs`` variables, [M] eq 8.

    Raises
    ------
    ChaosError
        When there is no germ or the order is negative.
    """
    if germs < 1:
        raise ChaosError(f"an expansion needs 1 germ or more, got {germs}")
    if order < 0:
        raise ChaosError(f"the order of an expansion is 0 or more, got {order}")
    return comb(germs + order, order)


def total_order(germs: int, order: int) -> Indices:
    """List the terms of total degree up to ``order`` in ``germs`` variables.

    Returns
    -------
    ndarray of int, shape (S, germs)
        Degrees, graded; row 0 is the constant, row 1 + k the linear term of germ k.

    Raises
    ------
    ChaosError
        When there is no germ, the order is negative, or there are more than a million terms.
    """
    terms = count_terms(germs, order)
    if terms > MOST_TERMS:
        raise ChaosError(
            f"{germs} germs of order {order} make {terms} terms, more than {MOST_TERMS}; lower the order,"
            " or keep fewer germs"
        )
    rows = [row for degree in range(order + 1) for row in _of_degree(germs, degree)]
    return np.array(rows, dtype=np.int64)


def hyperbolic(germs: int, order: int, q: float) -> Indices:
    """List the terms of the hyperbolic cross: q-norm of the degrees up to ``order``.

    Parameters
    ----------
    germs, order : int
        Number of variables and highest degree.
    q : float
        In (0, 1]; 1 gives `total_order`, smaller values drop interactions.

    Returns
    -------
    ndarray of int, shape (S, germs)
        A part of `total_order`, in its order.

    Raises
    ------
    ChaosError
        As `total_order`, or when ``q`` is outside (0, 1].
    """
    if not 0.0 < q <= 1.0:
        raise ChaosError(f"the hyperbolic q must lie in (0, 1], got {q!r}; 1 keeps the total order")
    indices = total_order(germs, order)
    norm = np.sum(indices.astype(np.float64) ** q, axis=1)
    # Pure powers lie on the bound itself and must not fall to rounding.
    kept: Indices = indices[norm <= order**q * (1.0 + 1e-12)]
    return kept


def _of_degree(germs: int, degree: int) -> list[tuple[int, ...]]:
    """List the ways to share out a total degree, the earlier germ taking most first."""
    if germs == 1:
        return [(degree,)]
    return [
        (first, *rest) for first in range(degree, -1, -1) for rest in _of_degree(germs - 1, degree - first)
    ]

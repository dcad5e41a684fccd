r"""The random draws behind [M] Tables 9 to 20, which the report does not name.

Ten numbers make its first five scenarios, and the rows for them in Tables 9, 10 and 12 to 16 are some thirty
equations. Least squares gives them, to 0.2 at worst; the one furthest out is known to 0.01, and it is -3.37.
That is what the formula of Box and Muller makes of 41 and 18467, the first two numbers of Microsoft's C
library:

.. math::

    x \leftarrow 214013\,x + 2531011 \bmod 2^{32}, \quad x_0 = 1, \qquad
    r = \lfloor x / 2^{16} \rfloor \bmod 2^{15}, \qquad u = r / 32767,

    z = \sqrt{-2 \ln u_1}\,\cos(2 \cdot 3.14\,u_2),

with :math:`\pi` as 3.14, which the errors in Table 9 tell from 3.1416. A scenario takes four numbers: two for
the free-flow speed, two for the density. A sample begins anew each time, so smaller ones are parts of larger
ones, and all tables have the same draws. Antithetic samples are the first half with their mirror images.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PI = 3.14
MULTIPLIER, INCREMENT, START, MOST = 214013, 2531011, 1, 32767


def library_numbers(count: int) -> list[int]:
    """Give the first integers of the generator: 41, 18467, 6334, ..."""
    state, numbers = START, []
    for _ in range(count):
        state = (MULTIPLIER * state + INCREMENT) % 2**32
        numbers.append(state // 2**16 % 2**15)
    return numbers


def report_draws(count: int) -> Array:
    """Give the report's standard normal draws, shape (count, 2): of free-flow speed and density."""
    uniform = np.array(library_numbers(4 * count), dtype=np.float64).reshape(count, 2, 2) / MOST
    draws = np.sqrt(-2.0 * np.log(uniform[..., 0])) * np.cos(2.0 * PI * uniform[..., 1])
    return np.asarray(draws, dtype=np.float64)

r"""A floor under the value of a program with little noise, which tells where cubic look-ups overshoot.

Where noise is narrower than a cell of the grid, the width of the belief may smooth the kinks of the
cost-to-go, or not: whether it does hangs on where penalties, rows and nodes lie, and no rule was found that
tells it beforehand. What goes wrong is seen in the value, which comes out per cents too low. With look-ups
that are linear in SOC and weights that are not negative (`ems.monotone`) it comes out too high, by an error
that falls with the spacing ``h`` at least as ``h``. So

.. math:: 2 J(h / 2) - J(h) - \varepsilon |J|

is a floor, and a solution by cubic look-ups that falls below it is not believed; the grid is refined
(`ems.resolution.finer`). Where the noise is wider nothing is tried: the check costs two solves more.
"""

from __future__ import annotations

TOLERANCE = 1e-3
"""Share of the value by which a solution may lie lower; well within what the grid promises."""


def floor_kg(coarse_kg: float, half_kg: float) -> float:
    """Give the floor from the values at a spacing and at half of it, in kg."""
    return 2.0 * half_kg - coarse_kg - TOLERANCE * abs(half_kg)

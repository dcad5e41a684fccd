r"""The control that a cost-to-go recommends at one state: [L] eq 19, compiled.

For every control the one-step cost plus the expected cost-to-go is evaluated at the state itself, not at a
grid node: cubic (or linear) in SOC, quadratic in variance, the Gaussian expectation by Gauss-Hermite
quadrature inside the control loop. So it approximates less than the sweep does, and does not depend on it but
through the tables.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms._levels import first_level, level_weights
from ems._look_up import look_up_gauss, look_up_point
from ems._moves import solve_current
from ems._sdp import Grid, Scalars, repeats

Array = NDArray[np.float64]

ESTIMATE, CERTAIN, TRUTH = 0, 1, 2  # what a policy acts on: (estimate, variance), estimate alone, true SOC

POINT = np.sqrt(3.0)  # outer points of the three-point Gauss-Hermite rule, see `ems._look_up`


class Action(NamedTuple):
    """A control: its column in the stage tables, and the engine state of the next step."""

    control: int
    engine_next: int


@njit(cache=True, inline="always", error_model="numpy")
def table_at(
    soc_first: float,
    soc_step: float,
    ocv_V: Array,
    discharge_ohm: Array,
    charge_ohm: Array,
    low_A: Array,
    high_A: Array,
    soc: float,
) -> tuple[float, float, float, float, float]:
    """OCV, the two resistances and the two current limits at a SOC, linear between nodes."""
    x = min(max((soc - soc_first) / soc_step, 0.0), ocv_V.size - 1.0)
    at = min(int(x), ocv_V.size - 2)
    t = x - at
    return (
        ocv_V[at] + t * (ocv_V[at + 1] - ocv_V[at]),
        discharge_ohm[at] + t * (discharge_ohm[at + 1] - discharge_ohm[at]),
        charge_ohm[at] + t * (charge_ohm[at + 1] - charge_ohm[at]),
        low_A[at] + t * (low_A[at + 1] - low_A[at]),
        high_A[at] + t * (high_A[at + 1] - high_A[at]),
    )


@njit(cache=True, error_model="numpy")
def pack_at(grid: Grid, soc: float) -> tuple[float, float, float, float, float]:
    """OCV, the two resistances and the two current limits at a SOC; see `table_at`."""
    return table_at(
        grid.soc_first,
        grid.soc_step,
        grid.ocv_V,
        grid.discharge_ohm,
        grid.charge_ohm,
        grid.current_low_A,
        grid.current_high_A,
        soc,
    )


@njit(cache=True, inline="always", error_model="numpy")
def first_node(x: float, n: int) -> tuple[int, float]:
    """First of four nodes around the grid coordinate ``x``, and the place from the second of them."""
    held = min(max(x, 0.0), n - 1.0)
    at = min(max(int(held) - 1, 0), n - 4)
    return at, held - at - 1.0


@njit(cache=True, nogil=True, inline="always", error_model="numpy")
def linear_look_up(after: NDArray[np.float32], x: float) -> tuple[float, float]:
    """Cost-to-go of a program with one row, engine off and on, linear between two nodes."""
    n = after.shape[2]
    held = min(max(x, 0.0), n - 1.0)
    at = min(int(held), n - 2)
    t = held - at
    off, on = (1.0 - t) * after[0, 0, at], (1.0 - t) * after[1, 0, at]
    return off + t * after[0, 0, at + 1], on + t * after[1, 0, at + 1]


@njit(cache=True, nogil=True, inline="always", error_model="numpy")
def cubic_look_up(
    after: NDArray[np.float32], x: float, spread: float, q: int, share: tuple[float, float, float]
) -> tuple[float, float]:
    """Expected cost-to-go, engine off and on, of a Gaussian about ``x`` in grid steps.

    Parameters
    ----------
    after : ndarray of float32, shape (2, r, n)
        Cost-to-go of the next stage.
    x, spread : float
        Mean and standard deviation, in grid steps.
    q, share : int, tuple of float
        First of three variance rows, and their weights; of a single row the first counts three times.
    """
    rows, n = after.shape[1], after.shape[2]
    row = n if rows > 1 else 0
    base = q * n
    middle, u = first_node(x, n)
    if spread <= 0.0:
        found: tuple[float, float] = look_up_point(after, rows * n, row, (base + middle,), (u,), share)
        return found
    low, v = first_node(x - spread * POINT, n)
    high, w = first_node(x + spread * POINT, n)
    starts = (base + low, base + middle, base + high)
    several: tuple[float, float] = look_up_gauss(after, rows * n, row, starts, (v, u, w), share)
    return several


@njit(cache=True, nogil=True)
def expected_cost_to_go(
    soc_first: float,
    soc_step: float,
    level_step: float,
    level: Array,
    cubic: bool,
    after: NDArray[np.float32],
    soc: float,
    spread: float,
    variance: float,
) -> tuple[float, float]:
    """Expected cost-to-go with the engine off and on next, for a Gaussian SOC and a variance level.

    Parameters
    ----------
    soc_first, soc_step, level_step, level, cubic
        As in `Grid`; a program with linear look-ups has one row, and ``spread`` is ignored.
    after : ndarray of float32, shape (2, r, n)
        Cost-to-go of the next stage.
    soc, spread : float
        Mean and standard deviation of the next SOC.
    variance : float
        Next variance; ignored where the cost-to-go has one row.
    """
    x = (soc - soc_first) / soc_step
    if not cubic:
        return linear_look_up(after, x)
    q, share = 0, (1.0, 0.0, 0.0)
    if after.shape[1] > 1:
        q, share = level_weights(level, level_step, variance)
    return cubic_look_up(after, x, spread / soc_step, q, share)


@njit(cache=True, nogil=True, error_model="numpy")
def choose(
    grid: Grid,
    scalars: Scalars,
    after: NDArray[np.float32],
    cost_kg: Array,
    power_W: Array,
    acts_on: int,
    soc: float,
    posterior: float,
    spread: float,
    engine_on: int,
) -> tuple[int, int]:
    """Choose the control of least expected cost, [L] eq 19.

    Parameters
    ----------
    grid, scalars
        The problem that the cost-to-go belongs to.
    after : ndarray of float32, shape (2, r, n)
        Cost-to-go of the next stage.
    cost_kg, power_W : ndarray, shape (C,)
        Stage tables of this step.
    acts_on : int
        ESTIMATE, CERTAIN or TRUTH.
    soc : float
        What the policy takes for the SOC.
    posterior, spread : float
        Next variance before the current's share, and standard deviation of the innovation (ESTIMATE only).
    engine_on : int
        Engine state of this step.

    Returns
    -------
    tuple of int
        Column of the control, and engine state of the next step.
    """
    return decide(
        grid.soc_first,
        grid.soc_step,
        grid.level_step,
        grid.level,
        grid.cubic,
        pack_at(grid, soc),
        scalars,
        after,
        cost_kg,
        power_W,
        acts_on,
        soc,
        posterior,
        spread,
        engine_on,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def decide(
    soc_first: float,
    soc_step: float,
    level_step: float,
    level: Array,
    cubic: bool,
    pack: tuple[float, float, float, float, float],
    scalars: Scalars,
    after: NDArray[np.float32],
    cost_kg: Array,
    power_W: Array,
    acts_on: int,
    soc: float,
    posterior: float,
    spread: float,
    engine_on: int,
) -> tuple[int, int]:
    """Choose as `choose` does, from fields of the grid and the pack at the SOC.

    Taking fields, not the grid, is a matter of speed: a tuple of arrays costs more than the look-ups, because
    numba counts the references to each of its arrays on every call.
    """
    ocv_V, discharge_ohm, charge_ohm, low_A, high_A = pack
    first, last = (1, power_W.size) if engine_on else (0, 1)
    start_cost_kg = 0.0 if engine_on else scalars.start_cost_kg
    price_kg_per_W = scalars.step_s * scalars.shortfall_kg_per_J
    per_cell = 1.0 / soc_step
    here = (soc - soc_first) * per_cell
    moved = scalars.charge_to_soc * per_cell
    width = 0.0 if acts_on == CERTAIN else spread * per_cell
    many = after.shape[1] > 1
    # The level of one control is mostly that of the next: its three rows are found anew where it is not.
    q, above, below = 0, -1.0, 0.0
    p0, p1, p2, s0, s1, s2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    share = (1.0, 0.0, 0.0)
    best = np.inf
    control, engine_next = first, engine_on
    for c in range(first, last):
        if repeats(power_W, cost_kg, c):
            continue
        i, missing_W = solve_current(power_W[c], ocv_V, discharge_ohm, charge_ohm, low_A, high_A)
        drift = scalars.drift + scalars.drift_per_A * abs(i)
        x = here + moved * i
        if not cubic:
            off, on = linear_look_up(after, x)
        else:
            if many:
                variance = posterior + drift
                if not below <= variance < above:
                    q = first_level(level_step, level.size, variance)
                    below = ((q + 0.5) * level_step) ** 2 if q > 0 else 0.0
                    above = ((q + 1.5) * level_step) ** 2 if q < level.size - 3 else np.inf
                    p0, p1, p2 = level[q], level[q + 1], level[q + 2]
                    s0 = 1.0 / ((p0 - p1) * (p0 - p2))
                    s1 = 1.0 / ((p1 - p0) * (p1 - p2))
                    s2 = 1.0 / ((p2 - p0) * (p2 - p1))
                x0, x1, x2 = variance - p0, variance - p1, variance - p2
                share = (x1 * x2 * s0, x0 * x2 * s1, x0 * x1 * s2)
            elif acts_on == TRUTH:
                width = np.sqrt(drift) * per_cell
            off, on = cubic_look_up(after, x, width, q, share)
        on += start_cost_kg
        cost = cost_kg[c] + missing_W * price_kg_per_W + min(off, on)
        if cost < best:
            best = cost
            control, engine_next = c, int(on < off)
    return control, engine_next

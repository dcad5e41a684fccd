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

from bms._levels import level_weights
from ems._moves import solve_current
from ems._sdp import Grid, Scalars, repeats

Array = NDArray[np.float64]

ESTIMATE, CERTAIN, TRUTH = 0, 1, 2  # what a policy acts on: (estimate, variance), estimate alone, true SOC

# Three-point Gauss-Hermite rule of the standard normal, exact to the fifth degree: the cost-to-go is
# smooth over the spread of one innovation, because the belief is several times wider
POINT = np.sqrt(3.0)
NODES = np.array([-POINT, 0.0, POINT])
WEIGHTS = np.array([1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0])
MIDDLE = 1


class Action(NamedTuple):
    """A control: its column in the stage tables, and the engine state of the next step."""

    control: int
    engine_next: int


@njit(cache=True, inline="always")
def pack_at(grid: Grid, soc: float) -> tuple[float, float, float, float, float]:
    """OCV, the two resistances and the two current limits at a SOC, linear between nodes."""
    x = min(max((soc - grid.soc_first) / grid.soc_step, 0.0), grid.ocv_V.size - 1.0)
    at = min(int(x), grid.ocv_V.size - 2)
    t = x - at
    return (
        grid.ocv_V[at] + t * (grid.ocv_V[at + 1] - grid.ocv_V[at]),
        grid.discharge_ohm[at] + t * (grid.discharge_ohm[at + 1] - grid.discharge_ohm[at]),
        grid.charge_ohm[at] + t * (grid.charge_ohm[at + 1] - grid.charge_ohm[at]),
        grid.current_low_A[at] + t * (grid.current_low_A[at + 1] - grid.current_low_A[at]),
        grid.current_high_A[at] + t * (grid.current_high_A[at + 1] - grid.current_high_A[at]),
    )


@njit(cache=True, inline="always")
def soc_weights(x: float, n: int, cubic: bool) -> tuple[int, float, float, float, float]:
    """First of four nodes around the grid coordinate ``x``, and their Lagrange (or linear) weights."""
    x = min(max(x, 0.0), n - 1.0)
    at = min(max(int(x) - 1, 0), n - 4)
    t = x - at
    if cubic:
        a, b, c, d = t, t - 1.0, t - 2.0, t - 3.0
        return at, -b * c * d / 6.0, 0.5 * a * c * d, -0.5 * a * b * d, a * b * c / 6.0
    first = min(int(t), 2)
    t -= first
    low, high = 1.0 - t, t
    return (
        at,
        low if first == 0 else 0.0,
        low if first == 1 else (high if first == 0 else 0.0),
        low if first == 2 else (high if first == 1 else 0.0),
        high if first == 2 else 0.0,
    )


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

    Takes fields of `Grid` one by one: passing the tuple costs more than the look-ups, because numba counts
    the references to each of its arrays on every call.

    Parameters
    ----------
    soc_first, soc_step, level_step, level, cubic
        As in `Grid`.
    after : ndarray of float32, shape (2, r, n)
        Cost-to-go of the next stage.
    soc, spread : float
        Mean and standard deviation of the next SOC.
    variance : float
        Next variance; ignored where the cost-to-go has one row.
    """
    rows, n = after.shape[1], after.shape[2]
    q, share = 0, (1.0, 0.0, 0.0)
    if rows > 1:
        q, share = level_weights(level, level_step, variance)
    off = on = 0.0
    single = spread <= 0.0
    for m in range(NODES.size):
        if single and m != MIDDLE:
            continue
        weight = 1.0 if single else WEIGHTS[m]
        x = (soc + spread * NODES[m] - soc_first) / soc_step
        at, w0, w1, w2, w3 = soc_weights(x, n, cubic)
        for row in range(min(rows, 3)):
            factor = weight * share[row]
            v = q + row
            off += factor * (
                w0 * after[0, v, at]
                + w1 * after[0, v, at + 1]
                + w2 * after[0, v, at + 2]
                + w3 * after[0, v, at + 3]
            )
            on += factor * (
                w0 * after[1, v, at]
                + w1 * after[1, v, at + 1]
                + w2 * after[1, v, at + 2]
                + w3 * after[1, v, at + 3]
            )
    return off, on


@njit(cache=True, nogil=True)
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
    ocv_V, discharge_ohm, charge_ohm, low_A, high_A = pack_at(grid, soc)
    first, last = (1, power_W.size) if engine_on else (0, 1)
    best = np.inf
    control, engine_next = first, engine_on
    for c in range(first, last):
        if repeats(power_W, cost_kg, c):
            continue
        i, missing_W = solve_current(power_W[c], ocv_V, discharge_ohm, charge_ohm, low_A, high_A)
        drift = scalars.drift + scalars.drift_per_A * abs(i)
        width, variance = spread, posterior + drift
        if acts_on == CERTAIN:
            width = 0.0
        elif acts_on == TRUTH:
            width = np.sqrt(drift)
        off, on = expected_cost_to_go(
            grid.soc_first,
            grid.soc_step,
            grid.level_step,
            grid.level,
            grid.cubic,
            after,
            soc + scalars.charge_to_soc * i,
            width,
            variance,
        )
        if not engine_on:
            on += scalars.start_cost_kg
        cost = cost_kg[c] + missing_W * scalars.step_s * scalars.shortfall_kg_per_J + min(off, on)
        if cost < best:
            best = cost
            control, engine_next = c, int(on < off)
    return control, engine_next

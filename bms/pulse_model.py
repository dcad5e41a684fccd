r"""The voltage of a pulse test as a casadi expression of the circuit's unknowns.

With the exact zero-order-hold response :math:`w_{k+1} = e\,w_k + (1 - e) I_k`, :math:`e = \exp(-h_k/\tau)`,
of a pair of 1 ohm that starts at rest, [M] eqs 55-56 read

.. math:: V_k = V_{oc}(SOC_0 + q_k / Q) + \sum_j R_j\,w_k(\tau_j) + R\,I_k .

Unknown are logarithms (positive by construction), with the second time constant as a multiple of the first,
and the initial SOC as it is. casadi differentiates the recursion exactly. The monotone cubic of the OCV table
is one with a continuous first derivative, hence a cubic B-spline with double knots: no second interpolation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bms.errors import BatteryError
from bms.ocv import OcvCurve

Array = NDArray[np.float64]

UNIT_V = 1e-3
"""The residuals that the solver sees are in millivolt."""

SOLVER = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-8,
    "ipopt.acceptable_tol": 1e-6,
    "ipopt.acceptable_iter": 3,
    "ipopt.mu_init": 1e-4,
    "ipopt.max_iter": 200,
}

NEAREST_TIMES = 1.2
"""The second time constant is at least this multiple of the first: closer ones cannot be told apart."""

WIDEST_TIMES = 1e4

BOUND = 1e-5
"""An unknown this near to a bound is held by it."""

PERFECT_V = 1e-9
ORTHOGONAL = 1e-6


@dataclass(frozen=True, eq=False)
class PulseProblem:
    """A pulse test made ready to be solved.

    Parameters
    ----------
    voltage_and_slopes : callable
        Takes the unknowns, gives the model's voltage (n,) and its derivatives (n, p).
    solve : callable
        Takes first values and bounds of the unknowns, gives the best ones; raises a `BatteryError` when the
        solver gives up.
    """

    voltage_and_slopes: Callable[[Array], tuple[Array, Array]]
    solve: Callable[[Array, Array, Array], Array]


def spline_of(curve: OcvCurve) -> tuple[Array, Array]:
    """Knots and coefficients of the cubic B-spline that is the curve's monotone cubic.

    Parameters
    ----------
    curve : OcvCurve
        With n nodes.

    Returns
    -------
    tuple of ndarray
        Knots, shape (2 n + 4,), each inner node twice; coefficients, shape (2 n,), the Bezier points.
    """
    knot, cubic = np.asarray(curve.interpolant.x), np.asarray(curve.interpolant.c)
    third = np.diff(knot) / 3.0
    slope = np.append(cubic[2], curve.slope_V(1.0))
    after = curve.voltage_V[:-1] + slope[:-1] * third
    before = curve.voltage_V[1:] - slope[1:] * third
    points = np.column_stack((after, before)).ravel()
    coefficients = np.concatenate((curve.voltage_V[:1], points, curve.voltage_V[-1:]))
    knots = np.concatenate((knot[:1].repeat(4), knot[1:-1].repeat(2), knot[-1:].repeat(4)))
    return knots, coefficients


def import_casadi() -> Any:
    """Import casadi.

    Raises
    ------
    BatteryError
        When it is not installed.
    """
    try:
        import casadi
    except ImportError as error:
        raise BatteryError(
            "identification needs casadi, which is not installed; pip install casadi"
        ) from error
    return casadi


def build_problem(
    step_s: Array,
    current_A: Array,
    voltage_V: Array,
    moved_soc: Array,
    curve: OcvCurve,
    pairs: int,
    soc: float | None,
) -> PulseProblem:
    """Write the pulse test down for casadi.

    Parameters
    ----------
    step_s : ndarray, shape (n - 1,)
        Steps between the samples.
    current_A, voltage_V, moved_soc : ndarray, shape (n,)
        Samples, and the change of SOC since the first one.
    curve : OcvCurve
        Open-circuit voltage.
    pairs : int
        Relaxation pairs, 1 or 2.
    soc : float or None
        SOC of the first sample; None to have it as the last unknown.
    """
    ca = import_casadi()
    unknown = ca.MX.sym("unknown", 1 + 2 * pairs + (soc is None))
    total = ca.exp(unknown[0]) * ca.DM(current_A)
    for pair, log_time in enumerate(_log_times(unknown, pairs)):
        total += ca.exp(unknown[1 + 2 * pair]) * _response(ca, step_s, current_A, log_time)
    if soc is None:
        knots, coefficients = spline_of(curve)
        ocv = ca.Function.bspline("ocv", [knots.tolist()], coefficients.tolist(), [3], 1)
        total += ocv.map(current_A.size)(unknown[-1] + ca.DM(moved_soc).T).T
    else:
        total += ca.DM(curve(soc + moved_soc))
    residual = (total - ca.DM(voltage_V)) / UNIT_V
    model = ca.Function("model", [unknown], [total, ca.jacobian(total, unknown)])
    solver = ca.nlpsol("solver", "ipopt", {"x": unknown, "f": 0.5 * ca.dot(residual, residual)}, SOLVER)

    def voltage_and_slopes(at: Array) -> tuple[Array, Array]:
        value, slopes = model(at)
        return np.asarray(value).ravel(), np.asarray(slopes)

    def solve(first: Array, low: Array, high: Array) -> Array:
        found = np.asarray(solver(x0=first, lbx=low, ubx=high)["x"], dtype=np.float64).ravel()
        if not (solver.stats()["success"] or _is_best(found, low, high, voltage_V, voltage_and_slopes)):
            raise BatteryError(
                f"IPOPT found no fit to the pulse test ({solver.stats()['return_status']}); check the sign"
                " of the current, the capacity and the OCV, or fit fewer pairs"
            )
        return found

    return PulseProblem(voltage_and_slopes, solve)


def _is_best(
    found: Array, low: Array, high: Array, voltage_V: Array, model: Callable[[Array], tuple[Array, Array]]
) -> bool:
    """Whether the residuals are at right angles to every slope that is not held by a bound.

    The solver gives up at a perfect fit too, when rounding hides the way down.
    """
    value, slopes = model(found)
    residual_V = voltage_V - value
    free = (found - low > BOUND) & (high - found > BOUND)
    lengths = np.linalg.norm(slopes[:, free], axis=0) * np.linalg.norm(residual_V)
    perfect = float(np.abs(residual_V).max()) < PERFECT_V
    return perfect or bool(np.all(np.abs(residual_V @ slopes[:, free]) <= ORTHOGONAL * lengths))


def _log_times(unknown: Any, pairs: int) -> list[Any]:
    """Logarithms of the time constants, from the unknowns."""
    return [unknown[2]] if pairs == 1 else [unknown[2], unknown[2] + unknown[4]]


def _response(ca: Any, step_s: Array, current_A: Array, log_time: Any) -> Any:
    """Voltage of a pair of 1 ohm at every sample, from rest."""
    state, step, current, log_of = (ca.SX.sym(name) for name in ("state", "step", "current", "log_of"))
    keep = ca.exp(-step * ca.exp(-log_of))
    once = ca.Function("once", [state, step, current, log_of], [keep * state + (1.0 - keep) * current])
    n = step_s.size
    moved = once.mapaccum(n)(0.0, ca.DM(step_s).T, ca.DM(current_A[:-1]).T, ca.repmat(log_time, 1, n))
    return ca.horzcat(0.0, moved).T

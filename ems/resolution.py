r"""How fine a grid must be so that noise smooths the kinks of the cost-to-go that the grid cannot see.

A penalty that jumps leaves kinks in the cost-to-go. Noise smooths them: what moves the state over a step, and
the width of the belief, through the expected penalties. Cubic look-ups are right where one of the two is as
wide as a few cells; where neither is they let a move of a small fraction of a cell cost next to nothing
(`ems._interpolate`). The default uncertainty moves the estimate by 0.3 % SOC a step, more than a cell; a real
estimator may move it by a hundredth of that.

The grid is refined until it resolves one of the two, down to a `FINEST` part of what the settings say; where
that does not do, the operators of `ems.monotone` take the place of the cubic ones. Only an innovation as wide
as a cell of the settings is sure to do; what the width of the belief promises is tried (`ems.floor`).

The variance of a belief moves without any noise, by a part of a row that becomes small as a measurement says
less. Parabolas through three rows have negative weights, and the minimum over the controls, which lead to
different variances, then picks what alternates from row to row. It is damped in proportion to that part
(`ems._sdp.damp_rows`), for what grows does so in proportion to it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from bms.uncertainty import innovation_spread
from ems.problem import Problem

TYPICAL = 0.1
"""Share of the pack's largest current that is typical of driving."""
INNOVATION_CELLS, BELIEF_CELLS = 1.0, 3.0
"""Cells that the standard deviation of the innovation, or that of the belief, must span."""
PROCESS_CELLS, AMPLE = 2.5, 0.0025
"""Cells that the process noise must span where there is no belief to smooth anything; noise that is ample,
like the default's, makes do with one."""
FINEST = 5
"""The spacing of the settings is divided by this at most."""
DAMPING, MOST_DAMPING = 0.5, 0.05
"""Damping of the rows: so many times the part of a row by which the variance drifts in a step, up to this."""
REFINED = (2, 3, FINEST)
"""Parts that are tried where the first trial does not hold."""


@dataclass(frozen=True)
class Resolution:
    """What a program under noise needs.

    Parameters
    ----------
    soc_step : float
        Spacing of the SOC grid, a whole part of that of the settings.
    cubic : bool
        Whether cubic look-ups are safe on it.
    sure : bool
        Whether that needs no trial.
    """

    soc_step: float
    cubic: bool
    sure: bool = True


def belief_resolution(problem: Problem) -> Resolution:
    """Find spacing and look-up for the program over beliefs."""
    innovation, belief = settled_spreads(problem)
    widest = max(innovation / INNOVATION_CELLS, belief / BELIEF_CELLS)
    found = _resolve(problem, widest)
    return replace(found, sure=not found.cubic or innovation >= INNOVATION_CELLS * problem.settings.soc_step)


def finer(problem: Problem, tried: Resolution) -> Iterator[Resolution]:
    """Give what to try one after the other: a resolution, finer ones, and operators that cannot overshoot."""
    coarse = problem.settings.soc_step
    parts = round(coarse / tried.soc_step)
    yield tried
    for more in REFINED:
        if more > parts:
            yield Resolution(coarse / more, cubic=True)
    yield Resolution(coarse / FINEST, cubic=False)


def row_damping(problem: Problem, row_step: float) -> float:
    """Give the damping between variance rows that are uniform in ``sqrt(p)``, ``row_step`` apart."""
    drift, (_, belief) = _typical_drift(problem), settled_spreads(problem)
    moved = drift / (2.0 * belief * row_step) if belief > 0.0 else 0.0
    return min(DAMPING * moved, MOST_DAMPING)


def process_resolution(problem: Problem) -> Resolution:
    """Find spacing and look-up for the program over the true SOC with process noise."""
    spread = math.sqrt(_typical_drift(problem))
    return _resolve(problem, spread if spread >= AMPLE else spread / PROCESS_CELLS)


def _resolve(problem: Problem, widest_cell: float) -> Resolution:
    coarse = problem.settings.soc_step
    cubic = widest_cell * FINEST >= coarse
    parts = max(1, math.ceil(coarse / widest_cell - 1e-9)) if cubic else FINEST
    return Resolution(coarse / parts, cubic)


def _typical_drift(problem: Problem) -> float:
    largest_A = max(problem.pack.discharge_limit_A, problem.pack.charge_limit_A)
    return float(problem.uncertainty.process_variance(TYPICAL * largest_A, problem.step_s))


def settled_spreads(problem: Problem) -> tuple[float, float]:
    """Give the standard deviations of innovation and belief at the end of the trip, at a typical current.

    The measurement is taken where it is best within the SOC window: there the belief is narrowest.
    """
    window, drift = problem.concept.window, _typical_drift(problem)
    alpha = np.asarray(problem.pack.ocv.alpha(np.linspace(window.low, window.high, 101)))
    measured = problem.uncertainty.mu * float(alpha.min())
    variance = problem.concept.initial_soc_sd**2
    for _ in range(problem.steps):  # [L] eq 9
        total = variance + measured
        variance = drift + (variance * measured / total if total > 0.0 else 0.0)
    return float(innovation_spread(variance, measured)), math.sqrt(variance)

"""The filters of `vehicle.inertia.mass_spring` as numba kernels; the maths stands there.

States are position [m], velocity [m/s] and mass [kg], one column per node, probe or sigma point.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gpc import _ekf, _ukf
from gpc.compiled import FilterArrays

Array = NDArray[np.float64]

STATES = 3


@njit(cache=True, nogil=True)
def step(stiffness_Npm: float, time_s: float, step_s: float, points: Array, moved: Array) -> None:
    """Move every column over a step by the classical Runge-Kutta rule."""
    middle, h = time_s + 0.5 * step_s, step_s
    drive = (math.sin(time_s), math.sin(middle), math.sin(time_s + step_s))
    for q in range(points.shape[1]):
        x, v, w = points[0, q], points[1, q], stiffness_Npm / points[2, q]
        a1 = drive[0] - w * x
        v2 = v + 0.5 * h * a1
        a2 = drive[1] - w * (x + 0.5 * h * v)
        v3 = v + 0.5 * h * a2
        a3 = drive[1] - w * (x + 0.5 * h * v2)
        v4 = v + h * a3
        a4 = drive[2] - w * (x + h * v3)
        moved[0, q] = x + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
        moved[1, q] = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        moved[2, q] = points[2, q]


@njit(cache=True, nogil=True)
def advance(
    stiffness_Npm: float, start_s: float, end_s: float, longest_s: float, points: Array, moved: Array
) -> None:
    """Move every column from one sample to the next, in as many steps as accuracy needs."""
    pieces = max(math.ceil((end_s - start_s) / longest_s - 1e-9), 1)
    length = (end_s - start_s) / pieces
    step(stiffness_Npm, start_s, length, points, moved)
    for piece in range(1, pieces):
        step(stiffness_Npm, start_s + piece * length, length, moved, moved)


@njit(cache=True, nogil=True)
def run_chaos(
    known: FilterArrays,
    process_noise: Array,
    noise: Array,
    reach: float,
    stiffness_Npm: float,
    longest_s: float,
    time_s: Array,
    position_m: Array,
    mean: Array,
    covariance: Array,
    nis: Array,
) -> None:
    """Run the filter on chaos coefficients over a log; sample 0 is the prior.

    Parameters
    ----------
    known : FilterArrays
        Settings and start; chaos and remainder are changed.
    process_noise, noise : ndarray, shapes (3, 3) and (1, 1)
        Per step, and of a position.
    reach : float
        Of the probes, in standard deviations; see `gpc._ekf`.
    stiffness_Npm, longest_s : float
        Stiffness of the spring, and the longest step that is taken at once.
    time_s, position_m : ndarray, shape (N,)
        Times, and measured positions; NaN where there is none.
    mean, covariance, nis : ndarray, shapes (N, 3), (N, 3, 3) and (N,)
        Written: belief after each sample; NIS is NaN where nothing was measured.
    """
    forward, back, chaos, remainder, growth, added, diagonal, carried, lower, upper, share = known
    terms, nodes = forward.shape
    points = np.zeros((STATES, nodes + 2 * STATES))
    moved, slope = np.zeros_like(points), np.zeros((STATES, STATES))
    gain, total, white = np.zeros((STATES, 1)), np.zeros((1, 1)), np.zeros(1)
    keep, work, seen, z = np.zeros_like(slope), np.zeros_like(slope), np.zeros((1, terms)), np.zeros(1)
    measures = np.zeros((1, STATES))
    measures[0, 0] = 1.0
    for k in range(time_s.size):
        nis[k] = math.nan
        if k > 0:
            _ekf.widen(chaos, growth, added)
            _ekf.spread_points(forward, chaos, remainder, lower, upper, reach, points)
            advance(stiffness_Npm, time_s[k - 1], time_s[k], longest_s, points, moved)
            _ekf.expand(back, moved, chaos)
            if carried:
                _ekf.slopes(points, moved, nodes, slope)
                _ekf.carry(slope, remainder, process_noise, work)
            z[0] = position_m[k]
            if math.isfinite(z[0]):
                seen[0] = chaos[0]
                nis[k] = _ekf.update(
                    chaos,
                    remainder,
                    diagonal,
                    carried,
                    seen,
                    measures,
                    noise,
                    z,
                    gain,
                    total,
                    white,
                    keep,
                    work,
                )
                if _ekf.wants_restart(chaos, remainder, share):
                    _ekf.restart(chaos, remainder)
        for i in range(STATES):
            mean[k, i] = chaos[i, 0]
            for j in range(STATES):
                both = remainder[i, j]
                for t in range(1, terms):
                    both += chaos[i, t] * chaos[j, t]
                covariance[k, i, j] = both


@njit(cache=True, nogil=True)
def run_unscented(
    state: Array,
    belief: Array,
    process_noise: Array,
    noise: Array,
    lower: Array,
    upper: Array,
    alpha: float,
    stiffness_Npm: float,
    longest_s: float,
    time_s: Array,
    position_m: Array,
    mean: Array,
    covariance: Array,
    nis: Array,
) -> bool:
    """Run the unscented filter over a log; arguments as in `run_chaos`.

    Returns
    -------
    bool
        False if a covariance lost its definiteness; what follows is NaN.
    """
    reach, outer, centre = _ukf.sigma_weights(STATES, alpha)
    points, factor = np.zeros((STATES, 2 * STATES + 1)), np.zeros((STATES, STATES))
    moved, z, expected, white = np.zeros_like(points), np.zeros(1), np.zeros(1), np.zeros(1)
    gain, total = np.zeros((STATES, 1)), np.zeros((1, 1))
    mean[:], covariance[:], nis[:] = math.nan, math.nan, math.nan
    for k in range(time_s.size):
        if k > 0:
            if not _ukf.spread_sigma(state, belief, reach, lower, upper, points, factor):
                return False
            advance(stiffness_Npm, time_s[k - 1], time_s[k], longest_s, points, moved)
            _ukf.gather(moved, outer, centre, process_noise, state, belief)
            z[0] = position_m[k]
            if math.isfinite(z[0]):
                if not _ukf.spread_sigma(state, belief, reach, lower, upper, points, factor):
                    return False
                nis[k] = _ukf.update(
                    state,
                    belief,
                    points,
                    points[:1],
                    outer,
                    centre,
                    noise,
                    z,
                    expected,
                    gain,
                    total,
                    white,
                )
        mean[k] = state
        covariance[k] = belief
    return True

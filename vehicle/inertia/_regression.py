"""Ride and load-transfer models, and the filters on them, as numba kernels; the maths stands beside them.

A model turns a row of inputs and parameters, one column per node, probe or sigma point, into outputs. The
parameters are the whole state ([M] eq 27): they stay what they are between samples.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gpc import _ekf, _ukf
from gpc.compiled import FilterArrays

Array = NDArray[np.float64]

RIDE, LTM, MLTM = 0, 1, 2
PER_GRAVITY = 1.0 / 9.81


class Samples(NamedTuple):
    """A log as a model reads it: N samples, k inputs, m outputs."""

    kind: int
    inputs: Array  # (N, k)
    outputs: Array  # (N, m); a row with NaN is left out
    noise: Array  # (m, m)
    lengths: Array  # (2,) wheelbase and track


@njit(cache=True, nogil=True)
def ride(inputs: Array, points: Array, values: Array) -> None:
    """[M] eqs 31-33 on inputs (sum of forces, pitch moment, roll moment, A_x braking, A_y)."""
    total, pitch, roll, braking, ay = inputs[0], inputs[1], inputs[2], inputs[3], inputs[4]
    for q in range(points.shape[1]):
        mass, height = points[0, q], points[3, q]
        values[0, q] = total / mass
        values[1, q] = (pitch + mass * height * braking) / points[1, q]
        values[2, q] = (roll + mass * height * ay) / points[2, q]


@njit(cache=True, nogil=True)
def load_transfer(inputs: Array, lengths: Array, points: Array, values: Array) -> None:
    """[M] eqs 35-38 with h_p C as one parameter, on inputs (A_x, A_y, A_z, V^2) in m/s^2 and (m/s)^2."""
    ax, ay, az, square = inputs[0] * PER_GRAVITY, inputs[1] * PER_GRAVITY, inputs[2], inputs[3]
    wheelbase, track = lengths[0], lengths[1]
    share = 1.0 / (wheelbase * track)
    for q in range(points.shape[1]):
        a, left = points[1, q], points[2, q]
        b, right = wheelbase - a, track - left
        load = points[0, q] * az * share
        side = load * ay * points[3, q]
        nose = load * ax * points[4, q] + square * points[5, q] * share
        values[0, q] = load * b * right - side * b - nose * right
        values[1, q] = load * b * left + side * b - nose * left
        values[2, q] = load * a * right - side * a + nose * right
        values[3, q] = load * a * left + side * a + nose * left


@njit(cache=True, nogil=True)
def corner_transfer(inputs: Array, lengths: Array, points: Array, values: Array) -> None:
    """[M] eqs 39, 48-51 with h_p C as one parameter.

    Inputs are A_x, A_y, A_z of the four corners, V^2, pitch and roll acceleration.
    """
    ax, ay = inputs[0] * PER_GRAVITY, inputs[1] * PER_GRAVITY
    square, pitch, roll = inputs[6], inputs[7], inputs[8]
    wheelbase, track = lengths[0], lengths[1]
    mean = 0.25 * (inputs[2] + inputs[3] + inputs[4] + inputs[5])
    for q in range(points.shape[1]):
        fl, fr, rl, rr = points[0, q], points[1, q], points[2, q], points[3, q]
        per_mass = 1.0 / (fl + fr + rl + rr)
        behind = wheelbase * (rl + rr) * per_mass
        beside = track * (fr + rr) * per_mass
        middle = mean + (behind - 0.5 * wheelbase) * pitch + (0.5 * track - beside) * roll
        side = middle * ay * points[4, q] / track
        nose = (middle * ax * points[5, q] + square * points[6, q] * per_mass) / wheelbase
        values[0, q] = fl * inputs[2] - (fl + fr) * side - (fl + rl) * nose
        values[1, q] = fr * inputs[3] + (fl + fr) * side - (fr + rr) * nose
        values[2, q] = rl * inputs[4] - (rl + rr) * side + (fl + rl) * nose
        values[3, q] = rr * inputs[5] + (rl + rr) * side + (fr + rr) * nose


@njit(cache=True, nogil=True)
def evaluate(kind: int, inputs: Array, lengths: Array, points: Array, values: Array) -> None:
    """Write the outputs of a model for every column of parameters."""
    if kind == RIDE:
        ride(inputs, points, values)
    elif kind == LTM:
        load_transfer(inputs, lengths, points, values)
    else:
        corner_transfer(inputs, lengths, points, values)


@njit(cache=True, nogil=True)
def run_model(kind: int, inputs: Array, lengths: Array, parameters: Array, outputs: Array) -> None:
    """Write the outputs of a model, shape (N, m), for one set of parameters, shape (p,)."""
    points, values = np.zeros((parameters.size, 1)), np.zeros((outputs.shape[1], 1))
    points[:, 0] = parameters
    for k in range(inputs.shape[0]):
        evaluate(kind, inputs[k], lengths, points, values)
        outputs[k] = values[:, 0]


@njit(cache=True, nogil=True)
def complete(inputs: Array, outputs: Array) -> bool:
    """Whether a sample has every value."""
    total = 0.0
    for value in inputs:
        total += value
    for value in outputs:
        total += value
    return math.isfinite(total)


@njit(cache=True, nogil=True)
def run_chaos(
    known: FilterArrays, reach: float, samples: Samples, mean: Array, covariance: Array, nis: Array
) -> None:
    """Run the filter on chaos coefficients over a log.

    Parameters
    ----------
    known : FilterArrays
        Its chaos and remainder are changed.
    reach : float
        Of the probes, in standard deviations.
    samples : Samples
    mean, covariance, nis : ndarray, shapes (N, p), (N, p, p) and (N,)
        Written: belief after each sample; NIS is NaN where a sample was left out.
    """
    forward, back, chaos, remainder, growth, added, diagonal, carried, lower, upper, share = known
    kind, inputs, outputs, noise, lengths = samples
    n, (terms, nodes), m = chaos.shape[0], forward.shape, outputs.shape[1]
    points, values = np.zeros((n, nodes + 2 * n)), np.zeros((m, nodes + 2 * n))
    seen, slope = np.zeros((m, terms)), np.zeros((m, n))
    gain, total, white = np.zeros((n, m)), np.zeros((m, m)), np.zeros(m)
    keep, work = np.zeros((n, n)), np.zeros((n, n))
    for k in range(inputs.shape[0]):
        nis[k] = math.nan
        if complete(inputs[k], outputs[k]):
            _ekf.widen(chaos, growth, added)
            _ekf.spread_points(forward, chaos, remainder, lower, upper, reach, points)
            evaluate(kind, inputs[k], lengths, points, values)
            _ekf.expand(back, values, seen)
            _ekf.slopes(points, values, nodes, slope)
            nis[k] = _ekf.update(
                chaos,
                remainder,
                diagonal,
                carried,
                seen,
                slope,
                noise,
                outputs[k],
                gain,
                total,
                white,
                keep,
                work,
            )
            if _ekf.wants_restart(chaos, remainder, share):
                _ekf.restart(chaos, remainder)
        for i in range(n):
            mean[k, i] = chaos[i, 0]
            for j in range(n):
                both = remainder[i, j]
                for t in range(1, terms):
                    both += chaos[i, t] * chaos[j, t]
                covariance[k, i, j] = both


@njit(cache=True, nogil=True)
def run_unscented(
    state: Array,
    belief: Array,
    lower: Array,
    upper: Array,
    alpha: float,
    samples: Samples,
    mean: Array,
    covariance: Array,
    nis: Array,
) -> bool:
    """Run the unscented filter over a log; ``state`` and ``belief`` are changed, the rest as in `run_chaos`.

    Returns
    -------
    bool
        False if a covariance lost its definiteness; what follows is NaN.
    """
    kind, inputs, outputs, noise, lengths = samples
    n, m = state.size, outputs.shape[1]
    reach, outer, centre = _ukf.sigma_weights(n, alpha)
    points, values = np.zeros((n, 2 * n + 1)), np.zeros((m, 2 * n + 1))
    factor, gain, total = np.zeros((n, n)), np.zeros((n, m)), np.zeros((m, m))
    expected, white = np.zeros(m), np.zeros(m)
    mean[:], covariance[:], nis[:] = math.nan, math.nan, math.nan
    for k in range(inputs.shape[0]):
        if complete(inputs[k], outputs[k]):
            if not _ukf.spread_sigma(state, belief, reach, lower, upper, points, factor):
                return False
            evaluate(kind, inputs[k], lengths, points, values)
            nis[k] = _ukf.update(
                state,
                belief,
                points,
                values,
                outer,
                centre,
                noise,
                outputs[k],
                expected,
                gain,
                total,
                white,
            )
        mean[k] = state
        covariance[k] = belief
    return True


@njit(cache=True, nogil=True)
def run_least_squares(
    state: Array,
    belief: Array,
    forget: float,
    rows: Array,
    targets: Array,
    mean: Array,
    covariance: Array,
    squares: Array,
) -> None:
    """Run recursive least squares over a log, one row after the other (Ljung, System Identification, 11.2).

    Parameters
    ----------
    state, belief : ndarray, shapes (p,) and (p, p)
        Start: coefficients, and their covariance in units of the residuals' variance; changed.
    forget : float
        Forgetting factor per sample.
    rows, targets : ndarray, shapes (N, m, p) and (N, m)
        ``targets = rows @ state`` plus residuals; a sample with NaN is left out.
    mean, covariance, squares : ndarray, shapes (N, p), (N, p, p) and (N,)
        Written: coefficients and covariance after each sample, and its normalised residuals, squared.
    """
    p, direction = state.size, np.zeros(state.size)
    for k in range(targets.shape[0]):
        squares[k] = math.nan
        total = 0.0
        for a in range(targets.shape[1]):
            total += targets[k, a]
            for i in range(p):
                total += rows[k, a, i]
        if math.isfinite(total):
            squares[k] = 0.0
            for i in range(p):
                for j in range(p):
                    belief[i, j] /= forget
            for a in range(targets.shape[1]):
                rest, spread = targets[k, a], 1.0
                for i in range(p):
                    direction[i] = 0.0
                    for j in range(p):
                        direction[i] += belief[i, j] * rows[k, a, j]
                    rest -= rows[k, a, i] * state[i]
                for i in range(p):
                    spread += rows[k, a, i] * direction[i]
                squares[k] += rest * rest / spread
                for i in range(p):
                    state[i] += direction[i] * rest / spread
                for i in range(p):
                    for j in range(i + 1):
                        belief[i, j] -= direction[i] * direction[j] / spread
                        belief[j, i] = belief[i, j]
        mean[k] = state
        covariance[k] = belief

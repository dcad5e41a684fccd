"""What the recursive gPC estimator believes, from its sums; the maths is in `bms.estimators.gpc_gradient`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms.estimators._gpc_form import (
    ALPHA,
    BETA,
    BIAS,
    THETA,
    X10,
    XI,
    R,
    accumulate,
    coefficients,
    lagrange,
    projected_variance,
    pull_back,
    push_forward,
    quadratic,
)
from gpc._small import factorise, solve_factored

Array = NDArray[np.float64]

X1, V2, HYSTERESIS, CLOCK_S, ON_S, DOUBT_C2 = 0, 1, 2, 3, 4, 5
WEIGHT_S, SQUARE_V2S, FAST_V2, SLOW_V, COUNT, OCCASION, REJECTED, SINCE_S = range(6, 14)
DOUBT_A, LOST_V, LOST2_V, LOST_H, FAR_S = range(14, 19)
EARNED_S, MISMATCH_S, CALM_S, PATIENCE_S, ALARM_S, DOUBTED_C, REFUSED_C = range(19, 26)
SCALARS = 26
"""Places in the memory behind the gate's: charge since the start, second pair, hysteresis, clock of the
offset, time since start, variance of x1, sums of weights and of squared voltage, residuals (square, mean),
weighted number of samples, rest or full charge at the last sample, rejected samples, time since a step,
doubt about the last current, and what such doubts leave: deviations of both pairs and of the
hysteresis; time for which residuals have been far off; time for which they have been small, for which a
mismatch stands and for which there was none, how long one may stand, how long it is still flagged, and
the charge that it puts in doubt; the charge that refused voltages put in doubt."""

QUICK_S = 100.0
"""Time for which a residual counts as one where quick changes of the current are looked at."""


class Settings(NamedTuple):
    """Settings of the recursive gPC estimator."""

    node: Array  # (N,) Gauss nodes: eigenvalues of the Galerkin matrix of xi
    barycentric: Array  # (N,) weights of the Lagrange polynomials through them
    low: Array  # (6,) bounds of the parameters
    high: Array  # (6,)
    gain: Array  # (6,) gradient gains, Table 8
    prior_sd: Array  # (6,) standard deviations before any data
    start: Array  # (6,) values before any data
    sigma_mid_per_s: float
    sigma_half_per_s: float
    log_forgetting_per_s: float
    start_after_s: float
    noise_V2: float
    limit_A: float  # no current is larger
    model_error_V2: float
    current_sd_A: float
    still_A: float  # no more current than this turns no hysteresis
    lately_V: float  # deviation of the first pair when a belief is given up
    least_lost_V: float  # deviations of less than this are over
    correlation_s: float
    flat_slope_V: float
    reference: Array  # (5,) R, R1, tau1, R2, tau2 of the nominal cell at the reference
    parameters: int  # 5, or 6 with the offset
    newton_every_s: float  # 0: gradient
    full_sd: float
    rest_doubt_V: float
    resets_at_rest: bool
    resets_at_full: bool


class Room(NamedTuple):
    """Views of the memory, and room to work in."""

    x: Array  # scalars
    theta: Array
    m: Array
    b: Array
    value: Array  # Lagrange polynomials at xi
    slope: Array  # and their derivatives
    c: Array
    image: Array
    along: Array
    gradient: Array
    step: Array
    unit: Array
    information: Array
    hessian: Array


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _information(
    parameters: int,
    sd: Array,
    m: Array,
    theta: Array,
    value: Array,
    slope: Array,
    unit: Array,
    along: Array,
    image: Array,
    out: Array,
) -> None:
    """Fill the lower half of (dc/dtheta)' M (dc/dtheta), in units of the prior's standard deviations."""
    with_bias = parameters == THETA
    for p in range(parameters):
        for q in range(parameters):
            unit[q] = sd[q] if q == p else 0.0
        push_forward(theta, value, slope, unit, with_bias, along)
        quadratic(m, along, image)
        back = pull_back(theta, value, slope, image, with_bias)
        unit[0], unit[1], unit[2], unit[3], unit[4], unit[5] = back
        for q in range(p + 1):
            out[p, q] = unit[q] * sd[q]


@njit(cache=True, nogil=True, error_model="numpy")
def normal(information: Array, n: int, noise_V2s: float, hessian: Array) -> bool:
    """Factorise information / noise + the prior's own, which is one."""
    for p in range(n):
        for q in range(p + 1):
            hessian[p, q] = information[p, q] / noise_V2s
        hessian[p, p] += 1.0
    return factorise(hessian, n)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def output_noise_V2s(noise_V2: float, x: Array, b: Array, c: Array, image: Array, slow_s: float) -> float:
    """Intensity of the output error: white noise, and what the residuals show beyond it as a slow error.

    ``image`` is M c + b.
    """
    if x[WEIGHT_S] <= 0.0 or x[COUNT] <= 0.0:
        return noise_V2
    total = x[SQUARE_V2S]
    for p in range(c.size):
        total += c[p] * (image[p] + b[p])
    excess = max(total / x[WEIGHT_S] - 1.05 * noise_V2, 0.0)
    return float(noise_V2 * x[WEIGHT_S] / x[COUNT] + slow_s * excess)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _report_soc(
    n: int,
    sd: Array,
    walk_C2_per_s: float,
    window_s: float,
    x: Array,
    theta: Array,
    hessian: Array,
    positive: bool,
    step: Array,
    z: Array,
    row: Array,
) -> None:
    """Fill SOC and variance; ``z`` is scratch.

    The covariance is that of least squares with the prior; where a gradient has not arrived yet, the distance
    to the least-squares solution is added to the deviation.
    """
    alpha = theta[ALPHA]
    charge = theta[X10] + x[X1] - theta[BIAS] * x[CLOCK_S]
    row[0] = min(max(alpha * charge, 0.0), 1.0)
    # A random walk of the counted charge, seen through the memory's window.
    walk_C2 = walk_C2_per_s * min(x[ON_S], window_s)
    z[:] = 0.0
    z[ALPHA], z[X10], z[BIAS] = charge, alpha, -alpha * x[CLOCK_S]
    away = 0.0
    for p in range(n):
        z[p] *= sd[p]
        away += z[p] * step[p]
    variance = alpha * alpha * (x[DOUBT_C2] + walk_C2) + away * away
    variance += projected_variance(hessian, n, z, positive)
    row[1] = min(max(variance, 0.0), 1.0 / 12.0)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _report_parameter(
    n: int,
    sd: Array,
    sigma_mid_per_s: float,
    sigma_half_per_s: float,
    theta: Array,
    p: int,
    hessian: Array,
    positive: bool,
    step: Array,
    z: Array,
    row: Array,
) -> None:
    """Fill a parameter in the user's terms and its standard deviation; ``z`` is scratch."""
    sigma = sigma_mid_per_s + sigma_half_per_s * theta[XI]
    z[:] = 0.0
    if p == 0:
        value = 1.0 / (3600.0 * theta[ALPHA])
        z[ALPHA] = -value / theta[ALPHA]
    elif p == 1:
        value = theta[R]
        z[R] = 1.0
    elif p == 2:
        value = theta[BETA] / sigma
        z[BETA] = 1.0 / sigma
        z[XI] = -value * sigma_half_per_s / sigma
    elif p == 3:
        value = 1.0 / theta[BETA]
        z[BETA] = -value / theta[BETA]
    else:
        value = theta[BIAS]
        z[BIAS] = 1.0
    away = 0.0
    for q in range(n):
        z[q] *= sd[q]
        away += z[q] * step[q]
    spread = projected_variance(hessian, n, z, positive)
    row[4 + p] = value
    row[4 + n - 1 + p] = math.sqrt(max(spread + away * away, 0.0))


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def look(settings: Settings, room: Room) -> None:
    """Fill c, M c + b, the gradient and the information at the present parameters."""
    parameters = settings.parameters
    with_bias = parameters == THETA
    lagrange(settings.node, settings.barycentric, room.theta[XI], room.value, room.slope)
    coefficients(room.theta, room.value, room.c, with_bias)
    quadratic(room.m, room.c, room.image)
    for p in range(room.c.size):
        room.image[p] += room.b[p]
    room.gradient[:] = pull_back(room.theta, room.value, room.slope, room.image, with_bias)
    work = np.empty(room.c.size)
    _information(
        parameters,
        settings.prior_sd,
        room.m,
        room.theta,
        room.value,
        room.slope,
        room.unit,
        room.along,
        work,
        room.information,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def fill_row(settings: Settings, room: Room, row: Array) -> float:
    """Fill a row but for residual and flags; give the intensity of the output error with its slow part."""
    parameters, sd = settings.parameters, settings.prior_sd
    middle, half = settings.sigma_mid_per_s, settings.sigma_half_per_s
    x, theta, step = room.x, room.theta, room.step
    slow_s, window_s = 2.0 * settings.correlation_s, math.inf
    if settings.log_forgetting_per_s < 0.0:
        window_s = -1.0 / settings.log_forgetting_per_s
    look(settings, room)
    # How far the least-squares solution still is, as Gauss-Newton would go there. Resistances are seen in
    # quick changes of the current, which a slow error of the model disturbs little.
    quick_V2s = output_noise_V2s(settings.noise_V2, x, room.b, room.c, room.image, QUICK_S)
    quick_V2s += QUICK_S * settings.model_error_V2
    slow_V2s = output_noise_V2s(settings.noise_V2, x, room.b, room.c, room.image, slow_s)
    slow_V2s += slow_s * settings.model_error_V2
    step[:] = 0.0
    positive = normal(room.information, parameters, quick_V2s, room.hessian)
    if positive:
        for p in range(parameters):
            step[p] = room.gradient[p] * sd[p] / quick_V2s
        solve_factored(room.hessian, parameters, step)
    for p in range(1, 4):
        _report_parameter(
            parameters, sd, middle, half, theta, p, room.hessian, positive, step, room.unit, row
        )
    positive = normal(room.information, parameters, slow_V2s, room.hessian)
    walk_C2_per_s = 0.5 * settings.current_sd_A**2
    _report_soc(
        parameters, sd, walk_C2_per_s, window_s, x, theta, room.hessian, positive, step, room.unit, row
    )
    for p in range(0, parameters - 1, 4):
        _report_parameter(
            parameters, sd, middle, half, theta, p, room.hessian, positive, step, room.unit, row
        )
    return slow_V2s


@njit(cache=True, nogil=True, error_model="numpy")
def take_soc(settings: Settings, room: Room, known: float, doubt: float, slow_V2s: float, row: Array) -> None:
    """Take a measurement of the SOC: into the sums, and at once into the estimate and the row."""
    x, theta, along = room.x, room.theta, room.along
    along[:] = 0.0
    along[0], along[1] = 1.0, x[X1]
    if settings.parameters == THETA:
        along[3 + settings.node.size] = x[CLOCK_S]
    weight = slow_V2s / doubt
    accumulate(room.m, room.b, along, -known, 1.0, weight)
    x[SQUARE_V2S] += weight * known * known
    gain = row[1] / (row[1] + doubt)
    moved_C = gain * (known - row[0]) / theta[ALPHA]
    share = min(theta[ALPHA] * theta[ALPHA] * x[DOUBT_C2] / max(row[1], 1e-30), 1.0)
    x[X1] += share * moved_C
    theta[X10] += (1.0 - share) * moved_C
    x[DOUBT_C2] *= 1.0 - gain
    row[0] += gain * (known - row[0])
    row[1] *= 1.0 - gain

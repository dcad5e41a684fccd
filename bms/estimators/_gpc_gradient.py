"""The recursive gPC estimator as numba kernels; the maths stands in `bms.estimators.gpc_gradient`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms._ecm import Circuit, move_hysteresis, move_temperature, ocv_and_slope, parameters_at
from bms.estimators import _gate
from bms.estimators._gate import Gate, is_temperature, screen
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
    descend,
    lagrange,
    projected_variance,
    pull_back,
    push_forward,
    quadratic,
)
from bms.estimators._reset import read_rest
from bms.estimators._small import factorise, solve_factored

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

X1, V2, HYSTERESIS, CLOCK_S, ON_S, DOUBT_C2 = 0, 1, 2, 3, 4, 5
WEIGHT_S, SQUARE_V2S, FAST_V2, SLOW_V, COUNT, OCCASION, REJECTED, SINCE_S, HEAT_W = range(6, 15)
SCALARS = 15
"""Places in the memory behind the gate's: charge since the start, second pair, hysteresis, clock of the
offset, time since start, variance of x1, sums of weights and of squared voltage, residuals (square, mean),
weighted number of samples, rest or full charge at the last sample, rejected samples, time since a step,
heat."""

OUTLIER_SD = 8.0
OUTLIER_SAMPLES = 60.0
RESIDUAL_S = 300.0
QUICK_S = 100.0
STALE = 0.03


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
    model_error_V2: float
    current_sd_A: float
    correlation_s: float
    flat_slope_V: float
    reference: Array  # (5,) R, R1, tau1, R2, tau2 of the nominal cell at the reference
    parameters: int  # 5, or 6 with the offset
    newton_every_s: float  # 0: gradient
    full_sd: float
    rest_doubt_V: float
    resets_at_rest: bool
    resets_at_full: bool


@njit(cache=True, nogil=True, inline="always")
def _hold_in_bounds(low: Array, high: Array, parameters: int, x: Array, theta: Array) -> bool:
    """Keep the parameters within their bounds and the SOC within [0, 1]."""
    held = False
    for p in range(parameters):
        if p != X10 and not low[p] <= theta[p] <= high[p]:
            theta[p] = min(max(theta[p], low[p]), high[p])
            # xi at its end only says that the relaxation is as fast or slow as was thought possible.
            held = held or p != XI
    charge = theta[X10] + x[X1] - theta[BIAS] * x[CLOCK_S]
    capacity_C = 1.0 / theta[ALPHA]
    if charge < 0.0 or charge > capacity_C:
        theta[X10] += min(max(charge, 0.0), capacity_C) - charge
        held = True
    return held


@njit(cache=True, nogil=True)
def _normal(
    settings: Settings,
    m: Array,
    theta: Array,
    value: Array,
    slope: Array,
    noise_V2s: float,
    unit: Array,
    along: Array,
    image: Array,
    hessian: Array,
) -> bool:
    """Factorise (dc/dtheta)' M (dc/dtheta) / noise + the prior's information, in units of the prior's sd."""
    n = settings.parameters
    with_bias = n == THETA
    for p in range(n):
        for q in range(n):
            unit[q] = settings.prior_sd[q] if q == p else 0.0
        push_forward(theta, value, slope, unit, with_bias, along)
        quadratic(m, along, image)
        back = pull_back(theta, value, slope, image, with_bias)
        unit[0], unit[1], unit[2], unit[3], unit[4], unit[5] = back
        for q in range(n):
            hessian[p, q] = unit[q] * settings.prior_sd[q] / noise_V2s
        hessian[p, p] += 1.0
    return factorise(hessian, n)


@njit(cache=True, nogil=True)
def _noise_V2s(settings: Settings, x: Array, b: Array, c: Array, image: Array, slow_s: float) -> float:
    """Intensity of the output error: white noise, and what the residuals show beyond it as a slow error.

    ``image`` is M c + b.
    """
    white = settings.noise_V2
    if x[WEIGHT_S] <= 0.0 or x[COUNT] <= 0.0:
        return white
    total = x[SQUARE_V2S]
    for p in range(c.size):
        total += c[p] * (image[p] + b[p])
    excess = max(total / x[WEIGHT_S] - 1.05 * white, 0.0)
    return float(white * x[WEIGHT_S] / x[COUNT] + slow_s * excess)


@njit(cache=True, nogil=True)
def _report_soc(
    settings: Settings, x: Array, theta: Array, hessian: Array, positive: bool, step: Array, row: Array
) -> None:
    """Fill SOC and variance.

    The covariance is that of least squares with the prior; where a gradient has not arrived yet, the distance
    to the least-squares solution is added to the deviation.
    """
    n, alpha, sd = settings.parameters, theta[ALPHA], settings.prior_sd
    charge = theta[X10] + x[X1] - theta[BIAS] * x[CLOCK_S]
    row[0] = min(max(alpha * charge, 0.0), 1.0)
    # A random walk of the counted charge, seen through the memory's window.
    window_s = x[ON_S]
    if settings.log_forgetting_per_s < 0.0:
        window_s = min(window_s, -1.0 / settings.log_forgetting_per_s)
    walk_C2 = 0.5 * settings.current_sd_A**2 * window_s
    sensitivity = np.zeros(THETA)
    sensitivity[ALPHA], sensitivity[X10], sensitivity[BIAS] = charge, alpha, -alpha * x[CLOCK_S]
    away = 0.0
    for p in range(n):
        away += sensitivity[p] * sd[p] * step[p]
    variance = alpha * alpha * (x[DOUBT_C2] + walk_C2) + away * away
    variance += projected_variance(hessian, n, sd, sensitivity, positive)
    row[1] = min(max(variance, 0.0), 1.0 / 12.0)


@njit(cache=True, nogil=True)
def _report_parameter(
    settings: Settings, theta: Array, p: int, hessian: Array, positive: bool, step: Array, row: Array
) -> None:
    """Fill a parameter in the user's terms and its standard deviation."""
    n, sd = settings.parameters, settings.prior_sd
    sigma = settings.sigma_mid_per_s + settings.sigma_half_per_s * theta[XI]
    sensitivity = np.zeros(THETA)
    if p == 0:
        value = 1.0 / (3600.0 * theta[ALPHA])
        sensitivity[ALPHA] = -value / theta[ALPHA]
    elif p == 1:
        value = theta[R]
        sensitivity[R] = 1.0
    elif p == 2:
        value = theta[BETA] / sigma
        sensitivity[BETA] = 1.0 / sigma
        sensitivity[XI] = -value * settings.sigma_half_per_s / sigma
    elif p == 3:
        value = 1.0 / theta[BETA]
        sensitivity[BETA] = -value / theta[BETA]
    else:
        value = theta[BIAS]
        sensitivity[BIAS] = 1.0
    away = 0.0
    for q in range(n):
        away += sensitivity[q] * sd[q] * step[q]
    spread = projected_variance(hessian, n, sd, sensitivity, positive)
    row[4 + p] = value
    row[4 + n - 1 + p] = math.sqrt(max(spread + away * away, 0.0))


@njit(cache=True, nogil=True)
def _newton(
    settings: Settings, theta: Array, gradient: Array, hessian: Array, noise_V2s: float, step: Array
) -> None:
    """Take a Gauss-Newton step, at most one standard deviation of the prior in each parameter."""
    n, sd = settings.parameters, settings.prior_sd
    for p in range(n):
        step[p] = gradient[p] * sd[p] / noise_V2s + (theta[p] - settings.start[p]) / sd[p]
    solve_factored(hessian, n, step)
    largest = 1.0
    for p in range(n):
        largest = max(largest, abs(step[p]))
    for p in range(n):
        theta[p] -= sd[p] * step[p] / largest


@njit(cache=True, nogil=True, inline="always")
def _correct_charge(x: Array, alpha: float, innovation: float, sensitivity: float, noise: float) -> None:
    """Weigh an innovation against the doubt about the charge that passed, a scalar Kalman step."""
    per_C = sensitivity * alpha
    total = per_C * per_C * x[DOUBT_C2] + noise
    if total > 0.0:
        gain = x[DOUBT_C2] * per_C / total
        x[X1] += gain * innovation
        x[DOUBT_C2] *= noise / total


@njit(cache=True, nogil=True)
def run(
    circuit: Circuit,
    gate: Gate,
    settings: Settings,
    memory: Array,
    current_A: Array,
    voltage_V: Array,
    step_s: Array,
    temperature_C: Array,
    every: int,
    rows: Array,
    row: Array,
) -> None:
    """Take samples; see `bms.estimators.base.KernelEstimator` for the arguments."""
    guide, knot, cubic, table, nodes_C = (
        circuit.guide,
        circuit.knot,
        circuit.cubic,
        circuit.table,
        circuit.temperature_C,
    )
    activation_K, reference_K, varies = circuit.activation_K, circuit.reference_K, circuit.varies
    rate = circuit.hysteresis_rate
    heat_capacity, thermal_K_per_W = circuit.heat_capacity_J_per_K, circuit.thermal_resistance_K_per_W
    node, barycentric, reference = settings.node, settings.barycentric, settings.reference
    middle, half = settings.sigma_mid_per_s, settings.sigma_half_per_s
    parameters, newton_s, start_s = settings.parameters, settings.newton_every_s, settings.start_after_s
    gain, low, high = settings.gain, settings.low, settings.high
    noise_V2, flat2 = settings.noise_V2, settings.flat_slope_V * settings.flat_slope_V
    n = node.size
    with_bias = parameters == THETA
    width = n + (4 if with_bias else 3)
    g = memory[: _gate.SIZE]
    at = _gate.SIZE
    x = memory[at : at + SCALARS]
    at += SCALARS
    theta = memory[at : at + THETA]
    at += THETA
    y, b = memory[at : at + n], memory[at + n : at + n + width]
    at += n + width
    m = memory[at : at + width * width].reshape(width, width)
    keep, feed, value, slope = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    z, c, image, along = np.zeros(width), np.zeros(width), np.zeros(width), np.zeros(width)
    gradient, move, step, unit = np.zeros(THETA), np.zeros(THETA), np.zeros(THETA), np.zeros(THETA)
    hessian = np.zeros((THETA, THETA))
    pending, at, due, last = int(g[_gate.PENDING]), 0, 0 if rows.shape[0] else -1, current_A.size - 1
    last_step, keep2, keep_warm, forget = -1.0, 0.0, 0.0, 1.0
    shape, speed, store, hysteresis_V = 1.0, 1.0, 1.0, 0.0
    r2, tau2 = reference[3], reference[4]
    if not varies:
        hysteresis_V = table[0, 0, 5]
    for k in range(current_A.size):
        seen = screen(gate, g, current_A[k], voltage_V[k], step_s[k], temperature_C[k])
        flags, drive, now, dt = seen.flags, seen.drive_A, seen.now_A, seen.step_s
        alpha = theta[ALPHA]
        if heat_capacity > 0.0 and dt > 0.0 and not is_temperature(temperature_C[k]):
            if dt != last_step:
                keep_warm = math.exp(-dt / (heat_capacity * thermal_K_per_W))
            g[_gate.TEMPERATURE_C] = move_temperature(
                g[_gate.TEMPERATURE_C], x[HEAT_W], gate.ambient_C, thermal_K_per_W, keep_warm
            )
        if varies:
            soc = alpha * (theta[X10] + x[X1] - theta[BIAS] * x[CLOCK_S])
            r_here, r1_here, tau1_here, r2, tau2, hysteresis_V = parameters_at(
                table, nodes_C, activation_K, reference_K, soc, g[_gate.TEMPERATURE_C]
            )
            shape = r_here / reference[0]
            if reference[1] > 0.0:
                speed = reference[2] / tau1_here
                store = (r1_here / reference[1]) * speed
        if varies or dt != last_step:
            for j in range(n):
                sigma = (middle + half * node[j]) * speed
                keep[j] = math.exp(-sigma * dt)
                feed[j] = (1.0 - keep[j]) / sigma
            keep2 = math.exp(-dt / tau2)
            forget = math.exp(settings.log_forgetting_per_s * dt)
            last_step = dt
        x[X1] += drive * dt
        x[CLOCK_S] += dt
        x[ON_S] += dt
        x[DOUBT_C2] += seen.charge_variance_C2
        for j in range(n):
            y[j] = keep[j] * y[j] + feed[j] * store * drive
        if r2 > 0.0:
            x[V2] = keep2 * x[V2] + r2 * (1.0 - keep2) * drive
        if rate > 0.0:
            x[HYSTERESIS] = move_hysteresis(x[HYSTERESIS], drive * dt * alpha, rate)
        charge = theta[X10] + x[X1] - theta[BIAS] * x[CLOCK_S]
        soc = min(max(alpha * charge, 0.0), 1.0)
        ocv_V, slope_V = ocv_and_slope(guide, knot, cubic, soc)
        lagrange(node, barycentric, theta[XI], value, slope)
        coefficients(theta, value, c, with_bias)
        z[0], z[1], z[2] = slope_V, slope_V * x[X1], shape * now
        for j in range(n):
            z[3 + j] = y[j]
        if with_bias:
            z[3 + n] = slope_V * x[CLOCK_S]
        # V_0 - V_m of the report, with what the nominal cell says of its second pair and hysteresis.
        difference_V = ocv_V - slope_V * soc + x[V2] + hysteresis_V * x[HYSTERESIS] - voltage_V[k]
        residual_V = -difference_V
        for p in range(width):
            residual_V -= c[p] * z[p]
        usable = seen.usable
        x[HEAT_W] = now * (voltage_V[k] - ocv_V) if usable else now * now * theta[R]
        if usable and x[ON_S] > start_s:
            square = residual_V * residual_V
            limit = (
                OUTLIER_SD * OUTLIER_SD * (x[FAST_V2] + noise_V2)
                + slope_V * slope_V * (alpha * alpha * x[DOUBT_C2]) * OUTLIER_SD
                + (theta[R] * seen.doubt_A) ** 2 * OUTLIER_SD
            )
            if x[WEIGHT_S] > RESIDUAL_S and square > limit and x[REJECTED] < OUTLIER_SAMPLES:
                x[REJECTED] += 1.0
                flags |= _gate.OUTLIER
                usable = False
            else:
                x[REJECTED] = 0.0
                quick = min(dt / RESIDUAL_S, 1.0)
                x[FAST_V2] += quick * (square - x[FAST_V2])
                x[SLOW_V] += quick * (residual_V - x[SLOW_V])
        elif usable:
            x[FAST_V2] = max(x[FAST_V2], residual_V * residual_V)
        if usable and x[DOUBT_C2] > 0.0:
            extra = (theta[R] * seen.doubt_A) ** 2
            _correct_charge(x, alpha, residual_V, slope_V, noise_V2 + extra + x[SLOW_V] * x[SLOW_V])
        if usable and seen.doubt_A == 0.0 and x[ON_S] > start_s:
            weight_s = dt
            if flat2 > 0.0:
                weight_s *= slope_V * slope_V / (slope_V * slope_V + flat2)
            accumulate(m, b, z, difference_V, forget, weight_s)
            x[WEIGHT_S] = forget * x[WEIGHT_S] + weight_s
            x[COUNT] = forget * x[COUNT] + weight_s / dt if dt > 0.0 else x[COUNT]
            x[SQUARE_V2S] = forget * x[SQUARE_V2S] + weight_s * difference_V * difference_V
        if x[ON_S] > start_s and x[WEIGHT_S] > 0.0:
            if newton_s == 0.0:
                quadratic(m, c, image)
                for p in range(width):
                    image[p] += b[p]
                back = pull_back(theta, value, slope, image, with_bias)
                descend(gain, m, theta, value, slope, back, dt, with_bias, move, along)
            else:
                x[SINCE_S] += dt
                if x[SINCE_S] >= newton_s:
                    x[SINCE_S] = 0.0
                    quadratic(m, c, image)
                    for p in range(width):
                        image[p] += b[p]
                    gradient[:] = pull_back(theta, value, slope, image, with_bias)
                    noise_V2s = _noise_V2s(settings, x, b, c, image, QUICK_S)
                    if _normal(settings, m, theta, value, slope, noise_V2s, unit, along, image, hessian):
                        _newton(settings, theta, gradient, hessian, noise_V2s, step)
                        moved = (
                            theta[ALPHA] * (theta[X10] + x[X1] - theta[BIAS] * x[CLOCK_S]) - alpha * charge
                        )
                        stale = math.exp(-abs(moved) / STALE)
                        x[WEIGHT_S] *= stale
                        x[SQUARE_V2S] *= stale
                        x[COUNT] *= stale
                        for p in range(width):
                            b[p] *= stale
                            for q in range(p + 1):
                                m[p, q] *= stale
            if _hold_in_bounds(low, high, parameters, x, theta):
                flags |= _gate.LIMIT
        occasion = flags & (_gate.REST | _gate.FULL)
        arrived = occasion & ~int(x[OCCASION])
        x[OCCASION] = occasion
        reset = (arrived & _gate.FULL and settings.resets_at_full) or (
            arrived & _gate.REST and settings.resets_at_rest
        )
        pending |= flags
        if reset or k in (due, last):
            lagrange(node, barycentric, theta[XI], value, slope)
            coefficients(theta, value, c, with_bias)
            quadratic(m, c, image)
            for p in range(width):
                image[p] += b[p]
            gradient[:] = pull_back(theta, value, slope, image, with_bias)
            # How far the least-squares solution still is, as Gauss-Newton would go there. Resistances are
            # seen in quick changes of the current, which a slow error of the model disturbs little.
            noise_V2s = _noise_V2s(settings, x, b, c, image, QUICK_S)
            noise_V2s += QUICK_S * settings.model_error_V2
            for p in range(THETA):
                step[p] = 0.0
            positive = _normal(settings, m, theta, value, slope, noise_V2s, unit, along, image, hessian)
            if positive:
                for p in range(parameters):
                    step[p] = gradient[p] * settings.prior_sd[p] / noise_V2s
                solve_factored(hessian, parameters, step)
            for p in range(1, 4):
                _report_parameter(settings, theta, p, hessian, positive, step, row)
            quadratic(m, c, image)
            for p in range(width):
                image[p] += b[p]
            noise_V2s = _noise_V2s(settings, x, b, c, image, 2.0 * settings.correlation_s)
            noise_V2s += 2.0 * settings.correlation_s * settings.model_error_V2
            positive = _normal(settings, m, theta, value, slope, noise_V2s, unit, along, image, hessian)
            _report_soc(settings, x, theta, hessian, positive, step, row)
            for p in range(0, parameters - 1, 4):
                _report_parameter(settings, theta, p, hessian, positive, step, row)
            if reset and (usable or arrived & _gate.FULL):
                known, doubt = 1.0, settings.full_sd**2
                if not arrived & _gate.FULL:
                    known, doubt = read_rest(guide, knot, cubic, voltage_V[k], settings.rest_doubt_V)
                # A measurement of the SOC: into the sums, and at once into the estimate.
                for p in range(width):
                    along[p] = 0.0
                along[0], along[1] = 1.0, x[X1]
                if with_bias:
                    along[3 + n] = x[CLOCK_S]
                weight = noise_V2s / doubt
                accumulate(m, b, along, -known, 1.0, weight)
                x[SQUARE_V2S] += weight * known * known
                gain_here = row[1] / (row[1] + doubt)
                moved_C = gain_here * (known - row[0]) / theta[ALPHA]
                share = min(theta[ALPHA] * theta[ALPHA] * x[DOUBT_C2] / max(row[1], 1e-30), 1.0)
                x[X1] += share * moved_C
                theta[X10] += (1.0 - share) * moved_C
                x[DOUBT_C2] *= 1.0 - gain_here
                row[0] += gain_here * (known - row[0])
                row[1] *= 1.0 - gain_here
            row[2] = residual_V if seen.usable else math.nan
            row[3] = flags
        if k == due:
            rows[at] = row
            rows[at, 3] = pending
            pending, at, due = 0, at + 1, due + every
    g[_gate.PENDING] = pending

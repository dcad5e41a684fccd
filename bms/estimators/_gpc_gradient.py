"""The recursive gPC estimator as numba kernels; the maths stands in `bms.estimators.gpc_gradient`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms._ecm import Circuit, move_hysteresis, ocv_and_slope, parameters_at
from bms.estimators import _gate, _watch
from bms.estimators._gate import Gate, glance, is_temperature, judge, warm
from bms.estimators._gpc_belief import (
    ALARM_S,
    CALM_S,
    CLOCK_S,
    COUNT,
    DOUBT_A,
    DOUBT_C2,
    DOUBTED_C,
    EARNED_S,
    FAR_S,
    FAST_V2,
    HYSTERESIS,
    LOST2_V,
    LOST_H,
    LOST_V,
    MISMATCH_S,
    OCCASION,
    ON_S,
    PATIENCE_S,
    QUICK_S,
    REFUSED_C,
    REJECTED,
    SCALARS,
    SINCE_S,
    SLOW_V,
    SQUARE_V2S,
    V2,
    WEIGHT_S,
    X1,
    Room,
    Settings,
    fill_row,
    look,
    normal,
    output_noise_V2s,
    take_soc,
)
from bms.estimators._gpc_form import (
    ALPHA,
    BIAS,
    THETA,
    X10,
    XI,
    R,
    accumulate,
    bound_curvature,
    coefficients,
    curvature_along,
    lagrange,
    pull_back,
    quadratic,
    scale,
    walk,
)
from bms.estimators._reset import read_rest, soc_at_voltage
from gpc._small import solve_factored

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


OUTLIER_SD = 8.0
RESIDUAL_S = 300.0
STALE = 0.03
MISMATCH_SD = 5.0
LOST_SD, GIVE_UP_S = 50.0, 600.0
INSIDE = 0.02
MOST_VARIANCE = 1.0 / 12.0
FAR_SOC = 0.03
FAR_SD = 20.0
SPIKE_S = 10.0


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _hold_in_bounds(
    low: Array, high: Array, parameters: int, x: Array, theta: Array, alpha_before: float, bias_before: float
) -> int:
    """Keep the parameters within their bounds and the SOC within [0, 1]; LIMIT when they were beyond.

    At the end of the SOC a voltage says nothing of capacity and offset: what it cannot change in the charge
    it would push into them, sample after sample, so they stay as they were.
    """
    flags = 0
    for p in range(parameters):
        if p != X10 and not low[p] <= theta[p] <= high[p]:
            theta[p] = min(max(theta[p], low[p]), high[p])
            # xi at its end only says that the relaxation is as fast or slow as was thought possible.
            flags = flags if p == XI else _gate.LIMIT
    charge = theta[X10] + x[X1] - theta[BIAS] * x[CLOCK_S]
    inside = min(max(charge, 0.0), 1.0 / theta[ALPHA])
    clamped = inside != charge
    if clamped:
        theta[ALPHA], theta[BIAS] = alpha_before, bias_before
        charge = theta[X10] + x[X1] - theta[BIAS] * x[CLOCK_S]
        inside = min(max(charge, 0.0), 1.0 / alpha_before)
    theta[X10] += inside - charge
    return _gate.LIMIT if clamped else flags


@njit(cache=True, nogil=True, error_model="numpy")
def _newton(
    n: int,
    sd: Array,
    start: Array,
    theta: Array,
    gradient: Array,
    hessian: Array,
    noise_V2s: float,
    step: Array,
) -> None:
    """Take a Gauss-Newton step, at most one standard deviation of the prior in each parameter."""
    for p in range(n):
        step[p] = gradient[p] * sd[p] / noise_V2s + (theta[p] - start[p]) / sd[p]
    solve_factored(hessian, n, step)
    largest = 1.0
    for p in range(n):
        largest = max(largest, abs(step[p]))
    for p in range(n):
        theta[p] -= sd[p] * step[p] / largest


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _lose(
    x: Array,
    doubt_A: float,
    drive_A: float,
    r1: float,
    tau1: float,
    r2: float,
    tau2: float,
    rate_per_C: float,
    dt: float,
) -> None:
    """Move what a doubtful current leaves in relaxation and hysteresis."""
    keep = math.exp(-dt / tau1)
    x[LOST_V] = keep * x[LOST_V] + r1 * (1.0 - keep) * doubt_A
    if r2 > 0.0:
        keep = math.exp(-dt / tau2)
        x[LOST2_V] = keep * x[LOST2_V] + r2 * (1.0 - keep) * doubt_A
    if rate_per_C > 0.0:
        x[LOST_H] *= math.exp(-rate_per_C * abs(drive_A) * dt)
        x[LOST_H] = min(x[LOST_H] + 1.0 - math.exp(-rate_per_C * doubt_A * dt), 1.0)


@njit(cache=True, nogil=True, inline="always")
def _correct_charge(x: Array, alpha: float, innovation: float, sensitivity: float, noise: float) -> None:
    """Weigh an innovation against the doubt about the charge that passed, a scalar Kalman step.

    A step goes no further than the doubt: the slope holds no further where the curve bends.
    """
    per_C = sensitivity * alpha
    total = per_C * per_C * x[DOUBT_C2] + noise
    if total > 0.0:
        gain = x[DOUBT_C2] * per_C / total
        most = math.sqrt(x[DOUBT_C2])
        x[X1] += min(max(gain * innovation, -most), most)
        x[DOUBT_C2] *= noise / total


@njit(cache=True, nogil=True, error_model="numpy")
def _step_newton(
    settings: Settings,
    room: Room,
    guide: IntArray,
    knot: Array,
    cubic: Array,
    shown_V: float,
    usable: bool,
) -> None:
    """Take a Gauss-Newton step and forget what was linearised far from where it leads.

    ``shown_V`` is the open-circuit voltage that the last sample shows.
    """
    x, theta = room.x, room.theta
    before = room.theta.copy()
    charge = theta[X10] + x[X1] - theta[BIAS] * x[CLOCK_S]
    soc = min(max(theta[ALPHA] * charge, 0.0), 1.0)
    look(settings, room)
    noise_V2s = output_noise_V2s(settings.noise_V2, x, room.b, room.c, room.image, QUICK_S)
    if not normal(room.information, settings.parameters, noise_V2s, room.hessian):
        return
    _newton(
        settings.parameters,
        settings.prior_sd,
        settings.start,
        theta,
        room.gradient,
        room.hessian,
        noise_V2s,
        room.step,
    )
    moved = theta[ALPHA] * (theta[X10] + x[X1] - theta[BIAS] * x[CLOCK_S]) - before[ALPHA] * charge
    if usable and abs(moved) > FAR_SOC and x[SLOW_V] ** 2 > FAR_SD * FAR_SD * settings.noise_V2:
        # From so far away the tangent leads nowhere: read the SOC off the curve.
        theta[:] = before
        theta[X10] += (soc_at_voltage(guide, knot, cubic, shown_V) - soc) / theta[ALPHA]
    _forget(room, math.exp(-abs(moved) / STALE))


@njit(cache=True, nogil=True, error_model="numpy")
def _forget(room: Room, share: float) -> None:
    """Keep only a share of all that was summed up."""
    x, m, b = room.x, room.m, room.b
    x[WEIGHT_S] *= share
    x[SQUARE_V2S] *= share
    x[COUNT] *= share
    for p in range(b.size):
        b[p] *= share
        for q in range(p + 1):
            m[p, q] *= share


@njit(cache=True, nogil=True, error_model="numpy")
def _start_anew(settings: Settings, room: Room) -> None:
    """Give up what bad data taught: parameters and sums as before any sample, a SOC that may be anything.

    The doubt is put on the charge that was counted; the charge at the start has its prior.
    """
    x, theta = room.x, room.theta
    soc = theta[ALPHA] * (theta[X10] + x[X1] - theta[BIAS] * x[CLOCK_S])
    theta[:] = settings.start
    x[X1] = soc / theta[ALPHA] - theta[X10] + theta[BIAS] * x[CLOCK_S]
    x[DOUBT_C2] = MOST_VARIANCE / (theta[ALPHA] * theta[ALPHA])
    x[LOST_V], x[LOST_H] = settings.lately_V, 1.0
    x[SLOW_V], x[REJECTED], x[FAR_S] = 0.0, 0.0, 0.0
    x[DOUBTED_C], x[REFUSED_C], x[MISMATCH_S] = 0.0, 0.0, 0.0
    x[ALARM_S] = _watch.longest_alarm(x[PATIENCE_S])
    _forget(room, 0.0)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _refused_C2(x: Array) -> float:
    """Part of the variance of the charge that stems from voltages refused in a row: none judges by it."""
    return float(min(x[REFUSED_C] ** 2, x[DOUBT_C2])) if x[REJECTED] > SPIKE_S else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _doubt_refused(settings: Settings, x: Array, off_V: float, ohm: float, alpha: float, dt: float) -> None:
    """Count a refused voltage, and doubt the charge: it may be the current that is wrong, by so much.

    What ends within seconds was a spike of the voltage.
    """
    before_C2 = _refused_C2(x)
    x[REJECTED] += min(max(dt, _watch.LEAST_STEP_S), _watch.MOST_STEP_S)
    x[REFUSED_C] += min(off_V / max(ohm, off_V / settings.limit_A), settings.limit_A) * dt
    if x[REJECTED] > SPIKE_S:
        most = max(MOST_VARIANCE / (alpha * alpha) - x[DOUBT_C2], 0.0)
        x[DOUBT_C2] += min(x[REFUSED_C] ** 2 - before_C2, most)


@njit(cache=True, nogil=True, error_model="numpy")
def _suspect(settings: Settings, room: Room, flags: int, ohm: float, dt: float) -> int:
    """Doubt the counted charge while residuals have a mean, and end what does not end.

    See `bms.estimators._absorb.suspect`. What has not arrived since the first sample is left to arrive.
    """
    x, theta = room.x, room.theta
    soc = theta[ALPHA] * (theta[X10] + x[X1] - theta[BIAS] * x[CLOCK_S])
    # At an end of the SOC a bound is no sign of anything wrong.
    held = flags & _gate.LIMIT and INSIDE < soc < 1.0 - INSIDE
    if not flags & _gate.MISMATCH and not held:
        x[DOUBTED_C] = 0.0
        x[MISMATCH_S] = max(x[MISMATCH_S] - dt, 0.0)
        x[CALM_S] += dt
        if x[CALM_S] > _watch.CALM_AFTER_S:
            x[PATIENCE_S] = _watch.LEAST_PATIENCE_S
        x[ALARM_S] = max(x[ALARM_S] - dt, 0.0)
        return _gate.MISMATCH if x[ALARM_S] > 0.0 else 0
    if x[EARNED_S] < _watch.MOST_TRUST_S:
        return 0
    if flags & _gate.MISMATCH:
        before, off_V = x[DOUBTED_C], abs(x[SLOW_V])
        x[DOUBTED_C] = before + min(off_V / max(ohm, off_V / settings.limit_A), settings.limit_A) * dt
        most = MOST_VARIANCE / (theta[ALPHA] * theta[ALPHA])
        x[DOUBT_C2] += min(x[DOUBTED_C] ** 2 - before * before, max(most - x[DOUBT_C2], 0.0))
    longest = _watch.longest_alarm(x[PATIENCE_S])
    x[ALARM_S] = max(x[ALARM_S] - dt, min(x[ALARM_S] + _watch.ALARM_RATE * dt, longest))
    x[CALM_S] = 0.0
    x[MISMATCH_S] += dt
    if x[MISMATCH_S] > x[PATIENCE_S]:
        _start_anew(settings, room)
        x[PATIENCE_S] = min(_watch.MORE_PATIENCE * x[PATIENCE_S], _watch.MOST_PATIENCE_S)
    return 0


@njit(cache=True, nogil=True, error_model="numpy")
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
    still_A, least_lost_V = settings.still_A, settings.least_lost_V
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
    hessian, information = np.zeros((THETA, THETA)), np.zeros((THETA, THETA))
    room = Room(x, theta, m, b, value, slope, c, image, along, gradient, step, unit, information, hessian)
    pending, at, due, last = int(g[_gate.PENDING]), 0, 0 if rows.shape[0] else -1, current_A.size - 1
    last_step, keep2, forget = -1.0, 0.0, 1.0
    shape, speed, store, hysteresis_V = 1.0, 1.0, 1.0, 0.0
    r2, tau2 = reference[3], reference[4]
    if not varies:
        hysteresis_V = table[0, 0, 5]
    for k in range(current_A.size):
        seen = glance(gate, g, current_A[k], voltage_V[k], step_s[k], temperature_C[k])
        if seen.flags == _gate.UNUSUAL:
            seen = judge(gate, g, current_A[k], voltage_V[k], step_s[k], temperature_C[k])
        flags, drive, now, dt = seen.flags, seen.drive_A, seen.now_A, seen.step_s
        alpha, bias = theta[ALPHA], theta[BIAS]
        celsius = seen.temperature_C
        if heat_capacity > 0.0 and not is_temperature(temperature_C[k]):
            celsius = warm(g, gate.ambient_C, heat_capacity, thermal_K_per_W, dt)
        if varies:
            soc = alpha * (theta[X10] + x[X1] - theta[BIAS] * x[CLOCK_S])
            r_here, r1_here, tau1_here, r2, tau2, hysteresis_V = parameters_at(
                table, nodes_C, activation_K, reference_K, soc, celsius
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
        drive_doubt = seen.doubt_A if gate.looks_back else x[DOUBT_A]
        if flags & _gate.GAP:
            drive_doubt = math.sqrt(seen.charge_variance_C2) / dt
        x[DOUBT_A] = seen.doubt_A
        lost_V2 = 0.0
        if drive_doubt > 0.0 or x[LOST_V] + x[LOST2_V] + hysteresis_V * x[LOST_H] > least_lost_V:
            _lose(x, drive_doubt, drive, reference[1], reference[2], r2, tau2, rate * alpha, dt)
            lost_V2 = x[LOST_V] ** 2 + x[LOST2_V] ** 2 + (hysteresis_V * x[LOST_H]) ** 2
        for j in range(n):
            y[j] = keep[j] * y[j] + feed[j] * store * drive
        if r2 > 0.0:
            x[V2] = keep2 * x[V2] + r2 * (1.0 - keep2) * drive
        # The noise of a sensor at rest would wear hysteresis away.
        if rate > 0.0 and abs(drive) > still_A:
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
        g[_gate.HEAT_W] = now * (voltage_V[k] - ocv_V) if usable else now * now * theta[R]
        if usable and x[ON_S] > start_s:
            square = residual_V * residual_V
            limit = (
                OUTLIER_SD * OUTLIER_SD * (x[FAST_V2] + noise_V2 + lost_V2)
                + slope_V * slope_V * (alpha * alpha * (x[DOUBT_C2] - _refused_C2(x))) * OUTLIER_SD
                + (theta[R] * seen.doubt_A) ** 2 * OUTLIER_SD
            )
            if x[WEIGHT_S] > RESIDUAL_S and square > limit:
                flags |= _gate.OUTLIER
                usable = False
                _doubt_refused(settings, x, abs(residual_V), theta[R] + reference[1] + r2, alpha, dt)
                if x[REJECTED] > _watch.MOST_TRUST_S:
                    _start_anew(settings, room)
                    x[ALARM_S] = max(x[ALARM_S], _watch.REFUSED_HOLD_S)
                    x[FAST_V2] = square
            else:
                x[REJECTED] = x[REFUSED_C] = 0.0
                quick = min(dt / RESIDUAL_S, 1.0)
                x[FAST_V2] += quick * (square - x[FAST_V2])
                x[SLOW_V] += quick * (residual_V - x[SLOW_V])
            if x[SLOW_V] * x[SLOW_V] > MISMATCH_SD * MISMATCH_SD * noise_V2 + lost_V2:
                flags |= _gate.MISMATCH
            far = x[SLOW_V] * x[SLOW_V] > LOST_SD * LOST_SD * noise_V2
            x[FAR_S] = x[FAR_S] + dt if far else 0.0
        elif usable:
            x[FAST_V2] = max(x[FAST_V2], residual_V * residual_V)
        if usable and x[DOUBT_C2] > 0.0:
            extra = (theta[R] * seen.doubt_A) ** 2
            # What was lost lasts, and so does what residuals show as a mean, be it the model's: it counts
            # once in the time of the residuals, not with every sample.
            samples = max(RESIDUAL_S / dt, 1.0) if dt > 0.0 else RESIDUAL_S
            lasting = (lost_V2 + x[SLOW_V] * x[SLOW_V]) * samples
            _correct_charge(x, alpha, residual_V, slope_V, noise_V2 + extra + lasting)
        if usable and seen.doubt_A == 0.0 and lost_V2 <= noise_V2 and x[ON_S] > start_s:
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
                d, fall = scale(gain, back)
                # Nearly always the bound shows the step to be safe; at most it goes to the minimum along it.
                length = dt
                if width * bound_curvature(m, theta, value, slope, d, with_bias) * length > fall:
                    curvature = curvature_along(m, theta, value, slope, d, with_bias, move, along)
                    if curvature * length > fall:
                        length = fall / curvature
                walk(theta, d, length)
            else:
                x[SINCE_S] += dt
                if x[SINCE_S] >= newton_s:
                    x[SINCE_S] = 0.0
                    _step_newton(settings, room, guide, knot, cubic, ocv_V + residual_V, usable)
                if x[FAR_S] > GIVE_UP_S:
                    _start_anew(settings, room)
            bounds_alpha, bounds_bias = theta[ALPHA], theta[BIAS]
            if newton_s == 0.0:
                bounds_alpha, bounds_bias = alpha, bias
            flags |= _hold_in_bounds(low, high, parameters, x, theta, bounds_alpha, bounds_bias)
        if flags & (_gate.MISMATCH | _gate.LIMIT) or x[ALARM_S] + x[MISMATCH_S] > 0.0:
            flags |= _suspect(settings, room, flags, theta[R] + reference[1] + r2, dt)
        elif usable and x[ON_S] > start_s:
            x[CALM_S] += dt
        if usable and x[EARNED_S] < _watch.MOST_TRUST_S and x[ON_S] > start_s:
            x[EARNED_S] = x[EARNED_S] + dt if x[SLOW_V] * x[SLOW_V] < noise_V2 else 0.0
        occasion = flags & (_gate.REST | _gate.FULL)
        arrived = occasion & ~int(x[OCCASION])
        x[OCCASION] = occasion
        reset = (arrived & _gate.FULL and settings.resets_at_full) or (
            arrived & _gate.REST and settings.resets_at_rest
        )
        pending |= flags
        if reset or k in (due, last):
            slow_V2s = fill_row(settings, room, row)
            if reset and arrived & _gate.FULL:
                take_soc(settings, room, 1.0, settings.full_sd**2, slow_V2s, row)
            elif reset and usable:
                known, doubt = read_rest(guide, knot, cubic, voltage_V[k], settings.rest_doubt_V)
                take_soc(settings, room, known, doubt, slow_V2s, row)
            row[2] = residual_V if seen.usable else math.nan
            row[3] = flags
        if k == due:
            rows[at] = row
            rows[at, 3] = pending
            pending, at, due = 0, at + 1, due + every
    g[_gate.PENDING] = pending

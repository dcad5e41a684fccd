"""The extended Kalman filter of SOC and one relaxation voltage, with every number in a register.

The same as `bms.estimators._ekf.run_joint` for a state of two and constant parameters, an order of magnitude
faster; what happens seldom is left to the kernels of the joint filter, by way of the memory.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms._ecm import Circuit, find_segment
from bms.estimators import _gate, _watch
from bms.estimators._absorb import CURVE_SOC, is_suspected, notice, refuse, suspect, take_occasion
from bms.estimators._gate import Gate, glance, judge
from bms.estimators._joint import (
    DRIFT,
    FAST,
    FAST_S,
    MOST_VARIANCE,
    MOVED,
    SHARED,
    STATE,
    Noise,
    Places,
    Settings,
    held_gain,
    lasting,
    see_wide,
    spread_of,
    white_variance,
)
from bms.estimators._report import report
from bms.estimators._watch import added_noise, is_lost, learn, mismatch_flag, weights

Array = NDArray[np.float64]
Covariances = tuple[float, float, float, float, float, float, float, float]

P, OWN = MOVED + 2, MOVED + 4


@njit(cache=True, nogil=True, error_model="numpy")
def store(m: Array, soc: float, v: float, c: Covariances) -> None:
    """Write a belief to its place."""
    m[STATE, 0], m[STATE, 1] = soc, v
    m[P, 0], m[P, 1], m[P + 1, 0], m[P + 1, 1] = c[0], c[1], c[1], c[2]
    m[OWN, 0], m[OWN, 1], m[OWN + 1, 0], m[OWN + 1, 1] = c[3], c[4], c[4], c[5]
    m[SHARED, 0], m[SHARED, 1] = c[6], c[7]


@njit(cache=True, nogil=True, error_model="numpy")
def load(m: Array) -> tuple[float, float, Covariances]:
    """Read a belief from its place."""
    c = m[P, 0], m[P, 1], m[P + 1, 1], m[OWN, 0], m[OWN, 1], m[OWN + 1, 1], m[SHARED, 0], m[SHARED, 1]
    return m[STATE, 0], m[STATE, 1], c


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def carry(
    c: Covariances, keep: float, keep2: float, q00: float, q01: float, q11: float, keeps: float
) -> Covariances:
    """Move the covariances over a step that keeps ``keep`` of the relaxation and adds the noise q."""
    p00, p01, p11, o00, o01, o11, s0, s1 = c
    return (
        p00 + q00,
        keep * p01 + q01,
        keep2 * p11 + q11,
        o00,
        keep * o01,
        keep2 * o11,
        keeps * s0,
        keeps * keep * s1,
    )


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def correct(
    c: Covariances,
    slope: float,
    k0: float,
    k1: float,
    seen0: float,
    seen1: float,
    erred0: float,
    erred1: float,
    total: float,
    unit: float,
) -> Covariances:
    """Joseph's form for two states, see `bms.estimators._joint.correct`."""
    p00, p01, p11, o00, o01, o11, s0, s1 = c
    crossed = 1.0 + slope * s0 + s1
    return (
        p00 + (k0 * (k0 * total - seen0) - seen0 * k0),
        p01 + (k1 * (k0 * total - seen0) - seen1 * k0),
        p11 + (k1 * (k1 * total - seen1) - seen1 * k1),
        o00 + (k0 * (k0 * unit - erred0) - erred0 * k0),
        o01 + (k1 * (k0 * unit - erred0) - erred1 * k0),
        o11 + (k1 * (k1 * unit - erred1) - erred1 * k1),
        s0 - k0 * crossed,
        s1 - k1 * crossed,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def disturb(
    places: Places, noise: Noise, m: Array, r1: float, keep: float, doubt_A: float, charge: float
) -> None:
    """Add the doubt about a current; ``charge`` is the variance that it gives the SOC."""
    spread = r1 * min(doubt_A, noise.limit_A)
    m[P, 0] += charge
    m[P + 1, 1] += (1.0 - keep * keep) * spread * spread
    if m[P, 0] > 0.25:
        shrink = math.sqrt(MOST_VARIANCE / m[P, 0])
        m[P, 1] *= shrink
        m[P + 1, 0] = m[P, 1]
        m[P, 0] = MOST_VARIANCE


@njit(cache=True, nogil=True, error_model="numpy")
def run_plain(
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
    guide, knot, cubic, per_C = circuit.guide, circuit.knot, circuit.cubic, 1.0 / circuit.capacity_C
    places, noise, watch, nominal = settings.places, settings.noise, settings.watch, settings.nominal
    table = circuit.table
    r, r1, tau1 = table[0, 0, 0], table[0, 0, 1], table[0, 0, 2]
    ohm = (r, r1, tau1, 0.0, 1.0, 0.0)
    g, m = memory[: _watch.END], memory[_watch.END :].reshape(-1, 2)
    soc, v, c = load(m)
    mean, noisy, slow = g[_watch.MEAN_V], g[_watch.NOISE_V2], g[_watch.SLOW_V2]
    excess, error = g[_watch.EXCESS_V2], g[_watch.ERROR_V2]
    trust, drift, shown, suspected = g[_watch.TRUST_S], m[DRIFT, 0], 0.0, is_suspected(g)
    occasion, doubt = g[_watch.OCCASION] != 0.0, g[_watch.DOUBT_A]
    sensed = white_variance(noise, ohm, r, 0.0, 1.0)
    last_step, keep, keep2, driven, driven_V, bends = -1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    q00, q01, q11, fast = 0.0, 0.0, 0.0, 0.0
    weight, quick, hold, by_time, spread = 0.0, 0.0, 0.0, 0.0, g[_watch.SPREAD]
    here, left, right = 0, 0, 0
    pending, at, due = int(g[_gate.PENDING]), 0, 0 if rows.shape[0] else -1
    for k in range(current_A.size):
        seen = glance(gate, g, current_A[k], voltage_V[k], step_s[k], temperature_C[k])
        if seen.flags == _gate.UNUSUAL:
            seen = judge(gate, g, current_A[k], voltage_V[k], step_s[k], temperature_C[k])
        flags, step = seen.flags, seen.step_s
        if step != last_step:
            keep = math.exp(-step / tau1)
            driven, driven_V, keep2 = step * per_C, r1 * (1.0 - keep), keep * keep
            q00 = noise.current_A2 * driven * driven + drift * step
            q01, q11 = noise.current_A2 * driven * driven_V, noise.current_A2 * driven_V * driven_V
            bends, last_step = lasting(step, noise.bend_s), step
            fast = FAST * lasting(step, FAST_S)
            weight, quick, hold = weights(step)
            by_time = step * noise.error_per_s
        passed = driven * seen.drive_A
        fades = min(by_time, abs(passed) * noise.error_per_soc)
        soc += passed
        v = keep * v + driven_V * seen.drive_A
        if step > 0.0:
            c = carry(c, keep, keep2, q00, q01, q11, max(1.0 - fades, 0.0))
        if seen.charge_variance_C2 > 0.0:
            if flags & _gate.GAP:
                doubt = math.sqrt(seen.charge_variance_C2) / step
            store(m, soc, v, c)
            disturb(places, noise, m, r1, keep, doubt, seen.charge_variance_C2 * per_C * per_C)
            soc, v, c = load(m)
        doubt = seen.doubt_A
        if flags & (_gate.REST | _gate.FULL) or occasion:
            fresh = notice(g, flags, seen.usable)
            occasion = g[_watch.OCCASION] != 0.0
            if fresh:
                g[_watch.ERROR_V2] = error
                store(m, soc, v, c)
                take_occasion(places, noise, guide, knot, cubic, g, m, fresh, voltage_V[k])
                soc, v, c = load(m)
        if not 0.0 <= soc <= 1.0:
            soc = min(max(soc, 0.0), 1.0)
            flags |= _gate.LIMIT
        residual = math.nan
        if seen.usable:
            p00, p01, p11, o00, o01, o11, s0, s1 = c
            # That a SOC is still in its segment, the processor foresees; a look-up would come first.
            if not knot[here] <= soc < knot[here + 1]:
                here = find_segment(guide, knot, soc)
            x = soc - knot[here]
            ocv = ((cubic[here, 0] * x + cubic[here, 1]) * x + cubic[here, 2]) * x + cubic[here, 3]
            slope = (3.0 * cubic[here, 0] * x + 2.0 * cubic[here, 1]) * x + cubic[here, 2]
            bent, spread = 0.0, spread_of(p00 + error * o00, spread)
            if spread > 0.0:
                below, above = max(soc - spread, 0.0), min(soc + spread, 1.0)
                if not knot[left] <= below < knot[left + 1]:
                    left = find_segment(guide, knot, below)
                if not knot[right] <= above < knot[right + 1]:
                    right = find_segment(guide, knot, above)
                x, y = below - knot[left], above - knot[right]
                low = ((cubic[left, 0] * x + cubic[left, 1]) * x + cubic[left, 2]) * x + cubic[left, 3]
                high = ((cubic[right, 0] * y + cubic[right, 1]) * y + cubic[right, 2]) * y + cubic[right, 3]
                ocv, slope, bent = see_wide(ocv, low, high, 0.5 / spread)
            if watch.error_V2 > 0.0:
                bent += CURVE_SOC * CURVE_SOC * slope * slope
            residual = voltage_V[k] - (ocv + v + r * seen.now_A)
            seen0, seen1 = slope * p00 + p01, slope * p01 + p11
            erred0, erred1 = slope * o00 + o01 + s0, slope * o01 + o11 + s1
            own = slope * erred0 + erred1 + (1.0 + slope * s0 + s1)
            white = sensed
            if seen.doubt_A > 0.0:
                white = white_variance(noise, ohm, r, seen.doubt_A, step)
            held = slope * seen0 + seen1 + error * own
            extra = added_noise(excess, white)
            noise_V2 = white + extra + bent * bends + error * fast
            total = held + noise_V2
            lost = is_lost(watch, mean, noisy, slow)
            if lost or residual * residual > watch.outlier * (held + bent + white + extra):
                g[_watch.MEAN_V], g[_watch.NOISE_V2], g[_watch.EXCESS_V2] = mean, noisy, excess
                g[_watch.SLOW_V2], g[_watch.ERROR_V2], g[_watch.TRUST_S] = slow, error, trust
                store(m, soc, v, c)
                flags |= refuse(places, watch, g, m, lost, step)
                soc, v, c = load(m)
                mean, noisy, excess = g[_watch.MEAN_V], g[_watch.NOISE_V2], g[_watch.EXCESS_V2]
                slow, error, trust = g[_watch.SLOW_V2], g[_watch.ERROR_V2], g[_watch.TRUST_S]
                suspected = is_suspected(g)
            else:
                trust = min(trust + step, _watch.MOST_TRUST_S)
                per_total = 1.0 / total
                k0, k1 = (seen0 + error * erred0) * per_total, (seen1 + error * erred1) * per_total
                if watch.active:
                    mean, noisy, slow, excess, error, shown = learn(
                        watch,
                        mean,
                        noisy,
                        slow,
                        excess,
                        error,
                        residual,
                        white,
                        held + bent,
                        held + bent - (error - watch.error_V2) * own,
                        weight,
                        quick,
                        hold,
                    )
                k0 = held_gain(noise, k0, seen0 * per_total, slope)
                soc += k0 * residual
                v += k1 * residual
                plain = slope * seen0 + seen1 + noise_V2
                c = correct(c, slope, k0, k1, seen0, seen1, erred0, erred1, plain, own)
                mismatch = mismatch_flag(watch, excess, shown)
                if mismatch or suspected:
                    g[_watch.MEAN_V], g[_watch.NOISE_V2], g[_watch.EXCESS_V2] = mean, noisy, excess
                    g[_watch.SLOW_V2], g[_watch.ERROR_V2], g[_watch.TRUST_S] = slow, error, trust
                    store(m, soc, v, c)
                    flags |= mismatch
                    flags |= suspect(places, noise, watch, g, m, mismatch, shown, r + r1, step, per_C)
                    soc, v, c = load(m)
                    mean, noisy, excess = g[_watch.MEAN_V], g[_watch.NOISE_V2], g[_watch.EXCESS_V2]
                    slow, error, trust = g[_watch.SLOW_V2], g[_watch.ERROR_V2], g[_watch.TRUST_S]
                    suspected = is_suspected(g)
                if not 0.0 <= soc <= 1.0:
                    soc = min(max(soc, 0.0), 1.0)
                    flags |= _gate.LIMIT
        pending |= flags
        if k == due or k == current_A.size - 1:
            store(m, soc, v, c)
            report(places, m, m[:0], nominal, error, row)
            row[2], row[3] = residual, flags
        if k == due:
            rows[at] = row
            rows[at, 3] = pending
            pending, at, due = 0, at + 1, due + every
    g[_watch.MEAN_V], g[_watch.NOISE_V2], g[_watch.SLOW_V2] = mean, noisy, slow
    g[_watch.EXCESS_V2], g[_watch.ERROR_V2], g[_watch.TRUST_S] = excess, error, trust
    g[_gate.PENDING], g[_watch.DOUBT_A], g[_watch.SPREAD] = pending, doubt, spread

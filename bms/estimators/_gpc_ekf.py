"""The polynomial-chaos Kalman filter as a numba kernel; the maths stands in `bms.estimators.gpc_ekf`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms._ecm import Circuit, ocv_and_slope, ocv_at, parameters_at
from bms.estimators import _gate, _watch
from bms.estimators._absorb import notice, take_occasion
from bms.estimators._chaos import (
    chaos_variance,
    collapse,
    from_nodes,
    project,
    regerm,
    take_voltage_chaos,
    to_nodes,
)
from bms.estimators._ekf import expect
from bms.estimators._gate import Gate, glance, is_temperature, judge, warm
from bms.estimators._joint import (
    STATE,
    WIDE_VARIANCE,
    Settings,
    add_noise,
    carry,
    carry_shared,
    covariance_row,
    lasting_ohm,
    move,
    move_and_linearise,
    rows_of,
    see_wide,
    spread_of,
    table_slopes,
    white_variance,
)
from bms.estimators._report import keep_inside, report
from bms.estimators._ukf import voltage_of

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


class ChaosSettings(NamedTuple):
    """Settings of the filter on chaos coefficients."""

    joint: Settings
    germs: IntArray  # (d,) places of the states that start with a germ of their own
    matrix: Array  # (q, terms) coefficients to values at the nodes
    inverse: Array  # (terms, q) and back
    rule: Array  # (order + 3, r) nodes, weights, and the polynomials up to the order at the nodes


@njit(cache=True, nogil=True, error_model="numpy")
def left_out(guide: IntArray, knot: Array, cubic: Array, soc: float, variance: float, rule: Array) -> float:
    """Variance of the OCV of a uniform SOC that polynomials up to the order leave out."""
    reach, square, middle = math.sqrt(3.0 * variance), 0.0, ocv_at(guide, knot, cubic, soc)
    kept = np.zeros(rule.shape[0] - 2)
    for q in range(rule.shape[1]):
        ocv = ocv_at(guide, knot, cubic, soc + reach * rule[0, q]) - middle
        square += rule[1, q] * ocv * ocv
        for i in range(kept.size):
            kept[i] += rule[1, q] * rule[2 + i, q] * ocv
    for i in range(kept.size):
        square -= kept[i] * kept[i]
    return max(square, 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def run(
    circuit: Circuit,
    gate: Gate,
    settings: ChaosSettings,
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
    guide, knot, cubic, table = circuit.guide, circuit.knot, circuit.cubic, circuit.table
    nodes_C, activation_K, reference_K = circuit.temperature_C, circuit.activation_K, circuit.reference_K
    varies, rate, per_C = circuit.varies, circuit.hysteresis_rate, 1.0 / circuit.capacity_C
    heat_capacity, thermal_K_per_W = circuit.heat_capacity_J_per_K, circuit.thermal_resistance_K_per_W
    joint, germs, matrix, inverse = settings.joint, settings.germs, settings.matrix, settings.inverse
    places, noise, watch, nominal = joint.places, joint.noise, joint.watch, joint.nominal
    n, terms = places.size, inverse.shape[0]
    end = _watch.END + rows_of(n) * n
    g, m = memory[: _watch.END], memory[_watch.END : end].reshape(-1, n)
    chaos = memory[end:].reshape(terms, n)
    nodes, node_V, seen_V = np.zeros((matrix.shape[0], n)), np.zeros(matrix.shape[0]), np.zeros(terms)
    top = covariance_row(places)
    pending, at, due = int(g[_gate.PENDING]), 0, 0 if rows.shape[0] else -1
    celsius = g[_gate.TEMPERATURE_C]
    ohm = parameters_at(table, nodes_C, activation_K, reference_K, m[STATE, 0], celsius)
    for k in range(current_A.size):
        seen = glance(gate, g, current_A[k], voltage_V[k], step_s[k], temperature_C[k])
        if seen.flags == _gate.UNUSUAL:
            seen = judge(gate, g, current_A[k], voltage_V[k], step_s[k], temperature_C[k])
        flags, step, celsius = seen.flags, seen.step_s, seen.temperature_C
        if heat_capacity > 0.0 and not is_temperature(temperature_C[k]):
            celsius = warm(g, gate.ambient_C, heat_capacity, thermal_K_per_W, step)
        if step > 0.0:
            to_nodes(matrix, chaos, nodes)
            for q in range(matrix.shape[0]):
                if varies:
                    ohm = parameters_at(table, nodes_C, activation_K, reference_K, nodes[q, 0], celsius)
                move(places, nodes, q, ohm, seen.drive_A, step, per_C, rate, noise.still_A)
            from_nodes(inverse, nodes, places.moving, chaos)
            if varies:
                ohm = parameters_at(table, nodes_C, activation_K, reference_K, m[STATE, 0], celsius)
            move_and_linearise(places, m, ohm, seen.drive_A, step, per_C, rate, noise.still_A)
            for i in range(n):
                m[STATE, i] = chaos[0, i]
            carry(places, m, top)
            carry(places, m, top + n)
            fades = min(step * noise.error_per_s, abs(seen.drive_A) * step * per_C * noise.error_per_soc)
            carry_shared(places, m, max(1.0 - fades, 0.0))
            doubt = g[_watch.DOUBT_A]
            if flags & _gate.GAP:
                doubt = math.sqrt(seen.charge_variance_C2) / step
            add_noise(places, noise, m, ohm, doubt, seen.charge_variance_C2, per_C, step)
        g[_watch.DOUBT_A] = seen.doubt_A
        fresh = notice(g, flags, seen.usable)
        if fresh:
            collapse(places, m, chaos)
            take_occasion(places, noise, guide, knot, cubic, g, m, fresh, voltage_V[k])
            regerm(places, m, chaos, germs)
        flags |= keep_inside(places, m)
        for i in range(n):
            chaos[0, i] = m[STATE, i]
        residual = math.nan
        if seen.usable:
            if m[top, 0] > max(chaos_variance(chaos, 0), WIDE_VARIANCE):
                collapse(places, m, chaos)
                regerm(places, m, chaos, germs)
            soc, variance = m[STATE, 0], m[top, 0] + g[_watch.ERROR_V2] * m[top + n, 0]
            ocv, over_soc = ocv_and_slope(guide, knot, cubic, soc)
            bent, spread, shift = 0.0, spread_of(variance, g[_watch.SPREAD]), -ocv
            g[_watch.SPREAD] = spread
            if spread > 0.0:
                low, high = ocv_at(guide, knot, cubic, soc - spread), ocv_at(guide, knot, cubic, soc + spread)
                ocv, over_soc, bent = see_wide(ocv, low, high, 0.5 / spread)
            shift += ocv
            spanned = chaos_variance(chaos, 0)
            if spanned > WIDE_VARIANCE:
                bent += left_out(guide, knot, cubic, soc, spanned, settings.rule)
            to_nodes(matrix, chaos, nodes)
            for q in range(matrix.shape[0]):
                if varies:
                    ohm = parameters_at(table, nodes_C, activation_K, reference_K, nodes[q, 0], celsius)
                node_ocv = ocv_at(guide, knot, cubic, nodes[q, 0])
                node_V[q] = voltage_of(places, nodes, q, ohm, node_ocv, seen.now_A)
            project(inverse, node_V, seen_V)
            if varies:
                ohm = parameters_at(table, nodes_C, activation_K, reference_K, soc, celsius)
                over_r, over_h = table_slopes(table, nodes_C, activation_K, reference_K, soc, celsius)
                over_soc += over_r * seen.now_A
                if places.hysteresis >= 0:
                    over_soc += over_h * m[STATE, places.hysteresis]
            _, series = expect(places, m, ohm, ocv, over_soc, seen.now_A)
            white = white_variance(noise, ohm, series, seen.doubt_A, step)
            residual = voltage_V[k] - seen_V[0] - shift
            judged = take_voltage_chaos(
                places,
                noise,
                watch,
                g,
                m,
                chaos,
                seen_V,
                bent,
                white,
                residual,
                step,
                lasting_ohm(ohm),
                per_C,
            )
            if judged & _gate.OUTLIER and judged & _gate.MISMATCH:
                regerm(places, m, chaos, germs)
            flags |= judged | keep_inside(places, m)
            for i in range(n):
                chaos[0, i] = m[STATE, i]
        if heat_capacity > 0.0:
            over_V = voltage_V[k] - ocv_at(guide, knot, cubic, m[STATE, 0])
            if varies and not seen.usable:
                ohm = parameters_at(table, nodes_C, activation_K, reference_K, m[STATE, 0], celsius)
            g[_gate.HEAT_W] = seen.now_A * over_V if seen.usable else seen.now_A**2 * ohm[0]
        pending |= flags
        if k == due or k == current_A.size - 1:
            report(places, m, chaos, nominal, g[_watch.ERROR_V2], row)
            row[2], row[3] = residual, flags
        if k == due:
            rows[at] = row
            rows[at, 3] = pending
            pending, at, due = 0, at + 1, due + every
    g[_gate.PENDING] = pending

"""The synthetic vehicle as a numba kernel; the maths stands in `vehicle.inertia.synthetic`.

State: heave, pitch, roll, the heights of the four wheels, then the rates of all seven; about rest.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

STATES = 14
GRAVITY_MPS2 = 9.81
LEAST_ROOM = 0.15
"""Share of its gas that a spring keeps: then it is on its stop."""


@njit(cache=True, nogil=True)
def strut_N(static_N: float, strut: Array, squeeze_m: float, speed_mps: float) -> float:
    """Dynamic force of a strut: polytropic gas spring and a damper with two slopes."""
    spring, exponent = strut[0], strut[1]
    room = max(1.0 - squeeze_m * spring / (exponent * static_N), LEAST_ROOM)
    damping = strut[2] if speed_mps > 0.0 else strut[3]
    return float(static_N * (room**-exponent - 1.0) + damping * speed_mps)


@njit(cache=True, nogil=True)
def derivative(
    state: Array,
    road: Array,
    ax: float,
    ay: float,
    drag_N: float,
    body: Array,
    static_N: Array,
    strut: Array,
    rate: Array,
    force: Array,
) -> None:
    """Write the derivative of the state and the dynamic strut forces."""
    m, pitch_inertia, roll_inertia = body[0], body[1], body[2]
    a, b, left, right, over_roll, over_pitch = body[3], body[4], body[5], body[6], body[7], body[8]
    unsprung, tyre = strut[4], strut[5]
    for i in range(7):
        rate[i] = state[7 + i]
    for i in range(4):
        x = -a if i < 2 else b
        y = left if i % 2 == 0 else -right
        squeeze = state[3 + i] - (state[0] + x * state[1] + y * state[2])
        speed = state[10 + i] - (state[7] + x * state[8] + y * state[9])
        force[i] = strut_N(static_N[i], strut, squeeze, speed)
        contact = max(tyre * (road[i] - state[3 + i]), -static_N[i] - unsprung * GRAVITY_MPS2)
        rate[10 + i] = (contact - force[i]) / unsprung
    front, rear = force[0] + force[1], force[2] + force[3]
    rate[7] = (front + rear) / m
    # The moment of gravity on a tilted body is that of the tilted accelerometer's reading.
    nose = m * over_pitch * (ax - GRAVITY_MPS2 * state[1]) + body[9] * drag_N
    side = m * over_roll * (ay + GRAVITY_MPS2 * state[2])
    rate[8] = (b * rear - a * front - nose) / (pitch_inertia + m * over_pitch * over_pitch)
    rolling = left * (force[0] + force[2]) - right * (force[1] + force[3])
    rate[9] = (rolling + side) / (roll_inertia + m * over_roll * over_roll)


@njit(cache=True, nogil=True)
def ride_over(
    road: Array,
    ax: Array,
    ay: Array,
    drag_N: Array,
    step_s: float,
    every: int,
    body: Array,
    static_N: Array,
    strut: Array,
    forces: Array,
    motion: Array,
) -> None:
    """Drive over a road by the classical Runge-Kutta rule, with inputs linear over a step.

    Parameters
    ----------
    road : ndarray, shape (n, 4)
        Height under each wheel.
    ax, ay, drag_N : ndarray, shape (n,)
        Specific forces in the axes of the road, and drag.
    step_s : float
    every : int
        Steps between samples.
    body, static_N, strut : ndarray, shapes (10,), (4,) and (6,)
        Mass, inertias, a, b, l, r, h_r, h_p, height of drag over the pitch centre; static forces; spring,
        exponent, damping of bump and rebound, unsprung mass, tyre.
    forces, motion : ndarray, shapes (samples, 4) and (samples, 5)
        Written: total strut forces; heave, pitch and roll acceleration, and A_x and A_y at the centre of
        gravity in the axes of the body.
    """
    state, trial = np.zeros(STATES), np.zeros(STATES)
    k1, k2, k3, k4 = np.zeros(STATES), np.zeros(STATES), np.zeros(STATES), np.zeros(STATES)
    force, middle = np.zeros(4), np.zeros(4)
    for k in range(road.shape[0]):
        derivative(state, road[k], ax[k], ay[k], drag_N[k], body, static_N, strut, k1, force)
        if k % every == 0:
            at = k // every
            for i in range(4):
                forces[at, i] = static_N[i] + force[i]
            for i in range(3):
                motion[at, i] = k1[7 + i]
            motion[at, 3] = ax[k] - GRAVITY_MPS2 * state[1] + body[8] * k1[8]
            motion[at, 4] = ay[k] + GRAVITY_MPS2 * state[2] - body[7] * k1[9]
        if k + 1 == road.shape[0]:
            break
        for i in range(4):
            middle[i] = 0.5 * (road[k, i] + road[k + 1, i])
        x, y, d = 0.5 * (ax[k] + ax[k + 1]), 0.5 * (ay[k] + ay[k + 1]), 0.5 * (drag_N[k] + drag_N[k + 1])
        for i in range(STATES):
            trial[i] = state[i] + 0.5 * step_s * k1[i]
        derivative(trial, middle, x, y, d, body, static_N, strut, k2, force)
        for i in range(STATES):
            trial[i] = state[i] + 0.5 * step_s * k2[i]
        derivative(trial, middle, x, y, d, body, static_N, strut, k3, force)
        for i in range(STATES):
            trial[i] = state[i] + step_s * k3[i]
        derivative(trial, road[k + 1], ax[k + 1], ay[k + 1], drag_N[k + 1], body, static_N, strut, k4, force)
        for i in range(STATES):
            state[i] += step_s / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])

"""Plain numpy twins of the battery kernels, written from the equations without regard to speed."""

import numpy as np

from gpc.basis import Legendre
from gpc.galerkin import uncertain_decay


def simulate(cell, current_A, step_s, soc=0.5):
    """[M] eqs 55-56 with constant parameters, pairs, hysteresis; states at the start of each step."""
    capacity_C = 3600.0 * cell.capacity_Ah
    v = np.zeros(len(cell.relaxation))
    h = 0.0
    socs, voltages, states = [], [], []
    for current, step in zip(current_A, np.broadcast_to(step_s, len(current_A)), strict=True):
        hysteresis_V = cell.hysteresis.voltage_V * h if cell.hysteresis else 0.0
        socs.append(soc)
        states.append(v.copy())
        voltages.append(float(cell.ocv(soc)) + hysteresis_V + v.sum() + cell.resistance_ohm * current)
        for j, pair in enumerate(cell.relaxation):
            tau = pair.time_constant_s or pair.resistance_ohm * pair.capacitance_F
            v[j] = np.exp(-step / tau) * v[j] + pair.resistance_ohm * (1.0 - np.exp(-step / tau)) * current
        moved = step * current / capacity_C
        if cell.hysteresis:
            keep = np.exp(-cell.hysteresis.rate * abs(moved))
            h = keep * h + (1.0 - keep) * np.sign(current)
        soc += moved
    return np.array(socs), np.array(voltages), np.array(states)


def gpc_gradient(ocv, current_A, voltage_V, theta, sigma, gains, terms, forgetting):
    """[M] eqs 73-85 term by term, in Legendre polynomials, an update a second; theta and SOC after each."""
    middle, half = 0.5 * (sigma[0] + sigma[1]), 0.5 * (sigma[1] - sigma[0])
    family = Legendre()
    move, feed = (np.asarray(part) for part in uncertain_decay(family, terms, middle, half).hold(1.0))
    feed = feed.reshape(-1)
    alpha, resistance, beta, xi, x10 = theta
    x1, q = 0.0, np.zeros(terms)
    integral = {}

    def add(name, value):
        integral[name] = forgetting * integral.get(name, 0.0) + value

    history, last = [], 0.0
    for current, measured in zip(current_A, voltage_V, strict=True):
        x1 += last
        q = move @ q + feed * last
        last = current
        soc = alpha * (x10 + x1)
        if not history:  # no time has passed before the first sample
            history.append([alpha, resistance, beta, xi, x10, soc])
            continue
        c0 = float(ocv.slope_V(soc))
        v0 = float(ocv(soc)) - c0 * soc
        error = v0 - measured
        add("e c x", error * c0 * x1)
        add("e c", error * c0)
        add("c2x2", (c0 * x1) ** 2)
        add("c2x", c0**2 * x1)
        add("c2", c0**2)
        add("q c x", q * c0 * x1)
        add("q c", q * c0)
        add("i c x", current * c0 * x1)
        add("i c", current * c0)
        add("e i", error * current)
        add("q i", q * current)
        add("i2", current**2)
        add("q e", q * error)
        add("q q", np.outer(q, q))
        phi, dphi = (
            np.asarray(v).reshape(-1) for v in family.evaluate_with_derivative(np.array([xi]), terms - 1)
        )
        s = integral
        d_alpha = (
            s["e c x"]
            + x10 * s["e c"]
            + alpha * s["c2x2"]
            + 2 * alpha * x10 * s["c2x"]
            + alpha * x10**2 * s["c2"]
            + beta * phi @ s["q c x"]
            + beta * x10 * phi @ s["q c"]
            + resistance * s["i c x"]
            + resistance * x10 * s["i c"]
        )
        d_r = (
            s["e i"]
            + alpha * x10 * s["i c"]
            + alpha * s["i c x"]
            + beta * phi @ s["q i"]
            + resistance * s["i2"]
        )
        inner = (
            s["q e"]
            + alpha * s["q c x"]
            + alpha * x10 * s["q c"]
            + beta * s["q q"] @ phi
            + resistance * s["q i"]
        )
        d_x10 = alpha * (
            s["e c"]
            + alpha * x10 * s["c2"]
            + alpha * s["c2x"]
            + beta * phi @ s["q c"]
            + resistance * s["i c"]
        )
        steps = np.array([d_alpha, d_r, phi @ inner, beta * dphi @ inner, d_x10]) * gains
        alpha, resistance, beta, xi, x10 = np.array([alpha, resistance, beta, xi, x10]) - steps
        history.append([alpha, resistance, beta, xi, x10, alpha * (x10 + x1)])
    return np.array(history)

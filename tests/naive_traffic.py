"""Plain numpy twins of the traffic kernels, and exact solutions of the kinematic-wave equation."""

import numpy as np
from scipy.special import lambertw


def godunov(diagram, initial, demand, ratio, steps, limit=None):
    """Every step of the whole road at once: densities (steps + 1, cells) and flows (steps, cells + 1)."""
    density = [np.array(initial, dtype=float)]
    flows = []
    for n in range(steps):
        k = density[-1]
        sent, room = diagram.demand_per_s(k), diagram.supply_per_s(k)
        flow = np.concatenate([[min(demand[n], room[0])], np.minimum(sent[:-1], room[1:]), sent[-1:]])
        if limit is not None:
            flow = np.minimum(flow, limit[n])
        flows.append(flow)
        density.append(k + ratio * (flow[:-1] - flow[1:]))
    return np.array(density), np.array(flows)


def upwind(diagram, initial, demand, ratio, steps):
    """The report's scheme."""
    density = [np.array(initial, dtype=float)]
    for n in range(steps):
        k = density[-1]
        flow = np.concatenate([[demand[n]], diagram.flow_per_s(k)])
        density.append(k + ratio * (flow[:-1] - flow[1:]))
    return np.array(density)


def shock(diagram, left, right, x, time_s):
    """Density of a jump that stays one: it travels with the slope of the chord."""
    speed = float(diagram.flow_per_s(right) - diagram.flow_per_s(left)) / (right - left)
    return np.where(x < speed * time_s, left, right)


def fan(diagram, left, right, x, time_s):
    """Density of a jump that spreads: each density travels with its own wave."""
    slope = np.clip(x / time_s, float(diagram.wave_mps(left)), float(diagram.wave_mps(right)))
    free = diagram.free_flow_mps
    if diagram.kind == "greenshields":
        return 0.5 * diagram.jam_per_m * (1.0 - slope / free)
    return diagram.critical_density_per_m * (1.0 - lambertw(np.e * slope / free).real)


def osher(diagram, left, right, slope, points=20001):
    """Density along a ray by Osher's formula, by brute force; holds for any diagram."""
    k = np.linspace(min(left, right), max(left, right), points)
    height = diagram.flow_per_s(k)[None, :] - np.atleast_1d(slope)[:, None] * k
    best = height.argmin(axis=1) if left < right else height.argmax(axis=1)
    return k[best]

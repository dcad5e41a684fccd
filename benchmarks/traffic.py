"""Traffic: many roads in one call, and that they and array code over all members drive alike."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.battery import require_equal
from benchmarks.timing import Task
from drivecycles.traffic import DIAGRAMS, Diagram, Road, make_diagram
from drivecycles.traffic.lwr import simulate_members

Array = NDArray[np.float64]

CELLS, CELL_M, DEMAND_PER_S = 50, 160.9344, 2400.0 / 3600.0
SAME = 1e-9
"""Largest difference of a density between kernel and array code, in 1/m; the jam density is 0.16."""

PARAMETERS = {
    "greenshields": {"free_flow_mps": 33.5, "jam_per_m": 0.155},
    "underwood": {"free_flow_mps": 33.5, "critical_density_per_m": 0.062},
    "greenberg": {"free_flow_mps": 33.5, "jam_per_m": 0.155, "optimum_mps": 15.0},
    "triangular": {"free_flow_mps": 33.5, "critical_density_per_m": 0.025, "jam_per_m": 0.155},
}


def road_tasks(members: int, steps: int) -> list[Task]:
    """Prepare Godunov's scheme on 50 cells, kernel against numpy over all members, then other diagrams.

    Raises
    ------
    DisagreementError
        Kernel and numpy find different densities.
    """
    drawn = {kind: _members(kind, members) for kind in DIAGRAMS}
    greenshields = drawn["greenshields"]
    ours = _run(greenshields, steps)
    require_equal("densities by kernel and numpy", ours, _numpy(greenshields, steps), SAME)
    units = members * steps * CELLS
    first = Task("greenshields", lambda: _run(greenshields, steps), units)
    second = Task("greenshields, NumPy", lambda: _numpy(greenshields, steps), units)
    others = [
        Task(kind, lambda kind=kind: _run(drawn[kind], steps), units)
        for kind in DIAGRAMS
        if kind != "greenshields"
    ]
    return [first, second, *others]


def _members(kind: str, members: int) -> list[Diagram]:
    generator = np.random.default_rng(0)
    return [
        make_diagram(
            kind,
            **{name: value * generator.uniform(0.9, 1.1) for name, value in PARAMETERS[kind].items()},
        )
        for _ in range(members)
    ]


def _run(members: list[Diagram], steps: int) -> Array:
    kept = simulate_members(
        Road(CELLS * CELL_M, CELLS), members, demand=DEMAND_PER_S, duration_s=float(steps), step_s=1.0,
        time_s=[steps],
    )  # fmt: skip
    return kept.density_per_m[0]


def _numpy(members: list[Diagram], steps: int) -> Array:
    """Step all members of Greenshields together, an operation on whole arrays after the other."""
    free = np.array([member.free_flow_mps for member in members])
    jam = np.array([member.full_per_m for member in members])
    critical, capacity = 0.5 * jam, 0.25 * free * jam
    density, flow = np.zeros((CELLS, free.size)), np.empty((CELLS + 1, free.size))
    for _ in range(steps):
        own = density * free * (1.0 - density / jam)
        below = density <= critical
        sent, room = np.where(below, own, capacity), np.where(below, capacity, own)
        flow[0] = np.minimum(DEMAND_PER_S, room[0])
        np.minimum(sent[:-1], room[1:], out=flow[1:-1])
        flow[-1] = sent[-1]
        density += (flow[:-1] - flow[1:]) / CELL_M
    return density

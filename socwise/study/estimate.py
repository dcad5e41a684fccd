"""What a study will take, before it is run: solves, memory, time.

A piece of a trip is solved and driven on this machine, in two lengths, for each concept and grid. Time and
memory grow in proportion to the steps of a trip and to the width of the SOC grid; what two lengths do not
explain is the price of setting up. It is an estimate: other work on the machine, or another machine, is not
in it, nor are closed loops and traffic, whose cost is of another kind.
"""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from drivecycles import DriveCycle
from socwise.study.digest import digest
from socwise.study.task import PlannedCase, WorkUnit
from socwise.study.units import solve_key
from socwise.study.worker import peak_rss_MB

SHORT_STEPS, LONG_STEPS = 30, 90
START_S = 3.0
"""What a worker takes to start and to load the kernels."""
STEP_S = 1.0


@dataclass(frozen=True)
class Estimate:
    """What some units will take.

    Parameters
    ----------
    busy_s : float
        Seconds of computing, over all workers.
    wall_s : float
        Seconds with the workers that were asked for.
    memory_MB : float
        Of each process.
    left_out : int
        Cases that are not in it: closed loops and traffic.
    """

    busy_s: float
    wall_s: float
    memory_MB: float
    left_out: int


@dataclass(frozen=True)
class _Rate:
    """Seconds and bytes of one policy: to set up, to solve and to drive a step."""

    setup_s: float
    solve_s: float
    drive_s: float
    setup_B: float
    step_B: float
    span: float


def estimate(units: Sequence[WorkUnit], workers: int) -> Estimate:
    """Estimate what units will take.

    Parameters
    ----------
    units : sequence of WorkUnit
        What is to be computed.
    workers : int
        Who computes.
    """
    rates: dict[str, dict[str, _Rate]] = {}
    busy, longest, memory, left_out = 0.0, 0.0, 0.0, 0
    for unit in units:
        first = unit.cases[0]
        if first.loop is not None or not isinstance(unit.trip, DriveCycle):
            left_out += len(unit.cases)
            continue
        kind = digest([first.concept.name, str(first.concept._folder), first.settings, first.realizations])
        if kind not in rates:
            rates[kind] = {name: _measure(unit, name) for name in first.policies}
        seconds, size = _of_unit(unit, rates[kind])
        busy, longest, memory = busy + seconds, max(longest, seconds), max(memory, size)
    used = max(1, min(workers, len(units)))
    wall = max(busy / used, longest) + START_S if busy else 0.0
    return Estimate(busy, wall, memory / 1e6 + peak_rss_MB(), left_out)


def _of_unit(unit: WorkUnit, rates: dict[str, _Rate]) -> tuple[float, float]:
    steps = _steps(unit.trip)
    seconds = size = 0.0
    for name, rate in rates.items():
        share = _span(unit.cases[0]) / rate.span
        solves = len({solve_key(case, name) for case in unit.cases})
        seconds += solves * (rate.setup_s + share * rate.solve_s * steps)
        seconds += len(unit.cases) * rate.drive_s * steps
        size = max(size, rate.setup_B + share * rate.step_B * steps)
    return seconds, size


def _steps(trip: Any) -> int:
    return round(float(trip.duration_s) / STEP_S)


def _span(case: PlannedCase) -> float:
    """Width of the SOC grid."""
    window, margin = case.concept.window, case.settings.soc_margin
    return min(1.0, window.high + margin) - max(0.0, window.low - margin)


def _measure(unit: WorkUnit, policy: str) -> _Rate:
    steps = _steps(unit.trip)
    short, long = min(SHORT_STEPS, max(2, steps // 2)), min(LONG_STEPS, steps)
    case = replace(unit.cases[0], policies=(policy,), on_infeasible="limit", trajectories=False)
    pieces = [replace(unit, cases=(case,), trip=_piece(unit.trip, count)) for count in (short, long)]
    _timed(pieces[0])
    (short_s, short_solve), (long_s, long_solve) = (min(_timed(one), _timed(one)) for one in pieces)
    short_B, long_B = (_peak_B(one) for one in pieces)
    more = max(1, long - short)
    solve = max(0.0, long_solve - short_solve) / more
    drive = max(0.0, (long_s - long_solve) - (short_s - short_solve)) / more
    step_B = max(0.0, long_B - short_B) / more
    return _Rate(
        setup_s=max(0.0, short_s - short * (solve + drive)),
        solve_s=solve,
        drive_s=drive,
        setup_B=max(0.0, short_B - short * step_B),
        step_B=step_B,
        span=_span(case),
    )


def _piece(trip: DriveCycle, steps: int) -> DriveCycle:
    """Cut a piece from the middle of a trip: at its ends a car stands."""
    whole = trip if trip.is_uniform and abs(trip.step_s - STEP_S) < 1e-9 else trip.resample(STEP_S)
    at = max(0, (len(whole) - 1 - steps) // 2)
    part = slice(at, at + steps + 1)
    return DriveCycle(whole.name, whole.time_s[part], whole.speed_mps[part], whole.altitude_m[part])


def _timed(unit: WorkUnit) -> tuple[float, float]:
    from socwise.study.compute import compute

    started = time.perf_counter()
    outcome = compute(unit)[0]
    return time.perf_counter() - started, sum(outcome.timing["solve_s"].values())


def _peak_B(unit: WorkUnit) -> float:
    from socwise.study.compute import compute

    tracemalloc.start()
    try:
        compute(unit)
        return float(tracemalloc.get_traced_memory()[1])
    finally:
        tracemalloc.stop()

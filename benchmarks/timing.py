"""Fair times on a machine that others use: rounds interleaved, processor and wall clock side by side."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Task:
    """Something to time: ``run`` does ``units`` pieces of work."""

    name: str
    run: Callable[[], object]
    units: int


@dataclass(frozen=True, eq=False)
class Timing:
    """Nanoseconds per unit of each round: ``cpu`` of this process, ``wall`` of the clock on it."""

    name: str
    cpu: Array
    wall: Array


def interleave(tasks: Sequence[Task], rounds: int) -> list[Timing]:
    """Run the tasks in turn, A B A B, and time every run.

    Parameters
    ----------
    tasks : sequence of Task
        Run once each beforehand, so that compilation and cold caches are not timed.
    rounds : int
        Number of runs of each.
    """
    for task in tasks:
        task.run()
    taken = np.empty((len(tasks), 2, rounds))
    for turn in range(rounds):
        for index, task in enumerate(tasks):
            wall, cpu = time.perf_counter_ns(), time.process_time_ns()
            task.run()
            taken[index, 0, turn] = (time.process_time_ns() - cpu) / task.units
            taken[index, 1, turn] = (time.perf_counter_ns() - wall) / task.units
    return [Timing(task.name, *times) for task, times in zip(tasks, taken, strict=True)]

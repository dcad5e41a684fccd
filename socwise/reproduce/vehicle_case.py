"""[M] parts 1 and 2, the vehicle: many drives of the synthetic Defender, each run through several methods."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import lru_cache

from socwise.inertia import InertiaRun, lean
from socwise.inertia_cases import METHODS, run_synthetic
from socwise.reproduce.registry import Progress
from vehicle.inertia.sensors import RIDE_SENSORS, ROAD_SENSORS, ROAD_SENSORS_GAIN, SensorErrors

RIDE_SEEDS, ROAD_SEEDS = 50, 20
RIDE_SCENARIO = "rural"
QUIET = "quiet"
NOISY = "noisy"
INPUTS_NOISY = "inputs noisy"
ROAD, ROAD_GAIN = "road", "road with gain"

SENSORS: dict[str, SensorErrors] = {
    QUIET: SensorErrors(acceleration_variance=0.0),
    NOISY: RIDE_SENSORS,
    INPUTS_NOISY: SensorErrors(horizontal_variance=0.1),
    ROAD: ROAD_SENSORS,
    ROAD_GAIN: ROAD_SENSORS_GAIN,
}
RIDE_NOISE_SD = {QUIET: 0.1, NOISY: 0.1**0.5, INPUTS_NOISY: 0.1**0.5}
"""Square root of R in Tables 3 and 4."""
ROAD_METHODS = ("gpc", "ekf", "rls-force")

Runs = dict[tuple[str, str], tuple[InertiaRun, ...]]
"""Runs of all seeds by model and method."""


@lru_cache(maxsize=512)
def _drive(models: tuple[str, ...], scenario: str, sensors: str, seed: int) -> tuple[InertiaRun, ...]:
    methods: Sequence[str] = METHODS if models == ("ride",) else ROAD_METHODS
    noise = RIDE_NOISE_SD.get(sensors)
    found = run_synthetic(models, scenario, seed, methods, SENSORS[sensors], noise_sd=noise)
    return tuple(lean(run) for run in found)


def drives(
    models: tuple[str, ...],
    scenario: str,
    sensors: str,
    seeds: int,
    *,
    jobs: int = 2,
    progress: Progress | None = None,
    before: int = 0,
    total: int | None = None,
) -> Runs:
    """Drive and estimate for every seed; the result does not depend on ``jobs``.

    Parameters
    ----------
    models : tuple of str
        ``ride``, or ``ltm`` and ``mltm``.
    scenario, sensors : str
        Key of `SENSORS`.
    seeds : int
        Drives.
    jobs : int
        Threads.
    progress : callable, optional
        Called with what is done and what there is.
    before, total : int
        What was done before, of how much in all; ``seeds`` if left out.
    """
    with ThreadPoolExecutor(jobs) as pool:
        tasks = [pool.submit(_drive, models, scenario, sensors, seed) for seed in range(seeds)]
        for done, _ in enumerate(as_completed(tasks), 1):
            if progress is not None:
                progress(before + done, total or seeds)
        found = [task.result() for task in tasks]
    by_kind: dict[tuple[str, str], list[InertiaRun]] = {}
    for several in found:
        for run in several:
            by_kind.setdefault((run.model, run.estimate.method), []).append(run)
    return {kind: tuple(several) for kind, several in by_kind.items()}

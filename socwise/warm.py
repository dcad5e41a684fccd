"""Compile every kernel ahead: small problems, run through the functions that the commands call.

A kernel is compiled for the types it is called with. Running what the commands run, only shorter, gives the
very types they will ask for; lists of types would have to be kept in step by hand.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from gpc.kernel_cache import cache_folders

if TYPE_CHECKING:
    from drivecycles import DriveCycle

STEPS = 12
"""Steps of a drive, from where the car moves on."""
REALIZATIONS = 2
CONCEPTS = ("hev", "phev")
ESTIMATOR_CELLS = ("lfp-2ah", "a123-26650")
SAMPLES = 40
SPRING_S, RIDE_S, TRANSFER_S = 2.0, 5.0, 30.0

Advance = Callable[[int, int], None]
Job = Callable[[], object]


def warm(progress: Callable[[str, int, int], None] | None = None) -> float:
    """Compile what is not compiled yet, and say how long that took, in s.

    Parameters
    ----------
    progress : callable, optional
        Called with the name of what comes next, how much is done, and how much there is.
    """
    began = time.perf_counter()
    _check_stamps()
    for done, (name, job) in enumerate(JOBS.items()):
        if progress is not None:
            progress(name, done, len(JOBS))
        job()
    if progress is not None:
        progress("", len(JOBS), len(JOBS))
    return time.perf_counter() - began


def kept_in() -> str:
    """Name the folders in which the kernels are kept, by the part that they have in common."""
    from bms import _kernels as battery
    from drivecycles.traffic import _kernels as traffic
    from ems import _kernels as energy
    from vehicle.inertia import _kernels as inertia

    modules = {module for group in (battery, traffic, energy, inertia) for module in group.MODULES}
    return os.path.commonpath([folder for module in modules for folder in cache_folders(module)])


def _check_stamps() -> None:
    """Discard what is stale of every group before anything is compiled: groups share modules."""
    from bms import _kernels as _battery
    from drivecycles.traffic import _kernels as _traffic
    from ems import _kernels as _energy
    from vehicle.inertia import _kernels as _inertia

    del _battery, _traffic, _energy, _inertia


def _drive() -> DriveCycle:
    from drivecycles import DriveCycle, load_cycle

    whole = load_cycle("larsson").resample(1.0)
    first = int(np.argmax(whole.speed_mps > 0.0))
    part = slice(first, first + STEPS + 1)
    time_s = whole.time_s[part] - whole.time_s[first]
    return DriveCycle("warming up", time_s, whole.speed_mps[part], whole.altitude_m[part])


def _policies() -> None:
    from ems import load_concept
    from ems.compare import compare

    concepts = [load_concept(name) for name in CONCEPTS]
    compare(concepts, _drive(), realizations=REALIZATIONS, jobs=1, on_infeasible="limit")


def _closed_loop() -> None:
    from ems import load_concept
    from ems.closed import ClosedLoop, Training, compare_closed

    drive = _drive()
    compare_closed(
        [load_concept("hev")],
        drive,
        ClosedLoop(),
        Training(drive, realizations=REALIZATIONS),
        realizations=REALIZATIONS,
        jobs=1,
        on_infeasible="limit",
    )


def _estimator(name: str) -> Job:
    def job() -> None:
        from bms.cells import load_cell
        from bms.estimators.catalogue import make_estimator
        from bms.logged_data import LoggedData
        from bms.simulation import simulate
        from socwise.estimation import run_estimator

        current_A = np.where(np.arange(SAMPLES) % 20 < 10, 1.0, -1.0)
        for cell in map(load_cell, ESTIMATOR_CELLS):
            voltage_V = simulate(cell, current_A, 1.0, soc=0.5).voltage_V
            time_s = np.arange(SAMPLES, dtype=np.float64)
            for celsius in (None, np.full(SAMPLES, 25.0)):
                log = LoggedData(time_s, current_A.copy(), voltage_V.copy(), celsius)
                run_estimator(make_estimator(name, cell, soc=0.5, soc_sd=0.3), log)

    return job


def _cells() -> None:
    from bms.ageing import age
    from bms.cells import load_cell
    from bms.cycling import cycling_profile
    from bms.plants.ecm import EcmPlant
    from bms.simulation import simulate_members
    from socwise.reproduce.fade_map import fade_map

    cell = load_cell("lfp-2ah")
    simulate_members(cell, np.ones(SAMPLES), soc=0.5, keep_soc=False)
    EcmPlant(cell).carry(1.0, 1.0)
    profile = cycling_profile(cell.capacity_Ah, np.full(SAMPLES, -1.0), float(SAMPLES))
    age(fade_map(), profile.current_A, profile.soc, 25.0, 1.0)


def _spring() -> None:
    from socwise.inertia_cases import MODES, run_mass_spring
    from vehicle.inertia.mass_spring import simulate

    run_mass_spring(simulate(seed=0, duration_s=SPRING_S), MODES, seed=0)


def _ride() -> None:
    from socwise.inertia_cases import METHODS, run_synthetic
    from vehicle.inertia.sensors import RIDE_SENSORS

    run_synthetic(["ride"], "rural", 0, METHODS, RIDE_SENSORS, duration_s=RIDE_S)


def _load_transfer() -> None:
    from socwise.inertia_cases import METHODS, run_synthetic
    from vehicle.inertia.sensors import ROAD_SENSORS_GAIN

    run_synthetic(["ltm", "mltm"], "urban", 0, METHODS, ROAD_SENSORS_GAIN, duration_s=TRANSFER_S)


def _traffic() -> None:
    from drivecycles.traffic.ensemble import draw_cycles
    from drivecycles.traffic.scenario_file import load_scenario
    from drivecycles.traffic.second_order import MODELS
    from socwise.traffic import spread

    scenario = load_scenario("report")
    scenario.simulate()
    spread(scenario, "lhs", 16, 0)
    draw_cycles(scenario, cycles=2)
    for model in MODELS:
        short = scenario.run.model_copy(update={"model": model, "duration_s": 20.0})
        scenario.model_copy(update={"run": short}).simulate()


JOBS: dict[str, Job] = {
    "policies": _policies,
    **{
        f"estimator {name.replace('_', '-')}": _estimator(name)
        for name in ("ekf", "coulomb", "ukf", "gpc_gradient", "gpc_gauss_newton", "gpc_ekf")
    },
    "closed loop": _closed_loop,
    "cells": _cells,
    "mass on a spring": _spring,
    "ride": _ride,
    "load transfer": _load_transfer,
    "traffic": _traffic,
}
"""What is run, in the order of how soon a user is likely to need it."""

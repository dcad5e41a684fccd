"""Cell simulation and estimators: what is timed, and that rivals agree before they are."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import plain_filters
from benchmarks.battery_log import Log
from benchmarks.rivals import DisagreementError
from benchmarks.timing import Task
from bms.cells import load_cell
from bms.estimators.base import KernelEstimator
from bms.estimators.catalogue import make_estimator
from bms.estimators.members import run_members
from bms.simulation import simulate, simulate_members
from socwise.reproduce.battery_case import FORGETTING, GAINS, SIGMA_PER_S, SOC_MODEL, TABLE_7

Array = NDArray[np.float64]

EVERY = 60
"""Samples per row that an estimator keeps."""
STATES = {"estimate": ()}
PLAIN = {"model_error_V": 0.0, "watches": False}
"""What makes the extended Kalman filter the one of the textbooks."""
SAME_V, SAME_SOC = 1e-9, 1e-9


def load_twins() -> ModuleType:
    """Load the plain twins of the test suite."""
    spec = spec_from_file_location("naive_bms", Path(__file__).parents[1] / "tests" / "naive_bms.py")
    if spec is None or spec.loader is None:
        raise ImportError("tests/naive_bms.py is missing; benchmarks run from a checkout")
    twins = module_from_spec(spec)
    spec.loader.exec_module(twins)
    return twins


def simulation_tasks(log: Log, samples: int) -> tuple[list[Task], list[Task]]:
    """Prepare the simulation of the log's cell against the plain loop, and that of cells with more to them.

    Parameters
    ----------
    log : Log
        The current to apply.
    samples : int
        How many of them the plain loop is given.

    Raises
    ------
    DisagreementError
        Kernel and loop find different voltages.
    """
    short, loop = log.first(samples), load_twins().simulate
    require_equal(
        "voltages of cell simulation and plain loop",
        _voltage(short),
        loop(short.cell, short.applied_A, 1.0, SOC_MODEL)[1],
        SAME_V,
    )
    paired = [
        Task("simulate_members, one member, voltage", lambda: _voltage(log), log.samples),
        Task("plain loop", lambda: loop(short.cell, short.applied_A, 1.0, SOC_MODEL), samples),
    ]
    others = [
        Task("... and SOC", lambda: _voltage(log, keep_soc=True), log.samples),
        Task("simulate, every state", lambda: simulate(log.cell, log.applied_A, soc=SOC_MODEL), log.samples),
    ]
    for name in ("a123-26650", "nmc-lgm50"):
        other = Log(load_cell(name), log.applied_A, log.current_A, log.voltage_V)
        others.append(Task(f"{name}, voltage", lambda other=other: _voltage(other), log.samples))
    return paired, others


def gradient_tasks(log: Log, samples: int) -> list[Task]:
    """Prepare the report's estimator, N = 3, and its equations written out.

    Raises
    ------
    DisagreementError
        They estimate different SOC, resistances or capacitances.
    """
    short, twin = log.first(samples), load_twins().gpc_gradient
    q, r, c_r, r_r = (parameter.guess for parameter in TABLE_7)
    middle, half = 0.5 * sum(SIGMA_PER_S), 0.5 * (SIGMA_PER_S[1] - SIGMA_PER_S[0])
    capacity_C = 3600.0 * q
    start = (1.0 / capacity_C, r, 1.0 / c_r, (1.0 / (r_r * c_r) - middle) / half, 0.5 * capacity_C)
    gains = np.array([GAINS.alpha, GAINS.resistance, GAINS.beta, GAINS.xi, GAINS.x10])
    options = {
        "forgetting": FORGETTING,
        "sigma_per_s": SIGMA_PER_S,
        "gains": GAINS,
        "initial": {parameter.name: parameter.guess for parameter in TABLE_7},
    }

    def loop() -> Array:
        ocv = short.cell.ocv
        history = twin(ocv, short.current_A, short.voltage_V, start, SIGMA_PER_S, gains, 3, FORGETTING)
        return np.asarray(history)

    trace = make_estimator("gpc_gradient", log.cell, soc=0.5, **options).run(short.current_A, short.voltage_V)
    named, written_out = trace.parameters, loop()
    require_equal(
        "SOC, R and C_r (over their guesses) of gpc_gradient and eqs 73-85 written out",
        np.array([trace.soc, named["resistance_ohm"] / r, named["relaxation_capacitance_F"] / c_r]),
        np.array([written_out[:, 5], written_out[:, 1] / r, 1.0 / (c_r * written_out[:, 2])]),
        SAME_SOC,
    )
    return [
        estimator_task("gpc_gradient, N = 3", log, "gpc_gradient", options),
        Task("NumPy, eqs 73-85 written out", loop, samples),
    ]


def filter_tasks(log: Log, samples: int, joint: bool) -> list[Task]:
    """Prepare the extended Kalman filter of 2 states, or of 5, against one out of a textbook.

    Ours is compared with model error and watch switched off, and timed with its defaults.

    Raises
    ------
    DisagreementError
        They estimate different SOC.
    """
    short, shape = log.first(samples), {} if joint else STATES
    ours = make_estimator("ekf", log.cell, soc=SOC_MODEL - 0.005, soc_sd=0.005, **shape, **PLAIN)
    trace = ours.run(short.current_A, short.voltage_V)
    rivals: dict[str, Callable[..., Array]] = {"NumPy, textbook": plain_filters.numpy_filter}
    if plain_filters.ExtendedKalmanFilter is not None:
        rivals["filterpy, textbook"] = plain_filters.filterpy_filter
    tasks = [
        estimator_task("ekf", log, "ekf", shape),
        estimator_task("ekf, model error and watch off", log, "ekf", shape | PLAIN),
    ]
    for name, rival in rivals.items():

        def loop(rival: Callable[..., Array] = rival) -> Array:
            return rival(log.cell, short.current_A, short.voltage_V, SOC_MODEL - 0.005, 0.005, joint)

        require_equal(f"SOC of ekf and {name}", trace.soc, loop(), SAME_SOC)
        tasks.append(Task(name, loop, samples))
    return tasks


def other_estimator_tasks(log: Log, day: int) -> list[Task]:
    """Prepare the other estimators, the slow ones on the first ``day`` samples."""
    short, steady = log.first(day), log.without_noise_of_the_current()
    return [
        estimator_task("coulomb", log, "coulomb"),
        estimator_task("gpc_gradient, N = 2", log, "gpc_gradient", {"terms": 2}),
        estimator_task("gpc_gradient, N = 4", log, "gpc_gradient", {"terms": 4}),
        estimator_task("gpc_gradient, current without noise", steady, "gpc_gradient"),
        estimator_task("gpc_gradient, every row kept", short, "gpc_gradient", every=1),
        estimator_task("gpc_gauss_newton, N = 3", log, "gpc_gauss_newton"),
        estimator_task("ukf, 5 states", short, "ukf"),
        estimator_task("gpc_ekf", short, "gpc_ekf"),
    ]


def member_tasks(log: Log, members: int) -> list[list[Task]]:
    """Prepare many cells, and many estimators, in one call against one in one call."""
    return [
        [
            Task(f"members: {count:,}", lambda count=count: _cells(log, count), count * log.samples)
            for count in (members, 1)
        ],
        [
            Task(f"members: {count:,}", lambda count=count: _estimators(log, count), count * log.samples)
            for count in (members, 1)
        ],
    ]


def estimator_task(
    title: str, log: Log, name: str, options: Mapping[str, Any] | None = None, every: int = EVERY
) -> Task:
    """Prepare an estimator on a log; making it is part of the time."""

    def run() -> object:
        estimator = make_estimator(name, log.cell, soc=0.5, **(options or {}))
        return estimator.run(log.current_A, log.voltage_V, every=every)

    return Task(title, run, log.samples)


def require_equal(what: str, ours: Array, theirs: Array, tolerance: float) -> float:
    """Compare, and give the largest difference.

    Raises
    ------
    DisagreementError
        It exceeds the tolerance.
    """
    apart = float(np.max(np.abs(ours - theirs)))
    if not apart <= tolerance:
        raise DisagreementError(
            f"{what} differ by up to {apart:.2g}, {tolerance:.2g} is allowed;"
            " one of the two is wrong, so no time is taken"
        )
    return apart


def _voltage(log: Log, keep_soc: bool = False) -> Array:
    return simulate_members(log.cell, log.applied_A, soc=SOC_MODEL, keep_soc=keep_soc).voltage_V[0]


def _cells(log: Log, count: int) -> object:
    factors = np.linspace(0.9, 1.1, count)
    return simulate_members(log.cell, log.applied_A, soc=SOC_MODEL, capacity_factor=factors, keep_soc=False)


def _estimators(log: Log, count: int) -> object:
    first: KernelEstimator = make_estimator("gpc_gradient", log.cell, soc=0.5)
    estimators = [first, *(first.copy() for _ in range(count - 1))]
    return run_members(estimators, log.current_A, log.voltage_V, every=EVERY)

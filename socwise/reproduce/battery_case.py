"""[M] section 4.3: the cell and the estimator of Table 7, the profile of Fig 28, and one estimated run."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from bms.cell import Cell
from bms.cells import load_cell
from bms.cycling import CyclingProfile, cycling_profile
from bms.estimators.base import KernelEstimator, Trace
from bms.estimators.catalogue import make_estimator
from bms.estimators.gpc_gradient import Gains
from bms.simulation import simulate
from socwise.reproduce.phev_current import phev_trip
from socwise.reproduce.registry import Progress

Array = NDArray[np.float64]

CELL = "lfp-2ah"
DAY_S = 86_400.0
DAYS, OFF_DAYS = 10, 1
CURRENT_SD_A, VOLTAGE_SD_V = 0.010, 0.002
SIGMA_PER_S = (0.02, 0.06)
"""Bounds of 1 / (R_r C_r); the report does not give them (ERRATA.md)."""
FORGETTING = 0.99999
SEED, SEEDS = 0, 20
EVERY = 600
GAINS = Gains(alpha=2e-14, resistance=1e-8, beta=1e-10, xi=1e-5, x10=100.0)
"""Table 8."""


@dataclass(frozen=True)
class Parameter:
    """A row of Table 7.

    Parameters
    ----------
    name : str
        Name in the estimators.
    symbol, unit : str
        As in the report.
    scale : float
        How many of the unit make one of SI.
    model, guess : float
        Value of the model and first guess of the estimator, in SI (capacities in Ah).
    """

    name: str
    symbol: str
    unit: str
    scale: float
    model: float
    guess: float


TABLE_7 = (
    Parameter("capacity_Ah", "Q", "Ah", 1.0, 2.0, 2.2),
    Parameter("resistance_ohm", "R", "mΩ", 1e3, 8e-3, 10e-3),
    Parameter("relaxation_capacitance_F", "C_r", "F", 1.0, 2700.0, 3000.0),
    Parameter("relaxation_resistance_ohm", "R_r", "mΩ", 1e3, 11e-3, 10e-3),
)
SOC_MODEL, SOC_GUESS = 0.7, 0.5
GRADIENT, NEWTON = "gpc_gradient", "gpc_gauss_newton"


@dataclass(frozen=True, eq=False)
class Estimated:
    """An estimated run: what was believed, and the truth beside it.

    Parameters
    ----------
    trace : Trace
        The estimator's rows.
    soc : ndarray, shape (n,)
        True SOC at the rows.
    """

    trace: Trace
    soc: Array

    @property
    def soc_error(self) -> Array:
        """Estimate less truth, shape (n,)."""
        return np.asarray(self.trace.soc - self.soc)

    def error_percent(self, parameter: Parameter, row: int = -1) -> float:
        """Error of a parameter at a row, in per cent of its true value."""
        return 100.0 * float(self.trace.parameters[parameter.name][row] / parameter.model - 1.0)

    def worst_soc_error(self, from_s: float) -> float:
        """Largest error of the SOC from a time on."""
        return float(np.abs(self.soc_error[self.trace.time_s >= from_s]).max())


@lru_cache(maxsize=1)
def battery_cell() -> Cell:
    """Load the cell of Table 7."""
    return load_cell(CELL)


@lru_cache(maxsize=2)
def battery_profile(duration_s: float = DAYS * DAY_S) -> CyclingProfile:
    """Cycle the cell of Table 7 between 20 and 80 % by the PHEV's current and 2 A, from 70 % on."""
    capacity_Ah = battery_cell().capacity_Ah
    return cycling_profile(capacity_Ah, phev_trip(capacity_Ah).current_A, duration_s)


@lru_cache(maxsize=2)
def _voltage(cell: Cell) -> tuple[Array, Array]:
    """Voltage and SOC of a cell along the profile, without noise."""
    run = simulate(cell, battery_profile().current_A, 1.0, soc=SOC_MODEL)
    return run.voltage_V, run.soc


def new_estimator(
    cell: Cell, terms: int, off_days: float = OFF_DAYS, name: str = GRADIENT
) -> KernelEstimator:
    """Make the report's estimator with the first guesses of Table 7 and the gains of Table 8."""
    return make_estimator(
        name,
        cell,
        soc=SOC_GUESS,
        terms=terms,
        start_after_s=off_days * DAY_S,
        initial={parameter.name: parameter.guess for parameter in TABLE_7},
        sigma_per_s=SIGMA_PER_S,
        forgetting=FORGETTING,
        gains=GAINS,
    )


def add_noise(current_A: Array, voltage_V: Array, random: np.random.Generator) -> tuple[Array, Array]:
    """Measure with the report's noise: 10 mA and 2 mV, white."""
    return (
        current_A + CURRENT_SD_A * random.standard_normal(current_A.size),
        voltage_V + VOLTAGE_SD_V * random.standard_normal(voltage_V.size),
    )


def generator(realization: int) -> np.random.Generator:
    """Random numbers of a realization of the noise."""
    return np.random.default_rng(np.random.SeedSequence(SEED, spawn_key=(realization,)))


@lru_cache(maxsize=128)
def estimate(
    terms: int,
    realization: int = 0,
    every: int = EVERY,
    *,
    name: str = GRADIENT,
    cell: Cell | None = None,
) -> Estimated:
    """Estimate ten days at 1 s, the estimator off for the first one.

    Parameters
    ----------
    terms : int
        Terms N of the expansion.
    realization : int
        Which noise.
    every : int
        Samples per row that is kept.
    name : str
        The estimator.
    cell : Cell, optional
        Serves as model and as the estimator's nominal cell; the one of Table 7 when left out.
    """
    model = cell or battery_cell()
    voltage_V, soc = _voltage(model)
    measured = add_noise(battery_profile().current_A, voltage_V, generator(realization))
    trace = new_estimator(model, terms, name=name).run(*measured, 1.0, every=every)
    return Estimated(trace, soc[::every].copy())


def estimate_many(
    cases: Sequence[tuple[str, int]],
    realizations: int,
    *,
    jobs: int = 2,
    progress: Progress | None = None,
) -> dict[tuple[str, int], list[Estimated]]:
    """Estimate in several ways, each on the same realizations of the noise.

    Parameters
    ----------
    cases : sequence of tuple of str and int
        Estimators and terms N.
    realizations : int
        How many of each.
    jobs, progress
        Threads, which do not change the result, and a callable that is told what is done.
    """
    _voltage(battery_cell())
    tasks = [(case, realization) for case in cases for realization in range(realizations)]
    found: dict[tuple[str, int], list[Estimated]] = {case: [] for case in cases}

    def work(task: tuple[tuple[str, int], int]) -> Estimated:
        (name, terms), realization = task
        return estimate(terms, realization, name=name)

    with ThreadPoolExecutor(max(jobs, 1)) as pool:
        for done, (task, run) in enumerate(zip(tasks, pool.map(work, tasks), strict=True), 1):
            found[task[0]].append(run)
            if progress is not None:
                progress(done, len(tasks))
    return found

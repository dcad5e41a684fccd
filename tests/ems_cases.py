"""Problems that several tests of the energy management share."""

from __future__ import annotations

import functools

import numpy as np

from drivecycles import DriveCycle, load_cycle
from ems import Concept, GridSettings, Problem, build_problem, load_concept


@functools.cache
def full_problem(concept: str, settings: GridSettings | None = None) -> Problem:
    """The job of the default command for one concept."""
    return build_problem(load_concept(concept), load_cycle("larsson"), settings=settings)


def short_cycle(seconds: int = 120) -> DriveCycle:
    """The first seconds of FTP-72: idling, two hills of speed, stops."""
    cycle = load_cycle("ftp72")
    return DriveCycle("short", cycle.time_s[: seconds + 1], cycle.speed_mps[: seconds + 1])


@functools.cache
def short_problem(concept: str, seconds: int = 120) -> Problem:
    """A concept on the short cycle, on a coarse grid."""
    settings = GridSettings(soc_step=0.01, deterministic_soc_step=0.005, variance_rows=5, torque_levels=5)
    return build_problem(load_concept(concept), short_cycle(seconds), settings=settings)


def without_noise(problem: Problem) -> Problem:
    """The same problem where nothing is uncertain."""
    import dataclasses

    none = problem.uncertainty.model_copy(update={"gamma": 0.0, "beta": 0.0, "mu": 0.0})
    certain: Concept = problem.concept.model_copy(update={"initial_soc_sd": 0.0})
    certain._folder = problem.concept._folder
    return dataclasses.replace(problem, uncertainty=none, concept=certain)


def rising(n: int, rng: np.random.Generator) -> np.ndarray:
    """A random increasing table."""
    return np.cumsum(rng.uniform(0.1, 1.0, n))

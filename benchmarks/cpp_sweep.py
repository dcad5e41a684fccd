"""The stochastic program in C++, compiled on the spot where there is a compiler (`sweep.cpp`)."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.cases import Case
from benchmarks.errors import UnavailableError

Array = NDArray[np.float64]

SOURCE = Path(__file__).with_name("sweep.cpp")
# What -ffast-math is good for here, without its start-up code: that makes the whole process, numba's kernels
# included, flush small numbers to zero as soon as the library is loaded.
FREE = (
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fno-signed-zeros",
    "-fassociative-math",
    "-ffinite-math-only",
)
OPTIONS = ("-std=c++17", "-O3", "-march=native", *FREE, "-shared", "-fPIC")
COMPILERS = ("c++", "g++", "clang++")
PARTS = ("circuit", "smoothing", "tables", "look-ups")
"""What `seconds_of` tells apart."""


INTEGERS = ("nodes", "rows", "steps", "controls", "reach", "cubic")
NUMBERS = (
    "soc_step", "level_step", "step_s", "charge_to_soc", "drift_per_A", "start_cost_kg", "shortfall_kg_per_J",
)  # fmt: skip
ARRAYS = (
    "ocv_V", "discharge_ohm", "charge_ohm", "low_A", "high_A", "level", "posterior", "taps", "weights",
    "cost_kg", "power_W", "penalty_kg", "terminal_kg", "first", "seconds",
)  # fmt: skip


class _Problem(ctypes.Structure):
    """As `sweep.cpp` declares it."""

    _fields_ = (
        *((name, ctypes.c_long) for name in INTEGERS),
        *((name, ctypes.c_double) for name in NUMBERS),
        *((name, ctypes.c_void_p) for name in ARRAYS),
    )


@cache
def compiled() -> Callable[[ctypes.Structure], int]:
    """Compile `sweep.cpp` and load it.

    Raises
    ------
    UnavailableError
        There is no C++ compiler, or it refuses the file.
    """
    chosen = os.environ.get("CXX")
    compiler = next(filter(None, map(shutil.which, [chosen] if chosen else COMPILERS)), None)
    if compiler is None:
        raise UnavailableError(f"no C++ compiler found ({chosen or ', '.join(COMPILERS)})")
    with tempfile.TemporaryDirectory(prefix="socwise-") as folder:
        library = Path(folder) / "sweep.so"
        done = subprocess.run(
            [compiler, *OPTIONS, str(SOURCE), "-o", str(library)], capture_output=True, text=True, check=False
        )
        if done.returncode != 0:
            raise UnavailableError(f"{compiler} refuses {SOURCE.name}: {done.stderr.strip()[:500]}")
        sweep = ctypes.CDLL(str(library)).sweep
    sweep.argtypes, sweep.restype = [ctypes.POINTER(_Problem)], ctypes.c_int
    return lambda problem: int(sweep(ctypes.byref(problem)))


def cpp_sweep(case: Case) -> Array:
    """Solve the program over (estimate, variance); ``J_0``, shape (2, r, n)."""
    return solve_in_parts(case)[0]


def solve_in_parts(case: Case) -> tuple[Array, Array]:
    """Solve, and give the processor time in s of the `PARTS`.

    Raises
    ------
    UnavailableError
        As `compiled` says; or the grid has more rows than the kernel was written for.
    """
    grid, scalars, stages = case.grid, case.scalars, case.stages
    rows, nodes = case.penalty_kg.shape
    taps, weights = case.half_weights
    first, seconds = np.empty((2, rows, nodes)), np.zeros(len(PARTS))
    arrays = {
        "ocv_V": grid.ocv_V,
        "discharge_ohm": grid.discharge_ohm,
        "charge_ohm": grid.charge_ohm,
        "low_A": grid.current_low_A,
        "high_A": grid.current_high_A,
        "level": grid.level,
        "posterior": grid.posterior,
        "taps": taps,
        "weights": weights,
        "cost_kg": stages.cost_kg,
        "power_W": stages.power_W,
        "penalty_kg": case.penalty_kg,
        "terminal_kg": case.terminal_kg,
        "first": first,
        "seconds": seconds,
    }
    kept = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    problem = _Problem(
        nodes=nodes,
        rows=rows,
        steps=stages.power_W.shape[0],
        controls=stages.power_W.shape[1],
        reach=int(weights.shape[1] - 1),
        cubic=int(grid.cubic),
        soc_step=grid.soc_step,
        level_step=grid.level_step,
        step_s=scalars.step_s,
        charge_to_soc=scalars.charge_to_soc,
        drift_per_A=scalars.drift_per_A,
        start_cost_kg=scalars.start_cost_kg,
        shortfall_kg_per_J=scalars.shortfall_kg_per_J,
        **{name: array.ctypes.data for name, array in kept.items()},
    )
    if compiled()(problem) != 0:
        raise UnavailableError(f"{rows} variance rows are more than {SOURCE.name} was written for")
    return first, seconds

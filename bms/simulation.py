"""Simulate a cell: `simulate` and `step` are two faces of the kernel in `bms._ecm`."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bms import _ecm
from bms.cell import Cell
from bms.circuit import tabulate
from bms.errors import BatteryError

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class CellState:
    """State of a cell between two steps.

    Parameters
    ----------
    soc : float
        State of charge.
    relaxation_V : tuple of float
        Voltages of the two relaxation pairs; 0 for a pair that the cell does not have.
    hysteresis : float
        Hysteresis state in [-1, 1].
    temperature_C : float
        Temperature of the cell.
    """

    soc: float
    relaxation_V: tuple[float, float] = (0.0, 0.0)
    hysteresis: float = 0.0
    temperature_C: float = 25.0

    def to_array(self) -> Array:
        """The state as the kernels take it, shape (5,)."""
        return np.array([self.soc, *self.relaxation_V, self.hysteresis, self.temperature_C])

    @staticmethod
    def from_array(values: Array) -> CellState:
        """Read a state back from the kernels' array of shape (5,)."""
        soc, v1, v2, hysteresis, temperature_C = (float(value) for value in values)
        return CellState(soc, (v1, v2), hysteresis, temperature_C)


@dataclass(frozen=True, eq=False, slots=True)
class Simulation:
    """A simulated run; every array has the shape (n,) and holds values at the start of each step.

    Parameters
    ----------
    time_s, current_A, voltage_V : ndarray
        Time, current held from there on, terminal voltage with that current flowing.
    soc, hysteresis, temperature_C : ndarray
        State of charge, hysteresis state, cell temperature.
    relaxation_V : ndarray, shape (n, 2)
        Voltages of the relaxation pairs.
    final : CellState
        State at the end of the last step.
    """

    time_s: Array
    current_A: Array
    voltage_V: Array
    soc: Array
    hysteresis: Array
    temperature_C: Array
    relaxation_V: Array
    final: CellState


def simulate(
    cell: Cell,
    current_A: ArrayLike,
    step_s: ArrayLike = 1.0,
    *,
    soc: float = 0.5,
    ambient_C: ArrayLike = 25.0,
    state: CellState | None = None,
) -> Simulation:
    """Simulate a cell along a current.

    Parameters
    ----------
    cell : Cell
        The cell.
    current_A : array_like, shape (n,)
        Current held over each step, > 0 charges.
    step_s : array_like, scalar or shape (n,)
        Length of the steps.
    soc : float
        SOC at the start, with everything else at rest; ignored when ``state`` is given.
    ambient_C : array_like, scalar or shape (n,)
        Temperature of the surroundings; the cell's own, where it has no thermal node.
    state : CellState, optional
        State at the start.

    Returns
    -------
    Simulation
        Values at the start of each step. The SOC follows the charge and is not stopped at empty or full,
        where the OCV stays at its end value.

    Raises
    ------
    BatteryError
        When an array has the wrong shape or holds NaN, a step is not positive, or the SOC is outside [0, 1].
    """
    current = _vector("current_A", current_A)
    steps = _steps(step_s, current.size)
    ambient = _per_step("ambient_C", ambient_C, current.size)
    if state is None:
        state = CellState(_fraction(soc), temperature_C=float(ambient[0]))
    values = state.to_array()
    if cell.thermal is None:
        values[4] = float(ambient[0])
    voltage_V = np.empty(current.size)
    track = np.empty((5, current.size))
    _ecm.simulate(tabulate(cell), np.ones(4), values, current, steps, ambient, voltage_V, track)
    time_s = np.arange(current.size, dtype=np.float64)
    if steps.size == 1:
        time_s *= steps[0]
    else:
        time_s[1:] = np.cumsum(steps[:-1])
    return Simulation(
        time_s=time_s,
        current_A=current,
        voltage_V=voltage_V,
        soc=track[0],
        relaxation_V=track[1:3].T,
        hysteresis=track[3],
        temperature_C=track[4],
        final=CellState.from_array(values),
    )


def step(
    cell: Cell, state: CellState, current_A: float, step_s: float, ambient_C: float = 25.0
) -> tuple[CellState, float]:
    """Move a cell over one step.

    Parameters
    ----------
    cell : Cell
        The cell.
    state : CellState
        State at the start.
    current_A, step_s : float
        Current, held, and the length of the step.
    ambient_C : float
        Temperature of the surroundings.

    Returns
    -------
    tuple of CellState and float
        State at the end, and the terminal voltage at the start with the current flowing.

    Raises
    ------
    BatteryError
        As in `simulate`.
    """
    run = simulate(cell, [current_A], step_s, ambient_C=ambient_C, state=state)
    return run.final, float(run.voltage_V[0])


@dataclass(frozen=True, eq=False, slots=True)
class Members:
    """Many simulated cells; see `simulate_members`.

    Parameters
    ----------
    voltage_V : ndarray, shape (m, n)
        Terminal voltages.
    soc : ndarray, shape (m, n) or (0, 0)
        States of charge, where they were asked for.
    final : ndarray, shape (m, 5)
        SOC, relaxation voltages, hysteresis, temperature at the end.
    """

    voltage_V: Array
    soc: Array
    final: Array


def simulate_members(
    cell: Cell,
    current_A: ArrayLike,
    step_s: ArrayLike = 1.0,
    *,
    soc: ArrayLike = 0.5,
    capacity_factor: ArrayLike = 1.0,
    resistance_factor: ArrayLike = 1.0,
    relaxation_factor: ArrayLike = 1.0,
    time_factor: ArrayLike = 1.0,
    ambient_C: ArrayLike = 25.0,
    keep_soc: bool = True,
    threads: int = 1,
) -> Members:
    """Simulate many cells or Monte-Carlo members in one call.

    Parameters
    ----------
    cell : Cell
        The nominal cell.
    current_A : array_like, shape (n,) or (m, n)
        One current for all, or one for each.
    step_s : array_like, scalar or shape (n,)
        Length of the steps.
    soc, capacity_factor, resistance_factor, relaxation_factor, time_factor : array_like, scalar or shape (m,)
        SOC at the start, and what the nominal capacity, series resistance, relaxation resistances and
        relaxation time constants are multiplied with.
    ambient_C : array_like, scalar or shape (n,)
        Temperature of the surroundings.
    keep_soc : bool
        Whether the SOC of every step is wanted.
    threads : int
        Members are independent; more than one thread divides them.

    Raises
    ------
    BatteryError
        When shapes do not fit together, or a value is out of range.
    """
    currents = np.atleast_2d(np.ascontiguousarray(current_A, dtype=np.float64))
    if currents.ndim != 2 or currents.shape[1] == 0 or not np.all(np.isfinite(currents)):
        raise BatteryError(f"current_A must be finite, of shape (n,) or (m, n), got {currents.shape}")
    named = (capacity_factor, resistance_factor, relaxation_factor, time_factor)
    try:
        columns = np.broadcast_arrays(
            np.atleast_1d(np.asarray(soc, dtype=np.float64)), *named, np.empty(max(currents.shape[0], 1))
        )[:-1]
    except ValueError as error:
        raise BatteryError(
            f"soc, the factors and current_A do not agree on the number of members: {error}"
        ) from None
    members = columns[0].size
    if currents.shape[0] not in (1, members):
        raise BatteryError(
            f"current_A has {currents.shape[0]} rows for {members} members; give 1 or {members}"
        )
    factors = np.ascontiguousarray(np.stack(columns[1:], axis=1), dtype=np.float64)
    if not np.all(factors > 0.0) or not np.all(np.isfinite(factors)):
        raise BatteryError("the factors must be positive; 1 leaves the nominal value")
    for value in columns[0]:
        _fraction(float(value))
    n = currents.shape[1]
    steps, ambient = _steps(step_s, n), _per_step("ambient_C", ambient_C, n)
    states = np.zeros((members, 5))
    states[:, 0], states[:, 4] = columns[0], ambient[0]
    voltage_V = np.empty((members, n))
    track = np.empty((members, n)) if keep_soc else np.empty((0, 0))
    circuit = tabulate(cell)

    def work(part: slice) -> None:
        shared = currents if currents.shape[0] == 1 else currents[part]
        kept = track[part] if keep_soc else track
        _ecm.simulate_members(
            circuit, factors[part], states[part], shared, steps, ambient, voltage_V[part], kept
        )

    run_parts(work, members, threads)
    return Members(voltage_V, track, states)


def run_parts(work: Callable[[slice], None], members: int, threads: int) -> None:
    """Divide members among threads.

    Parameters
    ----------
    work : callable
        Takes a slice of the members; its kernels release the interpreter's lock.
    members, threads : int
        How many there are of each.

    Raises
    ------
    BatteryError
        When ``threads`` is below 1.
    """
    if threads < 1:
        raise BatteryError(f"threads must be 1 or more, got {threads}")
    edges = np.linspace(0, members, min(threads, members) + 1).astype(int)
    parts = [slice(int(a), int(b)) for a, b in pairwise(edges)]
    if len(parts) == 1:
        work(parts[0])
        return
    with ThreadPoolExecutor(len(parts)) as pool:
        list(pool.map(work, parts))


def _vector(name: str, values: ArrayLike) -> Array:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != 1 or array.size == 0:
        raise BatteryError(f"{name} must be one row of numbers, got the shape {array.shape}")
    if not np.all(np.isfinite(array)):
        at = int(np.flatnonzero(~np.isfinite(array))[0])
        raise BatteryError(f"{name} holds {array[at]} at sample {at}; a simulation needs numbers throughout")
    return array


def _per_step(name: str, values: ArrayLike, n: int) -> Array:
    array = _vector(name, np.atleast_1d(np.asarray(values, dtype=np.float64)))
    if array.size not in (1, n):
        raise BatteryError(f"{name} has {array.size} values for {n} steps; give 1 or {n}")
    return array


def _steps(step_s: ArrayLike, n: int) -> Array:
    array = _per_step("step_s", step_s, n)
    if array.min() <= 0.0:
        raise BatteryError(f"a step must be longer than 0 s, got {array.min():g} s")
    return array


def _fraction(soc: float) -> float:
    if not 0.0 <= soc <= 1.0:
        raise BatteryError(
            f"the SOC at the start must lie in [0, 1], got {soc:g}; give a fraction, not per cent"
        )
    return soc

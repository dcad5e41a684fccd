"""What the estimators have in common: one compiled kernel serves `update` and `run`, so both give the same.

An estimator is a cell's circuit, the gate's limits and its own settings, which never change, and one array of
memory, which does. `update` hands the kernel one sample, `run` a whole log.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bms._ecm import Circuit
from bms.belief import SocBelief
from bms.cell import Cell
from bms.circuit import tabulate
from bms.errors import BatteryError
from bms.estimators._gate import PENDING, Gate
from bms.flags import Flag
from bms.measurement import Measurement

Array = NDArray[np.float64]
Kernel = Callable[..., None]

CHUNK = 200_000
"""Samples between two reports of progress; a few hundredths of a second."""

LEADING = 4
"""Columns of a kernel's row before the parameters: SOC, variance, residual, flags."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A parameter with its standard deviation; NaN where the estimator does not know it."""

    value: float
    sd: float


@dataclass(frozen=True, eq=False, slots=True)
class Trace:
    """What an estimator believed along a log, after each sample that was kept.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Time of the samples.
    soc, variance : ndarray, shape (n,)
        The belief.
    residual_V : ndarray, shape (n,)
        Measured minus expected voltage, before the sample was used; NaN where it was not usable.
    flags : ndarray of int, shape (n,)
        Every `Flag` raised since the row before.
    parameters, deviations : dict of str to ndarray, shape (n,)
        Estimated parameters and their standard deviations.
    """

    time_s: Array
    soc: Array
    variance: Array
    residual_V: Array
    flags: NDArray[np.int64]
    parameters: dict[str, Array]
    deviations: dict[str, Array]


class KernelEstimator:
    """Base of the estimators; a concrete one says which kernel, settings and memory it has.

    Parameters
    ----------
    cell : Cell
        Nominal cell.
    gate : Gate
        Limits of what is believed, see `bms.estimators.gate.gate_for`.
    settings : NamedTuple
        The kernel's own settings.
    memory : ndarray, shape (k,)
        State of the estimator before the first sample.
    parameters : tuple of str
        Names of the parameters in a row of the kernel's output.
    belief : SocBelief
        Belief before the first sample.
    """

    name: ClassVar[str]
    kernel: ClassVar[Kernel]

    def __init__(
        self,
        cell: Cell,
        gate: Gate,
        settings: Any,
        memory: Array,
        parameters: tuple[str, ...],
        belief: SocBelief,
    ) -> None:
        self.cell = cell
        self._circuit: Circuit = tabulate(cell)
        self._gate = gate
        self._settings = settings
        self._memory = memory
        self._names = parameters
        self._row = np.full(LEADING + 2 * len(parameters), np.nan)
        self._row[:2] = belief.mean, belief.variance
        self._row[3] = 0.0
        self._seen = 0

    @property
    def belief(self) -> SocBelief:
        """What is believed now."""
        return SocBelief(float(self._row[0]), float(self._row[1]))

    @property
    def flags(self) -> Flag:
        """What was to be said of the last sample."""
        return Flag(int(self._row[3]))

    @property
    def trusted(self) -> bool:
        """Whether the last sample was fit to be believed."""
        return self.flags.trusted

    @property
    def residual_V(self) -> float:
        """Measured minus expected voltage at the last sample; NaN when it was not usable."""
        return float(self._row[2])

    @property
    def parameters(self) -> dict[str, Estimate]:
        """Estimated parameters by name."""
        values, deviations = self._row[LEADING:].reshape(2, -1)
        return {
            name: Estimate(float(value), float(sd))
            for name, value, sd in zip(self._names, values, deviations, strict=True)
        }

    @property
    def covariance(self) -> Array:
        """Covariance of the parameters in the order of `parameters`, shape (m, m)."""
        deviations = self._row[LEADING + len(self._names) :]
        return np.asarray(self._correlation() * np.outer(deviations, deviations))

    def _correlation(self) -> Array:
        """Correlation of the parameters, shape (m, m); a concrete estimator knows it."""
        return np.eye(len(self._names))

    def copy(self) -> Self:
        """Copy the estimator with all that it remembers."""
        twin = copy.copy(self)
        twin._memory, twin._row = self._memory.copy(), self._row.copy()
        return twin

    def update(
        self, current_A: float, voltage_V: float, step_s: float, temperature_C: float | None = None
    ) -> SocBelief:
        """Take one sample and return the belief after it.

        Parameters
        ----------
        current_A : float
            Current, > 0 charges; NaN when it is missing. It flows from this sample to the next one, or
            flowed since the last one where the estimator was made so.
        voltage_V : float
            Terminal voltage with that current flowing; NaN when it is missing.
        step_s : float
            Time since the sample before; without meaning at the first one.
        temperature_C : float, optional
            Temperature of the cell; the last known one when left out.

        Raises
        ------
        BatteryError
            When the step is negative or not finite.
        """
        self._check_steps(np.array([step_s]))
        celsius = np.nan if temperature_C is None else float(temperature_C)
        sample = np.array([[current_A], [voltage_V], [step_s], [celsius]], dtype=np.float64)
        self._call(sample[0], sample[1], sample[2], sample[3])
        # Flags are collected between the rows of a run; there are none here.
        self._memory[PENDING] = 0.0
        return self.belief

    def observe(self, measurement: Measurement, step_s: float) -> SocBelief:
        """Take what a plant measured over one step, as `update` would.

        Parameters
        ----------
        measurement : Measurement
            Current that flowed during the step and the voltage at its end, so the estimator's sensors must
            be those of ``Sensors(holds="until")``.
        step_s : float
            Length of the step.

        Raises
        ------
        BatteryError
            When the plant reports a SOC instead of a voltage, or the estimator reads currents otherwise.
        """
        if measurement.voltage_V is None:
            raise BatteryError(
                "this plant reports a SOC, this estimator takes a voltage; choose the estimator 'model'"
            )
        if not self._gate.looks_back:
            raise BatteryError(
                "in a closed loop currents hold until their sample; give Sensors(holds='until')"
            )
        return self.update(measurement.current_A, measurement.voltage_V, step_s, measurement.temperature_C)

    def run(
        self,
        current_A: ArrayLike,
        voltage_V: ArrayLike,
        step_s: ArrayLike = 1.0,
        temperature_C: ArrayLike | None = None,
        *,
        time_s: ArrayLike | None = None,
        every: int = 1,
        progress: Callable[[int], None] | None = None,
    ) -> Trace:
        """Take a log, sample by sample, as `update` would.

        Parameters
        ----------
        current_A, voltage_V : array_like, shape (n,)
            The samples, see `update`.
        step_s : array_like, scalar or shape (n,)
            Time since the sample before.
        temperature_C : array_like, scalar or shape (n,), optional
            Temperature of the cell.
        time_s : array_like, shape (n,), optional
            Time of the samples, increasing, instead of ``step_s``.
        every : int
            Keep every so many-th sample in the trace, from the first on; all are used.
        progress : callable, optional
            Called with the number of samples done, now and then.

        Raises
        ------
        BatteryError
            When the shapes do not fit together, or time does not increase.
        """
        current, voltage = _column("current_A", current_A), _column("voltage_V", voltage_V)
        n = current.size
        if voltage.size != n:
            raise BatteryError(f"{n} currents and {voltage.size} voltages; a sample has one of each")
        if every < 1:
            raise BatteryError(f"every must be 1 or more, got {every}")
        size = CHUNK - CHUNK % every if every < CHUNK else every
        times, steps = _times_and_steps(time_s, step_s, n, every, size)
        self._check_steps(steps)
        temperature = _spread("temperature_C", np.nan if temperature_C is None else temperature_C, n, size)
        rows = np.empty((-(-n // every), self._row.size))
        for start in range(0, n, size):
            part = slice(start, min(start + size, n))
            kept = rows[start // every : -(-part.stop // every)]
            self._call(
                current[part], voltage[part], _of(part, steps, n), _of(part, temperature, n), every, kept
            )
            if progress is not None:
                progress(part.stop)
        return self._trace(times, rows)

    def _call(
        self,
        current_A: Array,
        voltage_V: Array,
        step_s: Array,
        temperature_C: Array,
        every: int = 1,
        rows: Array | None = None,
    ) -> None:
        out = np.empty((0, self._row.size)) if rows is None else rows
        type(self).kernel(
            self._circuit,
            self._gate,
            self._settings,
            self._memory,
            current_A,
            voltage_V,
            step_s,
            temperature_C,
            every,
            out,
            self._row,
        )

    def _check_steps(self, step_s: Array) -> None:
        bad = np.flatnonzero(~(np.isfinite(step_s) & (step_s >= 0.0)))
        if bad.size:
            raise BatteryError(
                f"the step to sample {int(bad[0])} is {step_s[bad[0]]:g} s;"
                " time must be finite and not run back"
            )

    def _trace(self, time_s: Array, rows: Array) -> Trace:
        values = rows[:, LEADING : LEADING + len(self._names)].T
        deviations = rows[:, LEADING + len(self._names) :].T
        return Trace(
            time_s=time_s,
            soc=rows[:, 0].copy(),
            variance=rows[:, 1].copy(),
            residual_V=rows[:, 2].copy(),
            flags=rows[:, 3].astype(np.int64),
            parameters={name: row.copy() for name, row in zip(self._names, values, strict=True)},
            deviations={name: row.copy() for name, row in zip(self._names, deviations, strict=True)},
        )


def _own(values: ArrayLike) -> Array:
    """Make the array one that a kernel was compiled for: numba compiles anew for read-only arrays."""
    plain = np.ma.filled(values, np.nan) if isinstance(values, np.ma.MaskedArray) else values
    return np.require(np.asarray(plain, dtype=np.float64), requirements=["C", "W"])


def _column(name: str, values: ArrayLike) -> Array:
    array = _own(values)
    if array.ndim != 1 or array.size == 0:
        raise BatteryError(f"{name} must be one row of numbers, got the shape {array.shape}")
    return array


def _spread(name: str, values: ArrayLike, n: int, size: int) -> Array:
    """Make one value for each sample; of a single value only as many as are used at once."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim > 1 or array.size not in (1, n):
        raise BatteryError(f"{name} has the shape {array.shape} for {n} samples; give one value or {n}")
    if array.size == n:
        return _own(np.atleast_1d(array))
    return np.full(min(n, size), float(array.reshape(-1)[0]))


def _of(part: slice, values: Array, n: int) -> Array:
    """The values of a part of the samples, from an array made by `_spread`."""
    return values[part] if values.size == n else values[: part.stop - part.start]


def _times_and_steps(
    time_s: ArrayLike | None, step_s: ArrayLike, n: int, every: int, size: int
) -> tuple[Array, Array]:
    """Times of the samples that are kept, and the step before every sample."""
    if time_s is not None:
        times = _column("time_s", time_s)
        if times.size != n:
            raise BatteryError(f"{times.size} times for {n} samples")
        return times[::every].copy(), np.diff(times, prepend=times[0])
    steps = _spread("step_s", step_s, n, size)
    if np.ndim(step_s) == 0:
        return np.arange(0.0, n, every) * float(steps[0]), steps
    return np.concatenate([[0.0], np.cumsum(steps[1:])])[::every].copy(), steps

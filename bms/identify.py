r"""Parameters of the circuit from a pulse test ([M] Fig 26), with confidence intervals.

The sum of squared voltage residuals over R, the relaxation pairs and, if it is not known, the initial SOC is
minimised by IPOPT with exact derivatives (`bms.pulse_model`), from first values that a grid of time constants
gives (`bms.pulse_guess`). With the Jacobian J of the n residuals over the p parameters at the optimum,

.. math:: s^2 = \frac{\sum r^2}{n - p}, \qquad
    \mathrm{Cov} = s^2\,(J^\top J)^{-1}, \qquad \hat\theta_i \pm t_{n-p}\,\sqrt{\mathrm{Cov}_{ii}} .

The intervals hold for white noise. What a circuit cannot follow (hysteresis, slow diffusion) leaves
correlated residuals, and the intervals are then too narrow: the correlation is reported and remarked on.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import t as student

from bms.cell import Cell, RelaxationPair
from bms.errors import BatteryError, BatteryWarning
from bms.ocv import OcvCurve
from bms.pulse_guess import first_values
from bms.pulse_model import BOUND, NEAREST_TIMES, WIDEST_TIMES, PulseProblem, build_problem

Array = NDArray[np.float64]

SPAN = 1e4
"""A resistance is sought between its first value over and times this."""

NULL_SHARE = 1e-7
"""A singular value below this share of the largest one counts as zero."""

NULL_PART = 1e-3
"""A parameter with at least this part in a direction without effect cannot be identified."""

LARGEST_SD = 1.0
"""A relative standard deviation above this says that the data hold nothing about a parameter."""

CORRELATED = 0.3
NO_NOISE_V = 1e-8


@dataclass(frozen=True, eq=False)
class Identification:
    """What a pulse test tells about a circuit.

    Parameters
    ----------
    names : tuple of str, length p
        ``resistance_ohm``, ``relaxation_1_resistance_ohm``, ``relaxation_1_time_constant_s``, the same with
        2, and ``soc`` (of the first sample) where it was sought.
    values : ndarray, shape (p,)
        Found values.
    covariance : ndarray, shape (p, p)
        Their covariance; the variance of an unidentifiable parameter is inf.
    level : float
        Level of the confidence intervals.
    voltage_V, residual_V : ndarray, shape (n,)
        Voltage of the fitted model, and what is left of the measured one.
    unidentifiable : tuple of str
        Parameters that the data do not determine.
    correlation : float
        Correlation of neighbouring residuals; well above zero, the intervals are too narrow.
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    level: float
    voltage_V: Array
    residual_V: Array
    unidentifiable: tuple[str, ...]
    correlation: float

    @property
    def parameters(self) -> dict[str, float]:
        """The values by name."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

    @cached_property
    def deviations(self) -> dict[str, float]:
        """Standard deviations by name."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """Confidence intervals by name."""
        quantile = float(student.ppf(0.5 + 0.5 * self.level, self.residual_V.size - self.values.size))
        return {
            name: (value - quantile * self.deviations[name], value + quantile * self.deviations[name])
            for name, value in self.parameters.items()
        }

    @property
    def residual_rms_V(self) -> float:
        """Root of the mean square of the residuals."""
        return float(np.sqrt(np.mean(np.square(self.residual_V))))

    def apply_to(self, cell: Cell) -> Cell:
        """Give a cell the found resistance and relaxation pairs; they replace its tables."""
        found = self.parameters
        pairs = tuple(
            RelaxationPair(
                resistance_ohm=found[f"relaxation_{k}_resistance_ohm"],
                time_constant_s=found[f"relaxation_{k}_time_constant_s"],
            )
            for k in (1, 2)
            if f"relaxation_{k}_resistance_ohm" in found
        )
        return cell.with_values(resistance_ohm=found["resistance_ohm"], relaxation=pairs)


def identify_pulse(
    time_s: ArrayLike,
    current_A: ArrayLike,
    voltage_V: ArrayLike,
    *,
    capacity_Ah: float,
    ocv: OcvCurve,
    pairs: int = 1,
    soc: float | None = None,
    level: float = 0.95,
) -> Identification:
    """Find the circuit that explains a pulse test.

    Parameters
    ----------
    time_s, current_A, voltage_V : array_like, shape (n,)
        Samples of a cell that is at rest at the first one; the current, > 0 when charging, is held from each
        sample to the next, and the voltage is that with it flowing.
    capacity_Ah : float
        Known capacity.
    ocv : OcvCurve
        Known open-circuit voltage. Of a cell with hysteresis, give the branch that the test starts from.
    pairs : int
        Relaxation pairs, 1 or 2.
    soc : float, optional
        SOC of the first sample; sought with the rest when left out.
    level : float
        Level of the confidence intervals.

    Returns
    -------
    Identification
        With a `BatteryWarning` when a parameter is not identifiable or the residuals are correlated.

    Raises
    ------
    BatteryError
        When casadi is missing, the data are no pulse test, a number is out of range, or no fit is found.
    """
    time, current, voltage = _columns(time_s, current_A, voltage_V)
    count = 1 + 2 * pairs + (soc is None)
    _check(capacity_Ah, pairs, soc, level, current, count)
    steps = np.diff(time)
    moved = np.concatenate(([0.0], np.cumsum(current[:-1] * steps))) / (3600.0 * capacity_Ah)
    start = soc if soc is not None else _soc_at(ocv, float(voltage[0]), moved)
    if min(moved.min() + start, 1.0 - moved.max() - start) < -1e-9:
        raise BatteryError(
            f"from {start:.3f} the current moves the SOC to {moved.min() + start:.3f} ... "
            f"{moved.max() + start:.3f}, outside [0, 1]; check soc, capacity_Ah and the sign of the current"
        )
    resistance, times, start = first_values(steps, current, voltage, moved, ocv, pairs, start, soc is None)
    problem = build_problem(steps, current, voltage, moved, ocv, pairs, soc)
    first, low, high = _bounds(resistance, times, steps, start, moved if soc is None else None)
    unknown = problem.solve(np.clip(first, low, high), low, high)
    return _judge(problem, unknown, low, high, voltage, pairs, level)


def _columns(time_s: ArrayLike, current_A: ArrayLike, voltage_V: ArrayLike) -> tuple[Array, Array, Array]:
    columns = [np.array(column, dtype=np.float64) for column in (time_s, current_A, voltage_V)]
    if columns[0].ndim != 1 or len({column.shape for column in columns}) > 1:
        shapes = ", ".join(str(column.shape) for column in columns)
        raise BatteryError(f"time_s, current_A and voltage_V must be rows of one length, got {shapes}")
    if not all(np.isfinite(column).all() for column in columns):
        raise BatteryError("the pulse test holds NaN or inf; remove these samples")
    if np.any(np.diff(columns[0]) <= 0.0):
        raise BatteryError("time_s must increase strictly; sort it and drop repetitions")
    return columns[0], columns[1], columns[2]


def _check(
    capacity_Ah: float, pairs: int, soc: float | None, level: float, current_A: Array, count: int
) -> None:
    if pairs not in (1, 2):
        raise BatteryError(f"pairs must be 1 or 2, got {pairs}")
    if not capacity_Ah > 0.0:
        raise BatteryError(f"capacity_Ah must be positive, got {capacity_Ah}")
    if soc is not None and not 0.0 <= soc <= 1.0:
        raise BatteryError(f"soc must lie in [0, 1], got {soc:g}; give a fraction, not per cent")
    if not 0.0 < level < 1.0:
        raise BatteryError(f"level must lie between 0 and 1, got {level:g}; 0.95 is usual")
    if current_A.size < count + 2:
        raise BatteryError(f"{count} parameters need {count + 2} samples or more, got {current_A.size}")
    if np.ptp(current_A) == 0.0:
        raise BatteryError(
            f"the current is {current_A[0]:g} A throughout: no pulse, and resistance cannot be told from OCV"
        )


def _soc_at(ocv: OcvCurve, voltage_V: float, moved_soc: Array) -> float:
    """SOC whose open-circuit voltage is the first voltage, kept so that the test stays inside [0, 1]."""
    dense = np.linspace(0.0, 1.0, 2001)
    found = float(np.interp(voltage_V, ocv(dense), dense))
    least, most = -float(moved_soc.min()), 1.0 - float(moved_soc.max())
    if least > most:
        raise BatteryError(
            f"the current moves {np.ptp(moved_soc):.3f} of the capacity, more than all; check capacity_Ah"
        )
    return min(max(found, least), most)


def _bounds(
    resistance_ohm: Array, times_s: Array, step_s: Array, soc: float, moved_soc: Array | None
) -> tuple[Array, Array, Array]:
    """First values of the unknowns of `bms.pulse_model`, and the box in which they are sought."""
    largest = float(resistance_ohm.max())
    first, low, high = [np.log(resistance_ohm[0])], [np.log(largest / SPAN)], [np.log(largest * SPAN)]
    shortest, longest = np.log(0.05 * step_s.min()), np.log(50.0 * step_s.sum())
    for pair, time_s in enumerate(times_s):
        first += [
            np.log(resistance_ohm[1 + pair]),
            np.log(time_s) if pair == 0 else np.log(time_s / times_s[0]),
        ]
        low += [np.log(largest / SPAN), shortest if pair == 0 else np.log(NEAREST_TIMES)]
        high += [np.log(largest * SPAN), longest if pair == 0 else np.log(WIDEST_TIMES)]
    if moved_soc is not None:
        first.append(soc)
        low.append(-float(moved_soc.min()))
        high.append(1.0 - float(moved_soc.max()))
    return np.array(first), np.array(low), np.array(high)


def _judge(
    problem: PulseProblem, unknown: Array, low: Array, high: Array, voltage_V: Array, pairs: int, level: float
) -> Identification:
    """Turn the optimum into values with covariance, and remark on what the data do not tell."""
    model_V, slopes = problem.voltage_and_slopes(unknown)
    residual_V = voltage_V - model_V
    names = ["resistance_ohm"]
    values, change = unknown.copy(), np.eye(unknown.size)
    values[: 1 + 2 * pairs] = np.exp(unknown[: 1 + 2 * pairs])
    if pairs == 2:
        values[4] *= values[2]
        change[4, 2] = 1.0
    for k in range(1, pairs + 1):
        names += [f"relaxation_{k}_resistance_ohm", f"relaxation_{k}_time_constant_s"]
    names += ["soc"] * (unknown.size - len(names))
    relative, unknowable = _inverse_information(slopes)
    spread = float(np.sum(np.square(residual_V))) / (voltage_V.size - unknown.size)
    with np.errstate(invalid="ignore"):
        scale = np.where(np.array(names) == "soc", 1.0, values)
        logs = spread * (change @ relative @ change.T)
        covariance = scale[:, None] * logs * scale
    edge = (unknown - low < BOUND) | (high - unknown < BOUND)
    weak = unknowable | edge | (np.diag(logs) > LARGEST_SD**2)
    if pairs == 2:
        weak[4] |= weak[2]
    covariance[weak, weak] = np.inf
    correlation = _neighbours(residual_V)
    result = Identification(
        tuple(names),
        values,
        covariance,
        level,
        model_V,
        residual_V,
        tuple(name for name, is_weak in zip(names, weak, strict=True) if is_weak),
        correlation,
    )
    _remark(result)
    return result


def _inverse_information(slopes: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Inverse of J'J, and which parameters take part in a direction without effect on the voltage."""
    size = np.linalg.norm(slopes, axis=0)
    dead = size == 0.0
    size = np.where(dead, 1.0, size)
    _, singular, directions = np.linalg.svd(slopes / size, full_matrices=False)
    null = singular < NULL_SHARE * singular[0]
    inverse = np.where(null, 0.0, 1.0 / np.where(null, 1.0, singular) ** 2)
    unknowable = dead | (np.abs(directions[null]) > NULL_PART).any(axis=0)
    return (directions.T * inverse) @ directions / np.outer(size, size), unknowable


def _neighbours(residual_V: Array) -> float:
    """Correlation of each residual with the next; 0 when there is nothing but rounding."""
    total = float(np.sum(np.square(residual_V)))
    if total <= residual_V.size * NO_NOISE_V**2:
        return 0.0
    return float(np.sum(residual_V[1:] * residual_V[:-1])) / total


def _remark(found: Identification) -> None:
    if found.unidentifiable:
        warnings.warn(
            f"the pulse test does not determine {', '.join(found.unidentifiable)}: a longer pulse or rest, or"
            " fewer pairs, would; their variance is given as inf",
            BatteryWarning,
            stacklevel=4,
        )
    if found.correlation > max(CORRELATED, 3.0 / np.sqrt(found.residual_V.size)):
        warnings.warn(
            f"neighbouring residuals are correlated by {found.correlation:.2f} (rms"
            f" {1e3 * found.residual_rms_V:.2g} mV): the circuit does not follow the cell, and the intervals"
            " are too narrow; try a second pair, or another OCV branch",
            BatteryWarning,
            stacklevel=4,
        )

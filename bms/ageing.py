r"""Ageing of a cell along a current profile, by the laws of `bms.fade_laws` or by a degradation map.

Exposures (see `bms.fade_laws`) and the rates of a map are summed over blocks of samples, and the fade follows
at the ends of the blocks:

.. math:: q_n = \Big(q_0^{1/z} + a \sum_k \dot y_k\,h\Big)^z \;\text{(laws)}, \qquad
          q_n = q_0 + a \sum_k \dot q_k\,h \;\text{(map)}.

So the result depends neither on the step ``h`` nor on the length of the blocks, and a profile that repeats is
summed once. The acceleration ``a`` speeds up the clock of ageing: one hour of the profile counts as ``a``
hours of the same use. Real fade in 10 or 100 days is below the bias of an estimator, so a demonstration needs
it, and has to say so: `AgeingHistory` carries it and its plot shows it.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bms.degradation import AXES, DegradationMap
from bms.errors import BatteryError, BatteryWarning
from bms.fade_laws import FadeLaws, Range, Wear

Array = NDArray[np.float64]

CHUNK = 1 << 15
"""Samples worked on at a time, so that what is computed of them stays in the cache."""

TOLERATED_OUTSIDE = 0.01
"""Share of the charge, or of the time, that may lie outside the range of a law without a warning."""


@dataclass(frozen=True, eq=False)
class AgeingHistory:
    """Ageing at the ends of blocks; row 0 is the start.

    Parameters
    ----------
    time_s : ndarray, shape (r,)
        Time of the profile, from 0.
    capacity_factor, resistance_factor : ndarray, shape (r,)
        Multiples of the initial capacity and resistance.
    cycle_fade, calendar_fade : ndarray, shape (r,)
        The two parts of ``1 - capacity_factor``; a map books all under ``cycle_fade``.
    acceleration : float
        How much faster than the profile the ageing clock ran.
    remarks : tuple of str
        What lay outside the range of the laws or the map; each was also warned of.
    """

    time_s: Array
    capacity_factor: Array
    resistance_factor: Array
    cycle_fade: Array
    calendar_fade: Array
    acceleration: float
    remarks: tuple[str, ...]

    @property
    def final(self) -> Wear:
        """The wear at the end, to go on from."""
        growth = float(self.resistance_factor[-1]) - 1.0
        return Wear(float(self.cycle_fade[-1]), float(self.calendar_fade[-1]), growth)


@dataclass(frozen=True, eq=False)
class _Profile:
    """A checked profile; ``soc`` and ``temperature_C`` hold one value per sample or a single one."""

    current_A: Array
    soc: Array
    temperature_C: Array
    step_s: float

    def at(self, name: str, start: int, stop: int) -> Array:
        values: Array = getattr(self, name)
        return values[start:stop] if values.size > 1 else values


def age(
    model: FadeLaws | DegradationMap,
    current_A: ArrayLike,
    soc: ArrayLike,
    temperature_C: ArrayLike,
    step_s: float,
    *,
    capacity_Ah: float | None = None,
    repeats: int = 1,
    every: int | None = None,
    acceleration: float = 1.0,
    wear: Wear | None = None,
) -> AgeingHistory:
    """Age a cell along a current profile, which may repeat.

    Parameters
    ----------
    model : FadeLaws or DegradationMap
        What ages the cell.
    current_A : array_like, shape (n,)
        Current, positive when charging, each value held for ``step_s``.
    soc, temperature_C : array_like
        One value per sample, or a single one.
    step_s : float
        Length of a sample in s.
    capacity_Ah : float, optional
        Initial capacity of the cell, from which the laws take the C-rate; a map does not need it.
    repeats : int
        How often the profile is run through, such as the days of a daily profile.
    every : int, optional
        Samples per row of the result; by default an hour, or the profile if that is shorter. The last block
        of a repetition may be shorter.
    acceleration : float
        How much faster than the profile the ageing clock runs.
    wear : Wear, optional
        Where to start; by default a new cell.

    Returns
    -------
    AgeingHistory
        ``1 + repeats * ceil(n / every)`` rows. To drive a simulation block by block, hold
        ``capacity_factor[k]`` over block ``k``.

    Raises
    ------
    BatteryError
        On NaN, a SOC outside [0, 1], arrays of different length, a step, acceleration or capacity that is not
        positive, or when nothing is left of the capacity.
    """
    profile = _checked(current_A, soc, temperature_C, step_s)
    start = wear or Wear()
    samples = profile.current_A.size
    block = every if every is not None else max(1, min(samples, round(3600.0 / step_s)))
    if block < 1 or repeats < 1:
        raise BatteryError(f"every and repeats must be at least 1, got {block} and {repeats}")
    if not (acceleration > 0.0 and np.isfinite(acceleration)):
        raise BatteryError(f"the acceleration must be positive, got {acceleration:g}; 1 is real time")
    remarks = _remarks(model, profile, capacity_Ah)
    for remark in remarks:
        warnings.warn(remark, BatteryWarning, stacklevel=2)
    sums = _block_sums(model, profile, capacity_Ah, block) * (step_s * acceleration)
    total = np.concatenate((np.zeros((3, 1)), np.cumsum(np.tile(sums, repeats), axis=1)), axis=1)
    cycle, calendar, grown = _fades(model, start, total)
    left = 1.0 - cycle - calendar
    ends = np.append(np.arange(block, samples, block), samples) * step_s
    time_s = np.append(0.0, (np.arange(repeats)[:, None] * (samples * step_s) + ends).ravel())
    if left[-1] <= 0.0:
        dead = float(time_s[np.argmax(left <= 0.0)])
        raise BatteryError(
            f"nothing is left of the capacity after {dead / 86400.0:.3g} days; lower the acceleration"
            f" ({acceleration:g}), or check step_s and the unit of the current"
        )
    return AgeingHistory(time_s, left, 1.0 + grown, cycle, calendar, float(acceleration), remarks)


def _fades(model: FadeLaws | DegradationMap, start: Wear, total: Array) -> tuple[Array, Array, Array]:
    """Cycle fade, calendar fade and resistance growth from the accumulated sums."""
    if isinstance(model, DegradationMap):
        return start.cycle + total[0], np.full_like(total[1], start.calendar), start.resistance + total[2]
    cycle = np.full_like(total[0], start.cycle)
    calendar = np.full_like(total[1], start.calendar)
    if model.cycle is not None:
        z = model.cycle.exponent
        cycle = (start.cycle ** (1.0 / z) + total[0]) ** z
    if model.calendar is not None:
        z = model.calendar.exponent
        calendar = (start.calendar ** (1.0 / z) + total[1]) ** z
    lost = (cycle - start.cycle) + (calendar - start.calendar)
    return cycle, calendar, start.resistance + model.resistance_per_fade * lost + total[2]


def _block_sums(
    model: FadeLaws | DegradationMap, profile: _Profile, capacity_Ah: float | None, every: int
) -> Array:
    """Sums per block, shape (3, blocks): exposure by cycling and by time (or a map's fade), growth."""
    if isinstance(model, DegradationMap):
        from bms._ageing import accumulate

        axes = (model.current_A, model.soc, model.temperature_C)
        tables = (model.capacity_fade_per_s, model.resistance_growth_per_s)
        stress = (profile.current_A, profile.soc, profile.temperature_C)
        fade, growth = accumulate(*axes, *tables, *stress, every)
        return np.array([fade, np.zeros_like(fade), growth])
    capacity = _required_capacity(capacity_Ah)
    samples = profile.current_A.size
    sums = np.zeros((3, -(-samples // every)))
    for start in range(0, samples, CHUNK):
        stop = min(start + CHUNK, samples)
        first = start // every
        cuts = np.append(start, np.arange((first + 1) * every, stop, every)) - start
        into = slice(first, first + cuts.size)
        soc, temperature = profile.at("soc", start, stop), profile.at("temperature_C", start, stop)
        if model.cycle is not None:
            rate = model.cycle.exposure_per_s(profile.current_A[start:stop], temperature, capacity)
            sums[0, into] += np.add.reduceat(rate, cuts)
        if model.calendar is not None:
            rate = model.calendar.exposure_per_s(soc, temperature)
            sums[1, into] += np.add.reduceat(np.broadcast_to(rate, (stop - start,)), cuts)
        if model.resistance is not None:
            rate = model.resistance.growth_per_s(soc, temperature)
            sums[2, into] += np.add.reduceat(np.broadcast_to(rate, (stop - start,)), cuts)
    return sums


def _remarks(
    model: FadeLaws | DegradationMap, profile: _Profile, capacity_Ah: float | None
) -> tuple[str, ...]:
    """Say what part of the profile lies outside the range of the laws, or outside the map."""
    said: list[str | None] = []
    size = np.abs(profile.current_A)
    if isinstance(model, DegradationMap):
        values = (model.lookup_current_A(profile.current_A), profile.soc, profile.temperature_C)
        for name, value in zip(AXES, values, strict=True):
            axis = getattr(model, name)
            limits = (float(axis[0]), float(axis[-1]))
            end = "the degradation map, whose ends it takes"
            said.append(_outside(value, None, limits, f"of the time {name}", end, 0.0))
        return tuple(text for text in said if text)
    if model.cycle is not None:
        source = "Wang et al. 2011, which is extrapolated"
        rate = size / _required_capacity(capacity_Ah)
        said.append(_outside(rate, size, model.cycle.c_rate_range, "of the charge the C-rate", source))
        limits = model.cycle.temperature_range_C
        said.append(_outside(profile.temperature_C, size, limits, "of the charge temperature_C", source))
    if model.calendar is not None:
        source = "Swierczynski et al. 2015, which is extrapolated"
        said.append(_outside(profile.soc, None, model.calendar.soc_range, "of the time soc", source))
        limits = model.calendar.temperature_range_C
        said.append(_outside(profile.temperature_C, None, limits, "of the time temperature_C", source))
    if model.resistance is not None:
        source = "Naumann et al. 2018, which is extrapolated"
        limits = model.resistance.temperature_range_C
        said.append(_outside(profile.temperature_C, None, limits, "of the time temperature_C", source))
    return tuple(text for text in said if text)


def _outside(
    values: Array,
    weight: Array | None,
    limits: Range,
    what: str,
    source: str,
    tolerated: float = TOLERATED_OUTSIDE,
) -> str | None:
    """Describe the weighted share of values outside limits, when it is more than tolerated."""
    if values.min() >= limits[0] and values.max() <= limits[1]:
        return None
    out = (values < limits[0]) | (values > limits[1])
    if weight is None:
        share = float(np.mean(out))
    else:
        total = float(weight.sum())
        share = float(np.sum(weight, where=out)) / total if total > 0.0 else 0.0
    if share <= tolerated:
        return None
    return (
        f"for {100.0 * share:.3g} % {what} is outside the {limits[0]:g} to {limits[1]:g} of {source}"
        f" (it runs from {values.min():.3g} to {values.max():.3g})"
    )


def _required_capacity(capacity_Ah: float | None) -> float:
    if capacity_Ah is None or not capacity_Ah > 0.0:
        given = "nothing" if capacity_Ah is None else f"{capacity_Ah:g}"
        raise BatteryError(f"fade laws need the cell's initial capacity_Ah, positive, to know C; got {given}")
    return capacity_Ah


def _checked(current_A: ArrayLike, soc: ArrayLike, temperature_C: ArrayLike, step_s: float) -> _Profile:
    if not (step_s > 0.0 and np.isfinite(step_s)):
        raise BatteryError(f"step_s must be positive, got {step_s:g}")
    arrays = {
        name: np.ascontiguousarray(np.atleast_1d(np.asarray(value, dtype=np.float64)))
        for name, value in zip(AXES, (current_A, soc, temperature_C), strict=True)
    }
    samples = arrays["current_A"].size
    for name, array in arrays.items():
        if array.ndim != 1 or array.size == 0 or array.size not in (1, samples):
            raise BatteryError(
                f"{name} has the shape {array.shape}; give one value per sample of the current ({samples})"
                + ("" if name == "current_A" else ", or a single one")
            )
        # A sum tells whether any value is NaN or inf without an array of flags.
        if not np.isfinite(array.sum()) and not np.all(np.isfinite(array)):
            first = int(np.argmin(np.isfinite(array)))
            raise BatteryError(f"{name} is {array[first]} at sample {first}; fill gaps of the profile first")
    low, high = arrays["soc"].min(), arrays["soc"].max()
    if low < -1e-6 or high > 1.0 + 1e-6:
        raise BatteryError(f"soc runs from {low:.3g} to {high:.3g}; give fractions between 0 and 1")
    if arrays["temperature_C"].min() <= -273.15:
        raise BatteryError("temperature_C lies below absolute zero; give degC")
    return _Profile(arrays["current_A"], arrays["soc"], arrays["temperature_C"], float(step_s))

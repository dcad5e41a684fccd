r"""Faults of a battery-management system's sensors, put into a log: `inject`.

A fault stands on one channel, or on both, from ``start_s`` on for ``duration_s``. What an estimator can see:

============== ==================================== ======================================================
fault          a reading becomes                    what an estimator can say
============== ==================================== ======================================================
`Dropout`      NaN, all along                       flagged: missing
`NotANumber`   NaN, now and then                    flagged: missing
`Infinite`     infinite, now and then               flagged: missing
`Gap`          no row at all                        the row after it is flagged, if it is longer than the
                                                    limit; else the current is taken to have been held
`Stuck`        what it was, or a given number       flagged after some ten samples if the other one moves;
                                                    both: once a few per cent of charge seem to pass
`Spikes`       off by ``size``, now and then        flagged if out of range, or if the voltage is far from
                                                    what an estimator that uses it expects
`SensorOffset` off by ``size``                      a large one as a mismatch; a small one only widens the
                                                    variance
`SensorGain`   ``size`` times what it was           as an offset
============== ==================================== ======================================================

A wrong SOC at the start is an argument of `bms.estimators.make_estimator`, a wrong cell one of
`bms.simulation.simulate`; neither is a matter of the log.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, Self, final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from bms.errors import BatteryError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CHANNELS = ("current", "voltage")


class Window(BaseModel):
    """When a fault holds: from ``start_s`` on, up to but without ``start_s + duration_s``.

    Raises
    ------
    pydantic.ValidationError
        When a value is unknown or out of range.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    start_s: float = Field(ge=0.0, description="time of the log at which the fault begins, s")
    duration_s: float = Field(gt=0.0, description="how long it lasts, s")

    @property
    def end_s(self) -> float:
        """Time at which the fault is over."""
        return self.start_s + self.duration_s


class OnChannel(Window):
    """A fault of one reading, or of both."""

    channel: Literal["current", "voltage", "both"] = Field(description="whose readings are wrong")
    in_units: ClassVar[bool] = True

    @model_validator(mode="after")
    def _one_unit(self) -> Self:
        if self.channel == "both" and self.in_units and getattr(self, "size", None) is not None:
            raise ValueError("a size in A or V belongs to one channel; give one fault for each of the two")
        return self

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that the fault stands on."""
        return CHANNELS if self.channel == "both" else (self.channel,)

    def rows(self, inside: Mask, rng: np.random.Generator) -> NDArray[np.int64]:
        """Choose the rows to spoil among those ``inside`` the window."""
        return np.flatnonzero(inside)

    def spoil(self, readings: Array, rng: np.random.Generator) -> Array:
        """Make faulty readings, shape (m,) with m > 0, of right ones."""
        return np.full(readings.size, np.nan)


class Scattered(OnChannel):
    """A fault of single readings, drawn at random; at least one is hit."""

    share: float = Field(default=0.05, gt=0.0, le=1.0, description="share of the readings that is hit")

    def rows(self, inside: Mask, rng: np.random.Generator) -> NDArray[np.int64]:
        """Draw the rows to spoil among those ``inside`` the window."""
        among = np.flatnonzero(inside)
        hit = min(max(1, round(self.share * among.size)), among.size)
        return np.sort(rng.choice(among, hit, replace=False)) if hit else among


@final
class SensorOffset(OnChannel):
    """Every reading is off by the same."""

    kind: Literal["offset"] = "offset"
    size: float = Field(description="what is added, A or V")

    def spoil(self, readings: Array, rng: np.random.Generator) -> Array:
        """Add the offset."""
        return readings + self.size


@final
class SensorGain(OnChannel):
    """Every reading is multiplied with the same."""

    kind: Literal["gain"] = "gain"
    size: float = Field(description="what the reading is multiplied with; 1 is right")
    in_units: ClassVar[bool] = False

    def spoil(self, readings: Array, rng: np.random.Generator) -> Array:
        """Multiply."""
        return readings * self.size


@final
class Stuck(OnChannel):
    """The reading stays what it was as the fault began, or jumps to a number and stays there."""

    kind: Literal["stuck"] = "stuck"
    size: float | None = Field(default=None, description="the number, A or V; the first reading if left out")

    def spoil(self, readings: Array, rng: np.random.Generator) -> Array:
        """Repeat one number."""
        return np.full(readings.size, readings[0] if self.size is None else self.size)


@final
class Dropout(OnChannel):
    """No reading: NaN in every row."""

    kind: Literal["dropout"] = "dropout"


@final
class NotANumber(Scattered):
    """Single readings are NaN."""

    kind: Literal["nan"] = "nan"


@final
class Infinite(Scattered):
    """Single readings are plus or minus infinity."""

    kind: Literal["infinite"] = "infinite"

    def spoil(self, readings: Array, rng: np.random.Generator) -> Array:
        """Put infinities of either sign."""
        return np.where(rng.random(readings.size) < 0.5, -np.inf, np.inf)


@final
class Spikes(Scattered):
    """Single readings are off by plus or minus the size."""

    kind: Literal["spikes"] = "spikes"
    size: float = Field(gt=0.0, description="how far they are off, A or V")

    def spoil(self, readings: Array, rng: np.random.Generator) -> Array:
        """Add the size with either sign."""
        return readings + np.where(rng.random(readings.size) < 0.5, -self.size, self.size)


@final
class Gap(Window):
    """The rows are not there."""

    kind: Literal["gap"] = "gap"


Fault = Annotated[
    SensorOffset | SensorGain | Stuck | Dropout | NotANumber | Infinite | Spikes | Gap,
    Field(discriminator="kind"),
]
"""Any fault; as the type of a pydantic field it is told by its ``kind``."""


@dataclass(frozen=True, eq=False, slots=True)
class FaultyLog:
    """A log with faults in it.

    Parameters
    ----------
    time_s, current_A, voltage_V : ndarray, shape (m,)
        What the battery-management system gets; rows within a gap are gone.
    kept : ndarray of int, shape (m,)
        Which rows of the log without faults these are.
    bad : dict of str to ndarray of bool, shape (m,)
        By kind of fault, the rows that it spoils; of a gap, the row after it.
    """

    time_s: Array
    current_A: Array
    voltage_V: Array
    kept: NDArray[np.int64]
    bad: dict[str, Mask]

    @property
    def any_bad(self) -> Mask:
        """Rows that any fault spoils, shape (m,)."""
        spoilt = np.zeros(self.time_s.size, dtype=bool)
        for hit in self.bad.values():
            spoilt |= hit
        return spoilt


def inject(
    time_s: ArrayLike,
    current_A: ArrayLike,
    voltage_V: ArrayLike,
    faults: Sequence[Fault],
    generator: np.random.Generator | int = 0,
) -> FaultyLog:
    """Put faults into a log, one after the other in the order given.

    Parameters
    ----------
    time_s, current_A, voltage_V : array_like, shape (n,)
        A log as measured.
    faults : sequence of Fault
        The faults.
    generator : numpy.random.Generator or int
        Draws the rows and signs of scattered faults; an int is a seed.

    Raises
    ------
    BatteryError
        When the columns differ in length or no row is left.
    """
    time = np.array(time_s, dtype=np.float64)
    readings = {
        "current": np.array(current_A, dtype=np.float64),
        "voltage": np.array(voltage_V, dtype=np.float64),
    }
    if time.ndim != 1 or any(column.shape != time.shape for column in readings.values()):
        shapes = ", ".join(str(column.shape) for column in (time, *readings.values()))
        raise BatteryError(f"a log has a time, a current and a voltage in each row, got the shapes {shapes}")
    rng = np.random.default_rng(generator)
    present = np.ones(time.size, dtype=bool)
    spoilt: dict[str, Mask] = {fault.kind: np.zeros(time.size, dtype=bool) for fault in faults}
    for fault in faults:
        inside = (time >= fault.start_s) & (time < fault.end_s)
        if isinstance(fault, Gap):
            present &= ~inside
            continue
        rows = fault.rows(inside, rng)
        spoilt[fault.kind][rows] = True
        for channel in fault.channels if rows.size else ():
            readings[channel][rows] = fault.spoil(readings[channel][rows], rng)
    kept = np.flatnonzero(present)
    if not kept.size:
        raise BatteryError("the gaps leave no row of the log; shorten them")
    bad = {kind: hit[kept] for kind, hit in spoilt.items()}
    if "gap" in bad:
        bad["gap"] = np.diff(kept, prepend=kept[0]) > 1
    return FaultyLog(time[kept], readings["current"][kept], readings["voltage"][kept], kept, bad)

r"""Published laws of capacity fade and resistance growth of LFP/graphite cells.

Each law of capacity is a power law :math:`q = k\,x^z` of throughput or time ``x``, with a coefficient ``k``
that depends on the stress. Under a varying stress the fade goes on from the *virtual* throughput that would
have led to the present fade, :math:`x_v = (q / k)^{1/z}`, so that :math:`q' = k\,(x_v + \Delta x)^z`. For the
exposure :math:`y = q^{1/z}` this means

.. math:: y' = y + k^{1/z}\,\Delta x, \qquad q = y^z :

exposures add up, so neither the time step nor the order of the stresses changes the result.

* Cycling, `CycleFade`: J. Wang et al., Cycle-life model for graphite-LiFePO4 cells, J. Power Sources 196
  (2011) 3942, :math:`q_\% = B \exp(-(31700 - 370.3\,C)/(R T))\,Ah^{0.55}`.
* Calendar, `CalendarFade`: M. Swierczynski et al., Lifetime estimation of the nanophosphate LiFePO4/C battery
  chemistry used in fully electric vehicles, IEEE Trans. Ind. Appl. 51 (2015) 3453,
  :math:`q_\% = (0.019\,SOC_\%^{0.823} + 0.5195)(3.258 \cdot 10^{-9}\,T_C^{5.087} + 0.295)\,months^{0.8}`.
* Resistance, `ResistanceGrowth`, off by default: M. Naumann et al., Analysis and modeling of calendar aging
  of a commercial LiFePO4/graphite cell, J. Energy Storage 17 (2018) 153, linear in time; another LFP cell
  (Sony, 3 Ah) than that of the other two.

The two fades are added ([M] has one map and says nothing), and both are fractions of the *initial* capacity.
C-rates refer to the initial capacity too.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from bms.errors import BatteryError, BatteryWarning

Array = NDArray[np.float64]
Range = tuple[float, float]

GAS_CONSTANT = 8.314
"""J/(mol K), with the digits that Wang et al. used."""

MONTH_s = 365.25 / 12.0 * 86400.0

ZERO_CELSIUS_K = 273.15

WANG_C_RATES = (0.5, 2.0, 6.0, 10.0)
WANG_PREFACTORS = (31630.0, 21681.0, 12934.0, 15512.0)
"""The paper's own table of B over the C-rate."""


@dataclass(frozen=True)
class Wear:
    """How far a cell has aged.

    Parameters
    ----------
    cycle, calendar : float
        Capacity lost to cycling and to time, fractions of the initial capacity. A `DegradationMap` does not
        tell the two apart; its fade is booked under ``cycle``.
    resistance : float
        Growth of the resistance, as a fraction of the initial one.

    Raises
    ------
    BatteryError
        When a part is negative or nothing is left of the capacity.
    """

    cycle: float = 0.0
    calendar: float = 0.0
    resistance: float = 0.0

    def __post_init__(self) -> None:
        if not min(self.cycle, self.calendar, self.resistance) >= 0.0 or not np.isfinite(self.resistance):
            raise BatteryError(f"wear must not be negative, got {self}; give fractions such as 0.02")
        if not self.cycle + self.calendar < 1.0:
            raise BatteryError(f"{self} leaves no capacity; give fractions, not per cent")

    @property
    def capacity_factor(self) -> float:
        """What is left of the initial capacity, as a fraction."""
        return 1.0 - self.cycle - self.calendar

    @property
    def resistance_factor(self) -> float:
        """The resistance as a multiple of the initial one."""
        return 1.0 + self.resistance


class CycleFade(BaseModel):
    r"""Fade by cycling, Wang et al. 2011, measured on an A123 26650 cell of 2.2 Ah.

    ``Ah`` is the charge that the cell *delivers* (cycles times depth times capacity in the paper), so half of
    the charge that passes in either direction counts. Another cell is scaled by equivalent full cycles: its
    throughput is multiplied by 2.2 Ah over its capacity.

    The default is the single B = 31630 of C/2 for all C-rates: wear per ampere-hour then rises with current.
    The paper's table of B (`CycleFade.with_table_of_paper`), linear between its C-rates and constant beyond,
    makes it *fall* from C/2 to 2C, so that an optimiser would seek high currents; building it warns.

    The test matrix covers C/2 to 10C and -30 to 60 degC. An Arrhenius law falls with the cold, where plating
    makes real wear rise; so the range of validity given here starts at 15 degC.

    Raises
    ------
    pydantic.ValidationError
        When a value is unknown or out of range.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    prefactor: tuple[float, ...] = Field(
        default=(31630.0,), min_length=1, description="B, % per Ah^exponent, at the nodes of prefactor_c_rate"
    )
    prefactor_c_rate: tuple[float, ...] = Field(
        default=(0.5,), min_length=1, description="C-rates of the nodes of B, 1/h; one node: the same for all"
    )
    activation_J_per_mol: float = Field(default=31700.0, ge=0.0, description="activation energy at rest")
    activation_drop_J_per_mol: float = Field(
        default=370.3, ge=0.0, description="what each C takes from the activation energy"
    )
    exponent: float = Field(default=0.55, gt=0.0, le=1.0, description="power z of the throughput")
    reference_capacity_Ah: float = Field(default=2.2, gt=0.0, description="capacity of the cell measured, Ah")
    throughput_share: float = Field(
        default=0.5, gt=0.0, le=1.0, description="share of |charge| that counts; 0.5: discharge only"
    )
    c_rate_range: Range = Field(default=(0.5, 10.0), description="C-rates measured, 1/h")
    temperature_range_C: Range = Field(default=(15.0, 60.0), description="temperatures to trust, degC")

    @classmethod
    def with_table_of_paper(cls) -> Self:
        """Build the law with the paper's B over the C-rate; warns that wear per Ah falls from C/2 to 2C."""
        return cls(prefactor=WANG_PREFACTORS, prefactor_c_rate=WANG_C_RATES)

    @model_validator(mode="after")
    def _check_table(self) -> Self:
        nodes = np.array(self.prefactor_c_rate)
        if nodes.size != len(self.prefactor):
            raise ValueError(f"prefactor has {len(self.prefactor)} values for {nodes.size} C-rates")
        if nodes[0] < 0.0 or np.any(np.diff(nodes) <= 0.0) or min(self.prefactor) <= 0.0:
            raise ValueError("prefactors must be positive, their C-rates increasing and not negative")
        c_rate = np.linspace(nodes[0], nodes[-1], 193)
        falls = np.flatnonzero(np.diff(self.coefficient(c_rate, 25.0)) < 0.0)
        if falls.size:
            warnings.warn(
                f"with this prefactor the wear per Ah falls with current between {c_rate[falls[0]]:.2g}C and"
                f" {c_rate[falls[-1] + 1]:.2g}C at 25 degC, rewarding high currents; the default does not",
                BatteryWarning,
                stacklevel=3,
            )
        return self

    def coefficient(self, c_rate: ArrayLike, temperature_C: ArrayLike) -> Array:
        """Coefficient k of the power law, in per cent per Ah^exponent (no range check)."""
        c = np.abs(np.asarray(c_rate, dtype=np.float64))
        kelvin = np.asarray(temperature_C, dtype=np.float64) + ZERO_CELSIUS_K
        energy = self.activation_J_per_mol - self.activation_drop_J_per_mol * c
        b = np.interp(c, self.prefactor_c_rate, self.prefactor)
        return np.asarray(b * np.exp(-energy / (GAS_CONSTANT * kelvin)))

    def fade(self, throughput_Ah: ArrayLike, c_rate: ArrayLike, temperature_C: ArrayLike) -> Array:
        """Give the fraction of capacity lost after a throughput at constant stress.

        Parameters
        ----------
        throughput_Ah : array_like
            Charge delivered by the cell measured (2.2 Ah), Ah.
        c_rate, temperature_C : array_like
            Stress, 1/h and degC; a `BatteryWarning` when outside the range of validity.
        """
        warn_outside(np.abs(np.asarray(c_rate)), self.c_rate_range, "the C-rate", "Wang et al. 2011")
        warn_outside(temperature_C, self.temperature_range_C, "the temperature in degC", "Wang et al. 2011")
        throughput = np.asarray(throughput_Ah, dtype=np.float64)
        return np.asarray(0.01 * self.coefficient(c_rate, temperature_C) * throughput**self.exponent)

    def throughput_Ah(self, fade: ArrayLike, c_rate: ArrayLike, temperature_C: ArrayLike) -> Array:
        """Give the virtual throughput in Ah: after it, ``fade`` (a fraction) is lost at constant stress."""
        percent = 100.0 * np.asarray(fade, dtype=np.float64)
        return np.asarray((percent / self.coefficient(c_rate, temperature_C)) ** (1.0 / self.exponent))

    def exposure_per_s(self, current_A: ArrayLike, temperature_C: ArrayLike, capacity_Ah: float) -> Array:
        """Rate of the exposure ``y = q^(1/z)`` in 1/s, of a cell of ``capacity_Ah`` at ``current_A``."""
        c = np.abs(np.asarray(current_A, dtype=np.float64)) / capacity_Ah
        power = 1.0 / self.exponent
        kelvin = np.asarray(temperature_C, dtype=np.float64) + ZERO_CELSIUS_K
        b = (
            self.prefactor[0]
            if len(self.prefactor) == 1
            else np.interp(c, self.prefactor_c_rate, self.prefactor)
        )
        scale = (0.01 * b) ** power * (self.throughput_share * self.reference_capacity_Ah / 3600.0)
        slope = power / GAS_CONSTANT / kelvin
        energy = self.activation_drop_J_per_mol * c - self.activation_J_per_mol
        return np.asarray(scale * c * np.exp(slope * energy))


class CalendarFade(BaseModel):
    """Fade by the passing of time, Swierczynski et al. 2015, on the same kind of cell as `CycleFade`.

    Accelerated tests, at high temperature and 10 to 90 % of SOC; the fit is used down to 25 degC. Below
    0 degC the temperature term is held at its value at 0 degC.

    Raises
    ------
    pydantic.ValidationError
        When a value is unknown or out of range.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    soc_factor: float = Field(default=0.019, ge=0.0, description="factor of SOC in per cent to soc_power")
    soc_power: float = Field(default=0.823, gt=0.0, description="power of SOC in per cent")
    soc_offset: float = Field(default=0.5195, ge=0.0, description="SOC term of an empty cell")
    temperature_factor: float = Field(default=3.258e-9, ge=0.0, description="factor of degC to the power")
    temperature_power: float = Field(default=5.087, gt=0.0, description="power of the temperature in degC")
    temperature_offset: float = Field(default=0.295, ge=0.0, description="temperature term at 0 degC")
    exponent: float = Field(default=0.8, gt=0.0, le=1.0, description="power z of the months")
    soc_range: Range = Field(default=(0.1, 0.9), description="SOC measured, fractions")
    temperature_range_C: Range = Field(default=(25.0, 55.0), description="temperatures to trust, degC")

    def coefficient(self, soc: ArrayLike, temperature_C: ArrayLike) -> Array:
        """Coefficient k of the power law, in per cent per month^exponent (no range check)."""
        percent = 100.0 * np.clip(np.asarray(soc, dtype=np.float64), 0.0, 1.0)
        warm = np.maximum(np.asarray(temperature_C, dtype=np.float64), 0.0)
        by_soc = self.soc_factor * percent**self.soc_power + self.soc_offset
        by_heat = self.temperature_factor * warm**self.temperature_power + self.temperature_offset
        return np.asarray(by_soc * by_heat)

    def fade(self, months: ArrayLike, soc: ArrayLike, temperature_C: ArrayLike) -> Array:
        """Give the fraction of capacity lost after ``months`` at constant SOC and temperature.

        A `BatteryWarning` when the stress is outside the range of validity.
        """
        warn_outside(soc, self.soc_range, "SOC", "Swierczynski et al. 2015")
        warn_outside(
            temperature_C, self.temperature_range_C, "the temperature in degC", "Swierczynski et al. 2015"
        )
        span = np.asarray(months, dtype=np.float64) ** self.exponent
        return np.asarray(0.01 * self.coefficient(soc, temperature_C) * span)

    def exposure_per_s(self, soc: ArrayLike, temperature_C: ArrayLike) -> Array:
        """Rate of the exposure ``y = q^(1/z)`` in 1/s."""
        per_month = (0.01 * self.coefficient(soc, temperature_C)) ** (1.0 / self.exponent)
        return np.asarray(per_month / MONTH_s)


class ResistanceGrowth(BaseModel):
    """Growth of resistance with time, Naumann et al. 2018, on a Sony LFP/graphite cell of 3 Ah.

    Linear in time: ``rate exp(-E/R (1/T - 1/298.15 K)) (curvature (SOC - 0.5)^2 + offset)``. The paper's law
    of cycling (2020) counts depths of half-cycles and turns negative above 1C, so it is not taken over.

    Raises
    ------
    pydantic.ValidationError
        When a value is unknown or out of range.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    rate_per_s: float = Field(default=3.4194e-10, ge=0.0, description="rate at 25 degC, 1/s")
    activation_J_per_mol: float = Field(default=71827.0, ge=0.0, description="activation energy")
    soc_curvature: float = Field(default=-3.3903, description="factor of (SOC - 0.5)^2")
    soc_offset: float = Field(default=1.5604, gt=0.0, description="SOC term at 50 %")
    temperature_range_C: Range = Field(default=(25.0, 60.0), description="temperatures to trust, degC")

    @model_validator(mode="after")
    def _check_sign(self) -> Self:
        if 0.25 * self.soc_curvature + self.soc_offset < 0.0:
            raise ValueError("resistance must not shrink: soc_curvature / 4 + soc_offset is negative")
        return self

    def growth_per_s(self, soc: ArrayLike, temperature_C: ArrayLike) -> Array:
        """Relative growth of resistance per second (no range check)."""
        middle = np.clip(np.asarray(soc, dtype=np.float64), 0.0, 1.0) - 0.5
        kelvin = np.asarray(temperature_C, dtype=np.float64) + ZERO_CELSIUS_K
        slope = self.activation_J_per_mol / GAS_CONSTANT
        heat = np.exp(slope * (1.0 / (25.0 + ZERO_CELSIUS_K) - 1.0 / kelvin))
        return np.asarray(self.rate_per_s * heat * (self.soc_curvature * middle**2 + self.soc_offset))


class FadeLaws(BaseModel):
    """The laws that age one cell; the fades of the two capacity laws are added.

    [M] keeps every parameter but the capacity constant, hence no resistance growth by default. With
    ``resistance_per_fade`` the resistance grows in proportion to the capacity lost (and so with current, SOC
    and temperature); ``resistance`` adds a law of its own.

    Raises
    ------
    pydantic.ValidationError
        When a value is unknown or out of range.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    cycle: CycleFade | None = Field(default_factory=CycleFade, description="fade by cycling")
    calendar: CalendarFade | None = Field(default_factory=CalendarFade, description="fade by time")
    resistance: ResistanceGrowth | None = Field(default=None, description="growth of resistance by time")
    resistance_per_fade: float = Field(
        default=0.0, ge=0.0, description="relative growth of resistance per relative loss of capacity"
    )

    def rates_per_s(
        self,
        current_A: ArrayLike,
        soc: ArrayLike,
        temperature_C: ArrayLike,
        *,
        capacity_Ah: float,
        wear: Wear,
    ) -> tuple[Array, Array]:
        """Capacity fade and resistance growth per second, relative, at a given state of wear.

        A power law of exponent z < 1 has the rate ``z q^(1 - 1/z) dy/dt``, which falls as the fade ``q``
        grows.

        Raises
        ------
        BatteryError
            When a law is on and its part of ``wear`` is zero: its rate is infinite there.
        """
        fade = np.zeros(np.broadcast_shapes(np.shape(current_A), np.shape(soc), np.shape(temperature_C)))
        if self.cycle is not None:
            rate = self.cycle.exposure_per_s(current_A, temperature_C, capacity_Ah)
            fade = fade + _slope(wear.cycle, self.cycle.exponent, "cycle") * rate
        if self.calendar is not None:
            rate = self.calendar.exposure_per_s(soc, temperature_C)
            fade = fade + _slope(wear.calendar, self.calendar.exponent, "calendar") * rate
        growth = self.resistance_per_fade * fade
        if self.resistance is not None:
            growth = growth + self.resistance.growth_per_s(soc, temperature_C)
        return fade, growth


def _slope(fade: float, exponent: float, part: str) -> float:
    """Slope dq/dy of a power law at a fade."""
    if fade <= 0.0 and exponent < 1.0:
        raise BatteryError(
            f"a new cell fades infinitely fast by a power law: give the wear at which to linearise,"
            f" such as Wear({part}=0.02), or switch the {part} law off"
        )
    return float(exponent * fade ** (1.0 - 1.0 / exponent))


def warn_outside(
    value: ArrayLike, limits: Range, what: str, source: str, done: str = "the law is extrapolated"
) -> None:
    """Warn (`BatteryWarning`) when any value lies outside the range of validity of a source."""
    values = np.asarray(value, dtype=np.float64)
    if values.size and (values.min() < limits[0] or values.max() > limits[1]):
        warnings.warn(
            f"{what} is {values.min():.3g} to {values.max():.3g}, outside the {limits[0]:g} to {limits[1]:g}"
            f" of {source}; {done}",
            BatteryWarning,
            stacklevel=3,
        )

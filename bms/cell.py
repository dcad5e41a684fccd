r"""A battery cell as an equivalent circuit: what a TOML file says about it ([M] eqs 55-56).

.. math::

    \dot{SOC} = \frac{I}{Q}, \qquad
    \dot v_j = -\frac{v_j}{\tau_j} + \frac{R_j}{\tau_j} I, \qquad
    V = V_{oc}(SOC) + M(SOC)\,h + \sum_j v_j + R\,I

with :math:`I > 0` when charging, no, one or two relaxation pairs (:math:`\tau_j = R_j C_j`) and, where the
cell has it, one hysteresis state (Plett, J. Power Sources 134, 2004, part 2):

.. math:: \dot h = \frac{\kappa |I|}{Q}\,(\operatorname{sign} I - h), \qquad -1 \le h \le 1 .

Resistances and time constants are constants, tables over SOC, or tables over temperature and SOC; with an
activation energy they follow :math:`R(T) = R(T_{ref})\,\exp\bigl(\tfrac{E}{R_g}(1/T - 1/T_{ref})\bigr)`, the
capacitances staying as they are. A lumped thermal node,
:math:`C_{th}\dot T = I\,(V - V_{oc}) - (T - T_{amb}) / R_{th}`, moves the temperature.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from bms.ocv import OcvCurve

Table = tuple[float, ...]
Quantity = float | Table | tuple[Table, ...]
"""A constant, a table over SOC, or one over temperature (outer) and SOC (inner)."""

STRICT = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


@lru_cache(maxsize=64)
def _curve(soc: Table, ocv_V: Table, slope_floor: float) -> OcvCurve:
    """Build a curve once per table; a property cached on the cell would survive a copy with other tables."""
    import numpy as np

    return OcvCurve(np.array(soc), np.array(ocv_V), slope_floor)


class RelaxationPair(BaseModel):
    """A resistor beside a capacitor; give the time constant or the capacitance."""

    model_config = STRICT

    resistance_ohm: Quantity = Field(description="resistance of the pair, ohm")
    time_constant_s: Quantity | None = Field(default=None, description="R C of the pair, s")
    capacitance_F: float | None = Field(default=None, gt=0.0, description="capacitance of the pair, F")

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if (self.time_constant_s is None) == (self.capacitance_F is None):
            raise ValueError("a relaxation pair has a time_constant_s or a capacitance_F, one of the two")
        return self


class Hysteresis(BaseModel):
    """Half the difference between the charge and the discharge branch of the OCV, and how fast it flips."""

    model_config = STRICT

    voltage_V: float | Table = Field(description="half the distance between the branches, V, >= 0")
    rate: float = Field(gt=0.0, description="1 / rate is the change of SOC that flips 63 % of it")


class Thermal(BaseModel):
    """One thermal node."""

    model_config = STRICT

    heat_capacity_J_per_K: float = Field(gt=0.0, description="heat capacity of the cell, J/K")
    resistance_K_per_W: float = Field(gt=0.0, description="thermal resistance to the surroundings, K/W")


class Cell(BaseModel):
    """Parameters of a battery cell (or of a pack seen as one, see `Cell.scaled`).

    Raises
    ------
    pydantic.ValidationError
        When a value is missing, unknown, or out of range; `load_cell` turns it into a `BatteryError`.
    """

    model_config = STRICT

    name: str = Field(description="short name, used in tables")
    source: str = Field(description="where the figures come from")
    capacity_Ah: float = Field(gt=0.0, description="nominal capacity, Ah")
    series: int = Field(
        default=1, ge=1, description="cells in series that this one stands for; errors in volt grow with it"
    )
    soc: Table = Field(description="SOC nodes of the tables, from 0 to 1")
    ocv_V: Table = Field(description="open-circuit voltage at the nodes, V")
    resistance_ohm: Quantity = Field(description="series resistance, ohm")
    temperature_C: Table | None = Field(
        default=None, description="temperature nodes of two-way tables, deg C"
    )
    relaxation: tuple[RelaxationPair, ...] = Field(
        default=(), max_length=2, description="none, one or two relaxation pairs"
    )
    hysteresis: Hysteresis | None = Field(default=None, description="one-state hysteresis")
    thermal: Thermal | None = Field(
        default=None, description="thermal node; without it the cell is isothermal"
    )
    activation_energy_J_per_mol: float = Field(
        default=0.0, ge=0.0, description="Arrhenius energy of all resistances, J/mol"
    )
    reference_temperature_C: float = Field(
        default=25.0, gt=-273.15, description="temperature at which the resistances hold, deg C"
    )
    voltage_min_V: float = Field(gt=0.0, description="lowest terminal voltage, V")
    voltage_max_V: float = Field(gt=0.0, description="highest terminal voltage, V")
    discharge_limit_A: float = Field(gt=0.0, description="largest discharge current, A, as a positive number")
    charge_limit_A: float = Field(gt=0.0, description="largest charge current, A")
    full_charge_voltage_V: float | None = Field(
        default=None, gt=0.0, description="full when the voltage is at least this while charging, V, ..."
    )
    full_charge_current_A: float | None = Field(
        default=None, gt=0.0, description="... and the current has fallen to this, A"
    )
    slope_floor: float = Field(
        default=0.02,
        gt=0.0,
        lt=1.0,
        description="least OCV slope used by alpha, as a share of the mean slope",
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if len(self.ocv_V) != len(self.soc):
            raise ValueError(f"ocv_V has {len(self.ocv_V)} values for {len(self.soc)} nodes of soc")
        _ = self.ocv
        self._check_temperatures()
        self._check_table("resistance_ohm", self.resistance_ohm)
        for at, pair in enumerate(self.relaxation):
            self._check_table(f"relaxation[{at}].resistance_ohm", pair.resistance_ohm)
            if pair.time_constant_s is not None:
                self._check_table(f"relaxation[{at}].time_constant_s", pair.time_constant_s)
        if self.hysteresis is not None:
            self._check_table("hysteresis.voltage_V", self.hysteresis.voltage_V, zero=True)
        if self.voltage_min_V >= self.voltage_max_V:
            raise ValueError(
                f"voltage_min_V {self.voltage_min_V:g} is not below voltage_max_V {self.voltage_max_V:g}"
            )
        if self.voltage_min_V >= self.ocv_V[-1] or self.voltage_max_V <= self.ocv_V[0]:
            raise ValueError(
                f"the voltage window {self.voltage_min_V:g} to {self.voltage_max_V:g} V holds nothing of the"
                f" OCV, {self.ocv_V[0]:g} to {self.ocv_V[-1]:g} V"
            )
        if (self.full_charge_voltage_V is None) != (self.full_charge_current_A is None):
            raise ValueError(
                "full_charge_voltage_V and full_charge_current_A come together; give both or none"
            )
        return self

    def _check_temperatures(self) -> None:
        nodes = self.temperature_C
        if nodes is None:
            return
        if len(nodes) < 2 or any(b <= a for a, b in pairwise(nodes)):
            raise ValueError(f"temperature_C must increase and have two nodes or more, got {nodes}")
        if self.activation_energy_J_per_mol > 0.0:
            raise ValueError(
                "tables over temperature_C and activation_energy_J_per_mol both say how resistance"
                " follows temperature; keep one of the two"
            )

    def _check_table(self, name: str, value: Quantity, *, zero: bool = False) -> None:
        rows: tuple[Any, ...] = value if isinstance(value, tuple) else (value,)
        if rows and isinstance(rows[0], tuple):
            if len(rows) != len(self.temperature_C or ()):
                raise ValueError(
                    f"{name} has {len(rows)} rows for {len(self.temperature_C or ())} nodes of temperature_C"
                )
        else:
            rows = (rows,)
        for row in rows:
            if isinstance(value, tuple) and len(row) != len(self.soc):
                raise ValueError(f"{name} has {len(row)} values for {len(self.soc)} nodes of soc")
            if min(row) < 0.0 or (min(row) == 0.0 and not zero):
                raise ValueError(f"{name} must be {'zero or more' if zero else 'positive'}, got {min(row):g}")

    @property
    def ocv(self) -> OcvCurve:
        """The open-circuit voltage curve."""
        return _curve(self.soc, self.ocv_V, self.slope_floor)

    @property
    def capacity_C(self) -> float:
        """Nominal capacity in coulomb."""
        return 3600.0 * self.capacity_Ah

    def with_values(self, **changes: Any) -> Cell:
        """Copy the cell with other values, validated anew.

        Raises
        ------
        pydantic.ValidationError
            When a value is unknown or out of range.
        """
        return Cell(**(self.model_dump() | changes))

    def scaled(self, series: int = 1, parallel: int = 1) -> Cell:
        """See a pack of equal cells as one cell.

        Parameters
        ----------
        series, parallel : int
            Cells in a string, and strings; at least 1.

        Raises
        ------
        ValueError
            When a count is below 1.
        """
        if series < 1 or parallel < 1:
            raise ValueError(
                f"a pack has at least 1 cell in series and in parallel, got {series}, {parallel}"
            )
        ohm = series / parallel
        data = self.model_dump()
        for name in ("voltage_min_V", "voltage_max_V", "full_charge_voltage_V"):
            data[name] = _times(data[name], series)
        for name in ("capacity_Ah", "discharge_limit_A", "charge_limit_A", "full_charge_current_A"):
            data[name] = _times(data[name], parallel)
        data["ocv_V"] = _times(self.ocv_V, series)
        data["resistance_ohm"] = _times(self.resistance_ohm, ohm)
        for pair in data["relaxation"]:
            pair["resistance_ohm"] = _times(pair["resistance_ohm"], ohm)
            pair["capacitance_F"] = _times(pair["capacitance_F"], 1.0 / ohm)
        if data["hysteresis"] is not None:
            data["hysteresis"]["voltage_V"] = _times(data["hysteresis"]["voltage_V"], series)
        if data["thermal"] is not None:
            data["thermal"]["heat_capacity_J_per_K"] *= series * parallel
            data["thermal"]["resistance_K_per_W"] /= series * parallel
        data["series"] = self.series * series
        data["name"] = f"{self.name} {series}s{parallel}p"
        return Cell(**data)


def _times(value: Any, factor: float) -> Any:
    """Scale a number or a nested table; None stays None."""
    if value is None:
        return None
    if isinstance(value, tuple | list):
        return tuple(_times(item, factor) for item in value)
    return value * factor

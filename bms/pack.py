r"""A battery pack as open-circuit voltage and internal resistance, each a table over SOC ([L] section 3.1).

With the terminal power ``P`` and the current ``i`` both positive when charging,

.. math:: P = i\,(V_{oc}(SOC) + R\,i), \qquad i = \frac{2 P}{V_{oc} + \sqrt{V_{oc}^2 + 4 R P}},

the stable form of the root that vanishes with ``P``. The resistance may differ between charge and discharge.
The pack accepts currents between two limits: its rated ones, tightened where the terminal voltage would leave
its window or the discharge would pass the maximum-power point ``-V_oc / (2 R)``.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from bms.ocv import OcvCurve

Table = tuple[float, ...]


@lru_cache(maxsize=32)
def _curve(soc: tuple[float, ...], ocv_V: tuple[float, ...], slope_floor: float) -> OcvCurve:
    """Build a curve once per table; a property cached on the pack would survive a copy with other tables."""
    return OcvCurve(np.array(soc), np.array(ocv_V), slope_floor)


class Pack(BaseModel):
    """Parameters of a battery pack.

    Raises
    ------
    pydantic.ValidationError
        When a value is missing, unknown, or out of range; `bms.load_pack` turns it into a `BatteryError`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: str = Field(description="short name, used in tables")
    source: str = Field(description="where the figures come from")
    capacity_Ah: float = Field(gt=0.0, description="nominal capacity, Ah")
    soc: Table = Field(description="SOC nodes of the tables, from 0 to 1")
    ocv_V: Table = Field(description="open-circuit voltage at the nodes, V")
    resistance_ohm: Table = Field(description="discharge resistance at the nodes, ohm")
    charge_resistance_ohm: Table | None = Field(
        default=None, description="charge resistance at the nodes, ohm; as discharge when left out"
    )
    discharge_limit_A: float = Field(gt=0.0, description="largest discharge current, A, as a positive number")
    charge_limit_A: float = Field(gt=0.0, description="largest charge current, A")
    voltage_min_V: float | None = Field(default=None, gt=0.0, description="lowest terminal voltage, V")
    voltage_max_V: float | None = Field(default=None, gt=0.0, description="highest terminal voltage, V")
    slope_floor: float = Field(
        default=0.02,
        gt=0.0,
        lt=1.0,
        description="least OCV slope used by alpha, as a share of the mean slope",
    )

    @model_validator(mode="after")
    def _check_tables(self) -> Self:
        for name in ("ocv_V", "resistance_ohm", "charge_resistance_ohm"):
            column = getattr(self, name)
            if column is not None and len(column) != len(self.soc):
                raise ValueError(f"{name} has {len(column)} values for {len(self.soc)} nodes of soc")
        _ = self.ocv
        for column in (self.resistance_ohm, self.charge_resistance_ohm or self.resistance_ohm):
            if min(column) <= 0.0:
                raise ValueError(f"a resistance must be positive, got {min(column):g} ohm")
        if self.voltage_min_V is not None and self.voltage_min_V >= self.ocv_V[-1]:
            raise ValueError(
                f"voltage_min_V {self.voltage_min_V:g} is not below the full OCV {self.ocv_V[-1]:g}"
            )
        if self.voltage_max_V is not None and self.voltage_max_V <= self.ocv_V[0]:
            raise ValueError(
                f"voltage_max_V {self.voltage_max_V:g} is not above the empty OCV {self.ocv_V[0]:g}"
            )
        low_V, high_V = self.voltage_min_V, self.voltage_max_V
        if low_V is not None and high_V is not None and low_V >= high_V:
            raise ValueError(f"voltage_min_V {low_V:g} is not below voltage_max_V {high_V:g}")
        return self

    @property
    def ocv(self) -> OcvCurve:
        """The open-circuit voltage curve."""
        return _curve(self.soc, self.ocv_V, self.slope_floor)

    @property
    def capacity_C(self) -> float:
        """Nominal capacity in coulomb."""
        return 3600.0 * self.capacity_Ah

    @property
    def energy_J(self) -> float:
        """Open-circuit energy between empty and full, the integral of OCV over charge."""
        nodes = np.linspace(0.0, 1.0, 1001)
        return float(self.capacity_C * np.trapezoid(self.ocv(nodes), nodes))

    def resistances_ohm(self, soc: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Discharge and charge resistance in ohm at ``soc``, linear between nodes."""
        at = np.asarray(soc, dtype=np.float64)
        discharge = np.interp(at, self.soc, self.resistance_ohm)
        charge = np.interp(at, self.soc, self.charge_resistance_ohm or self.resistance_ohm)
        return np.asarray(discharge), np.asarray(charge)

    def current_limits_A(self, soc: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest (discharge, negative) and highest (charge) current in A that the pack accepts at ``soc``."""
        ocv_V = self.ocv(soc)
        discharge_ohm, charge_ohm = self.resistances_ohm(soc)
        low = np.maximum(-self.discharge_limit_A, -0.5 * ocv_V / discharge_ohm)
        high = np.full_like(ocv_V, self.charge_limit_A)
        if self.voltage_min_V is not None:
            low = np.maximum(low, np.minimum(0.0, (self.voltage_min_V - ocv_V) / discharge_ohm))
        if self.voltage_max_V is not None:
            high = np.minimum(high, np.maximum(0.0, (self.voltage_max_V - ocv_V) / charge_ohm))
        return low, high

    def power_limits_W(self, soc: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Terminal power in W at the two current limits: the most negative (discharge) and the highest."""
        ocv_V = self.ocv(soc)
        discharge_ohm, charge_ohm = self.resistances_ohm(soc)
        low, high = self.current_limits_A(soc)
        return low * (ocv_V + discharge_ohm * low), high * (ocv_V + charge_ohm * high)

    def current_A(self, power_W: ArrayLike, soc: ArrayLike) -> NDArray[np.float64]:
        """Solve the circuit for the current in A at terminal power ``power_W``, clipped to the limits.

        Parameters
        ----------
        power_W, soc : array_like
            Terminal power (positive charges) and SOC, broadcast against each other.
        """
        power = np.asarray(power_W, dtype=np.float64)
        ocv_V = self.ocv(soc)
        discharge_ohm, charge_ohm = self.resistances_ohm(soc)
        resistance = np.where(power < 0.0, discharge_ohm, charge_ohm)
        root = np.sqrt(np.maximum(ocv_V**2 + 4.0 * resistance * power, 0.0))
        low, high = self.current_limits_A(soc)
        return np.clip(2.0 * power / (ocv_V + root), low, high)


PRESETS = Path(__file__).parent / "presets"

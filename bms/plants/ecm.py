r"""A battery that obeys its circuit: the equivalent circuit of `bms.cell`, asked for power, with a ledger.

At the start of a step the plant solves its own circuit for the current that gives the power asked for,

.. math::

    I\,(V_0 + R I) = P, \qquad V_0 = V_{oc}(SOC) + M h + v_1 + v_2, \qquad
    I = \frac{2 P}{V_0 + \sqrt{V_0^2 + 4 R P}},

cut off at the cell's limits of current and voltage, at the maximum-power point, and at empty and full, and
holds it over the step. States move exactly (`bms._ecm`). What it reports is that current and the terminal
voltage at the end of the step with the current still flowing.

**Ledger.** With the current held every energy has a closed form over a step, so that charge and energy
balance to rounding:

.. math::

    \int V I\,dt = \Delta\Bigl(Q \int_0^{SOC} V_{oc}\,ds + \sum_j \tfrac12 C_j v_j^2\Bigr)
                 + \int R I^2 dt + \sum_j \int \frac{v_j^2}{R_j} dt + \int M h\,I\,dt .

The last term is the work of the hysteresis, which is lost over a closed loop, but not at every step: some of
it comes back just after the current has turned. Where the circuit's parameters follow SOC or temperature they
are frozen over a step and change between steps; a capacitor that changes under voltage gains or loses energy,
which has its own entry.

When to use: as the plant of a closed loop in which energy is conserved, unlike [L]'s random walk.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import final

import numpy as np
from numpy.typing import NDArray

from bms._ecm import Circuit
from bms.cell import Cell
from bms.circuit import tabulate
from bms.errors import BatteryError
from bms.measurement import Measurement
from bms.plants import _ecm_plant as at
from bms.simulation import CellState

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Factors:
    """What sets one specimen apart from its nominal cell: factors on the nominal values.

    Parameters
    ----------
    capacity, resistance, relaxation, slowness : float
        On capacity, series resistance, relaxation resistances, relaxation time constants; all positive.
    """

    capacity: float = 1.0
    resistance: float = 1.0
    relaxation: float = 1.0
    slowness: float = 1.0

    def __post_init__(self) -> None:
        for name in ("capacity", "resistance", "relaxation", "slowness"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise BatteryError(f"the factor on {name} is {value:g}; give a positive number, 1 is nominal")


@dataclass(frozen=True, slots=True)
class Ledger:
    """Where charge and energy went since the start; the current is positive when charging.

    ``terminal_J - (stored_J now - stored_J at the start)`` equals ``series_J + relaxation_J + hysteresis_J -
    rewritten_J``.

    Parameters
    ----------
    charge_C : float
        Charge that went in.
    terminal_J : float
        Energy that went in at the terminals.
    stored_J : float
        Energy stored now: the OCV's integral from empty, and the capacitors.
    series_J, relaxation_J, hysteresis_J : float
        Energy lost in the series resistance, in the relaxation resistances, and to the hysteresis.
    rewritten_J : float
        Energy of capacitors that changed with SOC or temperature; 0 where the circuit is constant.
    """

    charge_C: float
    terminal_J: float
    stored_J: float
    series_J: float
    relaxation_J: float
    hysteresis_J: float
    rewritten_J: float

    @property
    def lost_J(self) -> float:
        """All losses together."""
        return self.series_J + self.relaxation_J + self.hysteresis_J


@final
class EcmPlant:
    """A cell, or a pack seen as one (`bms.cell.Cell.scaled`), as a plant.

    Parameters
    ----------
    cell : Cell
        The nominal cell.
    soc : float
        True SOC at the start, all else at rest; ignored when ``state`` is given.
    state : CellState, optional
        State at the start.
    ambient_C : float
        Temperature of the surroundings; the cell's own, where it has no thermal node.
    factors : Factors, optional
        How this specimen differs from the nominal cell.

    Raises
    ------
    BatteryError
        When the SOC is outside [0, 1].
    """

    def __init__(
        self,
        cell: Cell,
        soc: float = 0.5,
        *,
        state: CellState | None = None,
        ambient_C: float = 25.0,
        factors: Factors | None = None,
    ) -> None:
        circuit, specimen = tabulate(cell), factors or Factors()
        start = state or CellState(soc, temperature_C=ambient_C)
        if not 0.0 <= start.soc <= 1.0:
            raise BatteryError(
                f"the SOC at the start must lie in [0, 1], got {start.soc:g}; give a fraction, not per cent"
            )
        self._constants = _constants(cell, circuit, specimen, ambient_C)
        self._m = np.zeros(at.SIZE)
        self._m[: at.OHM] = start.to_array()
        if cell.thermal is None:
            self._m[at.TEMPERATURE_C] = ambient_C
        curve = (circuit.guide, circuit.knot, circuit.cubic)
        at.look_up(circuit.table, circuit.temperature_C, self._constants, self._m)
        self._m[at.REWRITTEN_J] = 0.0
        self._m[at.VOLTAGE_V] = at.source_voltage(*curve, self._m)
        self._tables = (*curve, _integral_below(cell), circuit.table, circuit.temperature_C, self._constants)

    @property
    def soc(self) -> float:
        """True SOC now."""
        return float(self._m[at.SOC])

    @property
    def state(self) -> CellState:
        """State now."""
        return CellState.from_array(self._m[: at.OHM])

    @property
    def current_A(self) -> float:
        """Current over the last step; 0 before the first."""
        return float(self._m[at.CURRENT_A])

    @property
    def voltage_V(self) -> float:
        """Terminal voltage at the end of the last step with its current flowing; without one at the start."""
        return float(self._m[at.VOLTAGE_V])

    @property
    def temperature_C(self) -> float:
        """Temperature of the cell."""
        return float(self._m[at.TEMPERATURE_C])

    @property
    def ledger(self) -> Ledger:
        """Where charge and energy went since the start."""
        m, (guide, knot, cubic, below, *_) = self._m, self._tables
        pairs = ((m[at.OHM1], m[at.TAU1], m[at.V1]), (m[at.OHM2], m[at.TAU2], m[at.V2]))
        stored = self._constants[at.CAPACITY_C] * at.ocv_integral(guide, knot, cubic, below, m[at.SOC])
        stored += sum(0.5 * tau / ohm * v * v for ohm, tau, v in pairs if ohm > 0.0)
        entries = (m[at.CHARGE_C], m[at.TERMINAL_J], stored, *m[at.SERIES_J : at.SIZE])
        return Ledger(*(float(value) for value in entries))

    def step(self, power_W: float, current_A: float, step_s: float) -> Measurement:
        """Carry a load over one step, see `bms.plants.Plant.step`; the current expected is not used.

        Raises
        ------
        BatteryError
            When the power is not finite or the step not positive.
        """
        return self._measure(at.step_power(*self._tables, self._m, *_checked("power_W", power_W, step_s)))

    def carry(self, current_A: float, step_s: float) -> Measurement:
        """Hold a current over one step, whatever the limits.

        Raises
        ------
        BatteryError
            When the current is not finite or the step not positive.
        """
        return self._measure(
            at.step_current(*self._tables, self._m, *_checked("current_A", current_A, step_s))
        )

    def _measure(self, flowed: tuple[float, float]) -> Measurement:
        return Measurement(
            current_A=flowed[0],
            voltage_V=flowed[1],
            temperature_C=float(self._m[at.TEMPERATURE_C]),
            withheld_W=float(self._m[at.WITHHELD_W]),
        )


def _checked(name: str, value: float, step_s: float) -> tuple[float, float]:
    if not (math.isfinite(value) and math.isfinite(step_s) and step_s > 0.0):
        raise BatteryError(
            f"{name} is {value:g} over a step of {step_s:g} s; both must be finite, the step > 0"
        )
    return float(value), float(step_s)


def _constants(cell: Cell, circuit: Circuit, factors: Factors, ambient_C: float) -> Array:
    return np.array(
        [
            circuit.capacity_C * factors.capacity,
            factors.resistance,
            factors.relaxation,
            factors.slowness,
            circuit.activation_K,
            circuit.reference_K,
            float(circuit.varies),
            circuit.hysteresis_rate,
            circuit.heat_capacity_J_per_K,
            circuit.thermal_resistance_K_per_W,
            ambient_C,
            cell.discharge_limit_A,
            cell.charge_limit_A,
            cell.voltage_min_V,
            cell.voltage_max_V,
        ]
    )


@lru_cache(maxsize=64)
def _integral_below(cell: Cell) -> Array:
    """Integral of the OCV from empty to each knot."""
    circuit = tabulate(cell)
    width, order = np.diff(circuit.knot)[:, None], np.arange(4, 0, -1)
    parts = np.sum(circuit.cubic * width**order / order, axis=1)
    below = np.concatenate([[0.0], np.cumsum(parts)])
    below.flags.writeable = False
    return below

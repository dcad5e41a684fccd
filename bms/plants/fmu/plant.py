r"""An FMU as a plant: finds the input that answers a demanded power, and reads what comes of it.

The loop asks for a power at the pack's terminals. An FMU that takes a current or a voltage is seen, for the
length of a step, as a source behind a resistance, whose voltage follows from what the FMU answered last:

.. math:: V_0 = V - R\,I, \qquad I\,(V_0 + R I) = P, \qquad I = \frac{2 P}{V_0 + \sqrt{V_0^2 + 4 R P}} .

With the resistance of the FMU's own circuit this is exact at the start of a step; with another one the power
is met but for the change of current times the error. A current or a power is held over the step. Under a
voltage the current moves meanwhile, so the voltage is set anew at every communication step, and the shorter
that is, the closer the power is followed. What is measured afterwards is the FMU's own answer, at the end of
the step; under a voltage, the mean of the currents at the ends of the communication steps.
"""

from __future__ import annotations

from dataclasses import replace
from math import isfinite, sqrt
from typing import final

from bms.measurement import Measurement
from bms.plants.fmu.channel import Channel
from bms.plants.fmu.errors import FmuCrash, FmuError
from bms.plants.fmu.roles import Place, Roles
from bms.plants.fmu.start import StartPoint


@final
class FmuPlant:
    """A realization of an FMU, see `bms.plants.Plant`; `bms.plants.fmu.session.FmuSession.start` makes it.

    Parameters
    ----------
    channel : Channel
        Started.
    roles : Roles
        What is driven and read.
    start : StartPoint
        Where the realization starts.
    resistance_ohm : float
        Of the pack.
    capacity_C : float or None
        Of the pack; counts the SOC where there is no output for it.
    """

    def __init__(
        self,
        channel: Channel,
        roles: Roles,
        start: StartPoint,
        resistance_ohm: float,
        capacity_C: float | None,
    ) -> None:
        self._advance = channel.step
        self._role = roles.role
        self._gain, self._shift = 1.0 / roles.drive.factor, -roles.drive.offset / roles.drive.factor
        self._voltage, self._current = _read(roles.voltage), _read(roles.current)
        self._temperature, self._soc_output = _read(roles.temperature), _read(roles.soc)
        self._resistance_ohm = resistance_ohm
        self._per_C = 1.0 / capacity_C if capacity_C is not None else 0.0
        self._unit_s = roles.wiring.step_s
        self._step_s = self._unit_s
        self._steps = 1
        self._soc = start.soc
        self._voltage_V, self._current_A = start.voltage_V, start.current_A
        self._temperature_C = start.temperature_C

    @property
    def soc(self) -> float:
        """True SOC now: the FMU's, or the one that was counted."""
        return self._soc

    @property
    def voltage_V(self) -> float:
        """Voltage at the pack's terminals at the end of the last step."""
        return self._voltage_V

    @property
    def current_A(self) -> float:
        """Current at the pack's terminals over the last step, > 0 charges; that of the start before."""
        return self._current_A

    @property
    def temperature_C(self) -> float | None:
        """Temperature; None where the FMU gives none."""
        return self._temperature_C

    def step(self, power_W: float, current_A: float, step_s: float) -> Measurement:
        """Carry a load over one step, see `bms.plants.Plant.step`; the current expected is not used.

        Raises
        ------
        FmuError
            When the step is no whole multiple of the communication step.
        FmuCrash
            When the FMU does not survive it.
        """
        if self._role == "power":
            return self._run(power_W, None, step_s)
        if self._role == "voltage":
            return self._follow(power_W, step_s)
        asked_A, withheld_W = self._current_for(power_W)
        return self._run(asked_A, withheld_W, step_s)

    def _current_for(self, power_W: float) -> tuple[float, float]:
        """The current that gives a power at the start of the step, and what the circuit cannot give."""
        ohm = self._resistance_ohm
        open_V = self._voltage_V - ohm * self._current_A
        inside = open_V * open_V + 4.0 * ohm * power_W
        if inside >= 0.0:
            return 2.0 * power_W / (open_V + sqrt(inside)), 0.0
        if not isfinite(inside):
            raise FmuError(f"the power is {power_W:g}; give a finite one")
        most_A = -0.5 * open_V / ohm
        return most_A, 0.5 * open_V * most_A - power_W

    def _follow(self, power_W: float, step_s: float) -> Measurement:
        """Set the voltage anew at every communication step, as the current moves under it."""
        if step_s != self._step_s:
            self._set_step(step_s)
        steps, charge_As, withheld_W = self._steps, 0.0, 0.0
        for _ in range(steps):
            asked_A, missing_W = self._current_for(power_W)
            voltage_V = self._voltage_V + self._resistance_ohm * (asked_A - self._current_A)
            seen = self._run(voltage_V, None, self._unit_s)
            charge_As += seen.current_A * self._unit_s
            withheld_W += missing_W / steps
        return replace(seen, current_A=charge_As / step_s, withheld_W=withheld_W)

    def carry(self, current_A: float, step_s: float) -> Measurement:
        """Carry a current over one step; exactly where the FMU takes a current, else as near as is known.

        Raises
        ------
        FmuError, FmuCrash
            As in `step`.
        """
        if self._role == "current":
            return self._run(current_A, None, step_s)
        voltage_V = self._voltage_V + self._resistance_ohm * (current_A - self._current_A)
        return self._run(voltage_V if self._role == "voltage" else voltage_V * current_A, None, step_s)

    def _run(self, asked: float, withheld_W: float | None, step_s: float) -> Measurement:
        """Hold the input, SI at the pack's terminals, over a step."""
        if step_s != self._step_s:
            self._set_step(step_s)
        if not isfinite(asked):
            raise FmuError(f"the load is {asked:g}; give a finite one")
        raw = self._advance(self._gain * asked + self._shift, self._steps)
        role = self._role
        at, factor, offset = self._voltage
        voltage_V = factor * raw[at] + offset if at >= 0 else asked
        if voltage_V <= 0.0:
            raise FmuCrash(
                f"the FMU's voltage is {voltage_V:g} V: it was discharged beyond empty, or [voltage] or its"
                " unit is wrong"
            )
        at, factor, offset = self._current
        if at >= 0:
            current_A = factor * raw[at] + offset
        else:
            current_A = asked if role == "current" else asked / voltage_V
        at, factor, offset = self._temperature
        temperature_C = factor * raw[at] + offset if at >= 0 else None
        at, factor, offset = self._soc_output
        if at >= 0:
            self._soc = factor * raw[at] + offset
        else:
            self._soc += current_A * step_s * self._per_C
        self._voltage_V, self._current_A, self._temperature_C = voltage_V, current_A, temperature_C
        return Measurement(current_A, None, voltage_V, temperature_C, withheld_W)

    def _set_step(self, step_s: float) -> None:
        steps = round(step_s / self._unit_s) if isfinite(step_s) else 0
        if steps < 1 or abs(steps * self._unit_s - step_s) > 1e-9 * step_s:
            raise FmuError(
                f"a step of {step_s:g} s is no whole multiple of the FMU's communication step, step_s ="
                f" {self._unit_s:g} in the mapping; change one of the two"
            )
        self._step_s, self._steps = step_s, steps

    def end(self) -> None:
        """Say that another realization runs in the FMU now; this one cannot go on."""
        self._advance = _ended


def _read(place: Place | None) -> tuple[int, float, float]:
    if place is None:
        return -1, 0.0, 0.0
    return place.at, place.conversion.factor, place.conversion.offset


def _ended(value: float, steps: int) -> tuple[float, ...]:
    raise FmuError("this realization has ended: another one was started in the same FMU, or it was closed")

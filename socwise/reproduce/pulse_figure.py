"""[M] Fig 26: a pulse test on the cell resting at 3.2 V, and the model that is found in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bms.cell import Cell
from bms.identify import Identification, identify_pulse
from bms.simulation import simulate
from socwise.figures.style import INK, LIMIT, finish
from socwise.reproduce.battery_case import TABLE_7, VOLTAGE_SD_V, battery_cell, generator
from socwise.reproduce.panels import COLORS, new_figure
from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import Progress
from socwise.reproduce.sources import mautc

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

REST_V, PULSE_A = 3.2, 4.0
PARTS = ((60, 0.0), (60, PULSE_A), (240, 0.0), (60, -PULSE_A), (240, 0.0))
"""Lengths in s and currents of the test, an own choice."""
BENCH_SD_V = 0.5 * VOLTAGE_SD_V
"""The report's noise is set to twice that of its test bench."""
TOLERANCE = 0.05
_LAG = (0.95, 1.05)
NOTE = (
    "The report tunes its model by hand to the pulses of a real cell, both only drawn. Here the cell of"
    f" Table 7 is simulated, with {1e3 * BENCH_SD_V:g} mV of noise on the voltage (what the report says of"
    " its bench), and the parameters are sought in the data: least squares by IPOPT with exact"
    f" derivatives, OCV and capacity known. Pulses of {PULSE_A:g} A for {PARTS[1][0]} s are an own choice."
)


@dataclass(frozen=True, eq=False)
class PulseTest:
    """A simulated pulse test and what was found in it.

    Parameters
    ----------
    time_s, current_A, voltage_V, true_V : ndarray, shape (n,)
        Samples; the last without noise.
    found : Identification
        Model with confidence intervals.
    """

    time_s: Array
    current_A: Array
    voltage_V: Array
    true_V: Array
    found: Identification


def pulse_test(cell: Cell, realization: int = 0) -> PulseTest:
    """Simulate the test on a cell that rests at 3.2 V, and identify it."""
    nodes = np.linspace(0.0, 1.0, 10_001)
    soc = float(np.interp(REST_V, cell.ocv(nodes), nodes))
    current_A = np.repeat([ampere for _, ampere in PARTS], [length for length, _ in PARTS])
    run = simulate(cell, current_A, 1.0, soc=soc)
    measured_V = run.voltage_V + BENCH_SD_V * generator(realization).standard_normal(current_A.size)
    found = identify_pulse(
        run.time_s, current_A, measured_V, capacity_Ah=cell.capacity_Ah, ocv=cell.ocv, soc=soc
    )
    return PulseTest(run.time_s, current_A, measured_V, run.voltage_V, found)


def reproduce(*, jobs: int = 2, progress: Progress | None = None) -> Reproduction:
    """Run the pulse test; ``jobs`` and ``progress`` are not used."""
    test = pulse_test(battery_cell())
    values, found = test.found.parameters, test.found
    ohm, seconds = values["relaxation_1_resistance_ohm"], values["relaxation_1_time_constant_s"]
    # The capacitance is a quotient: its relative variance follows from the covariance of the two logarithms.
    at = [found.names.index(f"relaxation_1_{name}") for name in ("resistance_ohm", "time_constant_s")]
    relative = np.array([-1.0 / ohm, 1.0 / seconds])
    share = float(np.sqrt(relative @ found.covariance[np.ix_(at, at)] @ relative))
    own = {
        "R": (values["resistance_ohm"], found.deviations["resistance_ohm"]),
        "R_r": (ohm, found.deviations["relaxation_1_resistance_ohm"]),
        "C_r": (seconds / ohm, share * seconds / ohm),
    }
    rows = [Row.near("voltage at rest", REST_V, float(test.true_V[0]), 1e-3, "V")]
    for p in TABLE_7[1:]:
        value, sd = own[p.symbol]
        true = p.scale * p.model
        name = f"{p.symbol} found in the pulse"
        rows.append(Row.near(name, true, p.scale * value, TOLERANCE * true, p.unit, p.scale * sd))
    rows.append(
        Row.between("residual, rms over the noise", *_LAG, found.residual_rms_V / BENCH_SD_V),
    )
    error = 1e3 * float(np.abs(found.voltage_V - test.true_V).max())
    rows.append(Row.between("model less cell without noise, largest", -np.inf, 1.0, error, "mV"))
    return Reproduction("mautc-fig26", mautc("Fig 26"), tuple(rows), NOTE, lambda: _draw(test))


def _draw(test: PulseTest) -> Figure:
    figure = new_figure(9.0, 5.2)
    current, voltage = figure.subplots(2, 1, sharex=True)
    current.plot(test.time_s, test.current_A, color=COLORS[1], drawstyle="steps-post")
    current.axhline(0.0, color=LIMIT, linewidth=0.6)
    current.set(ylabel="current [A],\n> 0 charges")
    voltage.plot(test.time_s, test.voltage_V, ".", color=LIMIT, markersize=2.5, label="cell, measured")
    voltage.plot(
        test.time_s, test.found.voltage_V, color=COLORS[0], linewidth=1.3, label="model that was found"
    )
    values = test.found.parameters
    text = (
        f"R = {1e3 * values['resistance_ohm']:.2f} mΩ\n"
        f"$R_r$ = {1e3 * values['relaxation_1_resistance_ohm']:.2f} mΩ\n"
        f"$τ$ = {values['relaxation_1_time_constant_s']:.1f} s"
    )
    voltage.text(0.75, 0.95, text, transform=voltage.transAxes, va="top", color=INK)
    voltage.set(xlabel="time [s]", ylabel="voltage [V]", xlim=(0.0, test.time_s[-1]))
    voltage.legend(loc="lower left", frameon=False)
    for ax in (current, voltage):
        finish(ax)
    figure.align_ylabels()
    return figure

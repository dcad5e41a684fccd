"""[M] Fig 25: slow charge and discharge, the open-circuit voltage between them, and its polynomial."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from bms.cell import Cell
from bms.errors import BatteryWarning
from bms.ocv_fit import OcvFit, SlowBranch, fit_ocv
from bms.ocv_polynomial import RANGE, OcvPolynomial, fit_polynomial_to_curve
from bms.simulation import simulate
from socwise.figures.style import BAND, INK, PERCENT, finish
from socwise.reproduce.battery_case import battery_cell
from socwise.reproduce.panels import COLORS, DASHED, new_figure
from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import Progress
from socwise.reproduce.sources import mautc

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

C_RATE, STEP_S = 0.1, 20.0
NOTE = (
    "The report cycles a real cell at 0.1C and gives no values. Here the cell of Table 7 is simulated so,"
    " with the OCV of the preset (electrode potentials of the literature), and no hysteresis, so the"
    " branches differ by the resistances alone. A polynomial of 6th order cannot follow a plateau"
    " everywhere: where it falls with SOC, two SOCs share a voltage. The monotone table is therefore the"
    " default; the polynomial is an option that warns. Inside 20 to 80 %, where the profile stays, it"
    " rises."
)
_RECOVERED_MV, _FIT_MV = 1.0, 2.0
_PUBLISHED_V = (2.2, 3.8)


@dataclass(frozen=True, eq=False)
class SlowTest:
    """Slow branches of a cell and what was made of them.

    Parameters
    ----------
    discharge, charge : SlowBranch
        Simulated at 0.1C.
    fit : OcvFit
        The open-circuit voltage between them.
    polynomial : OcvPolynomial
        Through it, over 10 to 90 %.
    """

    discharge: SlowBranch
    charge: SlowBranch
    fit: OcvFit
    polynomial: OcvPolynomial


def slow_test(cell: Cell) -> SlowTest:
    """Charge and discharge a cell with constant resistances at 0.1C and fit both curves."""
    current_A = C_RATE * cell.capacity_Ah
    discharge, charge = (_branch(cell, sign * current_A, start) for sign, start in ((-1.0, 1.0), (1.0, 0.0)))
    ohm = cast(float, cell.resistance_ohm) + sum(cast(float, p.resistance_ohm) for p in cell.relaxation)
    fit = fit_ocv(discharge, charge, resistance_ohm=ohm)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", BatteryWarning)
        polynomial = fit_polynomial_to_curve(fit.curve)
    return SlowTest(discharge, charge, fit, polynomial)


def _branch(cell: Cell, current_A: float, soc: float) -> SlowBranch:
    samples = round(3600.0 / C_RATE / STEP_S) + 1
    run = simulate(cell, np.full(samples, current_A), STEP_S, soc=soc)
    return SlowBranch(run.time_s, run.current_A, run.voltage_V)


def reproduce(*, jobs: int = 2, progress: Progress | None = None) -> Reproduction:
    """Run the slow test; ``jobs`` and ``progress`` are not used."""
    cell = battery_cell()
    test = slow_test(cell)
    soc = np.linspace(*RANGE, 801)
    recovered = 1e3 * float(np.abs(test.fit.curve(soc) - cell.ocv(soc)).max())
    inner = np.linspace(0.2, 0.8, 601)
    least = float(test.polynomial.slope_V(inner).min())
    apart = 1e3 * float(np.abs(test.polynomial(inner) - cell.ocv(inner)).max())
    falls = " and ".join(f"{PERCENT * a:.1f} to {PERCENT * b:.1f}" for a, b in test.polynomial.falls)
    monotone = np.diff(test.polynomial.to_curve(cell.ocv).voltage_V)
    rows = (
        Row.shown("voltage of the empty cell", float(cell.ocv(0.0)), "V", published=_PUBLISHED_V[0]),
        Row.shown("voltage of the full cell", float(cell.ocv(1.0)), "V", published=_PUBLISHED_V[1]),
        Row.between(
            "OCV between the branches less that of the cell, largest at 10 to 90 %",
            -np.inf,
            _RECOVERED_MV,
            recovered,
            "mV",
        ),
        Row.between(
            "polynomial less OCV, rms at 10 to 90 %", -np.inf, _FIT_MV, 1e3 * test.polynomial.rms_V, "mV"
        ),
        Row.shown("polynomial less OCV, largest at 20 to 80 %", apart, "mV"),
        Row.holds("polynomial rises at 20 to 80 %: least slope", least > 0.0, least, "V"),
        Row.shown("polynomial falls with SOC at", falls or "no SOC", "% SOC"),
        Row.holds(
            "its monotone table never falls: least rise", monotone.min() >= 0.0, float(monotone.min()), "V"
        ),
    )
    return Reproduction("mautc-fig25", mautc("Fig 25"), rows, NOTE, lambda: _draw(test))


def _draw(test: SlowTest) -> Figure:
    figure = new_figure(9.0, 3.8)
    whole, part = figure.subplots(1, 2)
    _draw_branches(whole, test)
    whole.set(xlabel="SOC [%]", ylabel="voltage [V]", xlim=(0.0, 100.0), title="full range")
    _draw_branches(part, test)
    soc = np.linspace(*RANGE, 401)
    part.plot(PERCENT * soc, test.fit.curve(soc), color=INK, linewidth=1.2, label="open circuit")
    part.plot(
        PERCENT * soc,
        test.polynomial(soc),
        color=COLORS[2],
        linewidth=1.4,
        linestyle=DASHED,
        label="polynomial, 6th order",
    )
    for place, (low, high) in enumerate(test.polynomial.falls):
        label = None if place else "polynomial falls"
        part.axvspan(PERCENT * low, PERCENT * high, color=BAND, zorder=0, label=label)
    low, high = (PERCENT * edge for edge in RANGE)
    part.set(xlabel="SOC [%]", ylabel="voltage [V]", xlim=(low, high), title="10 to 90 %")
    inside: NDArray[np.float64] = test.fit.curve(soc)
    part.set_ylim(float(inside.min()) - 0.02, float(inside.max()) + 0.02)
    for ax in (whole, part):
        ax.legend(loc="lower right", frameon=False)
        finish(ax)
    return figure


def _draw_branches(ax: Axes, test: SlowTest) -> None:
    for branch, start, color, label in (
        (test.charge, 0.0, COLORS[1], f"charge, {C_RATE:g}C"),
        (test.discharge, 1.0, COLORS[0], f"discharge, {C_RATE:g}C"),
    ):
        ax.plot(PERCENT * branch.soc_from(start), branch.voltage_V, color=color, linewidth=0.9, label=label)

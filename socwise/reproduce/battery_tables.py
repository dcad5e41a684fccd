"""[M] Tables 7 and 8: the cell, the first guesses and what becomes of them; the gains and their stability."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bms.estimators.gpc_gradient import Gains
from socwise.figures.style import LIMIT, finish
from socwise.reproduce.battery_case import (
    DAY_S,
    GAINS,
    SEED,
    SOC_GUESS,
    SOC_MODEL,
    TABLE_7,
    battery_cell,
    battery_profile,
    estimate,
    new_estimator,
)
from socwise.reproduce.gain_stability import SYMBOLS, Modes, modes_over_time
from socwise.reproduce.panels import COLORS, DASHED, new_figure
from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import Progress
from socwise.reproduce.sources import mautc

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TERMS = 3
TOLERANCE = 0.025
SOC_TOLERANCE = 0.005
NOTE_7 = (
    f"Estimates after 10 days at 1 s, N = {TERMS}, the estimator off for the first day, noise of 10 mA and"
    f" 2 mV, seed {SEED}; mautc-fig30 has 20 seeds and other N. The profile is that of mautc-fig28, the OCV"
    " that of the preset lfp-2ah; the report's own are not given."
)
NOTE_8 = (
    "The report gives no units: charge in coulomb, alpha in 1/C, x10 in C, one update a second"
    " (ERRATA.md); its Gamma_theta is that of beta. A gradient step theta - Gamma H (theta - theta*) is"
    " stable while the eigenvalues of Gamma H stay below 2, with H the forgetful sum of the products of"
    " the voltage's sensitivities. Eigenvalues are those at the true parameters along our profile, the"
    " sum begun at its start. Their inverses are the times in which the errors fall e-fold, in seconds."
)
_GAINS = {"alpha": 2e-14, "resistance": 1e-8, "beta": 1e-10, "xi": 1e-5, "x10": 100.0}
_NAMES = {"alpha": "α", "resistance": "R", "beta": "β", "xi": "ξ", "x10": "x10"}
_LIMIT = 2.0


def table7(*, jobs: int = 2, progress: Progress | None = None) -> Reproduction:
    """Compare model, guesses and final estimates; ``jobs`` and ``progress`` are not used."""
    cell, started = battery_cell(), new_estimator(battery_cell(), TERMS)
    pair = cell.relaxation[0]
    model = {
        "capacity_Ah": cell.capacity_Ah,
        "resistance_ohm": cell.resistance_ohm,
        "relaxation_capacitance_F": pair.capacitance_F,
        "relaxation_resistance_ohm": pair.resistance_ohm,
    }
    run, rows = estimate(TERMS), []
    for p in TABLE_7:
        own = float(model[p.name])  # type: ignore[arg-type]
        rows.append(Row.near(f"{p.symbol} of the model", p.scale * p.model, p.scale * own, 0.0, p.unit))
    rows.append(Row.near("SOC(0) of the model", SOC_MODEL, float(run.soc[0]), 0.0))
    for p in TABLE_7:
        own = started.parameters[p.name].value
        rows.append(Row.near(f"{p.symbol}, first guess", p.scale * p.guess, p.scale * own, 0.0, p.unit))
    rows.append(Row.near("SOC(0), first guess", SOC_GUESS, started.belief.mean, 0.0))
    for p in TABLE_7:
        true, own = p.scale * p.model, p.scale * float(run.trace.parameters[p.name][-1])
        name = f"{p.symbol}, estimate after 10 days, N = {TERMS}"
        rows.append(Row.near(name, true, own, TOLERANCE * true, p.unit))
    rows.append(
        Row.near("SOC, estimate after 10 days", float(run.soc[-1]), float(run.trace.soc[-1]), SOC_TOLERANCE)
    )
    return Reproduction("mautc-table7", mautc("Table 7"), tuple(rows), NOTE_7)


def table8(*, jobs: int = 2, progress: Progress | None = None) -> Reproduction:
    """Compare the gains and check their stability; ``jobs`` and ``progress`` are not used."""
    defaults = Gains()
    rows = [_gain(name, published, getattr(defaults, name)) for name, published in _GAINS.items()]
    modes = modes_over_time(battery_cell(), battery_profile(), GAINS)
    largest = float(modes.eigenvalue.max())
    rows += [
        Row.holds(f"largest eigenvalue of a step, stable below {_LIMIT:g}", largest < _LIMIT, largest),
        Row.shown("gains may grow by the factor", _LIMIT / largest),
    ]
    at = modes.time_s.size - 1
    for mode in range(modes.eigenvalue.shape[1]):
        name = f"time constant after 10 days of the mode that {SYMBOLS[modes.leading[at, mode]]} leads"
        rows.append(Row.shown(name, 1.0 / float(modes.eigenvalue[at, mode]) / 3600.0, "h"))
    return Reproduction("mautc-table8", mautc("Table 8"), tuple(rows), NOTE_8, lambda: _draw(modes))


def _gain(name: str, published: float, own: float) -> Row:
    """Compare a gain as it is, and show it with its power of ten for a unit: small numbers look like zero."""
    power = math.floor(math.log10(published))
    size, unit = 10.0**power, f"1e{power}" if power else ""
    return Row(f"gain of {_NAMES[name]}", published / size, own / size, 0.0, own == published, unit)


def _draw(modes: Modes) -> Figure:
    figure = new_figure(7.0, 3.6)
    ax = figure.subplots()
    colors = (*COLORS, "#CC79A7", "#56B4E9")
    days = modes.time_s / DAY_S
    for mode, color in enumerate(colors[: modes.eigenvalue.shape[1]]):
        label = f"{SYMBOLS[modes.leading[-1, mode]]} leads"
        ax.plot(days, modes.eigenvalue[:, mode], color=color, label=label)
    ax.axhline(_LIMIT, color=LIMIT, linewidth=0.9, linestyle=DASHED, label="unstable above")
    ax.set_yscale("log")
    ax.set(xlabel="time since the sum began [days]", ylabel="eigenvalue of Γ H [-]", xlim=(0.0, days[-1]))
    figure.legend(loc="outside lower center", ncols=6, frameon=False)
    finish(ax)
    return figure

"""[L] Fig 1: voltage over SOC of a Li-ion battery, here of both packs as a share of their nominal voltage."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from bms import Pack
from ems.concept import load_concept
from socwise.figures.style import finish
from socwise.reproduce.panels import COLORS, DASHED, new_figure
from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import Progress
from socwise.reproduce.sources import CONCEPTS, larsson

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NOMINAL_V = {"hev": 192.0, "phev": 305.0}
NOTE = (
    "The paper draws the curve without giving values. The rows hold what it says about it: almost flat in the"
    " middle, steep at low and high SOC. Both packs have the same curve per nominal voltage, an own choice."
)
_MIDDLE, _LOW, _HIGH = (0.3, 0.7), (0.0, 0.1), (0.9, 1.0)
_POINTS = 1001


def reproduce(*, jobs: int = 2, progress: Progress | None = None) -> Reproduction:
    """Check the shape of both curves; ``jobs`` and ``progress`` are not used."""
    packs = {name: load_concept(name).load_pack() for name in CONCEPTS}
    rows = [row for name, pack in packs.items() for row in _rows(name, pack)]
    return Reproduction("larsson-fig1", larsson("Fig 1"), tuple(rows), NOTE, lambda: _draw(packs))


def mean_slope(pack: Pack, nominal_V: float, stretch: tuple[float, float]) -> float:
    """Mean slope of the open-circuit voltage over a stretch of SOC, in nominal voltages per unit of SOC."""
    low, high = stretch
    return float(pack.ocv(high) - pack.ocv(low)) / (nominal_V * (high - low))


def _rows(name: str, pack: Pack) -> list[Row]:
    nominal, who = NOMINAL_V[name], name.upper()
    flat, low, high = (mean_slope(pack, nominal, stretch) for stretch in (_MIDDLE, _LOW, _HIGH))
    rise = float(np.diff(pack.ocv(np.linspace(0.0, 1.0, _POINTS))).min())
    half = float(pack.ocv(0.5)) / nominal
    return [
        Row.near(f"{who}: voltage at 50 % SOC over nominal voltage", 1.0, half, 0.005),
        Row.holds(f"{who}: voltage rises everywhere, least rise over 0.1 % SOC", rise > 0.0, rise, "V"),
        Row.between(f"{who}: slope at 0 to 10 % SOC over slope at 30 to 70 %", 5.0, np.inf, low / flat),
        Row.between(f"{who}: slope at 90 to 100 % SOC over slope at 30 to 70 %", 3.0, np.inf, high / flat),
    ]


def _draw(packs: Mapping[str, Pack]) -> Figure:
    figure = new_figure(6.0, 3.6)
    ax = figure.subplots()
    soc = np.linspace(0.0, 1.0, _POINTS)
    looks = ((2.6, "solid"), (1.4, DASHED))
    for (name, pack), color, (width, line) in zip(packs.items(), COLORS, looks, strict=False):
        nominal = NOMINAL_V[name]
        label = f"{name.upper()}, {nominal:g} V nominal"
        ax.plot(
            100.0 * soc, pack.ocv(soc) / nominal, color=color, linewidth=width, linestyle=line, label=label
        )
    ax.set(xlabel="SOC [%]", ylabel="open-circuit voltage / nominal [-]", xlim=(0.0, 100.0))
    ax.legend(loc="lower right", frameon=False)
    finish(ax)
    return figure

"""[M] Figs 32 and 33: the degradation map, and a hundred days of a cell that fades by it."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

from bms.degradation import DegradationMap
from bms.errors import BatteryWarning
from bms.fade_laws import CalendarFade, CycleFade, FadeLaws
from bms.plot_degradation import plot_degradation_map
from socwise.figures.style import INK, LIMIT, PERCENT, draw, finish
from socwise.reproduce.battery_case import DAY_S, TABLE_7, battery_cell
from socwise.reproduce.fade_map import TEMPERATURE_C, WEAR, fade_map
from socwise.reproduce.lifetime import Lifetime, live
from socwise.reproduce.panels import COLORS, DASHED, legend_below, new_figure
from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import Progress
from socwise.reproduce.sources import mautc

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DAYS, OFF_DAYS, SETTLED_DAY = 100.0, 10.0, 14.0
ACCELERATION = 3.0
CAPACITY_PERCENT, RESISTANCE_PERCENT, SOC_PERCENT = 0.5, 1.0, 0.5
NOTE_32 = (
    "The report's map is drawn only, over current and voltage. Ours adds the laws of Wang et al. 2011"
    " (cycling, with the single B of C/2) and Swierczynski et al. 2015 (calendar), both measured on A123"
    f" 26650 cells, at 25 degC, linearised at {100 * WEAR.cycle:g} % of cycling and {100 * WEAR.calendar:g}"
    " % of calendar fade. The first two rows check the laws themselves."
)
NOTE_33 = (
    "N = 3, first guesses of Table 7, gains of Table 8, noise of 10 mA and 2 mV, the estimator off for 10"
    f" days. Drawn with an ageing clock that runs {ACCELERATION:g} times faster than the profile; the rows"
    " hold the real rate as well. Only the capacity fades, as in the report. Errors lag behind the fade"
    " because lambda remembers 28 hours: they grow with the acceleration."
)
_WANG_AH, _CALENDAR_PERCENT = 17_825.0, 2.45


def figure32(*, jobs: int = 2, progress: Progress | None = None) -> Reproduction:
    """Tabulate the map; ``jobs`` and ``progress`` are not used."""
    known = fade_map()
    fade = known.capacity_fade_per_s[:, :, 0]
    rows = (
        *_law_rows(),
        Row.holds(
            "the rate rises with current: least rise",
            np.diff(fade, axis=0).min() > 0.0,
            np.diff(fade, axis=0).min(),
            "1/s",
        ),
        Row.holds(
            "the rate rises with SOC: least rise",
            np.diff(fade, axis=1).min() > 0.0,
            np.diff(fade, axis=1).min(),
            "1/s",
        ),
        Row.between(
            "table over laws half-way between its nodes, largest deviation",
            -np.inf,
            2.0,
            _table_error(known),
            "%",
        ),
        *(
            Row.shown(
                f"fade at {current:g} A, 50 % SOC",
                PERCENT * DAY_S * float(known.rates_per_s(current, 0.5, TEMPERATURE_C)[0]),
                "%/day",
            )
            for current in (0.0, 2.0, 4.0)
        ),
    )
    return Reproduction("mautc-fig32", mautc("Fig 32"), rows, NOTE_32, lambda: _draw32(known))


def _law_rows() -> tuple[Row, Row]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", BatteryWarning)
        table = CycleFade.with_table_of_paper()
    throughput = float(table.throughput_Ah(0.20, 1.0, TEMPERATURE_C))
    calendar = PERCENT * float(CalendarFade().fade(12.0, 0.5, TEMPERATURE_C))
    return (
        _check("Wang: throughput to 20 % at 1C, 25 degC, the paper's B", _WANG_AH, throughput, 1.0, "Ah"),
        _check(
            "Swierczynski: fade after 12 months at 50 %, 25 degC", _CALENDAR_PERCENT, calendar, 0.005, "%"
        ),
    )


def _check(name: str, known: float, own: float, tolerance: float, unit: str) -> Row:
    """Compare with a value worked out by hand from a paper's formula, which the report does not publish."""
    return Row(f"{name}, by hand: {known:g}", None, own, tolerance, abs(own - known) <= tolerance, unit)


def _table_error(known: DegradationMap) -> float:
    """Largest deviation of the map from its laws in the middle of its meshes, in per cent."""
    current, soc = np.meshgrid(
        0.5 * (known.current_A[:-1] + known.current_A[1:]),
        0.5 * (known.soc[:-1] + known.soc[1:]),
        indexing="ij",
    )
    exact, _ = FadeLaws().rates_per_s(
        current, soc, TEMPERATURE_C, capacity_Ah=battery_cell().capacity_Ah, wear=WEAR
    )
    return float(PERCENT * np.abs(known.rates_per_s(current, soc, TEMPERATURE_C)[0] / exact - 1.0).max())


def figure33(
    *, jobs: int = 2, progress: Progress | None = None, days: float = DAYS, off_days: float = OFF_DAYS
) -> Reproduction:
    """Live a hundred days, at the drawn and at the real rate of ageing; ``jobs`` is not used."""
    settled_s = (off_days + SETTLED_DAY - OFF_DAYS) * DAY_S
    drawn = live(days, off_days, fade_map(), acceleration=ACCELERATION, progress=progress)
    real = live(days, off_days, fade_map(), progress=progress)
    rows = [row for life in (drawn, real) for row in _life_rows(life, settled_s)]
    return Reproduction("mautc-fig33", mautc("Fig 33"), tuple(rows), NOTE_33, lambda: _draw33(drawn))


def _life_rows(life: Lifetime, settled_s: float) -> list[Row]:
    who = "real rate" if life.acceleration == 1.0 else f"ageing accelerated {life.acceleration:g} times"
    since = f"from day {settled_s / DAY_S:g} on"
    capacity = life.capacity_error_percent(settled_s)
    resistance = float(np.abs(life.resistance_error_percent(settled_s)).max())
    late = life.time_s >= settled_s
    soc = PERCENT * float(np.abs(life.soc_estimate[late] - life.soc[late]).max())
    lost = PERCENT * float(1.0 - life.capacity_Ah[-1] / life.capacity_Ah[0])
    limited = (
        (f"largest error of Q {since}", CAPACITY_PERCENT, float(np.abs(capacity).max()), "%"),
        (f"largest error of R {since}", RESISTANCE_PERCENT, resistance, "%"),
        (f"largest error of the SOC {since}", SOC_PERCENT, soc, "% SOC"),
    )
    return [
        Row.shown(f"{who}: capacity lost in {life.time_s[-1] / DAY_S:.0f} days", lost, "%"),
        *(Row.between(f"{who}: {name}", -np.inf, limit, own, unit) for name, limit, own, unit in limited),
        Row.shown(f"{who}: mean error of Q {since}", float(capacity.mean()), "%"),
    ]


def _draw32(known: DegradationMap) -> Figure:
    figure = new_figure(6.4, 5.0)
    ax = figure.add_subplot(projection="3d")
    plot_degradation_map(known, ax)
    ax.view_init(elev=25.0, azim=-125.0)
    return figure


def _draw33(life: Lifetime) -> Figure:
    figure = new_figure(9.0, 5.6)
    panels = figure.subplots(2, 1, sharex=True)
    days = life.time_s / DAY_S
    truths = (life.capacity_Ah, np.full_like(days, TABLE_7[1].scale * TABLE_7[1].model))
    for ax, parameter, truth in zip(panels, TABLE_7, truths, strict=False):
        values = parameter.scale * life.estimates[parameter.name]
        draw(ax, days, values, color=COLORS[0], linewidth=1.1, label="estimate, N = 3")
        ax.plot(days, truth, color=INK, linewidth=1.0, linestyle=DASHED, label="true")
        ax.axvline(life.off_s / DAY_S, color=LIMIT, linewidth=0.8, linestyle=(0, (2, 2)), label="switched on")
        ax.set(ylabel=f"{parameter.symbol} [{parameter.unit}]", xlim=(0.0, days[-1]))
        finish(ax)
    panels[0].set_title(f"ageing accelerated {life.acceleration:g} times")
    panels[-1].set_xlabel("time [days]")
    figure.align_ylabels()
    legend_below(figure, list(panels))
    return figure

"""[M] Figs 34 to 49: speed over time at four locations, at the mean and for five draws, two diagrams."""

from __future__ import annotations

import math
from functools import lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from socwise.figures.style import finish
from socwise.reproduce.panels import COLORS, DASHED, new_figure
from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import Progress
from socwise.reproduce.sources import mautc
from socwise.reproduce.traffic_case import (
    DEMAND_PER_S,
    DURATION_S,
    GREENSHIELDS,
    HOUR_S,
    JAM_PER_MILE,
    LOCATIONS_MILE,
    SPEED_MPH,
    STEP_S,
    UNDERWOOD,
    diagram,
    parameters,
    run,
)
from socwise.reproduce.traffic_draws import report_draws

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

SCENARIOS, SD = 5, 3.0
TOLERANCE_MPH, ONSET_MPH = 1e-3, 1.0
TIMES_S = tuple(float(t) for t in np.arange(0.0, DURATION_S + STEP_S, STEP_S))
SHOWN_S = (150, 300)
NOTES = {
    (GREENSHIELDS, False): (
        "Report's scheme and cells; below capacity it is Godunov's. The report draws only. In the steady"
        " state the flow is the demand: the speed solves v (1 - v/vf) kj = q; falls are counted towards it."
    ),
    (GREENSHIELDS, True): (
        "Report's scheme and cells, and its own first five draws, as its tables tell them. Time of the fall:"
        " when the speed is 1 mph below the free one. 'At the same time for all scenarios' at locations 1 to"
        " 3 does not quite hold: a front travels at a speed near vf, so the times part in proportion to"
        " distance."
    ),
    (UNDERWOOD, False): (
        "The capacity, 1380 veh/h, is below the demand. Under the report's scheme cell 1 jams at 14 s, what"
        " is ahead of it drains and drives at free flow; Godunov's scheme lets in what there is room for and"
        " fills the road at capacity. The report's 'marginally different from Greenshields' holds of neither."
    ),
    (UNDERWOOD, True): (
        "As mautc-fig42 to fig45, for the report's first five draws. Its 'similar to each other"
        " at all four locations' holds of their shape, a dip that travels; depth and time differ."
    ),
}


@lru_cache(maxsize=2)
def _mean_speeds(kind: str) -> tuple[Array, Array]:
    """Run the means by both schemes: speeds in mph, shape (301, 4)."""
    density = 0.0 if kind == UNDERWOOD else JAM_PER_MILE
    values = np.array([[SPEED_MPH, density]])
    first, second = (run(kind, values, TIMES_S, scheme)[..., 0] for scheme in ("report", "godunov"))
    return first, second


@lru_cache(maxsize=2)
def _drawn_speeds(kind: str) -> Array:
    """Run five draws: speeds in mph, shape (301, 4, 5)."""
    values, _ = parameters(kind, SD, report_draws(SCENARIOS))
    return run(kind, values, TIMES_S)


def _figure(number: int, *, jobs: int = 2, progress: Progress | None = None) -> Reproduction:
    """Reproduce a figure; ``jobs`` and ``progress`` are not used."""
    kind = GREENSHIELDS if number < 42 else UNDERWOOD
    at, drawn = (number - 34) % 4, (number - 34) // 4 % 2 == 1
    rows = _drawn_rows(kind, at) if drawn else _mean_rows(kind, at)
    place = mautc(f"Fig {number} ({kind}, location {at + 1} at {LOCATIONS_MILE[at]:g} mile)")
    return Reproduction(
        f"mautc-fig{number}", place, tuple(rows), NOTES[kind, drawn], lambda: _draw(kind, at, drawn)
    )


def _mean_rows(kind: str, at: int) -> list[Row]:
    report, godunov = _mean_speeds(kind)
    rows = [Row.holds("speed at the start is free", report[0, at] == SPEED_MPH, float(report[0, at]), "mph")]
    rows += [Row.shown(f"speed at {t} s", float(report[t, at]), "mph") for t in SHOWN_S]
    if kind == UNDERWOOD:
        rows += [Row.shown(f"speed at {t} s, Godunov", float(godunov[t, at]), "mph") for t in SHOWN_S]
        capacity = HOUR_S * diagram(kind).capacity_per_s
        rows.append(
            Row.holds("capacity is below the demand", capacity < HOUR_S * DEMAND_PER_S, capacity, "veh/h")
        )
        return rows
    apart = float(np.abs(report[:, at] - godunov[:, at]).max())
    rows.append(Row.between("largest difference between the schemes", -math.inf, 1e-9, apart, "mph"))
    share = 4.0 * HOUR_S * DEMAND_PER_S / (SPEED_MPH * JAM_PER_MILE)
    steady = 0.5 * SPEED_MPH * (1.0 + math.sqrt(1.0 - share))
    name = f"speed at 300 s over the steady state's {steady:.4f}"
    passed = float(report[-1, at]) - steady
    rows.append(Row.between(name, -TOLERANCE_MPH, SPEED_MPH - steady, passed, "mph"))
    times = [_fall_s(report[:, k], steady) for k in range(at + 1)]
    name = "the fall from 10 to 50 % is slower than at the location before"
    rows.append(Row.holds(name, times == sorted(set(times)), times[-1], "s"))
    return rows


def _drawn_rows(kind: str, at: int) -> list[Row]:
    speed = _drawn_speeds(kind)[:, at]
    ends = speed[0]
    rows = [
        Row.shown(f"spread of the speed (s) at {t} s", float(speed[t].std(ddof=1)), "mph")
        for t in (1, *SHOWN_S)
    ]
    rows.append(
        Row.holds(
            "all scenarios start at their free-flow speeds and fall: least fall",
            float((ends - speed.min(axis=0)).min()) > 0.0,
            float((ends - speed.min(axis=0)).min()),
            "mph",
        )
    )
    times = [_onset_s(column) for column in speed.T]
    rows.append(Row.shown("earliest time of the fall", min(times), "s"))
    rows.append(Row.shown("latest time of the fall", max(times), "s"))
    if kind == GREENSHIELDS:
        apart = [_apart_s(_drawn_speeds(kind)[:, k]) for k in range(at + 1)]
        name = "times of the fall part more than at the location before"
        rows.append(Row.holds(name, apart == sorted(set(apart)), apart[-1], "s"))
    return rows


def _crossing(speed: Array, level: float) -> float:
    """Time at which a speed first falls to a level."""
    after = int(np.argmax(speed <= level))
    part = (speed[after - 1] - level) / (speed[after - 1] - speed[after])
    return float(TIMES_S[after - 1] + part * STEP_S)


def _fall_s(speed: Array, steady: float) -> float:
    """Time from 10 to 50 % of the fall to the steady state."""
    levels = (speed[0] - share * (speed[0] - steady) for share in (0.1, 0.5))
    first, second = (_crossing(speed, level) for level in levels)
    return second - first


def _onset_s(speed: Array) -> float:
    """Time at which a speed has fallen by 1 mph."""
    return _crossing(speed, float(speed[0]) - ONSET_MPH)


def _apart_s(speeds: Array) -> float:
    """Time between the first and the last onset of scenarios, shape (times, scenarios)."""
    return float(np.ptp([_onset_s(column) for column in speeds.T]))


def _draw(kind: str, at: int, drawn: bool) -> Figure:
    figure = new_figure(6.4, 3.6)
    ax = figure.subplots()
    if drawn:
        for k, column in enumerate(_drawn_speeds(kind)[:, at].T):
            ax.plot(TIMES_S, column, color=COLORS[k % 3], linewidth=1.2, alpha=1.0 if k < 3 else 0.55)
    else:
        report, godunov = _mean_speeds(kind)
        ax.plot(TIMES_S, report[:, at], color=COLORS[0], linewidth=1.4, label="report's scheme")
        if kind == UNDERWOOD:
            ax.plot(
                TIMES_S, godunov[:, at], color=COLORS[1], linewidth=1.4, linestyle=DASHED, label="Godunov"
            )
        ax.legend(frameon=False)
    ax.set(xlabel="time [s]", ylabel="speed [mph]", xlim=(0.0, DURATION_S))
    ax.set_title(f"{kind}, {LOCATIONS_MILE[at]:g} mile" + (f", {SCENARIOS} draws" if drawn else ""))
    return finish(ax).figure  # type: ignore[return-value]


figure34, figure35, figure36, figure37 = (partial(_figure, number) for number in range(34, 38))
figure38, figure39, figure40, figure41 = (partial(_figure, number) for number in range(38, 42))
figure42, figure43, figure44, figure45 = (partial(_figure, number) for number in range(42, 46))
figure46, figure47, figure48, figure49 = (partial(_figure, number) for number in range(46, 50))

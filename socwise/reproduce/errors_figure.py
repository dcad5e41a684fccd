"""[M] Fig 31: the error of the SOC and of the voltage over ten days, with three terms."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from socwise.figures.style import BAND, LIMIT, PERCENT, draw, finish
from socwise.reproduce.battery_case import (
    CURRENT_SD_A,
    DAY_S,
    OFF_DAYS,
    SOC_GUESS,
    SOC_MODEL,
    TABLE_7,
    VOLTAGE_SD_V,
    Estimated,
    estimate,
)
from socwise.reproduce.estimates_figure import SOC_PERCENT, TRANSIENT_S
from socwise.reproduce.panels import COLORS, DASHED, new_figure
from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import Progress
from socwise.reproduce.sources import mautc

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TERMS, EVERY = 3, 20
HOUR_S, HALF_HOUR_S = 3600.0, 1800.0
_LEAST_MV = 0.2
NOTE = (
    "The run of mautc-table7. The residual is the measured less the expected voltage, before the sample"
    " was used. Its floor is the noise of the voltage and what that of the current makes of it through R:"
    " 2.002 mV."
)
NOISE_V = float(np.hypot(VOLTAGE_SD_V, TABLE_7[1].model * CURRENT_SD_A))


def reproduce(*, jobs: int = 2, progress: Progress | None = None) -> Reproduction:
    """Estimate ten days; ``jobs`` and ``progress`` are not used."""
    run = estimate(TERMS, every=EVERY)
    time_s, error = run.trace.time_s, PERCENT * np.abs(run.soc_error)
    on_s = OFF_DAYS * DAY_S
    before = float(error[(time_s > on_s - HOUR_S) & (time_s <= on_s)].max())
    after = float(error[(time_s > on_s) & (time_s <= on_s + HOUR_S)][-1])
    first, last = residual_rms(run, 0.0, on_s), residual_rms(run, time_s[-1] - DAY_S, time_s[-1])
    rows = (
        Row.near(
            "error of the SOC at the start", PERCENT * (SOC_MODEL - SOC_GUESS), float(error[0]), 0.01, "% SOC"
        ),
        Row.holds(
            "the error of the SOC drops at once: an hour after switching on over the largest of that before",
            after < 0.5 * before,
            after / before,
        ),
        Row.between(
            f"largest error of the SOC from day {TRANSIENT_S / DAY_S:g} on",
            -np.inf,
            SOC_PERCENT,
            PERCENT * run.worst_soc_error(TRANSIENT_S),
            "% SOC",
        ),
        Row.shown(
            "largest error of the SOC on the last day", PERCENT * run.worst_soc_error(9.0 * DAY_S), "% SOC"
        ),
        Row.shown("residual before switching on, rms", 1e3 * first, "mV"),
        Row.between("residual on the last day, rms over the noise", 0.95, 1.05, last / NOISE_V),
    )
    return Reproduction("mautc-fig31", mautc("Fig 31"), rows, NOTE, lambda: _draw(run))


def residual_rms(run: Estimated, from_s: float, until_s: float) -> float:
    """Root of the mean square of the residuals in a stretch of time, V."""
    inside = (run.trace.time_s > from_s) & (run.trace.time_s <= until_s)
    return float(np.sqrt(np.mean(np.square(run.trace.residual_V[inside]))))


def _draw(run: Estimated) -> Figure:
    figure = new_figure(9.0, 5.2)
    soc, voltage = figure.subplots(2, 1, sharex=True)
    days = run.trace.time_s / DAY_S
    draw(soc, days, PERCENT * run.soc_error, color=COLORS[0], linewidth=0.8)
    soc.set(ylabel="SOC estimate − true\n[% SOC]")
    size = np.maximum(1e3 * np.abs(run.trace.residual_V), _LEAST_MV)
    draw(voltage, days, size, color=BAND, linewidth=0.4, label="every 20 s")
    ends = np.arange(HALF_HOUR_S, run.trace.time_s[-1], HALF_HOUR_S)
    rms = [1e3 * residual_rms(run, end - HALF_HOUR_S, end) for end in ends]
    voltage.plot(ends / DAY_S, rms, color=COLORS[1], linewidth=1.1, label="rms of half hours")
    voltage.axhline(1e3 * NOISE_V, color=LIMIT, linewidth=1.0, linestyle=DASHED, label="noise, one sd")
    voltage.set(xlabel="time [days]", ylabel="|voltage residual| [mV]", xlim=(0.0, days[-1]))
    voltage.set_yscale("log")
    voltage.set_ylim(bottom=_LEAST_MV)
    voltage.legend(loc="upper right", frameon=False, ncols=3)
    for ax in (soc, voltage):
        ax.axvline(OFF_DAYS, color=LIMIT, linewidth=0.8, linestyle=(0, (2, 2)))
        finish(ax)
    figure.align_ylabels()
    return figure

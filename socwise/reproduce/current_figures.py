"""[M] Figs 27 and 28: the PHEV's cell current on FTP-72, and the cycling profile that is made of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bms.cycling import CyclingProfile
from socwise.figures.style import LIMIT, PERCENT, draw, finish
from socwise.reproduce.battery_case import battery_cell, battery_profile
from socwise.reproduce.panels import COLORS, DASHED, new_figure
from socwise.reproduce.phev_current import LAPS, PhevTrip, phev_trip
from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import Progress
from socwise.reproduce.sources import mautc

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NOTE = (
    "The report's power-split car and its policy are not given. Here it is the PHEV of Larsson et al. with"
    f" the certainty-equivalent policy on FTP-72 driven {LAPS} times, without noise; the picture shows the"
    " first lap. The cell's current is the pack's, scaled on energy to the report's pack of 16 kWh (ours"
    " holds 8), so that the C-rates are those of the larger pack."
)
HOURS_S = 36_000.0
LOW, HIGH, CHARGE_A = 0.2, 0.8, 2.0
_KMH_PER_MPS, _HOUR_S = 3.6, 3600.0


def figure27(*, jobs: int = 2, progress: Progress | None = None) -> Reproduction:
    """Drive the PHEV; ``jobs`` and ``progress`` are not used."""
    capacity_Ah = battery_cell().capacity_Ah
    trip = phev_trip(capacity_Ah)
    current_A = trip.current_A
    discharged = float(-current_A[current_A < 0.0].sum())
    regenerated = float(current_A[current_A > 0.0].sum())
    used = (discharged - regenerated) / (_HOUR_S * capacity_Ah)
    rows = (
        Row.near("FTP-72: duration", 1369.0, float(trip.time_s[-1] - trip.time_s[0]), 0.0, "s"),
        Row.near("FTP-72: distance", 11.99, trip.distance_m / 1e3, 0.01, "km"),
        Row.holds(
            "the current is dominantly negative: charge in over charge out",
            used > 0.0,
            regenerated / discharged,
        ),
        Row.holds(
            "there are positive spikes: largest charging current", current_A.max() > 0.0, current_A.max(), "A"
        ),
        Row.shown("largest discharging current", float(-current_A.min()), "A"),
        Row.shown("SOC that a lap uses", PERCENT * used, "%"),
        Row.holds(
            "the trip blends fuel and battery: share of time with the engine running",
            trip.engine_share > 0.0 and trip.soc[1] < trip.soc[0],
            PERCENT * trip.engine_share,
            "%",
        ),
        Row.shown("fuel of the trip", trip.fuel_l_per_100km, "l/100 km"),
        Row.shown("SOC of the pack at the end of the trip", PERCENT * trip.soc[1], "%"),
    )
    return Reproduction("mautc-fig27", mautc("Fig 27"), rows, NOTE, lambda: _draw27(trip))


def figure28(*, jobs: int = 2, progress: Progress | None = None) -> Reproduction:
    """Cycle the cell for ten hours; ``jobs`` and ``progress`` are not used."""
    profile = battery_profile(HOURS_S)
    charging = profile.current_A[_charging(profile)]
    sample = float(np.abs(profile.current_A).max()) / (_HOUR_S * battery_cell().capacity_Ah)
    rows = (
        Row.between("cycles in 10 hours; the report: nearly three", 2.5, 3.0, cycles(profile)),
        Row.near("lowest SOC", PERCENT * LOW, PERCENT * float(profile.soc.min()), PERCENT * sample, "%"),
        Row.near("highest SOC", PERCENT * HIGH, PERCENT * float(profile.soc.max()), PERCENT * sample, "%"),
        Row.near("least charging current", CHARGE_A, float(charging.min()), 0.0, "A"),
        Row.near("largest charging current", CHARGE_A, float(charging.max()), 0.0, "A"),
    )
    return Reproduction("mautc-fig28", mautc("Fig 28"), rows, NOTE, lambda: _draw28(profile))


def cycles(profile: CyclingProfile) -> float:
    """Full charge and discharge cycles that the length of a profile holds."""
    ends = np.flatnonzero(np.diff(_charging(profile).astype(np.int8)) < 0)
    return float(profile.current_A.size / np.diff(ends).mean())


def _charging(profile: CyclingProfile) -> NDArray[np.bool_]:
    """Samples of the charge: runs at exactly its current."""
    return np.asarray(profile.current_A == CHARGE_A)


def _draw27(trip: PhevTrip) -> Figure:
    figure = new_figure(9.0, 5.2)
    speed, current = figure.subplots(2, 1, sharex=True)
    time_s = trip.time_s - trip.time_s[0]
    speed.plot(time_s, _KMH_PER_MPS * trip.speed_mps, color=COLORS[0], linewidth=1.0)
    speed.set(ylabel="speed [km/h]", title="FTP-72")
    current.plot(time_s[:-1], trip.current_A, color=COLORS[1], linewidth=0.7, drawstyle="steps-post")
    current.axhline(0.0, color=LIMIT, linewidth=0.6)
    current.set(xlabel="time [s]", ylabel="cell current [A],\n> 0 charges", xlim=(0.0, time_s[-1]))
    for ax in (speed, current):
        finish(ax)
    figure.align_ylabels()
    return figure


def _draw28(profile: CyclingProfile) -> Figure:
    figure = new_figure(9.0, 5.2)
    current, soc = figure.subplots(2, 1, sharex=True)
    hours = profile.time_s / _HOUR_S
    draw(current, hours, profile.current_A, color=COLORS[1], linewidth=0.4)
    current.axhline(0.0, color=LIMIT, linewidth=0.6)
    current.set(ylabel="cell current [A],\n> 0 charges")
    draw(soc, hours, PERCENT * profile.soc, color=COLORS[0], linewidth=1.2)
    for limit in (LOW, HIGH):
        soc.axhline(PERCENT * limit, color=LIMIT, linewidth=0.9, linestyle=DASHED)
    soc.set(xlabel="time [h]", ylabel="SOC [%]", xlim=(0.0, HOURS_S / _HOUR_S), ylim=(0.0, 100.0))
    for ax in (current, soc):
        finish(ax)
    figure.align_ylabels()
    return figure

"""[M] Fig 50: errors of 5 antithetic against 100 plain runs; beside them 9 runs of a polynomial chaos."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drivecycles.traffic.distributions import TruncatedNormal
from drivecycles.traffic.uncertainty import Spread, propagate
from socwise.figures.style import finish
from socwise.reproduce.panels import COLORS, new_figure
from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import Progress
from socwise.reproduce.sources import mautc
from socwise.reproduce.traffic_case import (
    CELLS,
    DEMAND_PER_S,
    DURATION_S,
    GREENSHIELDS,
    JAM_PER_MILE,
    MILE,
    MPH,
    SPEED_MPH,
    STEP_S,
    TIMES_S,
    diagram,
    pair_error,
    pair_means,
    plain_speeds,
    road,
    sample_error,
)
from socwise.reproduce.traffic_published import PUBLISHED, SIZES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

CHAOS_RUNS, ANTITHETIC_RUNS, REFERENCE_RUNS, REPEATS = 9, 100, 256, 100
KINK_SD, KINK_S, KINK_SOBOL, KINK_REFERENCE = 6.0, 600.0, 16, 2**13
KINK_CELLS, KINK_REPEATS = (1, 6, 11, 26), 20
SDS = (3.0, 6.0, 10.0)
SHARE = 0.1
GREENSHIELDS_TABLES = (13, 14, 15, 16)
NOTE = (
    "The report: 5 antithetic runs have errors of 10 % of those of 100 plain ones. That holds in 5 of its own"
    " 16 Greenshields entries (rounded to whole per cent). A chaos of order 2 takes 9 runs: its true error,"
    f" against a Gauss grid of {REFERENCE_RUNS} runs, over the root mean square true error of"
    f" {ANTITHETIC_RUNS} antithetic runs in {REPEATS} repeats, worst of 4 locations and 2 times; Godunov's"
    " scheme, independent normal parameters cut at 4 standard deviations. With the demand at the mean"
    " capacity half of the members are congested, the speed has a kink: 9 runs of chaos no longer"
    " match 100 antithetic ones, and its median is worse than that of as many Sobol' runs."
)


def reproduce(*, jobs: int = 2, progress: Progress | None = None) -> Reproduction:
    """Count, and compare the chaos; ``jobs`` is not used."""
    published, ours = _shares()
    rows = [
        Row.near(
            "Greenshields entries where 5 antithetic are at most 10 % of 100 plain, as printed, of 16",
            5.0,
            float(np.sum(np.round(published, 2) <= SHARE)),
            0.0,
        ),
        Row.near("the same of ours", 5.0, float(np.sum(np.round(ours, 2) <= SHARE)), 0.0),
        Row.holds(
            "antithetic errors at equal runs are smaller in every entry: largest ratio, as printed",
            _equal_runs() < 1.0,
            _equal_runs(),
        ),
    ]
    for done, sd in enumerate(SDS):
        chaos, antithetic = chaos_against_antithetic(sd)
        name = (
            f"sd {sd:g}: true error of {CHAOS_RUNS} runs of chaos over that of {ANTITHETIC_RUNS} antithetic"
        )
        rows.append(Row.between(name, -math.inf, 1.0, float((chaos / antithetic).max())))
        if progress is not None:
            progress(done + 1, len(SDS))
    rows += _kink_rows()
    return Reproduction("mautc-fig50", mautc("Fig 50"), tuple(rows), NOTE, _draw)


def _shares() -> tuple[Array, Array]:
    """Errors of 5 antithetic over those of 100 plain runs, as printed and ours, shape (16,)."""
    published, ours = [], []
    for number in GREENSHIELDS_TABLES:
        antithetic, plain = PUBLISHED[number]
        published.append(np.array(antithetic[0]) / np.array(plain[-1]))
        sd, at = (6.0 if number < 15 else 10.0), (1 if number % 2 else 2)
        few = pair_error(pair_means(GREENSHIELDS, sd)[0][at], SIZES[0])
        many = sample_error(plain_speeds(GREENSHIELDS, sd)[0][at], SIZES[-1])
        ours.append(few / many)
    return np.concatenate(published), np.concatenate(ours)


def _equal_runs() -> float:
    """Give the largest ratio of antithetic to plain errors at the same number of runs, as printed."""
    tables = [PUBLISHED[number] for number in GREENSHIELDS_TABLES]
    return float(max(np.max(np.array(a) / np.array(b)) for a, b in tables))


def _kink_rows() -> list[Row]:
    """Compare where the demand is the mean capacity."""
    exact = spread(KINK_SD, "sobol", KINK_REFERENCE, seed=1, kink=True)
    tasks = (
        ("mean", "gpc", CHAOS_RUNS, 1),
        ("mean", "sobol", KINK_SOBOL, REPEATS),
        ("mean", "antithetic", ANTITHETIC_RUNS, REPEATS),
        ("median", "gpc", REFERENCE_RUNS, 1),
        ("median", "sobol", REFERENCE_RUNS, KINK_REPEATS),
    )
    rows = []
    for what, method, runs, repeats in tasks:
        found = [
            _centre(spread(KINK_SD, method, runs, seed, kink=True), what) - _centre(exact, what)
            for seed in range(repeats)
        ]
        error = float(np.sqrt(np.mean(np.square(found), axis=0)).max()) / MPH
        name = f"demand at the mean capacity: true error of the {what}, {runs} runs, {method}"
        rows.append(Row.shown(name, error, "mph"))
    return rows


def _centre(found: Spread, what: str) -> Array:
    return found.mean if what == "mean" else found.quantiles[found.quantile_levels.index(0.5)]


def spread(sd: float, method: str, runs: int, seed: int = 0, *, kink: bool = False) -> Spread:
    """Propagate uncertain Greenshields parameters over the report's road by Godunov's scheme.

    Parameters
    ----------
    sd : float
        Of the free-flow speed in mph and of the jam density in 1/mile.
    method : str
        One of `drivecycles.traffic.uncertainty.METHODS`.
    runs, seed : int
        Number of model runs, seed of the design.
    kink : bool
        Whether the demand is the mean capacity, and the end 600 s.
    """
    known_diagram = diagram(GREENSHIELDS)
    order = math.isqrt(runs) - 1 if method == "gpc" else None
    known = {
        "free_flow_mps": TruncatedNormal(SPEED_MPH * MPH, sd * MPH),
        "jam_per_m": TruncatedNormal(JAM_PER_MILE / MILE, sd / MILE),
    }
    return propagate(
        road(), known_diagram, known, demand=known_diagram.capacity_per_s if kink else DEMAND_PER_S,
        duration_s=KINK_S if kink else DURATION_S, step_s=STEP_S, method=method, runs=runs, order=order,
        seed=seed, time_s=[KINK_S] if kink else TIMES_S[1:], cells=KINK_CELLS if kink else CELLS,
    )  # fmt: skip


def chaos_against_antithetic(sd: float) -> tuple[Array, Array]:
    """Compare true errors of the mean speed, in mph, shape (2, 4): of the chaos, and of antithetic runs."""
    exact = spread(sd, "gpc", REFERENCE_RUNS).mean
    chaos = np.abs(spread(sd, "gpc", CHAOS_RUNS).mean - exact) / MPH
    repeats = [spread(sd, "antithetic", ANTITHETIC_RUNS, seed).mean - exact for seed in range(REPEATS)]
    return chaos, np.sqrt(np.mean(np.square(repeats), axis=0)) / MPH


def _draw() -> Figure:
    figure = new_figure(7.2, 3.6)
    panels = figure.subplots(1, 2, sharey=True)
    for ax, number in zip(panels, (13, 16), strict=True):
        antithetic, plain = PUBLISHED[number]
        sd, at = (6.0 if number < 15 else 10.0), (1 if number % 2 else 2)
        few = pair_error(pair_means(GREENSHIELDS, sd)[0][at], SIZES[0])
        many = sample_error(plain_speeds(GREENSHIELDS, sd)[0][at], SIZES[-1])
        place = np.arange(4.0)
        bars = (
            (antithetic[0], COLORS[0], "5 antithetic, published"),
            (few, "#9CC6E0", "5 antithetic, ours"),
            (plain[-1], COLORS[1], "100 plain, published"),
            (many, "#EFC0A0", "100 plain, ours"),
        )
        for k, (height, color, label) in enumerate(bars):
            ax.bar(place + 0.2 * (k - 1.5), height, 0.2, color=color, label=label)
        ax.set(xlabel=f"location (Table {number}, sd {sd:g})", xticks=place)
        ax.set_xticklabels([f"L{k + 1}" for k in range(4)])
        finish(ax)
    panels[0].set(ylabel="error [mph]")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    return figure

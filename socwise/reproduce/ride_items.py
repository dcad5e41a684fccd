"""[M] Tables 3 and 4 and Figs 7 to 14: mass, inertias and CG height from bounce, pitch and roll."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from socwise.figures.inertia import QUANTITIES, method_label, plot_quantity
from socwise.inertia import InertiaRun, Spread, spread
from socwise.reproduce.panels import legend_below, new_figure
from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import Progress
from socwise.reproduce.sources import mautc
from socwise.reproduce.vehicle_case import (
    INPUTS_NOISY,
    NOISY,
    QUIET,
    RIDE_NOISE_SD,
    RIDE_SCENARIO,
    RIDE_SEEDS,
    Runs,
    drives,
)
from vehicle.inertia.filters import WIDENING
from vehicle.inertia.synthetic import SAMPLE_S

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MEAN_PERCENT, EVERY_PERCENT = 0.3, 2.5
BIAS_PERCENT = {"mass_kg": 2.0, "roll_inertia_kgm2": 5.0}
QUIET_PERCENT = 0.5
QUIET_SEEDS, INPUT_SEEDS = 5, 20
PUBLISHED_WIDENING = (1 / 2000, 1 / 2000, 1 / 1000, 1 / 2000)
NAMES = ("mass_kg", "pitch_inertia_kgm2", "roll_inertia_kgm2", "cg_height_m")
_FIGURES = {
    **dict(zip((7, 8, 9, 10), ("cg_height_m", *NAMES[:3]), strict=True)),
    **dict(zip((11, 12, 13, 14), ("cg_height_m", *NAMES[:3]), strict=True)),
}
_METHODS = ("gpc", "gpc-report", "rls-force", "rls-acceleration", "ekf", "ukf")
_VEHICLE = (
    f"Vehicle, road ({RIDE_SCENARIO}, ISO 8608) and manoeuvres are ours, 300 s at 100 Hz: the report gives"
    " none of"
    " them. The forces are dynamic, because eq 31 has no gravity."
)


def table3(*, jobs: int = 2, progress: Progress | None = None, seeds: int = QUIET_SEEDS) -> Reproduction:
    """Compare the settings without sensor noise, and what comes of them."""
    found = drives(("ride",), RIDE_SCENARIO, QUIET, seeds, jobs=jobs, progress=progress)
    rows = _settings(0.01, QUIET)
    for name in NAMES:
        rows.append(_at_most("gpc", found, name, "worst", QUIET_PERCENT))
    rows += _shown(found, ("gpc-report", "rls-force", "rls-acceleration", "ekf", "ukf"))
    note = (
        f"{seeds} drives without sensor noise. {_VEHICLE} gPC-EKF is the filter with a germ for each"
        " parameter and"
        " noise carried beside the chaos; 'report' is the literal one, whose coefficients the table gives:"
        " its"
        " parameters are widened at each step for good, so they keep wandering, and the report says too that"
        " RLS"
        " does better without noise."
    )
    return Reproduction("mautc-table3", mautc("Table 3"), tuple(rows), note)


def table4(
    *,
    jobs: int = 2,
    progress: Progress | None = None,
    seeds: int = RIDE_SEEDS,
    input_seeds: int = INPUT_SEEDS,
) -> Reproduction:
    """Compare the settings with sensor noise, and what comes of them."""
    total = seeds + input_seeds
    options = {"jobs": jobs, "progress": progress, "total": total}
    found = drives(("ride",), RIDE_SCENARIO, NOISY, seeds, **options)  # type: ignore[arg-type]
    disturbed = drives(
        ("ride",), RIDE_SCENARIO, INPUTS_NOISY, input_seeds, before=seeds, **options  # type: ignore[arg-type]
    )  # fmt: skip
    rows = _settings(0.1, NOISY)
    for name in NAMES:
        rows.append(_at_most("gpc", found, name, "mean", MEAN_PERCENT))
        rows.append(_at_most("gpc", found, name, "worst", EVERY_PERCENT))
    for name, least in BIAS_PERCENT.items():
        size = abs(100.0 * _spread(found, "rls-force", name).mean)
        label = f"{method_label('rls-force')}, {QUANTITIES[name][0]}: mean error, size"
        rows.append(Row.between(label, least, np.inf, size, "%"))
    rows += _shown(found, ("gpc-report", "rls-force", "rls-acceleration", "ekf", "ukf"))
    rows += _shown(disturbed, _METHODS, "noise on A_x and A_y too, ")
    note = (
        f"{seeds} drives with white noise of variance 0.1 on bounce, pitch and roll acceleration;"
        f" {input_seeds} with"
        f" as much on A_x and A_y, which biases every method. {_VEHICLE} RLS in the force form (force ="
        " parameter"
        " times noisy acceleration) is biased, in the acceleration form it is as good as any filter: the"
        " report does"
        " not say which it used, and its verdict on RLS holds for the force form alone."
    )
    return Reproduction("mautc-table4", mautc("Table 4"), tuple(rows), note)


def figure(
    number: int,
    *,
    jobs: int = 2,
    progress: Progress | None = None,
    seeds: int | None = None,
) -> Reproduction:
    """Reproduce one of Figs 7 to 10, without noise, or 11 to 14, with it: a parameter over time."""
    name, sensors = _FIGURES[number], QUIET if number <= 10 else NOISY
    count = seeds or (QUIET_SEEDS if sensors == QUIET else RIDE_SEEDS)
    found = drives(("ride",), RIDE_SCENARIO, sensors, count, jobs=jobs, progress=progress)
    if sensors == QUIET:
        rows = [_at_most("gpc", found, name, "worst", QUIET_PERCENT)]
    else:
        rows = [
            _at_most("gpc", found, name, "mean", MEAN_PERCENT),
            _at_most("gpc", found, name, "worst", EVERY_PERCENT),
        ]
    for method in _METHODS[1:]:
        label = f"{method_label(method)}: mean error"
        rows.append(Row.shown(label, 100.0 * _spread(found, method, name).mean, "%"))
    with_it = "without sensor noise" if sensors == QUIET else "with noise of variance 0.1"
    note = f"{count} drives {with_it}; the picture shows the first. {_VEHICLE}"
    drawn = [found["ride", method][0] for method in ("gpc", "gpc-report", "rls-force", "rls-acceleration")]
    place = f"Fig {number}"
    return Reproduction(f"mautc-fig{number}", mautc(place), tuple(rows), note, lambda: draw(drawn, name))


figure7, figure8, figure9, figure10, figure11, figure12, figure13, figure14 = (
    partial(figure, number) for number in range(7, 15)
)


def draw(runs: list[InertiaRun], name: str) -> Figure:
    """Draw one quantity of several runs."""
    picture = new_figure(7.5, 3.8)
    ax = plot_quantity(runs, name, picture.subplots())
    legend_below(picture, [ax], columns=3)
    return picture


def _settings(noise_variance: float, sensors: str) -> list[Row]:
    rows = [
        Row.near("polynomial order", 2.0, 2.0, 0.0),
        Row.shown("Q; 15 is the least for 15 terms (ERRATA.md)", 15.0, published=4.0),
        Row.near("time step", 0.01, SAMPLE_S, 0.0, "s"),
        Row.near("R", noise_variance, RIDE_NOISE_SD[sensors] ** 2, 1e-12),
    ]
    pairs = zip(PUBLISHED_WIDENING, WIDENING, strict=True)
    return rows + [
        Row.near(f"c_{k} of the report's filter", 1e3 * published, 1e3 * own, 0.0, "1e-3")
        for k, (published, own) in enumerate(pairs, 1)
    ]


def _spread(found: Runs, method: str, name: str) -> Spread:
    known = spread(found["ride", method], name)
    if known is None:
        raise ValueError(f"the truth of {name} is not known")
    return known


def _at_most(method: str, found: Runs, name: str, what: str, limit: float) -> Row:
    one = _spread(found, method, name)
    words = {"mean": "mean error, size", "worst": "largest error"}[what]
    label = f"{method_label(method)}, {QUANTITIES[name][0]}: {words}"
    return Row.between(label, -np.inf, limit, abs(100.0 * getattr(one, what)), "%")


def _shown(found: Runs, methods: tuple[str, ...], before: str = "") -> list[Row]:
    return [
        Row.shown(
            f"{before}{method_label(method)}, {QUANTITIES[name][0]}: mean error",
            100.0 * _spread(found, method, name).mean,
            "%",
        )
        for method in methods
        for name in NAMES
    ]

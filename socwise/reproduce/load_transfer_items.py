"""[M] Tables 5 and 6 and Figs 17 to 22: mass and centre of gravity from the loads of the four struts."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from socwise.figures.inertia import QUANTITIES, method_label
from socwise.figures.style import INK, finish
from socwise.inertia import Spread, honesty, spread
from socwise.reproduce.panels import COLORS, DASHED, legend_below, new_figure
from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import Progress
from socwise.reproduce.sources import mautc
from socwise.reproduce.vehicle_case import ROAD, ROAD_GAIN, ROAD_METHODS, ROAD_SEEDS, Runs, drives

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MODELS = ("ltm", "mltm")
MASS, FRONT, LEFT = "mass_kg", "cg_from_front_m", "cg_from_left_m"
TRUTH = {MASS: 1873.0, FRONT: 1.4266, LEFT: 0.8867}
"""What Tables 5 and 6 imply by estimates and errors (ERRATA)."""
NOISE_PERCENT = {
    "ltm": {MASS: 0.2, FRONT: 2.0},
    "mltm": {MASS: 0.2, FRONT: 0.5, LEFT: 0.5},
}
GAIN_PERCENT = {"ltm": {MASS: 1.3, FRONT: 1.6, LEFT: 1.3}, "mltm": {MASS: 1.3, FRONT: 1.0, LEFT: 1.3}}
PUBLISHED: dict[str, dict[str, dict[str, tuple[float, float]]]] = {
    "urban": {
        "ltm": {MASS: (1891.0, 0.96), FRONT: (1.412, 1.02), LEFT: (0.895, 0.93)},
        "mltm": {MASS: (1891.0, 0.96), FRONT: (1.415, 0.81), LEFT: (0.8934, 0.75)},
    },
    "rural": {
        "ltm": {MASS: (1920.0, 2.51), FRONT: (1.412, 1.02), LEFT: (0.8743, 1.4)},
        "mltm": {MASS: (1919.0, 2.46), FRONT: (1.417, 0.67), LEFT: (0.8761, 1.2)},
    },
}
"""Estimate, and error in per cent; the report prints 2.57 for what its own figures make 2.51 (ERRATA)."""
_FIGURES = {
    17: ("urban", MASS),
    18: ("urban", LEFT),
    19: ("urban", FRONT),
    20: ("rural", MASS),
    21: ("rural", LEFT),
    22: ("rural", FRONT),
}
_VEHICLE = (
    "Its logs are not public: the vehicle is the synthetic Defender with the truth that Tables 5 and 6 imply,"
    " road"
    " and manoeuvres are ours, 300 s a drive."
)


def table(
    scenario: str, *, jobs: int = 2, progress: Progress | None = None, seeds: int = ROAD_SEEDS
) -> Reproduction:
    """Compare errors on the road with those of the synthetic vehicle, with and without gain errors."""
    options = {"jobs": jobs, "progress": progress, "total": 2 * seeds}
    noise = drives(MODELS, scenario, ROAD, seeds, **options)  # type: ignore[arg-type]
    gain = drives(MODELS, scenario, ROAD_GAIN, seeds, before=seeds, **options)  # type: ignore[arg-type]
    rows = [row for model in MODELS for row in _rows(scenario, model, noise, gain)]
    number = {"urban": 5, "rural": 6}[scenario]
    note = (
        f"{seeds} drives. {_VEHICLE} Published are the errors of one drive each; ours hold the error that 95"
        " % of the"
        " drives stay below, with noise on every channel and a gain error of 1 % (one standard deviation) on"
        " each"
        " strut, which is what the errors come from: with noise alone they are far smaller. C is not"
        " identifiable:"
        " its standard deviation holds that nobody knows how high the drag acts."
    )
    return Reproduction(f"mautc-table{number}", mautc(f"Table {number}"), tuple(rows), note)


table5, table6 = partial(table, "urban"), partial(table, "rural")


def figure(
    number: int, *, jobs: int = 2, progress: Progress | None = None, seeds: int = ROAD_SEEDS
) -> Reproduction:
    """Reproduce one of Figs 17 to 22: mass or position of the centre of gravity over time, by both models."""
    scenario, name = _FIGURES[number]
    gain = drives(MODELS, scenario, ROAD_GAIN, seeds, jobs=jobs, progress=progress)
    rows = [_with_gain(scenario, model, name, gain) for model in MODELS]
    for model in MODELS:
        first = gain[model, "gpc"][0].estimate
        settled = first.settled_s[first.names.index(name)]
        rows.append(Row.shown(f"{model.upper()}: within 2 % of its end for good after", float(settled), "s"))
    note = (
        f"{seeds} drives with 1 % gain error; the picture shows the first ± 2 standard deviations. {_VEHICLE}"
    )
    place = mautc(f"Fig {number}")
    return Reproduction(f"mautc-fig{number}", place, tuple(rows), note, lambda: _draw(gain, name))


figure17, figure18, figure19, figure20, figure21, figure22 = (partial(figure, n) for n in range(17, 23))


def _rows(scenario: str, model: str, noise: Runs, gain: Runs) -> list[Row]:
    rows = []
    for name, (estimate, _) in PUBLISHED[scenario][model].items():
        implied = 100.0 * abs(estimate / TRUTH[name] - 1.0)
        rows.append(
            Row.near(
                f"{_what(model, name)}: published error",
                _published(scenario, model, name),
                implied,
                0.06,
                "%",
            )
        )
        limit = NOISE_PERCENT[model].get(name)
        quiet = 100.0 * _spread(noise, model, name).worst
        label = f"{_what(model, name)}: largest error with noise only"
        if limit is None:
            rows.append(Row.shown(label, quiet, "%"))
        else:
            rows.append(Row.between(label, -np.inf, limit, quiet, "%"))
        rows.append(_with_gain(scenario, model, name, gain))
        for method in ROAD_METHODS[1:]:
            other = f"{_what(model, name)}: error of 95 % of runs, {method_label(method)}"
            rows.append(Row.shown(other, 100.0 * _spread(gain, model, name, method).p95, "%"))
    drag = _spread(gain, model, "drag_kgpm")
    rows.append(
        Row.shown(f"{model.upper()}, C, not identifiable: claimed sd, of the truth", 100.0 * drag.sd, "%")
    )
    rows.append(Row.shown(f"{model.upper()}, C, not identifiable: rms error", 100.0 * drag.rms, "%"))
    judged = honesty(gain[model, "gpc"])
    if judged is not None:
        rows.append(
            Row.shown(
                f"{model.upper()}: mean NEES, gains allowed for, band up to {judged.high:.2f}", judged.mean
            )
        )
    return rows


def _with_gain(scenario: str, model: str, name: str, gain: Runs) -> Row:
    return Row.between(
        f"{_what(model, name)}: error of 95 % of runs",
        -np.inf,
        GAIN_PERCENT[model][name],
        100.0 * _spread(gain, model, name).p95,
        "%",
        published=_published(scenario, model, name),
    )


def _published(scenario: str, model: str, name: str) -> float:
    return PUBLISHED[scenario][model][name][1]


def _what(model: str, name: str) -> str:
    return f"{model.upper()}, {QUANTITIES[name][0]}"


def _spread(found: Runs, model: str, name: str, method: str = "gpc") -> Spread:
    known = spread(found[model, method], name)
    if known is None:
        raise ValueError(f"the truth of {name} is not known")
    return known


def _draw(gain: Runs, name: str) -> Figure:
    picture = new_figure(7.5, 3.8)
    ax = picture.subplots()
    for model, color in zip(MODELS, COLORS, strict=False):
        one = gain[model, "gpc"][0].estimate
        values, sds = one.column(name)
        ax.fill_between(
            one.time_s, values - 2.0 * sds, values + 2.0 * sds, color=color, alpha=0.18, linewidth=0
        )
        ax.plot(one.time_s, values, color=color, linewidth=1.1, label=f"{model.upper()} ± 2 sd")
    words, unit = QUANTITIES[name]
    true = TRUTH[name]
    ax.axhline(true, color=INK, linewidth=0.9, linestyle=DASHED, label="true")
    ax.set(
        xlabel="time [s]",
        ylabel=f"{words} [{unit}]",
        xlim=(0.0, one.time_s[-1]),
        ylim=(0.96 * true, 1.04 * true),
    )
    finish(ax)
    legend_below(picture, [ax])
    return picture

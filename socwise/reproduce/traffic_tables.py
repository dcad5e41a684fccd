"""[M] Tables 9 to 20: means and errors of the speed, plain and antithetic samples of uncertain diagrams."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import Progress
from socwise.reproduce.sources import mautc
from socwise.reproduce.traffic_case import (
    GREENSHIELDS,
    JAM_PER_MILE,
    SAMPLES,
    TIMES_S,
    UNDERWOOD,
    matched_draws,
    pair_error,
    pair_means,
    plain_speeds,
    sample_error,
)
from socwise.reproduce.traffic_published import PUBLISHED, SIZES

Array = NDArray[np.float64]

MEAN_MPH, ERROR_SHARE = 0.02, 0.02
PLAIN_SHARE, FACTOR, NEGLIGIBLE_MPH = 0.10, 3.0, 1e-3
RANGE, MOST_BEYOND, BEYOND = (0.5, 99.5), 2.0, ": published beyond"
TABLES: dict[int, tuple[str, float, int]] = {
    9: (GREENSHIELDS, 3.0, 0),
    10: (GREENSHIELDS, 3.0, 2),
    11: (UNDERWOOD, 3.0, 0),
    12: (UNDERWOOD, 3.0, 2),
    13: (GREENSHIELDS, 6.0, 1),
    14: (GREENSHIELDS, 6.0, 2),
    15: (GREENSHIELDS, 10.0, 1),
    16: (GREENSHIELDS, 10.0, 2),
    17: (UNDERWOOD, 6.0, 1),
    18: (UNDERWOOD, 6.0, 2),
    19: (UNDERWOOD, 10.0, 1),
    20: (UNDERWOOD, 10.0, 2),
}
"""Diagram, standard deviation in mph and 1/mile, and time of each table."""
_DRAWS = (
    f"Report's scheme and cells. Medians over {SAMPLES} samples of nested draws with the moments that Tables"
    " 9 and 10 tell (free-flow speed: mean and error at 1 s; density of plain samples: mean speed at L1 after"
    " 300 s, met by construction in Table 10); the report's own draws are unknown. Error: s/sqrt(n)."
)
_PAIRS = (
    f" Antithetic: n runs are n/2 pairs, error s(pair means)/sqrt(n/2), right within a factor of {FACTOR:g};"
    f" plain within {100 * PLAIN_SHARE:g} %. Single draws rule what differs more: the central 99 %"
    f" of our samples is given, and at most {MOST_BEYOND:g} entries of a table may lie beyond. Negligible:"
    " below 0.001 mph."
)
_UNDERWOOD = (
    " Underwood's capacity, 1380 veh/h, is below the demand of 2400: under the report's scheme cell 1 jams"
    " and the road behind it empties, so L1 to L3 drive at free flow after 300 s. Godunov's scheme gives 36,"
    " 40 and 52 mph there."
)


def _table(number: int, *, jobs: int = 2, progress: Progress | None = None) -> Reproduction:
    """Reproduce a table; ``jobs`` and ``progress`` are not used."""
    kind, sd, at = TABLES[number]
    speed, truncated = plain_speeds(kind, sd)
    drawn = speed[0, 0].size
    if number < 13:
        rows = _moments(number, speed[at])
    else:
        pairs, more = pair_means(kind, sd)
        rows = _errors(number, speed[at], pairs[at])
        truncated, drawn = truncated + more, drawn + 2 * pairs[0, 0].size
    if number == 10:
        rows += [_jam_mean(size) for size in SIZES]
    rows.append(Row.shown(f"draws truncated, of {drawn}", float(truncated)))
    note = _DRAWS + (_PAIRS if number >= 13 else "") + (_UNDERWOOD if kind == UNDERWOOD else "")
    place = mautc(f"Table {number} (t = {TIMES_S[at]:g} s, sd {sd:g}, {kind})")
    return Reproduction(f"mautc-table{number}", place, tuple(rows), note)


def _moments(number: int, speed: Array) -> list[Row]:
    """Compare errors and means of the first numbers of scenarios; speeds of shape (4, samples, 100)."""
    errors, means = PUBLISHED[number]
    rows = []
    for published, row in zip(errors, SIZES, strict=True):
        ours = np.median(sample_error(speed, row), axis=-1)
        rows += [
            Row.near(f"error, n = {row}, L{k + 1}", value, float(ours[k]), ERROR_SHARE * value, "mph")
            for k, value in enumerate(published)
        ]
    for published, row in zip(means, SIZES, strict=True):
        ours = np.median(speed[..., :row].mean(axis=-1), axis=-1)
        rows += [
            Row.near(f"mean, n = {row}, L{k + 1}", value, float(ours[k]), MEAN_MPH, "mph")
            for k, value in enumerate(published)
        ]
    return rows


def _errors(number: int, speed: Array, pairs: Array) -> list[Row]:
    """Compare the errors of antithetic and of plain samples."""
    antithetic, plain = PUBLISHED[number]
    rows = []
    for published, size in zip(antithetic, SIZES, strict=True):
        ours = pair_error(pairs, size)
        rows += [
            _judged(f"antithetic, n = {size}, L{k + 1}", value, ours[k], _within_factor)
            for k, value in enumerate(published)
        ]
    for published, size in zip(plain, SIZES, strict=True):
        ours = sample_error(speed, size)
        rows += [
            _judged(f"plain, n = {size}, L{k + 1}", value, ours[k], _within_share)
            for k, value in enumerate(published)
        ]
    beyond = float(sum(row.name.endswith(BEYOND) for row in rows))
    return [*rows, Row.between(f"entries{BEYOND}, of {len(rows)}", -math.inf, MOST_BEYOND, beyond)]


def _within_factor(published: float, ours: float) -> bool:
    return published / FACTOR <= ours <= FACTOR * published


def _within_share(published: float, ours: float) -> bool:
    return abs(ours - published) <= PLAIN_SHARE * published


def _judged(name: str, published: float, ours: Array, rule: Callable[[float, float], bool]) -> Row:
    """Judge the median over samples, and where it is out, whether a sample of ours could have given it."""
    middle = float(np.median(ours))
    if math.isnan(published):
        return Row.holds(f"{name}, negligible", middle < NEGLIGIBLE_MPH, middle, "mph")
    if rule(published, middle):
        return Row.holds(name, True, middle, "mph", published=published)
    low, high = np.percentile(ours, RANGE)
    where = "" if low <= published <= high else BEYOND
    name = f"{name}, 99 % of samples {low:.3g} to {high:.3g}{where}"
    return Row.shown(name, middle, "mph", published=published)


def _jam_mean(size: int) -> Row:
    """Show the mean of the jam density that Table 10 tells, with how many standard errors it is off."""
    shift = float(matched_draws()[:, :size, 1].mean())
    name = f"mean jam density that L1 tells, n = {size}: {shift * math.sqrt(size):+.1f} standard errors"
    return Row.shown(name, JAM_PER_MILE + 3.0 * shift, "1/mile")


table9, table10, table11, table12 = (partial(_table, number) for number in range(9, 13))
table13, table14, table15, table16 = (partial(_table, number) for number in range(13, 17))
table17, table18, table19, table20 = (partial(_table, number) for number in range(17, 21))

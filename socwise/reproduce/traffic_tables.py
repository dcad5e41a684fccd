"""[M] Tables 9 to 20: means and errors of the speed, plain and antithetic samples of uncertain diagrams."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import Progress
from socwise.reproduce.sources import mautc
from socwise.reproduce.traffic_case import (
    GREENSHIELDS,
    TIMES_S,
    UNDERWOOD,
    pair_error,
    pair_means,
    plain_speeds,
    sample_error,
)
from socwise.reproduce.traffic_published import PUBLISHED, SIZES

Array = NDArray[np.float64]

MEAN_MPH, ERROR_SHARE = 0.001, 0.0005
PAIR_SHARE, PAIR_MPH, NEGLIGIBLE_MPH = 0.01, 3e-4, 1e-3
"""Differences in antithetic errors, small ones themselves, are of the size of the report's rounding."""
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
    "Report's scheme and cells, and its own draws, which it does not name: its entries for five scenarios"
    " tell them, and they are those of Microsoft's rand() from the start, by Box-Muller with pi as 3.14."
    " Error: s/sqrt(n)."
)
_PAIRS = (
    " Antithetic: n runs are n/2 pairs, rounded up, of a draw and its mirror image, error"
    f" s(pair means)/sqrt(pairs). Negligible: below {NEGLIGIBLE_MPH:g} mph."
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
    rows.append(Row.shown(f"draws truncated, of {drawn}", float(truncated)))
    note = _DRAWS + (_PAIRS if number >= 13 else "") + (_UNDERWOOD if kind == UNDERWOOD else "")
    place = mautc(f"Table {number} (t = {TIMES_S[at]:g} s, sd {sd:g}, {kind})")
    return Reproduction(f"mautc-table{number}", place, tuple(rows), note)


def _moments(number: int, speed: Array) -> list[Row]:
    """Compare errors and means of the first numbers of scenarios; speeds of shape (4, 100)."""
    errors, means = PUBLISHED[number]
    rows = []
    for published, size in zip(errors, SIZES, strict=True):
        ours = sample_error(speed, size)
        rows += [_error(f"error, n = {size}, L{k + 1}", value, ours[k]) for k, value in enumerate(published)]
    for published, size in zip(means, SIZES, strict=True):
        ours = speed[:, :size].mean(axis=-1)
        rows += [
            Row.near(f"mean, n = {size}, L{k + 1}", value, float(ours[k]), MEAN_MPH, "mph")
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
            _pair_error(f"antithetic, n = {size}, L{k + 1}", value, ours[k])
            for k, value in enumerate(published)
        ]
    for published, size in zip(plain, SIZES, strict=True):
        ours = sample_error(speed, size)
        rows += [_error(f"plain, n = {size}, L{k + 1}", value, ours[k]) for k, value in enumerate(published)]
    return rows


def _error(name: str, published: float, ours: float) -> Row:
    return Row.near(name, published, float(ours), ERROR_SHARE * published, "mph")


def _pair_error(name: str, published: float, ours: float) -> Row:
    if math.isnan(published):
        return Row.holds(f"{name}, negligible", ours < NEGLIGIBLE_MPH, float(ours), "mph")
    return Row.near(name, published, float(ours), max(PAIR_SHARE * published, PAIR_MPH), "mph")


table9, table10, table11, table12 = (partial(_table, number) for number in range(9, 13))
table13, table14, table15, table16 = (partial(_table, number) for number in range(13, 17))
table17, table18, table19, table20 = (partial(_table, number) for number in range(17, 21))

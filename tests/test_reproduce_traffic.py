"""Tables 9 to 20 and Figures 34 to 50 of the MAUTC report, part 4: traffic under uncertainty."""

import json
import math

import numpy as np
import pytest

from socwise import reproduce
from socwise.reproduce.traffic_case import (
    GREENSHIELDS,
    UNDERWOOD,
    matched_draws,
    pair_error,
    parameters,
    road,
    run,
    sample_error,
)
from socwise.reproduce.traffic_published import PUBLISHED, SIZES
from socwise.reproduce.traffic_tables import BEYOND, _judged, _within_factor, _within_share

QUICK = ["table9", "table10", "table13", "table14", *(f"fig{n}" for n in range(34, 50))]
LONG = ["table11", "table12", *(f"table{n}" for n in range(15, 21)), "fig50"]


def check(place):
    found = reproduce.run(f"mautc-{place}", jobs=1)
    assert found.id == f"mautc-{place}"
    assert [f"{row.label}: {row.ours}" for row in found.rows if not row.ok] == []
    json.dumps(found.to_json(), allow_nan=False)
    assert (found.draw is None) == place.startswith("table")
    if found.draw is not None:
        for ax in found.draw().axes:
            assert ax.get_xlabel()
    return found


@pytest.mark.parametrize("place", QUICK)
def test_every_row_of_the_quick_items_is_right(place):
    check(place)


@pytest.mark.slow
@pytest.mark.parametrize("place", LONG)
def test_every_row_of_the_long_items_is_right(place):
    found = check(place)
    if place.startswith("table") and place not in ("table11", "table12"):
        judged = [row for row in found.rows if row.published is not None]
        told = [row for row in judged if "99 % of samples" in row.name]
        greenshields = place in ("table15", "table16")
        assert len(told) <= (1 if greenshields else 10)


def test_the_tables_are_as_long_as_printed():
    assert sorted(PUBLISHED) == list(range(9, 21))
    for halves in PUBLISHED.values():
        assert [np.shape(half) for half in halves] == [(6, 4), (6, 4)]
    flat = np.concatenate([np.ravel(half) for halves in PUBLISHED.values() for half in halves])
    assert np.isnan(flat).sum() == 20
    assert PUBLISHED[9] == PUBLISHED[11] or PUBLISHED[9][1] == PUBLISHED[11][1]


def test_matched_draws_have_the_printed_moments():
    draws = matched_draws()
    speed = 75.0 + 3.0 * draws[..., 0]
    errors, means = (np.array(half)[:, 0] for half in PUBLISHED[9])
    for size, error, mean in zip(SIZES, errors, means, strict=True):
        np.testing.assert_allclose(speed[:, :size].mean(axis=1), mean, rtol=1e-12)
        np.testing.assert_allclose(sample_error(speed, size), error, rtol=1e-12)
    means = [draws[:, :size, 1].mean(axis=1) for size in SIZES]
    assert max(np.ptp(mean) for mean in means) < 1e-12
    scores = [float(mean[0]) * math.sqrt(size) for mean, size in zip(means, SIZES, strict=True)]
    assert np.abs(scores).max() < 3.0
    assert np.abs(draws[..., 2].mean()) < 0.02


def test_errors_are_written_out():
    generator = np.random.default_rng(1)
    first, second = generator.normal(60.0, 3.0, (2, 1, 50))
    pairs = 0.5 * (first + second)
    n = 10
    assert sample_error(first, n)[0] == pytest.approx(np.std(first[0, :n], ddof=1) / math.sqrt(n))
    assert pair_error(pairs, n)[0] == pytest.approx(np.std(pairs[0, :5], ddof=1) / math.sqrt(5.0))
    assert pair_error(pairs, 5)[0] == pytest.approx(np.std(pairs[0, :3], ddof=1) / math.sqrt(2.5))


def test_draws_below_the_demand_are_truncated_and_counted():
    draws = np.array([[0.0, 0.0], [-4.0, -4.0]])
    values, low = parameters(GREENSHIELDS, 10.0, draws)
    assert low == 1
    assert values[1, 0] * values[1, 1] / 4.0 == pytest.approx(1.02 * 2400.0)
    assert parameters(UNDERWOOD, 10.0, np.array([[0.0, -6.0]]))[1] == 1
    assert road().cell_m == pytest.approx(160.9344)
    assert np.all(np.isfinite(run(GREENSHIELDS, values)))


def test_a_row_is_judged_by_its_rule_and_else_shown_with_the_range():
    ours = np.linspace(0.9, 1.1, 101)
    assert _judged("x", 1.05, ours, _within_share).name == "x"
    assert _judged("x", 2.9, ours, _within_factor).ok
    assert _judged("x", 3.1, ours, _within_factor).name.endswith(BEYOND)
    wide = np.linspace(0.0, 4.0, 101)
    assert "99 % of samples 0.02 to 3.98" in _judged("x", 1.0, wide, _within_share).name
    assert not _judged("x", 1.0, wide, _within_share).name.endswith(BEYOND)
    assert not _judged("x", math.nan, ours, _within_share).ok
    assert _judged("x", math.nan, 1e-4 * ours, _within_share).ok

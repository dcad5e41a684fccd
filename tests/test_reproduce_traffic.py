"""Tables 9 to 20 and Figures 34 to 50 of the MAUTC report, part 4: traffic under uncertainty."""

import json
import math

import numpy as np
import pytest
from scipy.optimize import least_squares

from socwise import reproduce
from socwise.reproduce.traffic_case import (
    GREENSHIELDS,
    UNDERWOOD,
    pair_error,
    parameters,
    road,
    run,
    sample_error,
)
from socwise.reproduce.traffic_draws import library_numbers, report_draws
from socwise.reproduce.traffic_published import PUBLISHED, SIZES
from socwise.reproduce.traffic_tables import TABLES, _pair_error

ITEMS = [*(f"table{n}" for n in range(9, 21)), *(f"fig{n}" for n in range(34, 50))]


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


@pytest.mark.parametrize("place", ITEMS)
def test_every_row_is_right(place):
    found = check(place)
    if place.startswith("table"):
        assert sum(row.published is not None for row in found.rows) >= 36


@pytest.mark.slow
def test_every_row_of_the_sampling_figure_is_right():
    check("fig50")


def test_the_tables_are_as_long_as_printed():
    assert sorted(PUBLISHED) == list(range(9, 21))
    for halves in PUBLISHED.values():
        assert [np.shape(half) for half in halves] == [(6, 4), (6, 4)]
    flat = np.concatenate([np.ravel(half) for halves in PUBLISHED.values() for half in halves])
    assert np.isnan(flat).sum() == 20
    assert PUBLISHED[9] == PUBLISHED[11] or PUBLISHED[9][1] == PUBLISHED[11][1]


def test_the_generator_is_the_one_of_microsofts_library():
    assert library_numbers(10) == [41, 18467, 6334, 26500, 19169, 15724, 11478, 29358, 26962, 24464]
    assert report_draws(3)[2, 1] == pytest.approx(
        math.sqrt(-2.0 * math.log(5705 / 32767)) * math.cos(6.28 * 28145 / 32767), rel=1e-12
    )
    np.testing.assert_array_equal(report_draws(100)[:7], report_draws(7))


def test_the_draws_are_those_that_the_report_prints():
    # Nothing of the road is in this: at 1 s the speed is the free-flow speed.
    speed = 75.0 + 3.0 * report_draws(100)[:, 0]
    errors, means = (np.array(half)[:, 0] for half in PUBLISHED[9])
    for size, error, mean in zip(SIZES, errors, means, strict=True):
        assert speed[:size].mean() == pytest.approx(mean, abs=5e-4)
        assert sample_error(speed, size) == pytest.approx(error, abs=2.5e-5)
    # With pi as it is, the first error would be 1.6768.
    assert sample_error(speed, 5) == pytest.approx(1.67759, abs=5e-6)


def test_the_rows_for_five_scenarios_tell_their_draws():
    """As they were found: least squares on what the tables print, with nothing of a generator."""
    start = np.random.default_rng(0).standard_normal((5, 2)) - [1.335, 0.0]
    fit = least_squares(first_rows, start.ravel(), diff_step=1e-4)
    assert np.abs(fit.fun).max() < 6.0
    found = fit.x.reshape(-1, 2)
    # The tables do not say in which order they come.
    found, truth = (each[np.argsort(each[:, 0])] for each in (found, report_draws(5)))
    assert np.abs(found[0] - truth[0]).max() < 0.01
    assert np.all(np.abs(found - truth).max(axis=0) < [0.08, 0.25])


def first_rows(draws):
    """Ours less published for 5 scenarios in Tables 9, 10 and 12 to 16, in halves of about the last digit."""
    parts = []
    for number in (9, 10, 12, 13, 14, 15, 16):
        kind, sd, at = TABLES[number]
        speed = run(kind, parameters(kind, sd, draws.reshape(-1, 2))[0])[at]
        error, mean = np.array(PUBLISHED[number][0 if number < 13 else 1][0]), PUBLISHED[number][1][0]
        parts.append((sample_error(speed, 5) - error) / 5e-5)
        if number < 13:
            parts.append((speed.mean(axis=1) - mean) / 5e-4)
    return np.concatenate(parts)


def test_errors_are_written_out():
    generator = np.random.default_rng(1)
    first, second = generator.normal(60.0, 3.0, (2, 1, 50))
    pairs = 0.5 * (first + second)
    n = 10
    assert sample_error(first, n)[0] == pytest.approx(np.std(first[0, :n], ddof=1) / math.sqrt(n))
    assert pair_error(pairs, n)[0] == pytest.approx(np.std(pairs[0, :5], ddof=1) / math.sqrt(5.0))
    assert pair_error(pairs, 5)[0] == pytest.approx(np.std(pairs[0, :3], ddof=1) / math.sqrt(3.0))


def test_draws_below_the_demand_are_truncated_and_counted():
    draws = np.array([[0.0, 0.0], [-4.0, -4.0]])
    values, low = parameters(GREENSHIELDS, 10.0, draws)
    assert low == 1
    assert values[1, 0] * values[1, 1] / 4.0 == pytest.approx(1.02 * 2400.0)
    assert parameters(UNDERWOOD, 10.0, np.array([[0.0, -6.0]]))[1] == 1
    assert road().cell_m == pytest.approx(160.9344)
    assert np.all(np.isfinite(run(GREENSHIELDS, values)))


def test_antithetic_errors_are_judged_to_the_reports_rounding():
    assert _pair_error("x", 0.1, 0.1009).ok
    assert not _pair_error("x", 0.1, 0.1011).ok
    assert _pair_error("x", 0.001, 0.00129).ok
    assert not _pair_error("x", 0.001, 0.00131).ok
    assert _pair_error("x", math.nan, 1e-4).ok
    assert not _pair_error("x", math.nan, 1e-2).ok

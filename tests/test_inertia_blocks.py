"""Averages over blocks of time: what is in a block by its clock, and the chance that is left in a mean."""

import numpy as np
import pytest

from vehicle.errors import VehicleError
from vehicle.inertia.blocks import average, told_of


def noisy(time, sd=1.0, seed=0):
    """A level for each second, of variance 4, with noise."""
    generator = np.random.default_rng(seed)
    level = 2.0 * generator.standard_normal(int(time[-1]) + 2)
    return (level[np.floor(time + 1e-9).astype(int)] + sd * generator.standard_normal(time.size))[:, None]


def test_averages_are_of_blocks_of_time():
    time = 0.01 * np.arange(301)
    columns = np.column_stack([time, np.ones(301)])
    found = average(time, columns, 1.0)
    np.testing.assert_allclose(found.time_s, [0.99, 1.99, 2.99, 3.0])
    np.testing.assert_allclose(found.means[:3, 0], [0.495, 1.495, 2.495])
    # A single sample is no block, and no loss.
    assert np.isnan(found.means[3]).all()
    assert (found.left_out, told_of(found, 1.0)) == (0, ())
    assert found.samples == pytest.approx(100.0)
    columns[:30, 1], columns[100:180, 0] = np.nan, np.nan
    found = average(time, columns, 1.0)
    np.testing.assert_allclose(found.means[0], [np.mean(time[30:100]), 1.0])
    assert np.isnan(found.means[1]).all()
    assert found.left_out == 1
    assert told_of(found, 1.0)[0].startswith("1 of 4 blocks of 1 s were left out")
    whole = average(time, columns, 0.0)
    assert whole.time_s is time
    assert whole.means is columns
    with pytest.raises(VehicleError, match="average_s must be 0"):
        average(time, columns, -1.0)


def test_a_slower_clock_loses_no_block():
    """Half of the log at 100 Hz, half at 10 Hz: the usual step is 10 ms, and every block is full."""
    time = np.concatenate([0.01 * np.arange(10_000), 100.0 + 0.1 * np.arange(1000)])
    found = average(time, np.floor(time + 1e-9)[:, None], 1.0)
    np.testing.assert_allclose(found.means[:, 0], np.arange(200.0))
    assert found.left_out == 0
    assert found.samples == pytest.approx(2.0 / (1.0 / 100.0 + 1.0 / 10.0))


def test_bursts_are_a_clock():
    """Three samples within 1 ms, then none for 59 ms."""
    time = (0.06 * np.arange(1000)[:, None] + [0.0, 0.0005, 0.001]).ravel()
    found = average(time, time[:, None], 1.0)
    assert np.isfinite(found.means).all()
    np.testing.assert_allclose(found.means[:, 0], np.arange(60) + 0.5, atol=0.04)


def test_a_slow_log_whose_clock_jitters_keeps_its_blocks():
    time = np.arange(100.0) / 1.4 + 0.02 * np.sin(np.arange(100.0))
    found = average(time, time[:, None], 1.0)
    assert np.isfinite(found.means[:-1]).all()


def test_a_part_that_is_slower_than_blocks_is_left_out_and_told_of():
    time = np.concatenate([0.01 * np.arange(1000), 10.0 + 2.0 * np.arange(10)])
    found = average(time, np.ones((time.size, 1)), 1.0)
    assert np.isfinite(found.means[:10]).all()
    assert found.left_out == 9
    assert "9 of 20 blocks of 1 s were left out" in told_of(found, 1.0)[0]


@pytest.mark.parametrize("rate", [2, 5, 10, 100])
def test_chance_in_a_mean_is_the_variance_within_over_the_number(rate):
    """Noise of variance 1 on levels of variance 4: 1/n of 4 + 1/n is chance."""
    time = np.arange(1000 * rate) / rate
    found = average(time, noisy(time), 1.0)
    assert found.noise_share[0] == pytest.approx(1.0 / rate / (4.0 + 1.0 / rate), rel=0.15)
    assert average(time, noisy(time, sd=0.0), 1.0).noise_share[0] == pytest.approx(0.0, abs=1e-12)


def test_chance_in_single_samples_is_what_neighbours_do_not_share():
    """A slow wave of variance 2 with noise of variance 0.5, a sample per block."""
    time = np.arange(4000.0)
    signal = 2.0 * np.sin(0.05 * time) + np.random.default_rng(0).normal(0.0, 0.5**0.5, time.size)
    for block_s in (1.0, 0.0):
        found = average(time, signal[:, None], block_s)
        assert found.noise_share[0] == pytest.approx(0.2, rel=0.1)


def test_a_column_that_never_changes_has_no_chance_in_it():
    time = 0.01 * np.arange(1000)
    np.testing.assert_array_equal(average(time, np.full((1000, 2), 0.1), 1.0).noise_share, 0.0)
    columns = np.full((1000, 1), np.nan)
    empty = average(time, columns, 1.0)
    assert np.isnan(empty.means).all()
    assert np.isnan(empty.samples)

"""Detectors and the estimate from them: against brute-force Bayes, over seeds, and at its limits."""

import numpy as np
import pytest

from drivecycles.traffic.advance import Advance
from drivecycles.traffic.detectors import (
    MPS_PER,
    Detectors,
    Readings,
    observe,
    read_readings,
    write_readings,
)
from drivecycles.traffic.diagrams import Greenberg, Greenshields, Triangular, Underwood
from drivecycles.traffic.errors import TrafficError
from drivecycles.traffic.estimation import estimate
from drivecycles.traffic.lwr import simulate, simulate_members
from drivecycles.traffic.road import Bottleneck, Demand, Road
from gpc.consistency import nees

MPH, MILE = MPS_PER["mph"], 1609.344
ROAD = Road(5.0 * MILE, 50)
TRUTH = Greenshields(75.0 * MPH, 250.0 / MILE)
FIVE = Detectors(position_m=tuple(MILE * (0.5 + np.arange(5))), period_s=10.0, noise_mps=1.0 * MPH)
DEMAND = 2400.0 / 3600.0


def wrong_by_a_fifth(generator):
    signs = 1.0 + 0.2 * generator.choice([-1.0, 1.0], 2)
    return Greenshields(TRUTH.free_flow_mps * signs[0], TRUTH.jam_per_m * signs[1])


def over_seeds(seeds, field):
    true = np.array(list(TRUTH.parameters().values()))
    errors, covariances, road = [], [], []
    for seed in seeds:
        generator = np.random.default_rng(seed)
        guess = wrong_by_a_fifth(generator)
        found = estimate(observe(field, FIVE, generator), ROAD, guess, demand=DEMAND)
        errors.append(found.mean[-1] - true)
        covariances.append(found.covariance)
        late = slice(found.time_s.size // 2, None)
        away = (found.speed_mps - field.at(found.time_s))[late]
        road.append((np.mean(away**2), np.mean(found.speed_sd_mps[late] ** 2)))
    errors = np.array(errors)
    within = np.all(np.abs(errors / true) < [0.01, 0.05], axis=1)
    return within, nees(errors, covariances), np.mean(road, axis=0)


def test_within_tolerance_from_a_guess_that_is_a_fifth_off():
    """The truth takes other steps than the filter's scheme, so the filter's model is not exact."""
    field = simulate(ROAD, TRUTH, demand=DEMAND, duration_s=300.0, step_s=2.5)
    within, honesty, (square, claimed) = over_seeds(range(10), field)
    assert within.all()
    assert honesty.honest, honesty
    assert np.sqrt(square) < 0.25 * MPH and 0.3 < square / claimed < 1.5


@pytest.mark.slow
@pytest.mark.parametrize("step_s", [1.0, 2.5])
def test_fifty_seeds_are_within_tolerance_and_the_variance_is_honest(step_s):
    field = simulate(ROAD, TRUTH, demand=DEMAND, duration_s=300.0, step_s=step_s)
    within, honesty, _ = over_seeds(range(50), field)
    assert within.sum() >= 45
    assert honesty.honest, honesty


def test_without_a_random_walk_the_filter_is_bayes_on_a_grid():
    """The posterior of both parameters by brute force: every pair of a grid is a model run."""
    readings_at = 10.0 * np.arange(1.0, 31.0)
    field = simulate(ROAD, TRUTH, demand=DEMAND, duration_s=300.0, step_s=1.0)
    generator = np.random.default_rng(11)
    readings = observe(field, FIVE, generator)
    guess = Greenshields(TRUTH.free_flow_mps * 1.02, TRUTH.jam_per_m * 0.97)
    found = estimate(readings, ROAD, guess, demand=DEMAND, walk_per_m=0.0, spread=0.1)
    speeds = TRUTH.free_flow_mps * np.linspace(0.985, 1.015, 61)
    jams = TRUTH.jam_per_m * np.linspace(0.9, 1.1, 61)
    pairs = [Greenshields(v, k) for v in speeds for k in jams]
    runs = simulate_members(
        ROAD,
        pairs,
        demand=DEMAND,
        duration_s=300.0,
        step_s=1.0,
        time_s=readings_at,
        position_m=FIVE.position_m,
    )
    misfit = np.sum((runs.speed_mps - readings.speed_mps[:, :, None]) ** 2, axis=(0, 1)) / FIVE.noise_mps**2
    weight = np.exp(-0.5 * (misfit - misfit.min())).reshape(61, 61)
    weight /= weight.sum()
    for column, (axis, values) in enumerate(((1, speeds), (0, jams))):
        share = weight.sum(axis=axis)
        mean = share @ values
        sd = np.sqrt(share @ (values - mean) ** 2)
        assert found.sd[-1, column] == pytest.approx(sd, rel=0.05)
        assert found.mean[-1, column] == pytest.approx(mean, abs=0.25 * sd)


def test_an_empty_road_teaches_the_free_flow_speed_alone():
    field = simulate(ROAD, TRUTH, demand=0.0, duration_s=300.0)
    generator = np.random.default_rng(0)
    guess = wrong_by_a_fifth(generator)
    found = estimate(observe(field, FIVE, generator), ROAD, guess, demand=0.0, walk_per_m=0.0)
    assert found.mean[-1, 0] == pytest.approx(TRUTH.free_flow_mps, rel=0.01)
    # A mean of 150 readings.
    assert found.sd[-1, 0] == pytest.approx(FIVE.noise_mps / np.sqrt(150.0), rel=0.01)
    assert found.mean[-1, 1] == pytest.approx(guess.jam_per_m)
    assert found.sd[-1, 1] == pytest.approx(0.35 / np.sqrt(3.0) * guess.jam_per_m)
    assert np.allclose(found.density_per_m, 0.0)


def test_other_diagrams_and_one_unknown_among_known_ones():
    road = Road(6000.0, 30, (Bottleneck(4000.0, 0.5, 60.0, 400.0),))
    truth = Triangular(28.0, 0.04, 0.25)
    field = simulate(road, truth, demand=0.9, duration_s=600.0, initial=0.02)
    detectors = Detectors(position_m=(1000.0, 3000.0, 3700.0, 5000.0), noise_mps=0.5)
    readings = observe(field, detectors, np.random.default_rng(2))
    guess = Triangular(28.0, 0.04, 0.3)
    found = estimate(readings, road, guess, demand=0.9, initial=0.02, unknown=["jam_per_m"])
    assert found.names == ("jam_per_m",) and found.mean.shape == (60, 1)
    assert found.mean[-1, 0] == pytest.approx(0.25, abs=4.0 * found.sd[-1, 0])
    assert found.sd[-1, 0] < 0.05 * 0.25
    under = Underwood(30.0, 0.03)
    field = simulate(ROAD, under, demand=0.25, duration_s=400.0)
    readings = observe(field, FIVE, np.random.default_rng(3))
    found = estimate(readings, ROAD, Underwood(36.0, 0.024), demand=0.25)
    assert np.all(np.abs(found.mean[-1] / [30.0, 0.03] - 1.0) < [0.01, 0.06])


@pytest.mark.parametrize("unknown", [None, ["free_flow_mps"], ["optimum_mps"]])
def test_ranges_of_parameters_that_overlap_are_no_hindrance(unknown):
    """With the common half of the free-flow speed at capacity, 35 % up and down would cross."""
    road, truth = Road(6000.0, 40, (Bottleneck(4000.0, 0.35, 120.0, 900.0),)), Greenberg(25.0, 0.13, 12.5)
    field = simulate(road, truth, demand=0.5, duration_s=1200.0, initial=0.02)
    detectors = Detectors(position_m=(500.0, 2000.0, 3500.0, 5500.0), noise_mps=0.5)
    readings = observe(field, detectors, np.random.default_rng(1))
    known = {"demand": 0.5, "initial": 0.02, "unknown": unknown}
    found = estimate(readings, road, Greenberg(25.0, 0.13, 12.5), **known)
    true = np.array([truth.parameters()[name] for name in found.names])
    assert np.all(np.isfinite(found.mean)) and np.all(found.sd > 0.0)
    assert np.all(np.abs(found.mean[-1] / true - 1.0) < 0.15)
    found = estimate(readings, road, Triangular(25.0, 0.1, 0.15), demand=0.5, initial=0.02)
    assert np.all(np.isfinite(found.mean))


def test_missing_readings_teach_nothing_and_harm_nothing():
    field = simulate(ROAD, TRUTH, demand=DEMAND, duration_s=200.0)
    readings = observe(field, FIVE, np.random.default_rng(5))
    holes = readings.speed_mps.copy()
    holes[3:12] = np.nan
    holes[::2, 1] = np.nan
    less = Readings(readings.time_s, holes, FIVE)
    guess = wrong_by_a_fifth(np.random.default_rng(6))
    all_of_it, part = (estimate(one, ROAD, guess, demand=DEMAND) for one in (readings, less))
    assert part.read.tolist()[:4] == [4, 5, 4, 0] and np.isnan(part.nis[3])
    assert np.all(part.sd[-1] > all_of_it.sd[-1])
    assert part.mean[-1, 0] == pytest.approx(TRUTH.free_flow_mps, rel=0.02)


def test_advancing_in_two_goes_is_advancing_in_one():
    road = Road(6000.0, 30, (Bottleneck(4000.0, 0.5, 60.0, 200.0),))
    demand = Demand([0.0, 100.0], [0.4, 0.8])
    field = simulate(road, TRUTH, demand=demand, duration_s=300.0, step_s=3.0)
    go = Advance(road, demand, 3.0)
    start = np.zeros((30, 1))
    half = go(start, [TRUTH], 0, 37)
    np.testing.assert_allclose(half[:, 0], field.density_per_m[37], atol=1e-15)
    np.testing.assert_allclose(go(half, [TRUTH], 37, 63)[:, 0], field.density_per_m[100], atol=1e-15)


def test_a_log_is_read_as_it_was_written(tmp_path):
    readings = Readings([10.0, 20.0], [[20.0, np.nan], [21.0, 19.5]], Detectors(position_m=(100.0, 350.5)))
    path = tmp_path / "readings.csv"
    write_readings(readings, path)
    again = read_readings(path)
    assert again.detectors.position_m == (100.0, 350.5) and again.detectors.period_s == 10.0
    np.testing.assert_array_equal(again.speed_mps, readings.speed_mps)
    path.write_text("time_s,speed_kmh_at_100m,speed_mph_at_200\n5,72,10\n10,,20\n", encoding="utf-8")
    np.testing.assert_allclose(read_readings(path).speed_mps, [[20.0, 4.4704], [np.nan, 8.9408]])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time_s,speed_kmh\n5,72\n", "says no unit and position"),
        ("time_s,speed_knots_at_3\n5,72\n", "says no unit and position"),
        ("t,speed_kmh_at_3\n5,72\n", "must start with a line"),
        ("time_s\n5\n", "no column of a detector"),
        ("time_s,speed_kmh_at_3\n5,fast\n", "line 2"),
        ("time_s,speed_kmh_at_3\n5,72,1\n", "3 fields"),
        ("time_s,speed_kmh_at_3\n5,72\n4,72\n", "must increase"),
        ("time_s,speed_kmh_at_3\n5,\n6,\n", "a finite speed at least once"),
    ],
)
def test_a_log_that_says_nothing_clear_is_refused(tmp_path, text, said):
    path = tmp_path / "readings.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(TrafficError, match=said):
        read_readings(path)


def test_what_cannot_be_estimated_is_refused():
    one = Detectors(position_m=(500.0,))
    readings = Readings([10.0], [[20.0]], one)
    ask = {"demand": DEMAND}
    with pytest.raises(TrafficError, match="a detector at 9000 m is outside the road"):
        estimate(Readings([10.0], [[20.0]], Detectors(position_m=(9000.0,))), ROAD, TRUTH, **ask)
    with pytest.raises(TrafficError, match="did you mean 'jam_per_m'"):
        estimate(readings, ROAD, TRUTH, unknown=["jam_per_meter"], **ask)
    with pytest.raises(TrafficError, match="each once"):
        estimate(readings, ROAD, TRUTH, unknown=[], **ask)
    with pytest.raises(TrafficError, match="share of the guess"):
        estimate(readings, ROAD, TRUTH, spread=0.9, **ask)
    with pytest.raises(TrafficError, match="multiples of one period"):
        estimate(Readings([10.0, 25.0, 37.0], [[20.0]] * 3, one), ROAD, TRUTH, **ask)
    with pytest.raises(TrafficError, match="walk of the densities"):
        estimate(readings, ROAD, TRUTH, walk_per_m=-1.0, **ask)
    with pytest.raises(TrafficError, match="longer than the traffic"):
        observe(simulate(ROAD, TRUTH, demand=0.1, duration_s=5.0), one, np.random.default_rng(0))


def test_readings_that_contradict_the_road_are_told_of():
    wild = np.full((30, 5), 1e9)
    with pytest.raises(TrafficError, match="came apart at"):
        estimate(Readings(10.0 * np.arange(1.0, 31.0), wild, FIVE), ROAD, TRUTH, demand=DEMAND)

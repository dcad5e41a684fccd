"""The drive cycle record: kinematics against closed forms, and invariants of its operations."""

import math
import pickle
import subprocess
import sys
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivecycles import CycleError, DriveCycle, join
from drivecycles.plot import plot_cycle

speeds = st.lists(st.floats(0.0, 50.0), min_size=2, max_size=40)
steps = st.sampled_from([0.1, 0.25, 1.0, 3.0])


@st.composite
def cycles(draw: st.DrawFn) -> DriveCycle:
    """Stop to stop, uneven steps that are multiples of 0.05 s, altitude that changes only while driving."""
    speed = np.array([0.0, *draw(speeds), 0.0])
    step = np.array(draw(st.lists(steps, min_size=speed.size - 1, max_size=speed.size - 1)))
    time = draw(st.floats(0.0, 1e6)) + np.concatenate(([0.0], np.cumsum(step)))
    slope = np.array(draw(st.lists(st.floats(-0.1, 0.1), min_size=step.size, max_size=step.size)))
    rise = slope * np.diff(time) * 0.5 * (speed[1:] + speed[:-1])
    return DriveCycle("random", time, speed, np.concatenate(([5.0], 5.0 + np.cumsum(rise))))


@pytest.fixture
def ramp() -> DriveCycle:
    """1 m/s^2 for 10 s, 10 m/s for 20 s, -2 m/s^2 for 5 s, 5 s of standing; 5 % sine up all the way."""
    time = np.arange(41.0)
    speed = np.clip(np.minimum(time, 2.0 * (35.0 - time)), 0.0, 10.0)
    level = DriveCycle("ramp", time, speed)
    return DriveCycle("ramp", time, speed, 0.05 * level.position_m)


def test_kinematics_of_a_ramp(ramp: DriveCycle) -> None:
    assert ramp.duration_s == 40.0
    assert ramp.distance_m == pytest.approx(50.0 + 200.0 + 25.0, rel=1e-14)
    assert ramp.position_m[10] == pytest.approx(50.0)
    assert ramp.position_m[-1] == pytest.approx(ramp.distance_m)
    assert ramp.ascent_m == pytest.approx(0.05 * 275.0)
    assert ramp.grade[:35] == pytest.approx(np.full(35, 0.05))
    assert np.array_equal(ramp.grade[35:], np.zeros(5))
    assert ramp.step_s == 1.0
    assert len(ramp) == 41


def test_statistics_of_a_ramp(ramp: DriveCycle) -> None:
    s = ramp.statistics()
    assert (s.duration_s, s.max_speed_mps, s.stops) == (40.0, 10.0, 1)
    assert s.max_acceleration_mps2 == pytest.approx(1.0)
    assert s.min_acceleration_mps2 == pytest.approx(-2.0)
    assert s.mean_speed_mps == pytest.approx(275.0 / 40.0)
    assert s.mean_moving_speed_mps == pytest.approx(275.0 / 35.0)
    assert s.idle_fraction == pytest.approx(5.0 / 40.0)
    assert s.ascent_m == pytest.approx(13.75)
    assert (s.max_grade, s.min_grade) == pytest.approx((0.05, 0.0))


def test_statistics_of_standing_still() -> None:
    s = DriveCycle("parked", [0, 60], [0, 0]).statistics()
    assert (s.idle_fraction, s.mean_moving_speed_mps, s.stops, s.distance_m) == (1.0, 0.0, 0, 0.0)


def test_record_is_frozen_and_copies_its_input() -> None:
    speed = np.array([0.0, 1.0])
    cycle = DriveCycle("c", [0, 1], speed)
    speed[1] = 9.0
    assert cycle.speed_mps[1] == 1.0
    assert cycle.time_s.dtype == cycle.altitude_m.dtype == np.float64
    with pytest.raises(ValueError, match="read-only"):
        cycle.speed_mps[0] = 2.0
    with pytest.raises(FrozenInstanceError):
        cycle.name = "d"  # type: ignore[misc]


def test_repr_is_one_line(ramp: DriveCycle) -> None:
    assert repr(ramp) == "DriveCycle('ramp', 41 samples, 40 s, 0.275 km)"


def test_import_leaves_plotting_alone() -> None:
    code = "import sys, drivecycles, drivecycles.plot; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_pickle_keeps_values_and_read_only(ramp: DriveCycle) -> None:
    copy = pickle.loads(pickle.dumps(ramp))
    assert copy.name == ramp.name
    for field in ("time_s", "speed_mps", "altitude_m"):
        assert np.array_equal(getattr(copy, field), getattr(ramp, field))
        assert not getattr(copy, field).flags.writeable


@pytest.mark.parametrize(
    ("time", "speed", "altitude", "message"),
    [
        ([0, 1, 2], [0, 1], None, "time_s has 3 samples, speed_mps 2 and altitude_m 3"),
        ([0, 1], [0, 1], [0], "altitude_m 1"),
        ([0], [0], None, "needs at least 2"),
        ([0, 1, 1], [0, 1, 1], None, r"sample 2 \(t = 1 s\): time goes from 1 to 1 s"),
        ([0, 2, 1], [0, 1, 1], None, "time goes from 2 to 1 s"),
        ([0, 1, 2], [0, -0.5, 1], None, r"sample 1 \(t = 1 s\): speed is -0.5 m/s"),
        ([0, 1, 2], [0, math.nan, 1], None, "sample 1 .*speed is nan"),
        ([0, math.inf], [0, 1], None, "time is inf"),
        ([0, 1], [0, 1], [0, math.nan], "altitude is nan"),
        ([[0, 1]], [0, 1], None, r"time_s has shape \(1, 2\)"),
        ([0, 1], ["a", 1], None, "speed_mps must hold numbers"),
    ],
)
def test_impossible_samples_are_named(time: list, speed: list, altitude: list | None, message: str) -> None:
    with pytest.raises(CycleError, match=message):
        DriveCycle("bad", time, speed, altitude)


@given(cycles(), cycles())
@settings(max_examples=40, deadline=None)
def test_join_adds_up_and_altitude_continues(a: DriveCycle, b: DriveCycle) -> None:
    both = join([a, b])
    assert both.name == "random+random"
    assert len(both) == len(a) + len(b) - 1
    assert both.duration_s == pytest.approx(a.duration_s + b.duration_s, rel=1e-9)
    assert both.distance_m == pytest.approx(a.distance_m + b.distance_m, rel=1e-6, abs=1e-6)
    assert both.ascent_m == pytest.approx(a.ascent_m + b.ascent_m, rel=1e-9, abs=1e-9)
    climb = np.ptp(a.altitude_m[[0, -1]]) * np.sign(a.altitude_m[-1] - a.altitude_m[0])
    assert both.altitude_m[len(a) - 1] - both.altitude_m[0] == pytest.approx(climb, abs=1e-9)


@given(cycles(), st.integers(1, 5))
@settings(max_examples=30, deadline=None)
def test_repeat_multiplies(cycle: DriveCycle, n: int) -> None:
    laps = cycle.repeat(n)
    assert laps.duration_s == pytest.approx(n * cycle.duration_s, rel=1e-9)
    assert laps.distance_m == pytest.approx(n * cycle.distance_m, rel=1e-6, abs=1e-6)
    climb = cycle.altitude_m[-1] - cycle.altitude_m[0]
    assert laps.altitude_m[-1] - laps.altitude_m[0] == pytest.approx(n * climb, abs=1e-8)


def test_join_rejects_a_jump_in_speed_and_nothing_at_all() -> None:
    a = DriveCycle("a", [0, 1], [0, 5])
    with pytest.raises(CycleError, match=r"'a', which ends at 5 m/s, and 'a', which starts at 0 m/s"):
        a.repeat(2)
    with pytest.raises(CycleError, match="no cycles to join"):
        join([])
    with pytest.raises(CycleError, match="cannot repeat cycle 'a' 0 times"):
        a.repeat(0)
    assert join([a, DriveCycle("b", [7, 9], [4.6, 4.6])], name="ab").speed_mps.tolist() == [0, 5, 4.6]


@given(cycles(), st.sampled_from([0.05, 0.025]))
@settings(max_examples=40, deadline=None)
def test_finer_resampling_keeps_distance_grade_and_ends(cycle: DriveCycle, step: float) -> None:
    fine = cycle.resample(step)
    assert fine.is_uniform
    assert fine.step_s == pytest.approx(step)
    assert fine.duration_s == pytest.approx(cycle.duration_s, abs=1e-6)
    assert fine.distance_m == pytest.approx(cycle.distance_m, rel=1e-6, abs=1e-4)
    assert fine.altitude_m[[0, -1]] == pytest.approx(cycle.altitude_m[[0, -1]], abs=1e-6)
    moving = np.diff(fine.position_m) > 1e-3
    assert np.all(np.abs(fine.grade[moving]) <= 0.1 + 1e-3)


def test_resampling_while_accelerating_keeps_the_grade() -> None:
    cycle = DriveCycle("launch", [0, 10], [0, 10], [0, 2.5])
    fine = cycle.resample(0.5)
    assert fine.grade == pytest.approx(np.full(20, 0.05), rel=1e-9)
    assert fine.speed_mps == pytest.approx(np.arange(0, 10.1, 0.5))


def test_resampling_completes_the_last_step() -> None:
    cycle = DriveCycle("c", [3, 5.5], [2, 7], [0, 1])
    coarse = cycle.resample(1.0)
    assert coarse.time_s.tolist() == [3, 4, 5, 6]
    assert coarse.speed_mps.tolist() == [2, 4, 6, 7]
    assert coarse.altitude_m[-1] == 1.0


@pytest.mark.parametrize("step", [0.0, -1.0, math.nan, 11.0])
def test_resampling_to_an_impossible_step(step: float) -> None:
    with pytest.raises(CycleError, match="give a step above 0 and up to its duration, 10 s"):
        DriveCycle("c", [0, 10], [1, 1]).resample(step)


def test_uneven_steps_have_no_step() -> None:
    with pytest.raises(CycleError, match=r"time steps from 1 to 2 s.*resample\(1.0\)"):
        _ = DriveCycle("c", [0, 1, 3], [0, 1, 0]).step_s


def test_rounded_time_stamps_of_a_fast_log_are_uniform() -> None:
    time = 1.7e9 + 0.1 * np.arange(600)
    assert DriveCycle("log", time, np.ones(600)).step_s == pytest.approx(0.1, rel=1e-8)


def test_altitude_profile_over_distance(ramp: DriveCycle) -> None:
    hill = ramp.with_altitude([0, 137.5, 275], [10, 24, 10])
    x = ramp.position_m
    expected = np.where(x <= 137.5, 10 + 14 * x / 137.5, 24 - 14 * (x - 137.5) / 137.5)
    assert hill.altitude_m == pytest.approx(expected)
    assert hill.statistics().max_grade == pytest.approx(14 / 137.5)


@pytest.mark.parametrize(
    ("position", "altitude", "message"),
    [
        ([0, 100], [0, 1], "covers 0 to 100 m, but cycle 'ramp' drives from 0 to 275 m"),
        ([10, 300], [0, 1], "covers 10 to 300 m"),
        ([0, 0, 300], [0, 1, 2], "must increase"),
        ([0, 300], [0], "2 positions and 1 altitudes"),
        ([0, 300], [0, math.nan], "finite"),
    ],
)
def test_bad_altitude_profiles(ramp: DriveCycle, position: list, altitude: list, message: str) -> None:
    with pytest.raises(CycleError, match=message):
        ramp.with_altitude(position, altitude)


def test_smoothing_keeps_a_constant_grade_and_damps_a_wave(ramp: DriveCycle) -> None:
    assert ramp.smooth_altitude(60.0).altitude_m == pytest.approx(ramp.altitude_m, abs=1e-9)
    time = np.arange(0, 400.1, 0.05)
    speed = np.full(time.size, 10.0)
    x = 10.0 * time
    wave = DriveCycle("wave", time, speed, np.sin(2 * np.pi * x / 200.0)).smooth_altitude(50.0)
    inner = (x > 100) & (x < 3900)
    # The mean of a sine over a quarter of its length is the sine times sin(pi/4) / (pi/4).
    damped = np.sin(2 * np.pi * x / 200.0) * math.sin(math.pi / 4) / (math.pi / 4)
    # Between points 0.5 m apart the wave is a chord: up to (0.5 * 2 pi / 200)^2 / 8 = 3.1e-5 below the arc.
    assert wave.altitude_m[inner] == pytest.approx(damped[inner], abs=3.2e-5)
    with pytest.raises(CycleError, match="length above 0"):
        ramp.smooth_altitude(0.0)


def test_smoothing_a_parked_vehicle_averages_its_drift() -> None:
    parked = DriveCycle("parked", [0, 1, 2], [0, 0, 0], [1, 2, 3]).smooth_altitude(10.0)
    assert parked.altitude_m == pytest.approx(np.full(3, 2.0))


def test_plot_shows_kmh_and_altitude_on_a_twin_axis(ramp: DriveCycle) -> None:
    ax = plot_cycle(ramp)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time [s]", "speed [km/h]")
    assert ax.lines[0].get_ydata().max() == pytest.approx(36.0)
    assert [other.get_ylabel() for other in ax.figure.axes] == ["speed [km/h]", "altitude [m]"]
    level = plot_cycle(DriveCycle("level", [0, 1], [0, 1]))
    assert len(level.figure.axes) == 1
    assert plot_cycle(ramp, ax=level) is level


def test_noise_at_the_start_of_a_log_does_not_make_a_wall() -> None:
    time = np.arange(0.0, 301.0)
    speed = np.minimum(0.2 * np.maximum(time - 10.0, 0.0), 10.0)
    noisy = np.random.default_rng(1).normal(0.0, 1.0, time.size)
    smooth = DriveCycle("noisy", time, speed, noisy).smooth_altitude(200.0)
    moving = smooth.speed_mps[1:] > 0.0
    assert np.abs(smooth.grade[moving]).max() < 0.05
    assert smooth.altitude_m[-1] == pytest.approx(noisy[-1])
    assert smooth.altitude_m[0] == pytest.approx(noisy[:11].mean())

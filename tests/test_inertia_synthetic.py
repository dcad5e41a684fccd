"""The synthetic vehicle: its equations of motion, what its sensors make of them, and the log."""

import naive_inertia
import numpy as np
import pytest
from pydantic import ValidationError

from vehicle.errors import VehicleError
from vehicle.inertia import _body
from vehicle.inertia import _kernels as _kernels
from vehicle.inertia.defender import DEFENDER, Geometry, SprungVehicle
from vehicle.inertia.log import Log
from vehicle.inertia.sensors import NO_ERRORS, ROAD_SENSORS, SensorErrors, sense
from vehicle.inertia.synthetic import synthetic, vehicle_arrays

OTHER = SprungVehicle(
    mass_kg=1500.0,
    cg_from_front_m=1.2,
    cg_from_left_m=0.8,
    cg_over_roll_centre_m=0.6,
    cg_over_pitch_centre_m=0.4,
    drag_over_cg_m=-0.1,
)


def ride_over(vehicle, road, ax, ay, drag_N, step_s, every=1):
    samples = (len(road) - 1) // every + 1
    forces, motion = np.empty((samples, 4)), np.empty((samples, 5))
    body, strut = vehicle_arrays(vehicle)
    _body.ride_over(road, ax, ay, drag_N, step_s, every, body, vehicle.static_N, strut, forces, motion)
    return forces, motion


def test_the_kernel_is_newton_and_euler():
    """Against a twin that solves for accelerations and joint forces together."""
    generator = np.random.default_rng(5)
    road = 0.03 * np.cumsum(generator.standard_normal((300, 4)), axis=0) / 10.0
    ax, ay = np.cumsum(generator.standard_normal((2, 300)), axis=1) / 5.0
    drag = 400.0 + 50.0 * np.sin(np.arange(300.0))
    found = ride_over(OTHER, road, ax, ay, drag, 0.002)
    expected = naive_inertia.ride_over(OTHER, road, ax, ay, drag, 0.002)
    np.testing.assert_allclose(found[0], expected[0], rtol=1e-10)
    np.testing.assert_allclose(found[1], expected[1], rtol=1e-9, atol=1e-9)
    assert np.abs(found[1]).max(axis=0).min() > 0.5


def test_at_rest_it_rests():
    still = np.zeros(200)
    forces, motion = ride_over(DEFENDER, np.zeros((200, 4)), still, still, still, 0.002)
    np.testing.assert_array_equal(forces, np.tile(DEFENDER.static_N, (200, 1)))
    assert not motion.any()


def test_static_forces_carry_the_weight_where_it_is():
    a, b, left, right = OTHER.geometry.lengths_m
    fl, fr, rl, rr = OTHER.static_N
    assert fl + fr + rl + rr == pytest.approx(1500.0 * 9.81)
    assert (fl + fr) * a == pytest.approx((rl + rr) * b)
    assert (fl + rl) * left == pytest.approx((fr + rr) * right)


def test_a_steady_bend_while_braking_transfers_load_by_the_heights():
    """Moments about roll and pitch centre: m A h, and drag with its own lever; the body leans outwards."""
    n, ones = 10_000, np.ones(10_000)
    forces, motion = ride_over(OTHER, np.zeros((n, 4)), -3.0 * ones, 2.0 * ones, 300.0 * ones, 0.002)
    dynamic = forces[-1] - OTHER.static_N
    a, b, left, right = OTHER.geometry.lengths_m
    heave, pitch, roll, ax, ay = motion[-1]
    np.testing.assert_allclose([heave, pitch, roll], 0.0, atol=1e-6)
    side = right * (dynamic[1] + dynamic[3]) - left * (dynamic[0] + dynamic[2])
    assert side == pytest.approx(1500.0 * 0.6 * ay, rel=1e-6)
    nose = a * (dynamic[0] + dynamic[1]) - b * (dynamic[2] + dynamic[3])
    assert nose == pytest.approx(-1500.0 * 0.4 * ax - 0.3 * 300.0, rel=1e-6)
    assert dynamic.sum() == pytest.approx(0.0, abs=1e-6)
    # Leaning to the right in a left-hand bend, nose down when braking: gravity adds to both readings.
    assert 2.02 < ay < 2.3
    assert -3.3 < ax < -3.01


def test_halving_the_step_changes_little():
    time = np.arange(0.0, 4.0, 0.001)
    road = 0.02 * np.sin(2.0 * np.pi * np.outer(time, [1.1, 1.7, 2.3, 4.0]))
    zero = np.zeros_like(time)
    fine, _ = ride_over(DEFENDER, road, zero, zero, zero, 0.001, 10)
    coarse, _ = ride_over(DEFENDER, road[::2], zero[::2], zero[::2], zero[::2], 0.002, 5)
    assert np.abs(fine - DEFENDER.static_N).max() > 500.0
    np.testing.assert_allclose(coarse, fine, atol=2.0)


def test_the_log_obeys_newton_on_any_road():
    """Without sensor errors the four forces are m A_z, and corners move as one rigid body."""
    log, truth = synthetic("rural", seed=4, sensors=NO_ERRORS, duration_s=60.0, vehicle=OTHER)
    np.testing.assert_allclose(log.forces_N.sum(axis=1), truth["mass_kg"] * log.az_mps2, rtol=1e-12)
    fl, fr, rl, rr = log.corner_az_mps2.T
    np.testing.assert_allclose(fl - fr, rl - rr, atol=1e-12)
    np.testing.assert_allclose(rl - fl, OTHER.wheelbase_m * log.pitch_radps2, atol=1e-12)
    np.testing.assert_allclose(fl - fr, OTHER.track_m * log.roll_radps2, atol=1e-12)
    assert log.time_s[1] - log.time_s[0] == pytest.approx(0.01)
    assert log.time_s.size == 6001
    assert log.az_mps2.mean() == pytest.approx(9.81, abs=0.02)


def test_country_roads_shake_more():
    town, country = (
        synthetic(name, seed=0, sensors=NO_ERRORS, duration_s=100.0)[0] for name in ("urban", "rural")
    )
    assert country.heave_mps2.var() > 5.0 * town.heave_mps2.var()
    # Comfort of a class C road at 70 km/h: about 0.8 m/s^2 root mean square (ISO 2631: uncomfortable).
    assert 0.5 < country.heave_mps2.std() < 1.2
    assert country.forces_N.min() > 0.0


def test_same_seed_same_drive_whatever_the_sensors():
    one, _ = synthetic("urban", seed=3, duration_s=20.0, sensors=NO_ERRORS)
    two, _ = synthetic("urban", seed=3, duration_s=20.0, sensors=ROAD_SENSORS)
    other, _ = synthetic("urban", seed=4, duration_s=20.0, sensors=NO_ERRORS)
    np.testing.assert_array_equal(one.speed_mps, two.speed_mps)
    assert np.abs(one.forces_N - two.forces_N).max() < 200.0
    assert not np.array_equal(one.speed_mps, other.speed_mps)


def test_noise_has_the_size_that_was_asked_for():
    quiet, _ = synthetic("rural", seed=2, duration_s=120.0, sensors=NO_ERRORS)
    noisy, _ = synthetic("rural", seed=2, duration_s=120.0, sensors=ROAD_SENSORS)
    for name in ("az_mps2", "corner_az_mps2", "pitch_radps2", "roll_radps2", "ax_mps2", "ay_mps2"):
        assert (getattr(noisy, name) - getattr(quiet, name)).var() == pytest.approx(0.1, rel=0.05)
    assert (noisy.forces_N - quiet.forces_N).std() == pytest.approx(25.0, rel=0.03)
    default, _ = synthetic("rural", seed=2, duration_s=20.0)
    plain, _ = synthetic("rural", seed=2, duration_s=20.0, sensors=NO_ERRORS)
    np.testing.assert_array_equal(default.forces_N, plain.forces_N)
    np.testing.assert_array_equal(default.ax_mps2, plain.ax_mps2)
    assert (default.heave_mps2 - plain.heave_mps2).var() == pytest.approx(0.1, rel=0.1)


def test_gain_bias_and_misalignment():
    forces = np.tile(DEFENDER.static_N, (50_000, 1))
    rest = np.tile([0.0, 0.0, 9.81, 9.81, 9.81, 9.81, 9.81], (50_000, 1))
    none, flat, angular, gain = sense(
        NO_ERRORS, forces, rest, np.zeros((50_000, 2)), np.random.default_rng(1)
    )
    np.testing.assert_array_equal(none, forces)
    np.testing.assert_array_equal(flat, rest)
    assert not angular.any()
    np.testing.assert_array_equal(gain, 1.0)
    errors = SensorErrors(
        acceleration_variance=0.0, strut_gain_sd=0.02, bias_sd_mps2=0.1, misalignment_sd_rad=0.01
    )
    drawn = []
    for seed in range(300):
        found = sense(errors, forces[:1], rest[:1], np.zeros((1, 2)), np.random.default_rng(seed))
        np.testing.assert_allclose(found[0][0], forces[0] * found[3])
        drawn.append([*found[3], *(found[1] - rest[:1])[0]])
    sd = np.std(drawn, axis=0)
    np.testing.assert_allclose(sd[:4], 0.02, rtol=0.15)
    # Gravity leaks into A_x and A_y by the angle; the vertical ones feel their bias alone.
    np.testing.assert_allclose(sd[4:6], np.hypot(0.1, 0.0981), rtol=0.15)
    np.testing.assert_allclose(sd[6:], 0.1, rtol=0.15)


def test_the_tare_is_measured_by_the_same_struts():
    errors = SensorErrors(acceleration_variance=0.0, strut_gain_sd=0.05)
    log, _ = synthetic("urban", seed=1, duration_s=10.0, sensors=errors)
    plain, _ = synthetic("urban", seed=1, duration_s=10.0, sensors=NO_ERRORS)
    np.testing.assert_allclose(
        log.forces_N / plain.forces_N, np.tile(log.static_N / plain.static_N, (1001, 1))
    )
    assert np.abs(log.static_N / plain.static_N - 1.0).max() > 0.01


def test_vehicles_that_cannot_be_are_refused():
    with pytest.raises(ValidationError, match="between the axles"):
        Geometry(cg_from_front_m=3.0)
    with pytest.raises(ValidationError, match="between the axles"):
        SprungVehicle(cg_from_left_m=1.8)
    with pytest.raises(VehicleError, match="left its road"):
        synthetic("rural", duration_s=5.0, vehicle=SprungVehicle(tyre_Npm=1e12))
    with pytest.raises(VehicleError, match="did you mean 'urban'"):
        synthetic("urbn")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"time_s": [0.0, 1.0, 1.0]}, "increasing; sort the rows"),
        ({"time_s": [0.0]}, "two times or more"),
        ({"forces_N": np.ones((3, 3))}, r"column forces_N must have shape \(3, 4\)"),
        ({"ax_mps2": np.ones(2)}, r"column ax_mps2 must have shape \(3,\)"),
        ({"static_N": np.ones(3)}, r"column static_N must have shape \(4,\)"),
        ({"ay_mps2": [0.0, np.inf, 0.0]}, "ay_mps2 holds inf"),
        ({"az_mps2": np.full(3, np.nan)}, "az_mps2 holds inf, or nothing but NaN"),
    ],
)
def test_bad_logs_are_refused(changes, said):
    given = {
        "time_s": np.arange(3.0),
        "forces_N": np.ones((3, 4)),
        "ax_mps2": np.ones(3),
        "ay_mps2": np.ones(3),
    }
    assert Log(**given).az_mps2 is None
    with pytest.raises(VehicleError, match=said):
        Log(**(given | changes))

"""The mass-spring system of [M] eq 28: exact truth, compiled filters, and who deserves trust."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gpc.consistency import consistency
from vehicle.errors import VehicleError
from vehicle.inertia import mass_spring
from vehicle.inertia.mass_spring import MassSpringLog, estimate, make_filter, settings_for, simulate

SEEDS = range(50)


def studied(mode, position_m=0.0, **changes):
    """Relative error of the mass, its error in own standard deviations, and NEES of all three, per seed."""
    settings, rows = settings_for(mode, **changes), []
    for seed in SEEDS:
        log = simulate(seed=seed, position_m=position_m)
        found, truth = estimate(log, mode, settings, seed=seed), log.final_truth
        rows.append(
            (found.error(truth)["mass_kg"], found.deviations(truth)["mass_kg"], 3.0 * found.nees(truth))
        )
    error, deviation, square = np.transpose(rows)
    return np.abs(error), np.abs(deviation), square


def test_the_closed_form_solves_the_equation():
    log = simulate(duration_s=20.0, position_m=0.3, velocity_mps=-0.7, mass_kg=310.0, noise_sd_m=0.0)
    solved = solve_ivp(
        lambda t, y: [y[1], -1000.0 / 310.0 * y[0] + np.sin(t)],
        (0.0, 20.0),
        [0.3, -0.7],
        t_eval=log.time_s,
        rtol=1e-11,
        atol=1e-12,
    )
    np.testing.assert_allclose(log.truth[:, :2], solved.y.T, atol=1e-8)
    np.testing.assert_array_equal(log.position_m, log.truth[:, 0])
    assert log.final_truth["mass_kg"] == 310.0


def test_the_noise_is_what_was_asked_for_and_follows_the_seed():
    one, same, other = (simulate(seed=seed, noise_sd_m=0.2) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.position_m, same.position_m)
    noise = one.position_m - one.truth[:, 0]
    assert np.std(noise) == pytest.approx(0.2, rel=0.03)
    assert abs(np.corrcoef(noise, other.position_m - other.truth[:, 0])[0, 1]) < 0.04


def runge_kutta(time_s, step_s):
    """A step of the model as the twin takes it, row by row."""

    def rate(t, states):
        x, v, m = states.T
        return np.column_stack([v, -1000.0 / m * x + np.sin(t), np.zeros_like(m)])

    def model(states):
        h = step_s
        k1 = rate(time_s, states)
        k2 = rate(time_s + 0.5 * h, states + 0.5 * h * k1)
        k3 = rate(time_s + 0.5 * h, states + 0.5 * h * k2)
        k4 = rate(time_s + h, states + h * k3)
        return states + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)

    return model


@pytest.mark.parametrize("mode", ["unmodified", "report", "full_germ"])
def test_the_kernel_is_the_filter(mode):
    """A sample without a measurement too."""
    log = simulate(seed=3, duration_s=3.0)
    position = log.position_m.copy()
    position[40:60] = np.nan
    log = MassSpringLog(log.time_s, position)
    settings = settings_for(mode)
    found = estimate(log, mode, settings, seed=5)
    gpc, belief = make_filter(settings, mode, seed=5)
    squares = []
    for k in range(1, log.time_s.size):
        model = runge_kutta(log.time_s[k - 1], log.time_s[k] - log.time_s[k - 1])
        belief = gpc.forecast(belief, model)
        if np.isfinite(position[k]):
            noise = settings.noise_variance_m2
            belief, innovation = gpc.update(belief, position[k : k + 1], noise, [[1.0, 0.0, 0.0]])
            squares.append(innovation.nis)
        np.testing.assert_allclose(found.values[k], belief.mean, rtol=1e-6, atol=1e-6)
    assert found.nis == pytest.approx(np.mean(squares), rel=1e-6)
    sds = np.sqrt(np.diagonal(belief.covariance))
    np.testing.assert_allclose(found.sds[-1], sds, rtol=1e-6, atol=1e-12)


def test_the_extended_filter_is_the_textbook_one():
    """With the derivatives of a Runge-Kutta step by complex numbers, in Joseph's form; no bound is met."""
    log = simulate(seed=3, duration_s=3.0, position_m=0.2)
    narrow = {"position_m": 0.0, "velocity_mps": 0.0, "mass_kg": 300.0, "mass_half_range_kg": 90.0}
    settings = settings_for("ekf", position_half_range_m=0.5, velocity_half_range_mps=0.5, **narrow)
    found = estimate(log, "ekf", settings)
    mean = np.array([0.0, 0.0, 300.0])
    covariance = np.diag(np.array([0.5, 0.5, 90.0]) ** 2 / 3.0)
    h = np.array([[1.0, 0.0, 0.0]])
    for k in range(1, log.time_s.size):
        model = runge_kutta(log.time_s[k - 1], log.time_s[k] - log.time_s[k - 1])
        probes = mean + 1e-30j * np.eye(3)
        phi = model(probes).imag.T / 1e-30
        mean = model(mean[np.newaxis])[0]
        covariance = phi @ covariance @ phi.T
        gain = covariance @ h.T / (h @ covariance @ h.T + settings.noise_variance_m2)
        mean = mean + gain[:, 0] * (log.position_m[k] - mean[0])
        keep = np.eye(3) - gain @ h
        covariance = keep @ covariance @ keep.T + settings.noise_variance_m2 * gain @ gain.T
        np.testing.assert_allclose(found.values[k], mean, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(found.sds[-1], np.sqrt(np.diagonal(covariance)), rtol=1e-6)


def test_a_gap_in_the_log_is_crossed_in_small_steps():
    """Of times alone and of missing values at the same times, the filter learns the same."""
    log = simulate(seed=2, duration_s=20.0)
    kept = np.r_[0:500, 800:2001]
    holes = np.full_like(log.position_m, np.nan)
    holes[kept] = log.position_m[kept]
    for mode, close in (("full_germ", 1e-6), ("ekf", 1e-6), ("ukf", 1e-4)):
        short = estimate(MassSpringLog(log.time_s[kept], log.position_m[kept]), mode)
        long = estimate(MassSpringLog(log.time_s, holes), mode)
        np.testing.assert_allclose(short.values, long.values[kept], rtol=close, atol=close)


def test_the_unmodified_filter_blames_the_mass_for_a_wrong_position_and_is_sure_of_it():
    error, deviation, _ = studied("unmodified", position_m=0.2)
    assert np.count_nonzero(error > 0.05) >= 45
    assert np.median(deviation) > 1000.0
    error, deviation, _ = studied("unmodified")
    assert error.max() < 0.01
    assert np.median(deviation) > 2.0


def test_the_modified_filter_finds_the_mass_from_far_away():
    error, _, _ = studied("report")
    assert error.max() < 0.025
    settled = [estimate(simulate(seed=s), "report", seed=s).settled_s[2] for s in range(5)]
    assert min(settled) > 60.0


def test_with_full_germs_it_is_right_and_knows_how_right():
    error, _, square = studied("full_germ")
    assert np.count_nonzero(error < 0.01) >= 48
    assert consistency(square, 3).honest
    error, _, square = studied("full_germ", position_m=0.2)
    assert np.count_nonzero(error < 0.01) >= 48
    assert consistency(square, 3).honest


def test_the_unscented_filter_is_as_good_and_the_extended_one_is_not():
    error, _, square = studied("ukf")
    assert np.count_nonzero(error < 0.01) >= 48
    assert consistency(square, 3).mean < 1.6
    error, _, square = studied("ekf")
    assert np.count_nonzero(error < 0.01) >= 40
    assert np.count_nonzero(error > 0.05) >= 1
    assert consistency(square, 3).verdict == "over-confident"


@pytest.mark.slow
def test_the_restarts_are_what_makes_it_honest():
    """On logs that had no part in choosing when to restart: the batch of three that looked worst."""
    logs = [simulate(seed=seed) for seed in range(10_000, 10_400)]
    mean = {}
    for share in (0.7, 1.0):
        settings = settings_for("full_germ", restarts_at=share)
        squares = [3.0 * estimate(log, "full_germ", settings).nees(log.final_truth) for log in logs]
        mean[share] = consistency(squares, 3).mean
    assert 0.9 < mean[0.7] < 1.12
    assert mean[1.0] > mean[0.7] + 0.05


def test_the_record_says_when_and_how_well():
    log = simulate(seed=0)
    found = estimate(log)
    assert found.method == "full_germ"
    assert found.names == mass_spring.NAMES
    assert found.values.shape == found.sds.shape == (10_001, 3)
    assert found.nis == pytest.approx(1.0, abs=0.05)
    assert 0.5 < found.settled_s[2] < 20.0
    mass, sd = found.column("mass_kg")
    assert (mass[0], sd[0]) == pytest.approx((1000.0, 900.0 / np.sqrt(3.0)))
    assert np.sqrt(found.covariance[2, 2]) == pytest.approx(sd[-1])
    assert estimate(log, "report").notes != ()


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: settings_for("full-germ"), "did you mean full_germ"),
        (lambda: settings_for("ukf", mass_kg=-1.0), "mass_kg"),
        (lambda: settings_for("ukf", mass_kg=3000.0), "must lie between its bounds"),
        (lambda: settings_for("ukf", mass=3000.0), "Extra inputs"),
        (lambda: make_filter(settings_for("report", order=4), "report"), "5 terms need at least as many"),
        (lambda: make_filter(settings_for("ukf"), "ukf"), "no filter on chaos coefficients"),
        (lambda: estimate(simulate(duration_s=1.0), "kalman"), "unknown mode 'kalman'"),
        (lambda: estimate(simulate(), "ukf", settings_for("ukf", alpha=0.01), seed=0), "broke down"),
        (lambda: simulate(duration_s=0.0), "duration_s must be positive"),
        (lambda: simulate(noise_sd_m=-1.0), "noise_sd_m must be 0 or more"),
        (lambda: simulate(mass_kg=1000.0), "resonance"),
        (lambda: MassSpringLog(np.array([0.0, 0.0]), np.zeros(2)), "increasing"),
        (lambda: MassSpringLog(np.arange(3.0), np.zeros(2)), "as many positions"),
        (lambda: MassSpringLog(np.arange(3.0), np.zeros(3), 0.0), "stiffness must be positive"),
        (lambda: MassSpringLog(np.arange(3.0), np.full(3, np.nan)), "two measured positions"),
    ],
)
def test_wrong_use_says_what_is_wrong(call, said):
    with pytest.raises(VehicleError, match=said):
        call()

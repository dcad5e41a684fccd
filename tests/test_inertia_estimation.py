"""Estimates of mass, inertias and centre of gravity: filters against their twins, and against the truth."""

import naive_inertia
import numpy as np
import pytest

from gpc.ekf import GpcEkf
from vehicle.errors import VehicleError
from vehicle.inertia import filters, load_transfer, ride
from vehicle.inertia.defender import DEFENDER, SprungVehicle
from vehicle.inertia.estimation import estimate, prior_of
from vehicle.inertia.log import Log
from vehicle.inertia.sensors import (
    NO_ERRORS,
    RIDE_SENSORS,
    ROAD_SENSORS,
    ROAD_SENSORS_GAIN,
    SensorErrors,
)
from vehicle.inertia.synthetic import synthetic

RIDE_NOISE = 0.1**0.5
METHODS = ("gpc", "gpc-report", "ekf", "ukf", "rls-force", "rls-acceleration")
L, B = DEFENDER.wheelbase_m, DEFENDER.track_m


@pytest.fixture(scope="module")
def ride_log():
    return synthetic("rural", seed=1, sensors=RIDE_SENSORS)


@pytest.fixture(scope="module")
def road_logs():
    return {name: synthetic(name, seed=1, sensors=ROAD_SENSORS) for name in ("urban", "rural")}


def prepared(model, log):
    if model == "ride":
        problem = ride.prepare(log, DEFENDER.geometry)
        return problem, filters.noise_of(problem, RIDE_NOISE)
    problem = load_transfer.prepare(log, DEFENDER.geometry, model)
    return problem, filters.noise_of(problem, 40.0)


def function_of(model):
    if model == "ride":
        return naive_inertia.ride
    twin = naive_inertia.load_transfer if model == "ltm" else naive_inertia.corner_transfer
    return lambda u, p: twin(u, p, L, B)


@pytest.mark.parametrize("model", ["ride", "ltm", "mltm"])
def test_the_loop_is_the_chaos_filter(model, road_logs):
    """The compiled loop against `gpc.ekf.GpcEkf` on the equations in plain numpy."""
    problem, noise = prepared(model, road_logs["rural"][0])
    prior = prior_of(model)
    found = filters.run_filter(problem, prior, "gpc", noise, 2)
    centre, half = np.array(list(prior.values())).T
    positive = [not name.startswith(("cg_over", "cg_height", "drag")) for name in prior]
    lower = np.where(positive, 0.05 * centre, -np.inf)
    gpc, belief = GpcEkf.full_germ(centre, half, order=2, lower=lower)
    for k in range(40):
        u, z = problem.inputs[k], problem.outputs[k]
        belief, innovation = gpc.update(belief, z, noise, lambda p, u=u: function_of(model)(u, p))
        np.testing.assert_allclose(found.mean[k], belief.mean, rtol=1e-6)
        scale = np.sqrt(np.outer(*[np.diag(belief.covariance)] * 2))
        np.testing.assert_allclose(found.covariance[k] / scale, belief.covariance / scale, atol=1e-6)
        whitened = np.linalg.solve(innovation.covariance, innovation.residual)
        assert found.nis[k] == pytest.approx(innovation.residual @ whitened, rel=1e-6)


@pytest.mark.parametrize("model", ["ride", "ltm", "mltm"])
def test_the_unscented_filter_is_its_twin(model, road_logs):
    problem, noise = prepared(model, road_logs["rural"][0])
    prior = prior_of(model)
    found = filters.run_filter(problem, prior, "ukf", noise, 2)
    centre, half = np.array(list(prior.values())).T
    positive = [not name.startswith(("cg_over", "cg_height", "drag")) for name in prior]
    lower = np.where(positive, 0.05 * centre, -np.inf)
    mean, covariance = naive_inertia.unscented(
        function_of(model), centre, half**2 / 3.0, lower, noise, problem.inputs[:60], problem.outputs[:60]
    )
    np.testing.assert_allclose(found.mean[:60], mean, rtol=1e-6)
    sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    scale = sd[:, :, None] * sd[:, None, :]
    np.testing.assert_allclose(found.covariance[:60] / scale, covariance / scale, atol=1e-5)


def test_filters_end_at_weighted_least_squares(road_logs):
    """With much data, posterior mean and covariance are those of Gauss-Newton on everything at once."""
    problem, noise = prepared("mltm", road_logs["rural"][0])
    prior = prior_of("mltm")
    centre, half = np.array(list(prior.values())).T
    model, p = function_of("mltm"), centre.copy()
    kept = np.isfinite(problem.inputs).all(axis=1)
    inputs, outputs = problem.inputs[kept], problem.outputs[kept]

    def all_outputs(q):
        return np.array([model(u, q[None])[0] for u in inputs]).ravel()

    for _ in range(5):
        base = all_outputs(p)
        slope = np.column_stack([(all_outputs(p + 1e-4 * h) - base) / 1e-4 for h in np.eye(7)])
        weighed = slope.T @ np.kron(np.eye(len(inputs)), np.linalg.inv(noise))
        information = weighed @ slope + np.diag(3.0 / half**2)
        gradient = weighed @ (outputs.ravel() - base) + 3.0 / half**2 * (centre - p)
        p = p + np.linalg.solve(information, gradient)
    covariance = np.linalg.inv(information)
    sd = np.sqrt(np.diag(covariance))
    for method in ("gpc", "ekf", "ukf"):
        found = filters.run_filter(problem, prior, method, noise, 2)
        assert np.abs((found.mean[-1] - p) / sd).max() < 0.4, method
        np.testing.assert_allclose(np.sqrt(np.diag(found.covariance[-1])), sd, rtol=0.05, err_msg=method)


@pytest.mark.parametrize("method", ["gpc", "ekf", "ukf", "rls-acceleration"])
def test_ride_finds_all_four(method, ride_log):
    log, truth = ride_log
    noise = None if method.startswith("rls") else RIDE_NOISE
    found = estimate("ride", log, method, noise_sd=noise)
    assert found.names == ride.NAMES
    assert max(map(abs, found.error(truth).values())) < 0.01
    assert found.nees(truth) < 3.5
    assert found.notes == ()
    if not method.startswith("rls"):
        assert found.nis == pytest.approx(1.0, abs=0.03)


def test_force_form_is_biased_as_errors_in_variables_say(ride_log):
    """The mass shrinks by the share of the noise in the variance of what is heaved; acceleration form not."""
    log, truth = ride_log
    found = estimate("ride", log, "rls-force")
    error = found.error(truth)
    shrunk = 1.0 - 0.1 / np.mean(log.heave_mps2**2)
    assert 1.0 + error["mass_kg"] == pytest.approx(shrunk, abs=0.005)
    assert error["mass_kg"] < -0.02
    assert error["roll_inertia_kgm2"] < -0.05
    assert "biased" in found.notes[0]


def test_noise_on_the_horizontal_axes_biases_every_method():
    log, truth = synthetic("rural", seed=1, sensors=SensorErrors(horizontal_variance=0.1))
    for method in ("gpc", "rls-acceleration"):
        error = estimate("ride", log, method).error(truth)
        assert error["roll_inertia_kgm2"] > 0.25
        assert -0.15 < error["cg_height_m"] < -0.07
        assert abs(error["mass_kg"]) < 0.01


def test_the_report_filter_wanders_where_the_other_settles(ride_log):
    log, truth = ride_log
    report = estimate("ride", log, "gpc-report", noise_sd=RIDE_NOISE)
    good = estimate("ride", log, noise_sd=RIDE_NOISE)
    tail = slice(-6000, None)
    assert report.values[tail, 0].std() > 5.0 * good.values[tail, 0].std()
    assert "without regard to noise" in report.notes[0]
    assert max(map(abs, report.error(truth).values())) < 0.15


@pytest.mark.parametrize("scenario", ["urban", "rural"])
@pytest.mark.parametrize("model", ["ltm", "mltm"])
@pytest.mark.parametrize("method", METHODS)
def test_load_transfer_finds_mass_and_position(method, model, scenario, road_logs):
    log, truth = road_logs[scenario]
    found = estimate(model, log, method)
    error = found.error(truth)
    assert found.names == load_transfer.NAMES
    assert abs(error["mass_kg"]) < 0.002
    assert abs(error["cg_from_front_m"]) < (0.02 if model == "ltm" else 0.005)
    assert abs(error["cg_from_left_m"]) < 0.005
    assert "drag_kgpm is not identifiable" in found.notes[0]
    # Drag acts higher than the model presumes, and the standard deviation knows that it may.
    assert error["drag_kgpm"] > 0.15
    assert found.deviations(truth)["drag_kgpm"] < 1.0


def test_the_centre_of_gravity_need_not_be_in_the_middle():
    """Far from it the models share a bend's load wrongly; warp has noise of its own, or a is off by 0.8 %."""
    van = SprungVehicle(
        mass_kg=4000.0,
        pitch_inertia_kgm2=8000.0,
        roll_inertia_kgm2=2500.0,
        cg_over_roll_centre_m=1.0,
        cg_over_pitch_centre_m=1.0,
        spring_Npm=60_000.0,
        bump_Nspm=3500.0,
        rebound_Nspm=6000.0,
        wheelbase_m=3.6,
        cg_from_front_m=1.95,
    )
    log, truth = synthetic("rural", seed=1, vehicle=van, sensors=ROAD_SENSORS)
    for model in ("ltm", "mltm"):
        found = estimate(model, log, geometry=van.geometry)
        assert abs(found.error(truth)["mass_kg"]) < 0.002
        assert abs(found.error(truth)["cg_from_front_m"]) < 0.004
        assert abs(found.deviations(truth)["cg_from_front_m"]) < 3.0


def test_averaging_is_what_load_transfer_needs(road_logs):
    """Sample by sample on a bumpy road the corner model is off by many of its standard deviations."""
    log, truth = road_logs["rural"]
    raw, good = estimate("mltm", log, average_s=0.0, noise_sd=300.0), estimate("mltm", log)
    assert raw.nees(truth) > 50.0 * good.nees(truth)
    assert raw.time_s.size == log.time_s.size
    assert abs(raw.error(truth)["mass_kg"]) > 5.0 * abs(good.error(truth)["mass_kg"])


def test_gain_errors_are_considered_in_the_covariance(road_logs):
    """A gain of its own per strut moves mass and position by closed forms of the corner loads."""
    log, _ = road_logs["rural"]
    blind = estimate("mltm", log)
    found = estimate("mltm", log, consider=SensorErrors(strut_gain_sd=0.01))
    corner = DEFENDER.static_N / 9.81
    mass = corner.sum()
    rear = corner[2:].sum() / mass
    by_gain = L * corner / mass * (np.array([0.0, 0.0, 1.0, 1.0]) - rear)
    np.testing.assert_allclose(found.values, blind.values)
    assert found.final_sd["mass_kg"] == pytest.approx(0.01 * np.sqrt(np.sum(corner**2)), rel=0.02)
    assert found.final_sd["cg_from_front_m"] == pytest.approx(0.01 * np.sqrt(np.sum(by_gain**2)), rel=0.05)
    assert blind.final_sd["mass_kg"] < 0.1 * found.final_sd["mass_kg"]


def test_bias_and_misalignment_are_considered(road_logs):
    log, _ = road_logs["urban"]
    bias = estimate("ltm", log, consider=SensorErrors(bias_sd_mps2=0.05))
    tilt = estimate("ltm", log, consider=SensorErrors(misalignment_sd_rad=0.01))
    corner = estimate("mltm", log, consider=SensorErrors(bias_sd_mps2=0.05))
    assert bias.final_sd["mass_kg"] == pytest.approx(1873.0 * 0.05 / 9.81, rel=0.05)
    assert tilt.final_sd["cg_from_front_m"] == pytest.approx(0.55 * 0.01, rel=0.1)
    assert corner.final_sd["mass_kg"] == pytest.approx(1873.0 * 0.05 / 9.81 / 2.0, rel=0.1)


def thinned(log, every):
    """Every n-th sample, as a slower logger without a filter would take them."""
    columns = {n: c if c is None or n == "static_N" else c[::every] for n, c in vars(log).items()}
    return Log(**columns)


@pytest.mark.parametrize("scenario", ["urban", "rural"])
@pytest.mark.parametrize("every", [10, 20, 50, 100])
def test_a_slow_log_knows_that_its_heights_are_too_low(scenario, every, road_logs):
    """Noise and sway that a few samples do not average out shrink both heights; others hardly change."""
    log, truth = road_logs[scenario]
    for method in ("gpc", "rls-force"):
        found = estimate("mltm", thinned(log, every), method)
        for name in load_transfer.NAMES[3:5]:
            assert found.error(truth)[name] < 0.0
            assert abs(found.deviations(truth)[name]) < 2.0, (method, name)
            assert found.final_sd[name] / truth[name] < 0.05 + 0.0066 * every
        if method == "gpc":
            assert abs(found.error(truth)["mass_kg"]) < 0.005
        wanted = f"samples per block of 1 s: {100 // every};"
        assert sum(note.startswith(wanted) for note in found.notes) == 1


def test_a_fast_log_needs_no_word_on_its_rate(road_logs):
    for log, truth in road_logs.values():
        found = estimate("mltm", log)
        assert not [note for note in found.notes if "per block" in note or "left out" in note]
        for name in load_transfer.NAMES[3:5]:
            assert 0.02 < found.final_sd[name] / found.final[name] < 0.025
            assert abs(found.deviations(truth)[name]) < 1.5


def test_a_clock_that_slows_down_or_ticks_in_bursts_loses_nothing(road_logs):
    """The second half at 10 Hz; and three samples within 1 ms, then none for 60 ms."""
    log, truth = road_logs["rural"]
    half = log.time_s.size // 2
    slower = np.r_[np.arange(half), np.arange(half, log.time_s.size, 10)]
    burst = np.arange(log.time_s.size) // 6 * 6 + np.arange(log.time_s.size) % 6
    burst = burst[burst % 6 < 3]
    for kept in (slower, burst):
        columns = {n: c if c is None or n == "static_N" else c[kept] for n, c in vars(log).items()}
        if kept is burst:
            columns["time_s"] = 0.06 * (kept // 6) + 0.0005 * (kept % 6)
        found = estimate("mltm", Log(**columns))
        assert abs(found.error(truth)["mass_kg"]) < 0.002
        assert np.count_nonzero(np.diff(found.values[:, 0]) != 0.0) >= 298
        assert not [note for note in found.notes if "left out" in note]


def test_blocks_that_are_left_out_are_told_of(road_logs):
    log, _ = road_logs["rural"]
    slow = np.r_[np.arange(10_000), np.arange(10_000, log.time_s.size, 150)]
    columns = {n: c if c is None or n == "static_N" else c[slow] for n, c in vars(log).items()}
    found = estimate("ltm", Log(**columns))
    assert any("blocks of 1 s were left out" in note for note in found.notes)
    none = {n: c if c is None or n == "static_N" else c[slow[9_400:]] for n, c in vars(log).items()}
    with pytest.raises(VehicleError, match=r"needs 10 or more: .* blocks of 1 s were left out"):
        estimate("ltm", Log(**none))


def test_heights_below_the_ground_name_the_sign(road_logs, ride_log):
    log, _ = road_logs["rural"]
    for column, name, word in (("ay_mps2", "roll", "ay (> 0 is a"), ("ax_mps2", "pitch", "ax (> 0 acc")):
        wrong = Log(**{**vars(log), column: -getattr(log, column)})
        found = estimate("ltm", wrong)
        wanted = f"cg_over_{name}_centre_m is negative: check the sign of {word}"
        assert next(note for note in found.notes if "negative" in note).startswith(wanted)
        assert not [note for note in estimate("ltm", log).notes if "negative" in note]
    log, _ = ride_log
    wrong = Log(**{**vars(log), "ax_mps2": -log.ax_mps2, "ay_mps2": -log.ay_mps2})
    assert any("cg_height_m is negative" in note for note in estimate("ride", wrong).notes)


def test_gaps_are_left_out(road_logs):
    log, truth = road_logs["rural"]
    forces, ay = log.forces_N.copy(), log.ay_mps2.copy()
    forces[2000:5000, 1] = np.nan
    ay[::7] = np.nan
    holed = Log(**{**vars(log), "forces_N": forces, "ay_mps2": ay})
    for model in ("ltm", "mltm", "ride"):
        for method in ("gpc", "ukf", "rls-acceleration"):
            found = estimate(model, holed, method)
            assert np.isfinite(found.values).all(), (model, method)
            assert abs(found.error(truth)["mass_kg"]) < (0.02 if model == "ride" else 0.002)


def test_what_a_log_does_not_tell_is_said():
    """A straight road at one speed has no bend to tell the height over the roll centre."""
    log, _ = synthetic("urban", seed=1, sensors=NO_ERRORS, duration_s=40.0)
    straight = Log(**{**vars(log), "ay_mps2": np.zeros_like(log.ay_mps2)})
    found = estimate("ltm", straight, noise_sd=40.0)
    assert any("cg_over_roll_centre_m is not identified" in note for note in found.notes)
    assert found.final_sd["cg_over_roll_centre_m"] == pytest.approx(0.5 / np.sqrt(3.0), rel=0.01)


def test_the_prior_can_be_given(road_logs):
    log, truth = road_logs["rural"]
    far = {"mass_kg": (3000.0, 2500.0), "cg_over_roll_centre_m": (1.0, 1.0)}
    for model in ("ltm", "mltm"):
        found = estimate(model, log, prior=far)
        assert abs(found.error(truth)["mass_kg"]) < 0.002
    assert prior_of("mltm", {"mass_kg": (2000.0, 400.0)})["mass_rr_kg"] == (500.0, 200.0)
    assert prior_of("ride", {"cg_height_m": (0.5, 0.2)})["cg_height_m"] == (0.5, 0.2)


def test_orders_of_the_expansion(road_logs):
    log, truth = road_logs["rural"]
    for order in (1, 3):
        assert abs(estimate("ltm", log, order=order).error(truth)["mass_kg"]) < 0.002
    with pytest.raises(VehicleError, match="order"):
        estimate("ltm", log, order=0)


def test_bad_questions_are_refused(ride_log):
    log, _ = ride_log
    with pytest.raises(VehicleError, match=r"unknown model 'mtlm'.*did you mean"):
        estimate("mtlm", log)
    with pytest.raises(VehicleError, match=r"unknown method 'rls'.*allowed are gpc, gpc-report"):
        estimate("ride", log, "rls")
    with pytest.raises(VehicleError, match=r"unknown parameter 'mas_kg'.*did you mean 'mass_kg'"):
        estimate("ride", log, prior={"mas_kg": (1.0, 0.5)})
    with pytest.raises(VehicleError, match="positive centre"):
        estimate("ride", log, prior={"mass_kg": (100.0, 500.0)})
    for noise in (0.0, [1.0, 1.0], np.nan):
        with pytest.raises(VehicleError, match="noise_sd is a positive number, or one for each of 3"):
            estimate("ride", log, noise_sd=noise)


@pytest.mark.slow
def test_ride_over_fifty_drives():
    """Noise of variance 0.1 on the outputs: unbiased but for least squares in the form of forces."""
    errors, squares = {}, {}
    for seed in range(50):
        log, truth = synthetic("rural", seed=seed, sensors=RIDE_SENSORS)
        for method in ("gpc", "ekf", "ukf", "rls-force", "rls-acceleration"):
            found = estimate("ride", log, method, noise_sd=RIDE_NOISE)
            errors.setdefault(method, []).append(list(found.error(truth).values()))
            squares.setdefault(method, []).append(found.nees(truth))
    for method in ("gpc", "ekf", "ukf", "rls-acceleration"):
        relative = np.abs(errors[method])
        assert relative.mean(axis=0).max() < 0.003, method
        assert relative.max() < 0.025, method
        # Mean of 50 chi-squares of 4 degrees, per degree: 0.81 to 1.21 in 95 of 100.
        assert 0.7 < np.mean(squares[method]) < 1.3, method
    mass, _, roll, _ = np.mean(errors["rls-force"], axis=0)
    assert mass < -0.02
    assert roll < -0.05


@pytest.mark.slow
@pytest.mark.parametrize("model", ["ltm", "mltm"])
def test_load_transfer_over_twenty_drives(model):
    noise, gain, squares = [], [], []
    for scenario in ("urban", "rural"):
        for seed in range(20):
            log, truth = synthetic(scenario, seed=seed, sensors=ROAD_SENSORS)
            noise.append(list(estimate(model, log).error(truth).values())[:3])
            log, truth = synthetic(scenario, seed=seed, sensors=ROAD_SENSORS_GAIN)
            found = estimate(model, log, consider=ROAD_SENSORS_GAIN)
            gain.append(list(found.error(truth).values())[:3])
            validated = ("mass_kg", "cg_from_front_m", "cg_from_left_m")
            squares.append(found.nees({name: truth[name] for name in validated}))
    mass, a, left = np.abs(noise).max(axis=0)
    assert mass < 0.002
    assert a < (0.02 if model == "ltm" else 0.005)
    assert left < 0.005
    mass, a, left = np.quantile(np.abs(gain), 0.95, axis=0, method="higher")
    assert mass < 0.013
    assert a < (0.016 if model == "ltm" else 0.0115)
    assert left < 0.013
    assert np.mean(np.abs(gain)[:, 1] < (0.016 if model == "ltm" else 0.01)) >= 0.95
    # 40 chi-squares of 3 degrees, per degree: 0.76 to 1.27 in 95 of 100, had every drive gains of its own;
    # the two drives of a seed have the same.
    assert 0.55 < np.mean(squares) < 1.6

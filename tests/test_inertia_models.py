"""Ride and load-transfer models: the kernels against the equations, balances, and what is made of a log."""

import naive_inertia
import numpy as np
import pytest

from vehicle.errors import VehicleError
from vehicle.inertia import _kernels as _kernels
from vehicle.inertia import _regression, load_transfer, ride
from vehicle.inertia.defender import DEFENDER, Geometry, SprungVehicle
from vehicle.inertia.estimation import predict
from vehicle.inertia.filters import outputs_at
from vehicle.inertia.log import Log
from vehicle.inertia.regression import propagate
from vehicle.inertia.rls import least_squares
from vehicle.inertia.sensors import NO_ERRORS
from vehicle.inertia.synthetic import synthetic

L, B = 2.794, 1.790
LENGTHS = np.array([L, B])


def kernel(kind, inputs, parameters):
    """Outputs of a kernel for rows of parameters, C last; the load-transfer kernels take h_p C."""
    if kind != 0:
        parameters = parameters.copy()
        parameters[:, -1] *= parameters[:, -2]
    values = np.empty((3 if kind == 0 else 4, len(parameters)))
    _regression.evaluate(kind, np.array(inputs), LENGTHS, np.ascontiguousarray(parameters.T), values)
    return values.T


def test_kernels_are_the_equations():
    generator = np.random.default_rng(2)
    u = generator.uniform(0.5, 2.0, (20, 9))
    p = generator.uniform(0.5, 1.5, (20, 7))
    product = p.copy()
    product[:, 5], product[:, 6] = p[:, 5] * p[:, 4], p[:, 6] * p[:, 5]
    for row in u:
        np.testing.assert_allclose(kernel(0, row[:5], p[:, :4]), naive_inertia.ride(row[:5], p[:, :4]))
        load = naive_inertia.load_transfer(row[:4], np.column_stack([p[:, :5], product[:, 5]]), L, B)
        np.testing.assert_allclose(kernel(1, row[:4], p[:, :6]), load, atol=1e-12)
        corner = naive_inertia.corner_transfer(row, np.column_stack([p[:, :6], product[:, 6]]), L, B)
        np.testing.assert_allclose(kernel(2, row, p), corner, atol=1e-12)


def test_load_transfer_balances_forces_and_moments():
    """The four forces carry m A_z, and their moments about the corner of front and left are closed forms."""
    ax, ay, az, square = 2.0, -3.0, 10.5, 400.0
    m, a, left, h_r, h_p, c = 1873.0, 1.4, 0.9, 0.6, 0.5, 1.1
    fl, fr, rl, rr = kernel(1, [ax, ay, az, square], np.array([[m, a, left, h_r, h_p, c]]))[0]
    assert fl + fr + rl + rr == pytest.approx(m * az)
    vertical = m * az / 9.81
    assert (rl + rr) * L == pytest.approx(m * az * a + vertical * ax * h_p + h_p * c * square)
    assert (fr + rr) * B == pytest.approx(m * az * left + vertical * ay * h_r)


def test_both_load_transfer_models_agree_on_a_body_that_does_not_turn():
    """Equal accelerations at the corners and masses of a rigid body: eqs 48-51 are eqs 35-38."""
    a, b, left, right = DEFENDER.geometry.lengths_m
    corner = DEFENDER.static_N / 9.81
    one = kernel(2, [1.5, 2.0, *[9.5] * 4, 300.0, 0.0, 0.0], np.array([[*corner, 0.6, 0.5, 1.2]]))
    other = kernel(1, [1.5, 2.0, 9.5, 300.0], np.array([[1873.0, a, left, 0.6, 0.5, 1.2]]))
    np.testing.assert_allclose(one, other, rtol=1e-12)
    assert b > 0.0 < right


def test_eq_39_finds_the_acceleration_of_the_centre_of_gravity():
    """Corners of a turning rigid body; a model without load transfer would not see A_y at all."""
    heave, pitch, roll = 10.0, 0.7, -0.4
    a, b, left, right = DEFENDER.geometry.lengths_m
    corners = [heave + x * pitch + y * roll for x in (-a, b) for y in (left, -right)]
    masses = DEFENDER.static_N / 9.81
    with_bend = kernel(2, [0.0, 3.0, *corners, 0.0, pitch, roll], np.array([[*masses, 0.6, 0.5, 1.0]]))
    without = kernel(2, [0.0, 0.0, *corners, 0.0, pitch, roll], np.array([[*masses, 0.6, 0.5, 1.0]]))
    moved = (with_bend - without)[0]
    expected = heave * 3.0 / 9.81 * 0.6 / B * (masses[0] + masses[1])
    np.testing.assert_allclose(moved[:2], [-expected, expected], rtol=1e-12)


def test_the_ride_model_is_exact_on_the_synthetic_vehicle():
    """Eqs 31-33 with the drag that they lack; the simulation was not built from them."""
    log, truth = synthetic("rural", seed=1, sensors=NO_ERRORS, duration_s=30.0)
    values = predict("ride", log, truth)
    np.testing.assert_allclose(
        values, np.column_stack([log.heave_mps2, log.pitch_radps2, log.roll_radps2]), atol=1e-9
    )
    still_air = DEFENDER.geometry.model_copy(update={"drag_moment_kg": 0.0})
    off = predict("ride", log, truth, still_air) - values
    drag = DEFENDER.drag_kgpm * 0.75 * log.speed_mps**2 / DEFENDER.pitch_inertia_kgm2
    np.testing.assert_allclose(off, np.column_stack([0.0 * drag, drag, 0.0 * drag]), atol=1e-12)


def test_without_a_tare_means_are_taken_off():
    log, truth = synthetic("rural", seed=1, sensors=NO_ERRORS, duration_s=60.0)
    bare = Log(**{**vars(log), "static_N": None})
    problem = ride.prepare(bare, DEFENDER.geometry)
    np.testing.assert_allclose(problem.inputs.mean(axis=0), 0.0, atol=1e-8)
    np.testing.assert_allclose(problem.outputs.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(predict("ride", bare, truth), problem.outputs, atol=1e-9)


def test_angular_accelerations_come_from_the_corners():
    log, _ = synthetic("rural", seed=1, sensors=NO_ERRORS, duration_s=20.0)
    problem = load_transfer.prepare(log, DEFENDER.geometry, "mltm", 0.0)
    np.testing.assert_allclose(problem.inputs[:, 7], log.pitch_radps2, atol=1e-12)
    np.testing.assert_allclose(problem.inputs[:, 8], log.roll_radps2, atol=1e-12)


def test_slow_motion_is_load_transfer():
    """Averaged over a second the model's forces are those of the simulation to 1 %, sample by sample not."""
    no_lever = SprungVehicle(drag_over_cg_m=0.0)
    log, truth = synthetic("rural", seed=1, sensors=NO_ERRORS, vehicle=no_lever, duration_s=60.0)
    errors = []
    for block in (0.0, 1.0):
        problem = load_transfer.prepare(log, DEFENDER.geometry, "ltm", block)
        values = outputs_at(problem, np.array([truth[name] for name in load_transfer.OWN_NAMES]))
        errors.append(np.nanstd(values - problem.outputs))
    assert errors[1] < 50.0
    assert errors[0] > 5.0 * errors[1]


def test_corner_masses_give_the_centre_of_gravity():
    corner = DEFENDER.static_N / 9.81
    mass, a, left, *rest = load_transfer.from_corners(np.array([[*corner, 0.1, 0.2, 0.3]]), LENGTHS)[0]
    assert mass == pytest.approx(1873.0)
    assert a == pytest.approx(1.4266)
    assert left == pytest.approx(0.8867)
    assert rest == [0.1, 0.2, pytest.approx(1.5)]


def test_heights_and_drag_are_doubted():
    values = np.array([[1873.0, 1.4, 0.9, 0.6, 0.5, 2.0]])
    doubted = load_transfer.add_doubt(values, np.zeros((1, 6, 6)))
    expected = np.array([0.0, 0.0, 0.0, 0.012, 0.01, 2.0 * 0.3 / 0.5]) ** 2
    np.testing.assert_allclose(doubted[0], np.diag(expected))


@pytest.mark.parametrize("form", ["force", "acceleration"])
def test_least_squares_rows_are_the_models(form):
    """Coefficients of known parameters reproduce the targets, and turn back into the parameters."""
    generator = np.random.default_rng(0)
    truth = np.array([1873.0, 2900.0, 870.0, 0.55])
    u = generator.standard_normal((50, 5)) * [3000.0, 3000.0, 2000.0, 2.0, 2.0]
    problem = ride.Regression(
        0, "ride", np.arange(50.0), u, np.array([kernel(0, r, truth[None])[0] for r in u]), LENGTHS
    )
    rows, targets = ride.as_rows(problem, form)
    coefficients = ride.coefficients_of(truth, form)
    np.testing.assert_allclose(rows @ coefficients, targets, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(ride.from_coefficients(coefficients[None], form)[0], truth)
    # Load transfer: with A_z of gravity alone the products of the model are linear in what is fitted.
    a, _, left, _ = DEFENDER.geometry.lengths_m
    known = np.array([[1873.0, a, left, 0.6, 0.5, 1.1]])
    u = np.column_stack(
        [
            generator.standard_normal((60, 2)),
            np.full(60, 9.81) + generator.uniform(-1, 1, 60),
            generator.uniform(0, 600, 60),
        ]
    )
    out = np.array([kernel(1, row, known)[0] for row in u])
    problem = ride.Regression(1, "ltm", np.arange(60.0), u, out, LENGTHS)
    rows, targets = load_transfer.as_rows(problem, form)
    start = load_transfer.coefficients_of(np.array([1500.0, 1.4, 0.9, 0.7, 0.7, 1.0]), form)
    fitted, _ = least_squares(rows, targets, start)
    found = load_transfer.from_coefficients(fitted, form, LENGTHS)[-1]
    np.testing.assert_allclose(found, known[0], rtol=1e-3)


def test_recursive_least_squares_is_least_squares():
    """The recursion ends at the closed form of ridge regression about its start, gaps left out."""
    generator = np.random.default_rng(1)
    rows, noise = generator.standard_normal((200, 2, 3)), generator.standard_normal((200, 2))
    targets = rows @ np.array([1.0, -2.0, 0.5]) + 0.1 * noise
    targets[17, 1] = np.nan
    start = np.array([5.0, 5.0, 5.0])
    mean, covariance = least_squares(rows, targets, start)
    kept = np.delete(rows, 17, axis=0).reshape(-1, 3)
    wanted = np.delete(targets, 17, axis=0).ravel()
    power = np.nanmean(np.sum(rows**2, axis=1), axis=0)
    normal = kept.T @ kept + np.diag(power) / 1e8
    np.testing.assert_allclose(
        mean[-1], np.linalg.solve(normal, kept.T @ wanted + power / 1e8 * start), rtol=1e-9
    )
    residual = wanted - kept @ mean[-1]
    expected = np.linalg.inv(kept.T @ kept) * (residual @ residual) / (wanted.size - 3)
    np.testing.assert_allclose(covariance[-1], expected, rtol=0.03, atol=1e-7)
    np.testing.assert_array_equal(mean[17], mean[16])


def test_forgetting_follows_a_change():
    rows = np.ones((400, 1, 1))
    targets = np.repeat([[1.0], [2.0]], 200, axis=0)
    kept, _ = least_squares(rows, targets, np.zeros(1))
    forgot, _ = least_squares(rows, targets, np.zeros(1), 0.9)
    assert kept[-1, 0] == pytest.approx(1.5, abs=1e-3)
    assert forgot[-1, 0] == pytest.approx(2.0, abs=1e-6)


def test_what_noise_shrinks_is_doubted():
    """A height that is left of a share of noise in its regressor was greater by that share."""
    values = np.array([[1873.0, 1.4, 0.9, 0.6, 0.02, 2.0]])
    plain = load_transfer.add_doubt(values, np.zeros((1, 6, 6)))
    doubted = load_transfer.add_doubt(values, np.zeros((1, 6, 6)), np.array([0.2, 0.97]))
    # 0.6 m = 0.8 * 0.75 m; and hardly any signal tells nothing of a height: 0.1 m over a tenth at least.
    expected = np.array([0.0, 0.0, 0.0, 0.15, 0.97, 0.0]) ** 2
    np.testing.assert_allclose(doubted[0] - plain[0], np.diag(expected), atol=1e-12)


def test_variances_pass_through_functions_to_first_order():
    mean = np.array([[2.0, 5.0], [3.0, 0.0]])
    covariance = np.array([[[0.04, 0.01], [0.01, 0.09]]] * 2)
    values, carried = propagate(lambda p: np.column_stack([p[:, 0] * p[:, 1], p[:, 0]]), mean, covariance)
    np.testing.assert_allclose(values, [[10.0, 2.0], [0.0, 3.0]])
    for k, (x, y) in enumerate(mean):
        slope = np.array([[y, x], [1.0, 0.0]])
        np.testing.assert_allclose(carried[k], slope @ covariance[k] @ slope.T, rtol=1e-6)


def test_missing_columns_and_short_logs_are_named():
    log, truth = synthetic("urban", seed=0, duration_s=3.0)
    with pytest.raises(VehicleError, match=r"'mltm' reads .*corner_az_mps2.*this log has no corner_az_mps2"):
        predict(
            "mltm",
            Log(**{**vars(log), "corner_az_mps2": None}),
            {**truth, **dict.fromkeys(load_transfer.CORNER_NAMES, 1.0)},
        )
    with pytest.raises(VehicleError, match="finds 3 complete samples, it needs 10"):
        load_transfer.prepare(log, Geometry(), "ltm", 1.0)
    with pytest.raises(VehicleError, match="missing: mass_fl_kg"):
        predict("mltm", log, truth)

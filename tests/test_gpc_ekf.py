"""The chaos filter: the Kalman filter where that is exact, closed forms where it is not, and honesty."""

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import brentq

from gpc import (
    ChaosError,
    GpcEkf,
    Hermite,
    Inflation,
    Legendre,
    affine_coefficients,
    collocate,
    normalised_square,
    quadrature,
    scatter,
    total_order,
)
from gpc.belief import as_covariance

F = np.array([[0.9, 0.2, 0.0], [-0.1, 0.95, 0.1], [0.0, 0.0, 1.0]])
H = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.0]])
Q = np.array([[0.02, 0.01, 0.0], [0.01, 0.03, 0.0], [0.0, 0.0, 0.0]])
R = np.array([[0.1, 0.02], [0.02, 0.05]])
MEAN, SPREAD = np.array([1.0, -2.0, 0.5]), np.array([0.5, 0.3, 0.8])


def chaos(germs, order, family=None):
    return collocate((family or Legendre(),) * germs, total_order(germs, order))


def line(setup, centre, spread):
    """Coefficients of states that each follow a germ of their own."""
    return affine_coefficients(setup.families, setup.indices, centre, spread, list(range(len(centre))))


def constant(states):
    """Model of parameters that do not change."""
    return states


def kalman(mean, covariance, measurements):
    """The textbook filter on F, H, Q, R, in its plain form."""
    for z in measurements:
        mean, covariance = F @ mean, F @ covariance @ F.T + Q
        gain = covariance @ H.T @ np.linalg.inv(H @ covariance @ H.T + R)
        mean = mean + gain @ (z - H @ mean)
        covariance = (np.eye(3) - gain @ H) @ covariance
    return mean, covariance


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("measure", [H, lambda states: states @ H.T], ids=["matrix", "function"])
def test_on_a_linear_system_it_is_the_kalman_filter(order, measure):
    """Of order 0 nothing is in germs, and N alone is the extended Kalman filter."""
    setup = chaos(3, order, Hermite())
    gpc = GpcEkf(setup)
    if order == 0:
        belief = gpc.start(MEAN[np.newaxis], np.diag(SPREAD**2))
    else:
        belief = gpc.start(line(setup, MEAN, SPREAD))
    measurements = np.random.default_rng(0).normal([1.0, -1.0], 1.0, (40, 2))
    for z in measurements:
        belief = gpc.forecast(belief, lambda states: states @ F.T, Q)
        belief, _ = gpc.update(belief, z, R, measure)
    mean, covariance = kalman(MEAN, np.diag(SPREAD**2), measurements)
    np.testing.assert_allclose(belief.mean, mean, atol=1e-10)
    np.testing.assert_allclose(belief.covariance, covariance, atol=1e-10)
    # What the germs still hold is a small part: most is carried.
    assert np.all(np.diagonal(belief.chaos_covariance) < 0.1 * np.diagonal(covariance))


def test_restarts_leave_the_kalman_filter_as_it_is():
    setup = chaos(3, 2, Hermite())
    gpc = GpcEkf(setup)
    belief = gpc.start(line(setup, MEAN, SPREAD))
    measurements = np.random.default_rng(1).standard_normal((12, 2))
    for z in measurements:
        belief = gpc.forecast(belief, lambda states: states @ F.T, Q)
        belief, _ = gpc.update(belief, z, R, H)
        again = gpc.restart(belief)
        np.testing.assert_allclose(again.covariance, belief.covariance, atol=1e-14)
        np.testing.assert_array_equal(again.remainder, 0.0)
        belief = again
    mean, covariance = kalman(MEAN, np.diag(SPREAD**2), measurements)
    np.testing.assert_allclose(belief.mean, mean, atol=1e-12)
    np.testing.assert_allclose(belief.covariance, covariance, atol=1e-12)


def test_an_innovation_is_normal_with_the_covariance_it_claims():
    setup = chaos(3, 1)
    gpc = GpcEkf(setup)
    belief = gpc.start(line(setup, MEAN, SPREAD))
    z = np.array([2.0, -1.5])
    _, innovation = gpc.update(belief, z, R, H)
    claimed = H @ np.diag(SPREAD**2 / 3.0) @ H.T + R
    np.testing.assert_allclose(innovation.residual, z - H @ MEAN, atol=1e-14)
    np.testing.assert_allclose(innovation.covariance, claimed, atol=1e-14)
    residual = z - H @ MEAN
    assert innovation.nis == pytest.approx(residual @ np.linalg.inv(claimed) @ residual, rel=1e-12)


def test_without_the_remainder_the_covariance_becomes_half_the_honest_one():
    """A constant seen n times through noise R: 1/C grows by 2/R + C/R^2 per update, and should by 1/R."""
    setup = chaos(1, 2)
    steps, r, c0 = 1000, 0.3, 4.0 / 3.0
    report, honest = GpcEkf.report(setup), GpcEkf(setup)
    one = two = report.start(line(setup, [0.0], [2.0]))
    for _ in range(steps):
        one = report.update(report.forecast(one, constant), [1.0], r, [[1.0]])[0]
        two = honest.update(honest.forecast(two, constant), [1.0], r, [[1.0]])[0]
    assert 1.0 / two.covariance[0, 0] == pytest.approx(1.0 / c0 + steps / r, rel=1e-10)
    assert two.mean[0] == pytest.approx(1.0 / (1.0 + r / (steps * c0)), rel=1e-10)
    assert one.covariance[0, 0] / two.covariance[0, 0] == pytest.approx(0.5, rel=0.01)
    assert one.covariance[0, 0] > 0.0


@pytest.mark.parametrize("kind", ["additive", "multiplicative"])
def test_inflation_holds_the_spread_at_its_fixed_point(kind):
    """Spread s of one germ per step: widened to w, then w R / (R + w^2)."""
    setup = chaos(1, 2)
    r, factor, s0 = 0.3, 0.02, 2.0 / np.sqrt(3.0)
    start = line(setup, [0.0], [2.0])
    gpc = GpcEkf.report(setup, diagonal=[0.0], inflation=Inflation(kind, [factor], start))
    belief = gpc.start(start)
    for _ in range(2000):
        belief = gpc.update(gpc.forecast(belief, constant), [1.0], r, [[1.0]])[0]

    def leftover(s):
        w = s + factor * s0 if kind == "additive" else s * (1.0 + factor)
        return w * r / (r + w**2) - s

    assert belief.coefficients[1, 0] == pytest.approx(brentq(leftover, 1e-3, s0), rel=1e-9)
    if kind == "multiplicative":
        assert belief.covariance[0, 0] == pytest.approx(factor * r / (1.0 + factor) ** 2, rel=1e-9)


def test_inflation_widens_the_parameters_own_germ_only():
    """[M] eq 25 at the nodes: c times the half-range times the node's germ."""
    setup = chaos(2, 2)
    start = line(setup, [5.0, 200.0], [1.0, 30.0])
    current = start + 0.01 * np.arange(12.0).reshape(6, 2)
    widened = Inflation("additive", [0.0, 0.1], start).apply(current)
    added = setup.at_nodes(widened - current)
    np.testing.assert_allclose(added[:, 1], 0.1 * 30.0 * setup.nodes[:, 1], atol=1e-12)
    np.testing.assert_array_equal(added[:, 0], 0.0)
    grown = Inflation("multiplicative", [0.0, 0.1], start).apply(current) / current
    assert grown[2, 1] == pytest.approx(1.1, rel=1e-14)
    grown[2, 1] = 1.0
    np.testing.assert_array_equal(grown[1:], 1.0)


def test_the_diagonal_moves_the_gain_and_nothing_else():
    """[M] eqs 23-24 for one observed state and one parameter."""
    setup = chaos(2, 1)
    start = line(setup, [1.0, 5.0], [0.6, 0.9])
    plain, c, r = start[1:].T @ start[1:], 0.01, 0.2
    gpc = GpcEkf.report(setup, diagonal=[c, 0.0])
    belief, innovation = gpc.update(gpc.start(start), [2.0], r, [[1.0, 0.0]])
    gain = (plain[0, 0] + c) / (plain[0, 0] + c + r)
    np.testing.assert_allclose(innovation.gain, [[gain], [0.0]], atol=1e-15)
    assert belief.mean[0] == pytest.approx(1.0 + gain * (2.0 - 1.0), rel=1e-14)
    np.testing.assert_allclose(belief.covariance, np.diag([(1 - gain) ** 2 * plain[0, 0], plain[1, 1]]))


@pytest.mark.parametrize("carry", [True, False])
def test_regression_is_recursive_least_squares(carry):
    """Outputs U p are states computed anew; [M] eq 27 lets a measurement move p alone."""
    setup = chaos(2, 1, Hermite())
    gpc = GpcEkf.regression(setup, 1, 2, carry=carry)
    truth, prior, spread, r = np.array([2.0, -1.0]), np.array([1.0, 0.0]), np.array([1.5, 2.5]), 0.1
    rng = np.random.default_rng(3)
    rows = rng.standard_normal((30, 2))
    values = rows @ truth + np.sqrt(r) * rng.standard_normal(30)
    initial = affine_coefficients(setup.families, setup.indices, [0.0, *prior], [0.0, *spread], [0, 0, 1])
    belief = gpc.start(initial)
    for row, value in zip(rows, values, strict=True):
        belief = gpc.forecast(belief, lambda s, row=row: np.column_stack([s[:, 1:] @ row, s[:, 1:]]))
        predicted = belief.mean[0]
        belief, innovation = gpc.update(belief, [value], r, [[1.0, 0.0, 0.0]])
        assert innovation.gain[0, 0] == 0.0
        assert belief.mean[0] == predicted
    information = np.diag(spread**-2.0) + rows.T @ rows / r
    least_squares = np.linalg.solve(information, prior / spread**2 + rows.T @ values / r)
    covariance = np.linalg.inv(information)
    if carry:
        np.testing.assert_allclose(belief.mean[1:], least_squares, atol=1e-10)
        np.testing.assert_allclose(belief.covariance[1:, 1:], covariance, atol=1e-10)
    else:
        assert np.all(np.diagonal(belief.covariance)[1:] < 0.7 * np.diagonal(covariance))


def test_a_forecast_sees_the_curvature_of_the_model():
    """exp(a) of a uniform a has mean sinh(r) / r; a first-order filter would say 1."""
    half = 0.8
    setup = quadrature((Legendre(),), total_order(1, 8))
    gpc = GpcEkf.report(setup)
    belief = gpc.forecast(gpc.start(line(setup, [0.0], [half])), np.exp)
    assert belief.mean[0] == pytest.approx(np.sinh(half) / half, rel=1e-13)
    variance = np.sinh(2.0 * half) / (2.0 * half) - (np.sinh(half) / half) ** 2
    assert belief.covariance[0, 0] == pytest.approx(variance, rel=1e-9)


def test_the_remainder_follows_the_slope_of_the_model():
    """Central differences are exact for a parabola; of the state without variance they need nothing."""
    setup = chaos(2, 1)
    gpc = GpcEkf(setup)
    start = np.array([[2.0, 3.0], [0.0, 0.0], [0.0, 0.0]])
    belief = gpc.start(start, [[0.04, 0.0], [0.0, 0.0]])
    moved = gpc.forecast(belief, lambda s: np.column_stack([s[:, 0] ** 2, s[:, 0] * s[:, 1]]), [0.0, 0.5])
    slope = np.array([4.0, 3.0])
    np.testing.assert_allclose(moved.covariance, 0.04 * np.outer(slope, slope) + np.diag([0.0, 0.5]))


STEP_S = 0.25


def decay(current):
    """States x and s of x' = -s x + current, over one step."""

    def model(states):
        x, s = states.T
        e = np.exp(-s * STEP_S)
        return np.column_stack([e * x + current * (1.0 - e) / s, s])

    return model


def final_nees(carry, seed, steps=60, noise=0.05, drift=0.01):
    """Truth drawn from the prior, x measured: normalised square of the error at the end."""
    rng = np.random.default_rng(seed)
    setup = chaos(2, 2)
    gpc = GpcEkf(setup, carry, lower=[-np.inf, 1e-3], upper=[np.inf, np.inf])
    belief = gpc.start(line(setup, [1.0, 0.6], [1.0, 0.4]))
    truth = np.array([1.0, 0.6]) + rng.uniform(-1.0, 1.0, 2) * [1.0, 0.4]
    for k in range(steps):
        model = decay(1.0 + np.sin(0.3 * k))
        truth = model(truth[np.newaxis])[0] + [drift * rng.standard_normal(), 0.0]
        belief = gpc.forecast(belief, model, [drift**2, 0.0] if carry else None)
        z = truth[:1] + noise * rng.standard_normal(1)
        belief, _ = gpc.update(belief, z, noise**2, [[1.0, 0.0]])
    return normalised_square(truth - belief.mean, belief.covariance)


def test_a_nonlinear_filter_is_honest_with_the_remainder_and_not_without():
    seeds = range(60)
    low, high = stats.chi2.ppf([0.025, 0.975], 2 * len(seeds)) / len(seeds)
    assert low < np.mean([final_nees(True, seed) for seed in seeds]) < high
    assert np.median([final_nees(False, seed) for seed in seeds]) > 10.0 * high


def test_nodes_stay_within_bounds():
    seen = []

    def model(states):
        seen.append(states)
        return states

    setup = chaos(2, 2)
    gpc = GpcEkf(setup, lower=[-np.inf, 0.5], upper=[np.inf, 2.0])
    belief = gpc.start(line(setup, [0.0, 0.6], [3.0, 0.6]), [0.1, 0.2])
    belief = gpc.forecast(belief, model)
    gpc.update(belief, [0.7], 0.1, lambda states: model(states)[:, 1:])
    states = np.concatenate(seen)
    assert states[:, 1].min() == 0.5
    assert states[:, 1].max() <= 2.0
    assert states[:, 0].min() < -2.0


def test_a_mean_beyond_a_bound_leaves_the_slope_defined():
    """An update can push a parameter out of its bounds; the model is asked at the bound then."""
    gpc = GpcEkf(chaos(1, 1), lower=[0.5], upper=[2.0])
    belief = gpc.start([[0.1], [0.0]], 0.01)
    moved = gpc.forecast(belief, lambda states: 3.0 * states)
    assert moved.mean[0] == pytest.approx(1.5, rel=1e-14)
    assert moved.covariance[0, 0] == pytest.approx(9.0 * 0.01, rel=1e-13)


def test_scattered_states_lie_within_their_range_at_the_nodes():
    """[M] eq 26: as many nodes as terms, so the nodes keep the noise they were given."""
    setup = chaos(1, 2)
    start = affine_coefficients(setup.families, setup.indices, [0.0, 0.0, 200.0], [0.0, 0.0, 30.0], [0, 0, 0])
    shaken = scatter(setup, start, [3.0, 1.0, 0.0], np.random.default_rng(5))
    moved = setup.at_nodes(shaken) - setup.at_nodes(start)
    assert np.all(np.abs(moved) <= [3.0 + 1e-12, 1.0 + 1e-12, 1e-12])
    assert np.all(np.ptp(moved[:, :2], axis=0) > 0.0)
    again = scatter(setup, start, [3.0, 1.0, 0.0], np.random.default_rng(5))
    np.testing.assert_array_equal(shaken, again)


def test_a_normalised_square_of_a_collapsed_covariance_is_infinite():
    assert normalised_square([1.0, 2.0], np.diag([0.5, 4.0])) == pytest.approx(3.0)
    assert normalised_square([1.0, 2.0], np.zeros((2, 2))) == np.inf


ONE = chaos(1, 1)
PLAIN = GpcEkf(ONE)
BELIEF = PLAIN.start([[1.0], [0.5]])


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: GpcEkf(ONE, lower=[1.0], upper=[1.0]), "lie below its upper"),
        (lambda: GpcEkf.report(ONE, diagonal=[-1.0]), "must be 0 or more"),
        (lambda: GpcEkf.report(ONE, diagonal=[1.0, 1.0]).update(BELIEF, [1.0], 1.0, [[1.0]]), "per state"),
        (lambda: GpcEkf.regression(ONE, 0, 2), "outputs and parameters, got 0 and 2"),
        (lambda: PLAIN.start([[1.0]]), r"shape \(2, n\), got \(1, 1\)"),
        (lambda: PLAIN.start([[1.0], [np.nan]]), "finite coefficients"),
        (lambda: GpcEkf.report(ONE).start([[1.0], [0.5]], 0.1), "carry=True"),
        (lambda: GpcEkf.report(ONE).forecast(BELIEF, constant, 0.1), "carry=True"),
        (lambda: PLAIN.forecast(BELIEF, lambda s: s[:1]), "rows of states to rows of results"),
        (lambda: PLAIN.forecast(BELIEF, lambda s: np.hstack([s, s])), "its 1 states, got 2"),
        (lambda: PLAIN.forecast(BELIEF, lambda s: np.full(s.shape, np.nan)), "NaN or inf at the states"),
        (lambda: PLAIN.update(BELIEF, [np.nan], 0.1, [[1.0]]), "leave out what is missing"),
        (lambda: PLAIN.update(BELIEF, [1.0, 2.0], 0.1, [[1.0]]), "2 values were measured"),
        (lambda: PLAIN.update(BELIEF, [1.0], 0.1, [[1.0, 2.0]]), "one column for each of 1 states"),
        (lambda: PLAIN.update(BELIEF, [1.0, 1.0], 0.0, [[1.0], [1.0]]), "noise above 0"),
        (lambda: chaos_restart(1, 1, 2), "for each of 2 states, got 1"),
        (lambda: chaos_restart(2, 0, 1), "linear term"),
        (lambda: as_covariance([[1.0, 2.0], [0.0, 1.0]], 2, "R"), "R must be symmetric"),
        (lambda: as_covariance([1.0, -1.0], 2, "R"), "variances of 0 or more"),
        (lambda: as_covariance([1.0, 1.0, 1.0], 2, "R"), "a number, 2 variances or a 2 x 2 matrix"),
        (lambda: Inflation("aditive", [0.1], [[1.0], [0.5]]), "did you mean additive"),
        (lambda: Inflation("additive", [0.1, 0.1], [[1.0], [0.5]]), "one factor per state"),
        (lambda: Inflation("additive", [-0.1], [[1.0], [0.5]]), "must be 0 or more"),
        (lambda: scatter(ONE, [[1.0], [0.5]], [1.0, 2.0], np.random.default_rng(0)), "one half-range per"),
    ],
)
def test_bad_parameters_are_named(call, said):
    with pytest.raises(ChaosError, match=said):
        call()


def chaos_restart(germs, order, states):
    """Restart a filter of so many germs and states."""
    gpc = GpcEkf(chaos(germs, order))
    terms = gpc.collocation.indices.shape[0]
    return gpc.restart(gpc.start(np.ones((terms, states))))

"""The compiled pieces of the filters against `GpcEkf` itself and a plain unscented filter."""

import numpy as np
import pytest

from gpc import (
    ChaosError,
    GpcEkf,
    Inflation,
    Legendre,
    _ekf,
    _ukf,
    affine_coefficients,
    collocate,
    normalised_square,
    total_order,
)
from gpc.compiled import as_arrays

CENTRE, HALF = np.array([1.0, 2.0, 0.5]), np.array([0.6, 0.9, 0.4])
LOWER, UPPER = np.array([-np.inf, 0.8, -1.0]), np.array([np.inf, 3.5, 1.0])
R = np.array([[0.02, 0.004], [0.004, 0.03]])
Q = np.diag([1e-4, 2e-4, 0.0])


def model(states):
    """A step of a nonlinear system, row by row."""
    x, y, p = states.T
    return np.column_stack([x + 0.1 * y * p, y - 0.05 * x**2, p])


def measure(states):
    """Two outputs, both bent."""
    x, y, p = states.T
    return np.column_stack([x * y, np.exp(0.3 * x) + p**2])


def measurements(count, seed=0):
    rng = np.random.default_rng(seed)
    truth, rows = np.array([[0.8, 2.3, 0.3]]), []
    for _ in range(count):
        truth = model(truth)
        rows.append(measure(truth)[0] + rng.multivariate_normal([0.0, 0.0], R))
    return rows


def run_pieces(known, reach, rows):
    """A loop as a model would compile it, with the model still in Python."""
    forward, back, chaos, remainder, growth, added, diagonal, carried, lower, upper, share = known
    (n, terms), nodes, m = chaos.shape, forward.shape[1], R.shape[0]
    points, slope, moves = np.zeros((n, nodes + 2 * n)), np.zeros((m, n)), np.zeros((n, n))
    seen, gain, total, white = np.zeros((m, terms)), np.zeros((n, m)), np.zeros((m, m)), np.zeros(m)
    keep, work, found = np.zeros((n, n)), np.zeros((n, n)), []
    for z in rows:
        _ekf.widen(chaos, growth, added)
        _ekf.spread_points(forward, chaos, remainder, lower, upper, reach, points)
        moved = np.ascontiguousarray(model(points.T).T)
        _ekf.expand(back, moved, chaos)
        if carried:
            _ekf.slopes(points, moved, nodes, moves)
            _ekf.carry(moves, remainder, Q, work)
        _ekf.spread_points(forward, chaos, remainder + np.diag(diagonal), lower, upper, reach, points)
        values = np.ascontiguousarray(measure(points.T).T)
        _ekf.expand(back, values, seen)
        _ekf.slopes(points, values, nodes, slope)
        nis = _ekf.update(
            chaos, remainder, diagonal, carried, seen, slope, R, z, gain, total, white, keep, work
        )
        if _ekf.wants_restart(chaos, remainder, share):
            _ekf.restart(chaos, remainder)
        covariance = remainder + chaos[:, 1:] @ chaos[:, 1:].T
        found.append((chaos[:, 0].copy(), covariance, chaos.copy(), nis))
    return found


def filters():
    """Every mode, by name."""
    full, start = GpcEkf.full_germ(CENTRE, HALF, lower=LOWER, upper=UPPER)
    yield "full germ", full, start
    yield "without restarts", GpcEkf(full.collocation, lower=LOWER, upper=UPPER), start
    cubic, begin = GpcEkf.full_germ(CENTRE, HALF, order=3, lower=LOWER, upper=UPPER, restarts_at=0.3)
    yield "order 3", cubic, begin
    for kind in ("additive", "multiplicative"):
        widening = Inflation(kind, np.array([0.0, 0.0, 0.02]), start.coefficients)
        options = {"diagonal": [1e-3, 2e-3, 0.0], "inflation": widening, "lower": LOWER, "upper": UPPER}
        yield f"report, {kind}", GpcEkf.report(full.collocation, **options), start
    alone = GpcEkf(collocate((Legendre(),), total_order(1, 0)), lower=LOWER, upper=UPPER)
    yield "no chaos", alone, alone.start(CENTRE[np.newaxis], HALF**2 / 3.0)


MODES = list(filters())


@pytest.mark.parametrize(("gpc", "start"), [mode[1:] for mode in MODES], ids=[mode[0] for mode in MODES])
def test_the_pieces_are_the_filter(gpc, start):
    rows = measurements(25)
    found = run_pieces(as_arrays(gpc, start), _ekf.REACH, rows)
    belief = start
    for z, (mean, covariance, chaos, nis) in zip(rows, found, strict=True):
        belief = gpc.forecast(belief, model, Q if gpc.carry else None)
        belief, innovation = gpc.update(belief, z, R, measure)
        np.testing.assert_allclose(mean, belief.mean, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(covariance, belief.covariance, rtol=1e-8, atol=1e-11)
        np.testing.assert_allclose(chaos.T, belief.coefficients, rtol=1e-7, atol=1e-9)
        assert nis == pytest.approx(innovation.nis, rel=1e-8)


def test_restarts_do_happen_and_change_the_estimate():
    rows = measurements(25)
    modes = {name: (gpc, start) for name, gpc, start in MODES}
    with_restarts, without = (
        run_pieces(as_arrays(*modes[name]), _ekf.REACH, rows) for name in ("full germ", "without restarts")
    )
    # Of an expansion that is linear again nothing but rows 1 to n is left.
    assert any(not np.any(chaos[:, 4:]) for _, _, chaos, _ in with_restarts)
    assert all(np.any(chaos[:, 4:]) for _, _, chaos, _ in without)
    assert not np.allclose(with_restarts[-1][0], without[-1][0], rtol=1e-6)


def test_a_restart_keeps_mean_and_covariance():
    """Of a state without variance too, and of one that others explain."""
    rng = np.random.default_rng(4)
    root = rng.standard_normal((4, 2))
    covariance = root @ root.T
    covariance[2], covariance[:, 2] = 0.0, 0.0
    chaos, remainder = 0.1 * rng.standard_normal((4, 9)), covariance.copy()
    chaos[2, 1:] = 0.0
    total, mean = covariance + chaos[:, 1:] @ chaos[:, 1:].T, chaos[:, 0].copy()
    _ekf.restart(chaos, remainder)
    np.testing.assert_allclose(chaos[:, 1:] @ chaos[:, 1:].T, total, atol=1e-14)
    np.testing.assert_array_equal(chaos[:, 0], mean)
    np.testing.assert_array_equal(remainder, 0.0)
    np.testing.assert_array_equal(chaos[:, 5:], 0.0)


def test_with_a_short_reach_and_no_chaos_it_is_the_extended_kalman_filter():
    _, gpc, start = MODES[-1]
    rows = measurements(10)
    found = run_pieces(as_arrays(gpc, start), _ekf.SHORT_REACH, rows)
    mean, covariance = CENTRE, np.diag(HALF**2 / 3.0)
    for z, (ours, our_covariance, _, _) in zip(rows, found, strict=True):
        x, y, p = mean
        phi = np.array([[1.0, 0.1 * p, 0.1 * y], [-0.1 * x, 1.0, 0.0], [0.0, 0.0, 1.0]])
        mean, covariance = model(mean[np.newaxis])[0], phi @ covariance @ phi.T + Q
        x, y, p = mean
        h = np.array([[y, x, 0.0], [0.3 * np.exp(0.3 * x), 0.0, 2.0 * p]])
        gain = covariance @ h.T @ np.linalg.inv(h @ covariance @ h.T + R)
        mean = mean + gain @ (z - measure(mean[np.newaxis])[0])
        covariance = (np.eye(3) - gain @ h) @ covariance
        np.testing.assert_allclose(ours, mean, rtol=1e-6)
        np.testing.assert_allclose(our_covariance, covariance, rtol=1e-5, atol=1e-9)


def test_an_innovation_without_variance_changes_nothing():
    chaos, remainder, zero = np.array([[1.0, 0.0]]), np.zeros((1, 1)), np.zeros((1, 1))
    nis = _ekf.update(
        chaos, remainder, np.zeros(1), True, np.zeros((1, 2)), zero, zero, np.ones(1), zero.copy(),
        zero.copy(), np.zeros(1), zero.copy(), zero.copy(),
    )  # fmt: skip
    assert np.isnan(nis)
    np.testing.assert_array_equal(chaos, [[1.0, 0.0]])


def plain_unscented(mean, covariance, rows, alpha):
    """The filter of Julier and Uhlmann in matrices, all points drawn anew before an update."""
    n = mean.size
    lam = 3.0 * alpha**2 - n
    outer = np.full(2 * n + 1, 0.5 / (n + lam))
    weight, spread = outer.copy(), outer.copy()
    weight[0] = lam / (n + lam)
    spread[0] = weight[0] + 3.0 - alpha**2

    def points(mean, covariance):
        root = np.sqrt(n + lam) * np.linalg.cholesky(covariance).T
        return np.clip(np.vstack([mean, mean + root, mean - root]), LOWER, UPPER)

    for z in rows:
        moved = model(points(mean, covariance))
        mean = weight @ moved
        covariance = (moved - mean).T @ (spread[:, np.newaxis] * (moved - mean)) + Q
        states = points(mean, covariance)
        seen = measure(states)
        expected = weight @ seen
        cross = (states - mean).T @ (spread[:, np.newaxis] * (seen - expected))
        total = (seen - expected).T @ (spread[:, np.newaxis] * (seen - expected)) + R
        gain = cross @ np.linalg.inv(total)
        nis = normalised_square(z - expected, total)
        mean, covariance = mean + gain @ (z - expected), covariance - gain @ total @ gain.T
        yield mean, covariance, nis


@pytest.mark.parametrize("alpha", [1.0, 0.4])
def test_the_unscented_pieces_are_the_plain_filter(alpha):
    reach, outer, centre = _ukf.sigma_weights(3, alpha)
    state, belief = CENTRE.copy(), np.diag(HALF**2 / 3.0)
    points, factor = np.zeros((3, 7)), np.zeros((3, 3))
    expected, gain, total, white = np.zeros(2), np.zeros((3, 2)), np.zeros((2, 2)), np.zeros(2)
    rows = measurements(25)
    for z, (mean, covariance, nis) in zip(
        rows, plain_unscented(CENTRE, np.diag(HALF**2 / 3.0), rows, alpha), strict=True
    ):
        assert _ukf.spread_sigma(state, belief, reach, LOWER, UPPER, points, factor)
        moved = np.ascontiguousarray(model(points.T).T)
        _ukf.gather(moved, outer, centre, Q, state, belief)
        assert _ukf.spread_sigma(state, belief, reach, LOWER, UPPER, points, factor)
        values = np.ascontiguousarray(measure(points.T).T)
        ours = _ukf.update(state, belief, points, values, outer, centre, R, z, expected, gain, total, white)
        np.testing.assert_allclose(state, mean, rtol=1e-9)
        np.testing.assert_allclose(belief, covariance, rtol=1e-8, atol=1e-12)
        assert ours == pytest.approx(nis, rel=1e-8)


def test_sigma_points_of_no_covariance_are_refused():
    flat = np.diag([1.0, -1e-9, 1.0])
    assert not _ukf.spread_sigma(CENTRE, flat, 1.0, LOWER, UPPER, np.zeros((3, 7)), np.zeros((3, 3)))


FULL, START = GpcEkf.full_germ(CENTRE, HALF)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: as_arrays(GpcEkf.regression(FULL.collocation, 1, 2), START), "measure them instead"),
        (lambda: as_arrays(GpcEkf(FULL.collocation, lower=[0.0, 1.0]), START), "lower bound as one value"),
        (lambda: as_arrays(GpcEkf(FULL.collocation, inflation=two_states()), START), "inflation of 2 states"),
        (lambda: as_arrays(GpcEkf(MODES[-1][1].collocation, restarts_at=0.5), MODES[-1][2]), "each of 3"),
        (lambda: GpcEkf(FULL.collocation, restarts_at=0.0), "share in"),
        (lambda: GpcEkf.full_germ([1.0, 2.0], [0.1]), "half-range of 0 or more per state"),
        (lambda: GpcEkf.full_germ([1.0], [-0.1]), "half-range of 0 or more per state"),
        (lambda: GpcEkf.full_germ([1.0], [0.0]), "1 germ or more"),
    ],
)
def test_wrong_use_says_what_is_wrong(call, said):
    with pytest.raises(ChaosError, match=said):
        call()


def two_states():
    collocation = collocate((Legendre(),) * 2, total_order(2, 1))
    start = affine_coefficients(collocation.families, collocation.indices, [0, 0], [1, 1], [0, 1])
    return Inflation("additive", np.array([0.1, 0.1]), start)


def test_a_known_state_has_no_germ():
    gpc, start = GpcEkf.full_germ([1.0, 2.0, 3.0], [0.5, 0.0, 0.2])
    assert gpc.collocation.indices.shape == (6, 2)
    assert gpc.restarts_at == 1.0
    np.testing.assert_allclose(start.mean, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(start.covariance, np.diag([0.25, 0.0, 0.04]) / 3.0, atol=1e-16)

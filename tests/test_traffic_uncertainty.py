"""Uncertain diagrams: distributions, designs, and what `propagate` says of the spread."""

import math

import numpy as np
import pytest
from scipy import stats

from drivecycles.traffic import (
    Bottleneck,
    Demand,
    Greenshields,
    Road,
    TrafficError,
    Triangular,
    Underwood,
)
from drivecycles.traffic.distributions import Beta, LogNormal, TruncatedNormal
from drivecycles.traffic.lwr import simulate
from drivecycles.traffic.sampling import LEAST, SAMPLERS, design, even_points
from drivecycles.traffic.uncertain import UncertainDiagram
from drivecycles.traffic.uncertainty import METHODS, propagate

MPH, MILE = 0.44704, 1609.344
DIAGRAM = Greenshields(75.0 * MPH, 250.0 / MILE)
ROAD = Road(5.2 * MILE, 52)
RUN = {
    "demand": 2400.0 / 3600.0,
    "duration_s": 300.0,
    "step_s": 1.0,
    "time_s": [150, 300],
    "cells": [6, 11, 26, 51],
}
SHAPES = (
    TruncatedNormal(30.0, 3.0),
    TruncatedNormal(30.0, 10.0, 20.0, 35.0),
    LogNormal(30.0, 6.0),
    Beta(30.0, 4.0, 15.0, 40.0),
)
each = pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)


def known(sd):
    return {
        "free_flow_mps": TruncatedNormal(75.0 * MPH, sd * MPH),
        "jam_per_m": TruncatedNormal(250.0 / MILE, sd / MILE),
    }


def oracle(shape):
    if isinstance(shape, TruncatedNormal):
        low, high = ((bound - shape.mean) / shape.sd for bound in shape.bounds)
        return stats.truncnorm(low, high, loc=shape.mean, scale=shape.sd)
    if isinstance(shape, LogNormal):
        s = math.sqrt(math.log1p((shape.sd / shape.mean) ** 2))
        return stats.lognorm(s, scale=shape.mean * math.exp(-0.5 * s * s))
    return stats.beta(*shape.shapes, loc=shape.lower, scale=shape.upper - shape.lower)


@each
def test_shares_become_quantiles(shape):
    share = np.array([1e-9, 0.01, 0.3, 0.5, 0.77, 0.999, 1.0 - 1e-9])
    exact = oracle(shape).ppf(share)
    np.testing.assert_allclose(shape.of_germ(shape.germ_of_share(share)), exact, rtol=1e-8)
    np.testing.assert_allclose(shape.of_normal(stats.norm.ppf(share)), exact, rtol=1e-6)
    if not isinstance(shape, TruncatedNormal):
        assert oracle(shape).mean() == pytest.approx(shape.mean, rel=1e-12)
        assert oracle(shape).std() == pytest.approx(shape.sd, rel=1e-12)


def test_the_gauss_rule_of_the_germ_gives_the_moments():
    for shape in SHAPES:
        nodes, weights = shape.family.gauss(40)
        values = shape.of_germ(nodes)
        assert weights @ values == pytest.approx(oracle(shape).mean(), rel=1e-6)
        assert weights @ values**2 == pytest.approx(oracle(shape).moment(2), rel=1e-4)


def test_what_truncation_takes_away_is_known():
    assert TruncatedNormal(30.0, 3.0).cut == pytest.approx(2.0 * stats.norm.sf(4.0), rel=1e-9)
    assert SHAPES[1].cut == pytest.approx(stats.norm.cdf(-1.0) + stats.norm.sf(0.5), rel=1e-12)
    assert SHAPES[2].cut == SHAPES[3].cut == 0.0


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: TruncatedNormal(30.0, 10.0), "reaches below zero, to -10"),
        (lambda: TruncatedNormal(30.0, 10.0, lower=-1.0), "reaches below zero, to -1"),
        (lambda: TruncatedNormal(30.0, 1.0, upper=29.0), "must enclose its mean"),
        (lambda: TruncatedNormal(30.0, 0.0), "standard deviation of a normal .* positive"),
        (lambda: LogNormal(-1.0, 1.0), "mean of a lognormal .* positive"),
        (lambda: Beta(1.0, 0.1, -0.5, 2.0), "reaches zero or below"),
        (lambda: Beta(1.0, 0.1, 1.5, 2.0), "must enclose its mean"),
        (lambda: Beta(1.0, 0.5, 0.5, 1.5), "has a standard deviation below 0.5, got 0.5"),
    ],
)
def test_what_is_no_distribution_is_refused(made, said):
    with pytest.raises(TrafficError, match=said):
        made()


@pytest.mark.parametrize("method", SAMPLERS)
def test_designs_fill_the_cube_evenly(method):
    plan = design(method, 1024, 2, np.random.default_rng(0))
    assert plan.share.shape == (1024, 2)
    assert np.all((plan.share > 0.0) & (plan.share < 1.0))
    for column in plan.share.T:
        assert stats.kstest(column, "uniform").pvalue > 1e-3
    if method == "antithetic":
        np.testing.assert_allclose(plan.share[::2] + plan.share[1::2], 1.0)
    if method in ("lhs", "sobol"):
        first = np.sort(plan.share[:128], axis=0)
        assert np.all(np.floor(first * 128).astype(int) == np.arange(128)[:, None])


@pytest.mark.parametrize("method", SAMPLERS)
def test_errors_are_those_that_repeats_show(method):
    """A smooth function of known mean: estimated errors match the scatter of the means."""
    means, errors = [], []
    for seed in range(300):
        plan = design(method, 64, 2, np.random.default_rng(seed))
        values = np.exp(plan.share[:, 0]) * (1.0 + plan.share[:, 1] ** 2)
        means.append(values.mean())
        errors.append(float(plan.error(values)))
    true = np.sqrt(np.mean((np.array(means) - (np.e - 1.0) * 4.0 / 3.0) ** 2))
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(true, rel=0.15)
    plain = np.sqrt(0.5 * (np.e**2 - 1.0) * 28.0 / 15.0 - ((np.e - 1.0) * 4.0 / 3.0) ** 2) / 8.0
    assert (true < 0.5 * plain) == (method != "mc")


def test_even_points_are_even():
    points = even_points(3, np.random.default_rng(1))
    assert points.shape == (4096, 3)
    np.testing.assert_allclose(points.mean(axis=0), 0.5, atol=1e-3)


def test_correlated_parameters_have_the_correlation_of_their_scores():
    matrix = [[1.0, -0.6], [-0.6, 1.0]]
    uncertain = UncertainDiagram(
        DIAGRAM, {"free_flow_mps": LogNormal(33.0, 4.0), "jam_per_m": Beta(0.15, 0.02, 0.05, 0.2)}, matrix
    )
    values = uncertain.values(uncertain.germs(np.random.default_rng(2).random((20_000, 2))))
    ranks = stats.spearmanr(values).statistic
    assert ranks == pytest.approx(6.0 / np.pi * np.arcsin(-0.3), abs=0.02)
    for column, shape in zip(values.T, uncertain.distributions.values(), strict=True):
        assert stats.kstest(column, oracle(shape).cdf).pvalue > 1e-3


@pytest.mark.parametrize("method", ["gpc", "sobol"])
def test_correlated_parameters_have_no_sobol_index(method):
    """With independent germs an index would depend on which parameter is named first."""
    shapes = known(6.0)
    swapped = dict(reversed(shapes.items()))
    ask = {"method": method, "runs": 128, **RUN}
    one, other = (
        propagate(ROAD, DIAGRAM, each, correlation=[[1.0, 0.8], [0.8, 1.0]], **ask)
        for each in (shapes, swapped)
    )
    for found in (one, other):
        assert found.first_order is None and found.total is None
    np.testing.assert_allclose(one.sd, other.sd, rtol=0.1)
    alone = propagate(ROAD, DIAGRAM, shapes, correlation=np.eye(2), **ask)
    np.testing.assert_allclose(alone.total, propagate(ROAD, DIAGRAM, shapes, **ask).total, atol=0.01)


@pytest.mark.parametrize("method", ["gpc", "sobol"])
def test_a_speed_that_is_certain_has_no_shares(method):
    """The density is uncertain, free triangular traffic drives at its one free-flow speed all the same."""
    shapes = {
        "critical_density_per_m": TruncatedNormal(0.04, 0.002),
        "jam_per_m": TruncatedNormal(0.25, 0.01),
    }
    found = propagate(
        ROAD, Triangular(25.0, 0.04, 0.25), shapes, method=method, runs=128, demand=0.3, duration_s=300.0
    )
    np.testing.assert_array_equal(found.first_order, 0.0)
    np.testing.assert_array_equal(found.total, 0.0)
    np.testing.assert_array_equal(found.explained, 1.0)


@pytest.mark.parametrize("method", METHODS)
def test_every_method_tells_the_same_story(method):
    exact = propagate(ROAD, DIAGRAM, known(6.0), method="gpc", runs=81, order=8, **RUN)
    found = propagate(ROAD, DIAGRAM, known(6.0), method=method, runs=512, seed=3, **RUN)
    assert found.runs == {"gpc": 25}.get(method, 512)
    assert found.mean.shape == (2, 4)
    assert np.all(np.abs(found.mean - exact.mean) < 4.0 * found.error + 1e-4)
    np.testing.assert_allclose(found.sd, exact.sd, rtol=0.15)
    np.testing.assert_allclose(found.quantiles, exact.quantiles, rtol=0.03)
    np.testing.assert_allclose(found.first_order, exact.first_order, atol=0.02)
    assert np.all(found.total >= found.first_order - 1e-12)
    assert np.all(found.explained > 0.99)
    assert found.congested == 0
    assert found.cut == pytest.approx(2.0 * stats.norm.sf(4.0))
    again = propagate(ROAD, DIAGRAM, known(6.0), method=method, runs=512, seed=3, **RUN)
    np.testing.assert_array_equal(found.outcome, again.outcome)


@pytest.mark.parametrize("sd", [3.0, 6.0, 10.0])
def test_nine_runs_of_chaos_beat_a_hundred_antithetic_ones(sd):
    exact = propagate(ROAD, DIAGRAM, known(sd), method="gpc", runs=256, order=15, **RUN)
    other = propagate(ROAD, DIAGRAM, known(sd), method="sobol", runs=2**12, seed=1, **RUN)
    assert np.all(np.abs(exact.mean - other.mean) < 4.0 * other.error)
    chaos = propagate(ROAD, DIAGRAM, known(sd), method="gpc", runs=9, **RUN)
    assert chaos.runs == 9
    repeats = [
        propagate(ROAD, DIAGRAM, known(sd), method="antithetic", runs=100, seed=seed, **RUN).mean - exact.mean
        for seed in range(40)
    ]
    antithetic = np.sqrt(np.mean(np.square(repeats), axis=0))
    error = np.abs(chaos.mean - exact.mean)
    assert np.all(error < antithetic)
    # What the chaos says of its own error is cautious, and still of use.
    assert np.all(error < 1.5 * chaos.error)
    assert np.all(chaos.error < 0.02 * chaos.sd)


def test_at_the_capacity_few_runs_of_chaos_do_not():
    changed = RUN | {
        "demand": DIAGRAM.capacity_per_s,
        "duration_s": 600.0,
        "time_s": [600],
        "cells": [1, 6],
    }
    exact = propagate(ROAD, DIAGRAM, known(6.0), method="sobol", runs=2**12, seed=9, **changed)
    assert 0.4 < exact.congested / exact.runs < 0.6
    chaos = propagate(ROAD, DIAGRAM, known(6.0), method="gpc", runs=9, **changed)
    repeats = [
        propagate(ROAD, DIAGRAM, known(6.0), method="antithetic", runs=100, seed=seed, **changed).mean
        - exact.mean
        for seed in range(20)
    ]
    antithetic = np.sqrt(np.mean(np.square(repeats), axis=0)).max()
    error = np.abs(chaos.mean - exact.mean).max()
    assert error > 2.0 * antithetic
    assert chaos.error.max() > 0.5 * error
    many = propagate(ROAD, DIAGRAM, known(6.0), method="gpc", runs=256, order=15, **changed)
    even = propagate(ROAD, DIAGRAM, known(6.0), method="sobol", runs=256, seed=2, **changed)
    medians = [np.abs(each.quantiles[1] - exact.quantiles[1]).max() for each in (many, even)]
    assert medians[0] > medians[1]


def test_sobol_indices_are_those_of_picking_and_freezing():
    """Jansen's estimator, with the model's own runs."""
    shapes = {"free_flow_mps": TruncatedNormal(30.0, 3.0), "critical_density_per_m": LogNormal(0.02, 0.003)}
    base = Triangular(30.0, 0.02, 0.15)
    road = Road(3000.0, 30, (Bottleneck(2000.0, 0.2),))
    run = {"demand": 0.5, "duration_s": 120.0, "step_s": 1.0, "time_s": [120], "cells": [5, 22]}
    found = propagate(road, base, shapes, method="sobol", runs=2048, quantity="density", **run)
    uncertain = UncertainDiagram(base, shapes)
    generator = np.random.default_rng(4)
    a, b = generator.random((2, 4096, 2))

    def outcome(share):
        members = uncertain.diagrams(uncertain.values(uncertain.germs(share)))
        from drivecycles.traffic.lwr import simulate_members

        return simulate_members(road, members, **run).density_per_m[0]

    first = outcome(a)
    for k in range(2):
        mixed = a.copy()
        mixed[:, k] = b[:, k]
        total = 0.5 * np.mean((first - outcome(mixed)) ** 2, axis=-1) / first.var(axis=-1)
        np.testing.assert_allclose(found.total[k, 0], total, atol=0.05)


def test_a_member_is_a_run_of_its_own():
    found = propagate(ROAD, DIAGRAM, known(6.0), method="mc", runs=5, quantiles=(0.5,), **RUN)
    field = simulate(
        ROAD, Greenshields(*found.values[2]), demand=2400.0 / 3600.0, duration_s=300.0, step_s=1.0
    )
    np.testing.assert_allclose(
        found.outcome[..., 2], field.speed_mps[np.ix_([150, 300], [6, 11, 26, 51])], rtol=1e-12
    )
    np.testing.assert_allclose(found.mean, found.outcome.mean(axis=-1))
    np.testing.assert_allclose(found.quantiles[0], np.median(found.outcome, axis=-1))
    assert found.first_order is None
    assert found.names == ("free_flow_mps", "jam_per_m")


def test_whole_fields_and_changing_demand_are_propagated():
    demand = Demand([0.0, 60.0], [0.3, 0.6])
    found = propagate(ROAD, DIAGRAM, known(3.0), demand=demand, duration_s=90.0, method="gpc", runs=4)
    assert found.mean.shape == (found.time_s.size, 52)
    assert np.all(found.sd[0] == pytest.approx(3.0 * MPH, rel=1e-3))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"method": "antithetc"}, "did you mean 'antithetic'"),
        ({"method": "sobol", "runs": 8}, f"takes {LEAST['sobol']} to"),
        ({"method": "mc", "order": 2}, "only the method 'gpc' has an order"),
        ({"method": "gpc", "runs": 3}, r"takes \(p \+ 1\)\^2 runs"),
        ({"method": "gpc", "runs": 9, "order": 3}, "9 runs allow no order 3"),
        ({"quantity": "flow"}, "known are speed, density"),
        ({"quantiles": (0.0,)}, "between 0 and 1"),
        ({"correlation": [[1.0, 0.5]]}, "symmetric 2 x 2 matrix"),
        ({"correlation": [[1.0, 1.0], [1.0, 1.0]]}, "not positive definite"),
        ({"step_s": 10.0}, "Courant number"),
    ],
)
def test_what_cannot_be_propagated_is_refused(changed, said):
    known_run = {**RUN, "method": "mc", "runs": 16} | changed
    with pytest.raises(TrafficError, match=said):
        propagate(ROAD, DIAGRAM, known(3.0), **known_run)


def test_what_is_uncertain_must_be_a_parameter():
    with pytest.raises(TrafficError, match="did you mean 'jam_per_m'"):
        propagate(ROAD, DIAGRAM, {"jam": LogNormal(0.1, 0.01)}, **RUN)
    with pytest.raises(TrafficError, match="nothing is uncertain"):
        propagate(ROAD, DIAGRAM, {}, **RUN)
    shapes = {"critical_density_per_m": Beta(0.1, 0.03, 0.02, 0.2)}
    with pytest.raises(TrafficError, match="member 0 of 3 cannot be: the critical density"):
        UncertainDiagram(Triangular(30.0, 0.02, 0.15), shapes).diagrams([[0.18], [0.1], [0.1]])


def test_members_that_blow_up_are_told():
    shapes = {"free_flow_mps": TruncatedNormal(30.0, 1.0), "jam_per_m": TruncatedNormal(0.03, 0.001)}
    with pytest.raises(TrafficError, match=r"members blew up under the scheme 'report'"):
        propagate(
            ROAD, Greenshields(30.0, 0.03), shapes, method="mc", runs=4, scheme="report",
            demand=0.6, duration_s=600.0, step_s=1.0,
        )  # fmt: skip
    found = propagate(
        ROAD, Underwood(30.0, 0.02), {"free_flow_mps": LogNormal(30.0, 1.0)}, method="mc", runs=4,
        demand=0.6, duration_s=600.0, step_s=1.0, time_s=[600],
    )  # fmt: skip
    assert found.congested == 4
    assert np.all(np.isfinite(found.outcome))

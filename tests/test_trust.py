"""What makes the solver trustworthy: the five checks of DESIGN.md section 3, and what little noise does."""

import dataclasses

import numpy as np
import pytest
from ems_cases import full_problem, short_cycle, short_problem, without_noise
from scipy.interpolate import CubicSpline

from ems import GridSettings, build_policy, build_problem, draw_noise, load_concept, roll_out
from ems._choose import CERTAIN, ESTIMATE
from ems.grid import deterministic_grid, soc_nodes, stochastic_grid, variance_rows
from ems.policies import CostToGoPolicy
from ems.solution import node_penalties, solve
from ems.statistics import interval, mean_and_error

CONCEPTS = ("hev", "phev")
MUS = (0.7e-3, 2e-3, 6e-3)


def both(problem, cubic):
    """The stochastic and the deterministic program of a problem on the same SOC grid."""
    soc = soc_nodes(problem.concept, problem.settings, 0.005)
    rows = variance_rows(problem.concept, problem.pack, problem.uncertainty, 1.0, problem.settings)
    policies = []
    for name, acts_on, variances, grid in (
        ("s", ESTIMATE, rows, stochastic_grid(soc, rows, problem.pack, problem.uncertainty, 1.0, cubic)),
        ("d", CERTAIN, np.zeros(1), deterministic_grid(soc, problem.pack, cubic)),
    ):
        solution = solve(problem, grid, *node_penalties(problem, soc, variances, grid.soc_step))
        policies.append(CostToGoPolicy(name, acts_on, problem, solution, 0.0))
    return policies


@pytest.mark.parametrize("cubic", [False, True])
@pytest.mark.parametrize("concept", CONCEPTS)
def test_1_without_noise_the_stochastic_program_is_the_deterministic_one(concept, cubic):
    problem = without_noise(short_problem(concept, 400))
    stochastic, deterministic = both(problem, cubic)
    assert stochastic.solution.first_kg.shape[1] > 1
    ours, theirs = stochastic.solution.first_kg[:, 0], deterministic.solution.first_kg[:, 0]
    assert np.abs(ours - theirs).max() < 1e-9
    noise = draw_noise(0, 1, problem.steps)
    one, two = (roll_out(problem, policy, noise) for policy in (stochastic, deterministic))
    assert np.array_equal(one.engine_on, two.engine_on)
    assert np.array_equal(one.engine_torque_Nm, two.engine_torque_Nm)
    assert np.allclose(one.soc, two.soc, atol=1e-7)
    assert not one.variance.any()


def martingale(rollout, policy):
    """A quantity of expectation zero that carries nearly all noise of the cost, shape (n,).

    For any function U of the estimate, ``U(s') - E[U(s + h i / Q + sigma nu)]`` has mean zero in every step;
    U is the cost-to-go of one variance row with the engine off. The expectation is taken by a 21-point rule,
    not by anything that the solver or the rollout use, so the solver's errors stay in what is tested.
    """
    problem, solution = policy.problem, policy.solution
    points, weights = np.polynomial.hermite_e.hermegauss(21)
    i = rollout.current_A.astype(np.float64)
    p = rollout.variance.astype(np.float64)
    s = rollout.soc_estimate.astype(np.float64)
    learnt = p[:, :-1] + problem.scalars.drift + problem.scalars.drift_per_A * np.abs(i) - p[:, 1:]
    centre = s[:, :-1] + i * problem.scalars.charge_to_soc
    soc, row = solution.soc, solution.grid.level.size // 2
    total = np.zeros(s.shape[0])
    for k in range(problem.steps):
        table = CubicSpline(soc, solution.cost_to_go_kg[k + 1, 0, row])
        x = centre[:, k, None] + np.sqrt(np.maximum(learnt[:, k, None], 0.0)) * points
        expected = table(np.clip(x, soc[0], soc[-1])) @ weights / weights.sum()
        total += table(np.clip(s[:, k + 1], soc[0], soc[-1])) - expected
    return total


def check_self_consistency(concept, mu, realizations, truth=100):
    problem = full_problem(concept).with_mu(mu)
    policy = build_policy("stochastic", problem)
    rollout = roll_out(problem, policy, draw_noise(5, realizations, problem.steps), belief_space=True)
    mean, error = mean_and_error(rollout.cost_kg - martingale(rollout, policy))
    assert error < 0.003 * policy.value_kg
    # The control variate leaves an error far below the 0.3 % asked for: where it is least it resolves what
    # look-ups cost (docs/method.md).
    assert abs(mean - policy.value_kg) < max(3.0 * error, 0.001 * policy.value_kg)
    real = roll_out(problem, policy, draw_noise(6, truth, problem.steps))
    mean, error = mean_and_error(real.cost_kg)
    difference = abs(mean - policy.value_kg)
    if concept == "hev":
        assert difference < max(3.0 * error, 0.01 * policy.value_kg)
    # the PHEV's difference is reported in docs/method.md; here it must only not be a different problem
    assert difference < max(3.0 * error, 0.1 * policy.value_kg)


@pytest.mark.parametrize(("concept", "realizations"), [("hev", 200), ("phev", 200)])
def test_2_the_value_is_the_mean_cost_of_rollouts_in_belief_space(concept, realizations):
    check_self_consistency(concept, 2e-3, realizations)


@pytest.mark.slow
@pytest.mark.parametrize("mu", [0.7e-3, 6e-3])
@pytest.mark.parametrize(("concept", "realizations"), [("hev", 400), ("phev", 400)])
def test_2_at_the_other_measurement_variances(concept, realizations, mu):
    check_self_consistency(concept, mu, realizations)


def values(concept, mu, policy):
    coarse, fine = GridSettings(), GridSettings().halved()
    return [
        build_policy(policy, full_problem(concept, settings).with_mu(mu)).value_kg
        for settings in (coarse, fine)
    ]


@pytest.mark.parametrize(
    "policy",
    ["stochastic", "perfect_information", pytest.param("certainty_equivalent", marks=pytest.mark.slow)],
)
@pytest.mark.parametrize("concept", ["hev", pytest.param("phev", marks=pytest.mark.slow)])
def test_3_halving_every_spacing_hardly_moves_the_value(concept, policy):
    coarse, fine = values(concept, 2e-3, policy)
    assert abs(coarse - fine) < 0.003 * fine


@pytest.mark.slow
@pytest.mark.parametrize("mu", [0.7e-3, 6e-3])
@pytest.mark.parametrize("concept", CONCEPTS)
def test_3_at_the_other_measurement_variances(concept, mu):
    coarse, fine = values(concept, mu, "stochastic")
    assert abs(coarse - fine) < 0.003 * fine


# check 4, kernel against twin, is tests/test_sdp.py


def check_stochastic_wins(concept, realizations):
    problem = full_problem(concept)
    noise = draw_noise(1, realizations, problem.steps)
    certain = build_policy("certainty_equivalent", problem)
    for mu in MUS:
        setting = problem.with_mu(mu)
        ours = roll_out(setting, build_policy("stochastic", setting), noise).cost_kg
        theirs = roll_out(setting, certain, noise).cost_kg
        mean, limits = interval(ours - theirs)
        assert limits is not None
        assert limits[0] < 0.0
        assert mean < 0.0
        if concept == "hev":
            assert limits[1] < 0.0


@pytest.mark.parametrize("concept", ["hev", pytest.param("phev", marks=pytest.mark.slow)])
def test_5_stochastic_beats_certainty_equivalent(concept):
    check_stochastic_wins(concept, 40)


@pytest.mark.slow
@pytest.mark.parametrize("concept", CONCEPTS)
def test_5_in_500_pairs(concept):
    check_stochastic_wins(concept, 500)


@pytest.mark.parametrize("concept", CONCEPTS)
def test_perfect_information_bounds_the_stochastic_value(concept):
    problem = full_problem(concept, GridSettings(torque_levels=9, variance_rows=6, soc_step=0.005))
    bound = build_policy("perfect_information", problem).value_kg
    last = bound
    for mu in (1e-5, *MUS):
        value = build_policy("stochastic", problem.with_mu(mu)).value_kg
        assert value > last
        last = value


def test_a_harsher_penalty_or_a_larger_engine_start_cannot_be_cheaper():
    problem = short_problem("hev", 400)
    base = build_policy("stochastic", problem).value_kg
    harsher = problem.concept.model_copy(update={"start_fuel_kg": 2.0 * problem.concept.start_fuel_kg})
    assert build_policy("stochastic", dataclasses.replace(problem, concept=harsher)).value_kg >= base


DRIFTS = ((1e-7, 3.9e-8), (1e-8, 3.9e-9), (1e-9, 1e-10), (1e-13, 3.7e-11), (0.0, 0.0))


def little_noise(concept, seconds, drift, mu):
    """The optimum with nothing uncertain, the lower bound, and the stochastic value, on the default grid."""
    problem = build_problem(load_concept(concept), short_cycle(seconds))
    gamma, beta = drift
    known = problem.uncertainty.model_copy(update={"gamma": gamma, "beta": beta, "mu": mu})
    problem = dataclasses.replace(problem, uncertainty=known)
    names = ("certainty_equivalent", "perfect_information", "stochastic")
    return [build_policy(name, problem).value_kg for name in names]


@pytest.mark.parametrize("mu", [1e-6, 2e-3, 0.3])
@pytest.mark.parametrize("drift", DRIFTS[1::2])
def test_with_little_noise_no_program_promises_less_than_the_optimum_without(drift, mu):
    """Cubic look-ups at kinks that nothing smooths promised down to two thirds of the optimum."""
    certain, bound, stochastic = little_noise("hev", 250, drift, mu)
    assert bound > certain * 0.999
    assert stochastic > certain * 0.999
    assert stochastic > bound * 0.999
    if mu < 1e-3 and drift[0] < 1e-8:
        assert stochastic < 1.004 * certain


@pytest.mark.slow
@pytest.mark.parametrize("mu", [1e-6, 2e-3, 0.3])
@pytest.mark.parametrize("drift", DRIFTS)
@pytest.mark.parametrize("concept", CONCEPTS)
def test_with_little_noise_on_a_whole_cycle(concept, drift, mu):
    certain, bound, stochastic = little_noise(concept, 1371, drift, mu)
    assert bound > certain * 0.999
    assert stochastic > bound * 0.999
    if mu < 1e-3 and drift[0] < 1e-8:
        assert stochastic < 1.003 * certain


@pytest.mark.slow
def test_value_changes_little_where_the_kind_of_look_up_changes():
    """As the drift falls the grid is refined, and at last solved linearly; the value knows nothing of it."""
    drifts = 10.0 ** np.arange(-6.5, -8.6, -0.5)
    values = [little_noise("hev", 250, (drift, 0.39 * drift), 1e-4)[2] for drift in drifts]
    assert np.all(np.diff(values) < 0.001 * values[-1])
    assert np.abs(np.diff(values)).max() < 0.012 * values[-1]

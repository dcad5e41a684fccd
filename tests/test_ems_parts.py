"""Penalties, concepts, noise, statistics, rules and the comparison's book-keeping."""

import dataclasses
import math
import tomllib
import tracemalloc

import numpy as np
import pytest
from ems_cases import full_problem, short_cycle, short_problem, without_noise
from scipy import stats

from bms.uncertainty import steady_variance
from ems import (
    EmsError,
    GridSettings,
    GridWarning,
    build_policy,
    build_problem,
    draw_noise,
    load_concept,
    roll_out,
)
from ems.compare import compare, input_digest
from ems.concept import PRESETS, parse_concept
from ems.footprint import footprint
from ems.grid import soc_nodes
from ems.monotone import hat_weights, linear_shares
from ems.penalty import Terminal, Window
from ems.resolution import Resolution, belief_resolution, process_resolution, settled_spreads
from ems.statistics import interval, mean_and_error
from ems.summary import to_json

COARSE = GridSettings(soc_step=0.01, deterministic_soc_step=0.005, variance_rows=5, torque_levels=5)


def test_penalties_are_what_their_parameters_say():
    window = Window(
        low=0.3,
        high=0.8,
        jump_below_kgps=0.1,
        slope_below_kgps=2.0,
        jump_above_kgps=0.2,
        slope_above_kgps=3.0,
    )
    gamma = window.penalty_kgps()
    assert gamma([0.3, 0.5, 0.8]).tolist() == [0.0, 0.0, 0.0]
    assert gamma([0.2, 0.9]) == pytest.approx([0.1 + 0.2, 0.2 + 0.3])
    s, p = 0.31, 1e-4
    normal = stats.norm(s, 0.01)
    expected = 0.1 * normal.cdf(0.3) + 2.0 * normal.expect(lambda x: 0.3 - x, lb=0.2, ub=0.3)
    assert gamma.expectation(s, p) == pytest.approx(expected, rel=2e-2)
    upsilon = Terminal(target_soc=0.5, jump_below_kg=0.1, slope_below_kg=4.0, slope_above_kg=1.0).penalty_kg()
    assert upsilon([0.4, 0.5, 0.6]) == pytest.approx([0.5, 0.0, 0.1])


def test_a_window_over_all_soc_costs_nothing():
    flat = {"jump_below_kgps": 1.0, "slope_below_kgps": 1.0, "jump_above_kgps": 1.0, "slope_above_kgps": 1.0}
    gamma = Window(low=0.0, high=1.0, **flat).penalty_kgps()
    assert not gamma.expectation([0.0, 0.3, 1.0], 1e-3).any()


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("window", "high"), 1.2, "window.high"),
        (("window", "low"), -0.1, "window.low"),
        (("window", "low"), 0.8, "must be below"),
        (("initial_soc",), 0.5, "outside the window"),
        (("surprise",), 1, "surprise"),
        (("uncertainty", "mu"), -1.0, "uncertainty.mu"),
        (("terminal", "target_soc"), math.nan, "terminal.target_soc"),
        (("initial_soc_sd",), "much", "initial_soc_sd"),
        (("shortfall_kg_per_MJ",), math.inf, "shortfall_kg_per_MJ"),
        (("window", "slope_below_kgps"), math.inf, "window.slope_below_kgps"),
    ],
)
def test_a_bad_concept_is_refused_with_its_place(path, value, message):
    data = tomllib.loads((PRESETS / "hev.toml").read_text())
    place = data
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    with pytest.raises(EmsError, match=message):
        parse_concept(data, "mine.toml")


def test_concepts_by_name_and_path(tmp_path):
    with pytest.raises(EmsError, match="did you mean 'phev'"):
        load_concept("pheev")
    with pytest.raises(EmsError, match="cannot read"):
        load_concept(tmp_path / "none.toml")
    bad = tmp_path / "bad.toml"
    bad.write_text("name = ")
    with pytest.raises(EmsError, match="not valid TOML"):
        load_concept(bad)
    mine = tmp_path / "mine.toml"
    mine.write_text((PRESETS / "hev.toml").read_text().replace('name = "hev"', 'name = "mine"'))
    assert load_concept(mine).name == "mine"
    assert load_concept(mine).load_pack().name == "hev"


def test_noise_is_antithetic_standard_and_independent_of_how_much_is_drawn():
    noise, more = draw_noise(4, 7, 500), draw_noise(4, 40, 500)
    assert np.array_equal(noise.process, more.process[:7])
    assert np.array_equal(noise.initial, more.initial[:7])
    assert np.array_equal(more.measurement[::2], -more.measurement[1::2])
    assert not np.array_equal(draw_noise(5, 7, 500).process, noise.process)
    assert stats.kstest(more.process[::2].ravel(), "norm").pvalue > 1e-3
    for realizations, seed in ((0, 1), (-3, 1), (4, -1)):
        with pytest.raises(EmsError):
            draw_noise(seed, realizations, 10)


def test_standard_error_is_that_of_the_pairs():
    values = np.random.default_rng(0).normal(size=40)
    pairs = values.reshape(-1, 2).mean(axis=1)
    mean, error = mean_and_error(values)
    assert mean == pytest.approx(values.mean())
    assert error == pytest.approx(pairs.std(ddof=1) / math.sqrt(20))
    _, limits = interval(values)
    half = stats.t.ppf(0.975, 19) * error
    assert limits == pytest.approx((mean - half, mean + half))
    assert mean_and_error(np.array([3.0, 5.0])) == (4.0, None)
    assert mean_and_error(np.array([3.0, 5.0, 4.0]))[1] is not None


def test_interval_covers_its_mean_in_95_of_100():
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(2000):
        z = rng.normal(size=10)
        values = np.column_stack([z, -z]).ravel() + 0.5 * rng.normal(size=20)
        low, high = interval(values)[1]
        hits += low <= 0.0 <= high
    assert 0.93 < hits / 2000 < 0.97


def test_an_estimate_that_moves_without_noise_follows_the_charge():
    problem = without_noise(short_problem("phev", 300))
    rollout = roll_out(problem, build_policy("rule_based", problem), draw_noise(0, 1, problem.steps))
    charge = np.concatenate([[0.0], np.cumsum(rollout.current_A[0].astype(float))]) / problem.pack.capacity_C
    assert np.allclose(rollout.soc[0], problem.concept.initial_soc + charge, atol=1e-6)
    assert np.allclose(rollout.soc_estimate, rollout.soc, atol=1e-7)


def test_rules_keep_the_battery_and_follow_the_cycle():
    for concept in ("hev", "phev"):
        problem = full_problem(concept)
        rollout = roll_out(problem, build_policy("rule_based", problem), draw_noise(2, 20, problem.steps))
        assert rollout.shortfall_kg.max() < 1e-3
        assert rollout.soc.min() > problem.concept.window.low - 0.15
        assert rollout.outside_window.mean() < 0.1
        torque, on = rollout.engine_torque_Nm, rollout.engine_on[:, :-1]
        assert not torque[~on].any()


def test_comparison_is_complete_paired_and_independent_of_the_workers():
    concepts = [load_concept("hev"), load_concept("phev")]
    options = {"mus": (1e-3, 4e-3), "realizations": 4, "seed": 3, "settings": COARSE}
    seen = []
    one = compare(concepts, short_cycle(), jobs=1, progress=lambda *done: seen.append(done), **options)
    two = compare(concepts, short_cycle(), jobs=2, **options)
    assert seen[-1] == (len(seen), len(seen))
    assert len(one.cases) == 2 * 2 * 4
    result, again = to_json(one), to_json(two)
    for case in result["cases"] + again["cases"]:
        case["solve_s"] = 0.0
    assert result == again
    for a, b in zip(one.cases, two.cases, strict=True):
        assert np.array_equal(a.rollout.soc, b.rollout.soc)
    assert {pair["versus"] for pair in result["paired"]} == {
        "certainty_equivalent",
        "perfect_information",
        "rule_based",
    }
    first = result["paired"][0]
    cases = {(c.concept, c.mu, c.policy): c.rollout.cost_kg for c in one.cases}
    key = first["concept"], first["mu"]
    expected = np.mean(cases[*key, first["policy"]] - cases[*key, first["versus"]])
    assert first["cost_kg"]["mean"] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mus": (-1.0,)}, "mu is -1"),
        ({"mus": ()}, "no mu"),
        ({"mus": (1e-3, 1e-3)}, "twice"),
        ({"realizations": 0}, "0 realizations"),
        ({"policies": ("stochastik",)}, "did you mean 'stochastic'"),
        ({"policies": ()}, "no policy"),
    ],
)
def test_a_bad_comparison_is_refused(change, message):
    with pytest.raises(EmsError, match=message):
        compare([load_concept("hev")], short_cycle(), **({"settings": COARSE, "realizations": 2} | change))


def test_a_cycle_that_is_too_hard_is_refused_or_limited(tmp_path):
    from drivecycles import load_cycle

    concept = load_concept("hev")
    with pytest.raises(EmsError, match=r"cannot follow 'us06' in \d+ of 600 steps: at t = "):
        build_problem(concept, load_cycle("us06"), settings=COARSE)
    problem = build_problem(concept, load_cycle("us06"), settings=COARSE, on_infeasible="limit")
    rollout = roll_out(problem, build_policy("stochastic", problem), draw_noise(0, 2, problem.steps))
    assert rollout.shortfall_kg.min() > 0.0


def test_leaving_the_grid_is_said():
    problem = short_problem("hev", 600)
    free = {key: 0.0 for key in problem.concept.window.model_dump() if key.endswith("kgps")}
    window = problem.concept.window.model_copy(update=free | {"low": 0.6})
    terminal = problem.concept.terminal.model_copy(update={"jump_below_kg": 0.0, "slope_below_kg": 0.0})
    lax = problem.concept.model_copy(update={"window": window, "terminal": terminal})
    narrow = problem.settings.model_copy(update={"soc_margin": 0.01})
    loose = dataclasses.replace(problem, concept=lax, settings=narrow)
    policy = build_policy("stochastic", loose)
    with pytest.warns(GridWarning, match="outside the SOC grid"):
        roll_out(loose, policy, draw_noise(0, 2, loose.steps))


def test_the_manifest_tells_cars_and_cycles_apart():
    problem = short_problem("hev")
    again = build_problem(problem.concept, short_cycle(), settings=problem.settings)
    assert input_digest(problem) == input_digest(again)
    heavier = dataclasses.replace(
        problem.vehicle, chassis=problem.vehicle.chassis.model_copy(update={"mass_kg": 1501.0})
    )
    table = heavier.controls(heavier.demand(problem.cycle), problem.settings.torque_levels)
    stages = problem.stages._replace(power_W=table.battery_power_W)
    assert input_digest(dataclasses.replace(problem, stages=stages)) != input_digest(problem)
    assert input_digest(short_problem("hev", 300)) != input_digest(problem)


def test_a_cycle_of_another_step_is_resampled():
    cycle = short_cycle().resample(0.5)
    problem = build_problem(load_concept("hev"), cycle, settings=COARSE)
    assert problem.steps == 120
    half = build_problem(load_concept("hev"), cycle, settings=COARSE, step_s=0.5)
    assert half.steps == 240
    assert half.scalars.drift == pytest.approx(0.5e-6)


def test_solution_interpolates_its_own_nodes():
    policy = build_policy("stochastic", short_problem("hev"))
    solution = policy.solution
    for r in (0, 2, 4):
        value = solution.value_kg(float(solution.soc[20]), float(solution.grid.level[r]))
        assert value == pytest.approx(solution.first_kg[0, r, 20], rel=1e-12)
    assert dataclasses.is_dataclass(solution)


def test_weights_that_are_never_negative_have_the_mean_and_variance_of_the_gaussian():
    cells = np.array([[0.0, 1e-7, 1e-3, 0.1, 0.3, 0.7, 1.0, 1.49, 1.51, 3.0]])
    weights = hat_weights(0.002 * cells, 0.002)
    offset = np.arange(weights.shape[1])[:, None] - weights.shape[1] // 2
    assert weights.min() >= 0.0
    assert np.allclose(weights.sum(axis=1), 1.0)
    assert np.allclose((offset * weights[0]).sum(axis=0), 0.0, atol=1e-12)
    assert np.allclose((offset**2 * weights[0]).sum(axis=0), cells[0] ** 2, rtol=1e-4, atol=0.0)


def test_linear_shares_enclose_the_variance():
    level = np.square(np.linspace(0.0, 0.02, 6))
    variance = np.random.default_rng(3).uniform(0.0, 5e-4, 50)
    lower, (below, above) = linear_shares(level, variance)
    assert min(below.min(), above.min()) >= 0.0
    found = below * level[lower] + above * level[lower + 1]
    assert found == pytest.approx(np.minimum(variance, level[-1]))


@pytest.mark.parametrize("step", [0.0025, 0.003, 0.00073, 0.05])
def test_nodes_are_uniform_multiples_of_the_step_within_reach(step):
    for name in ("hev", "phev"):
        concept = load_concept(name)
        nodes = soc_nodes(concept, GridSettings(), step)
        assert np.allclose(np.diff(nodes), step, rtol=1e-9)
        assert np.allclose(nodes / step, np.round(nodes / step))
        assert 0.0 <= nodes[0] <= max(concept.window.low - 0.15, 0.0)
        assert min(concept.window.high + 0.15, 1.0) - step < nodes[-1] <= 1.0


def test_a_narrow_window_at_full_charge_still_has_a_grid():
    concept = load_concept("hev")
    window = concept.window.model_copy(update={"low": 0.97, "high": 1.0})
    high = concept.model_copy(update={"window": window, "initial_soc": 0.98})
    nodes = soc_nodes(high, GridSettings(soc_margin=0.01), 0.01)
    assert nodes.size == 9
    assert nodes[-1] == pytest.approx(1.0)


def test_a_spacing_that_does_not_divide_the_whole_charge_does_not_shift_the_grid():
    """The PHEV's grid ends at full charge; the value once moved with where the last node fell."""
    problem = build_problem(load_concept("phev"), short_cycle(), settings=GridSettings(torque_levels=5))
    values = [
        build_policy(
            "stochastic",
            dataclasses.replace(problem, settings=problem.settings.model_copy(update={"soc_step": step})),
        ).value_kg
        for step in (0.0025, 0.00243)
    ]
    assert values[1] == pytest.approx(values[0], rel=5e-4)


def test_the_default_noise_is_resolved_by_the_default_grid_and_little_noise_is_not():
    for name in ("hev", "phev"):
        problem = full_problem(name)
        for mu in (0.7e-3, 2e-3, 6e-3):
            assert belief_resolution(problem.with_mu(mu)) == Resolution(0.0025, cubic=True)
        assert process_resolution(problem) == Resolution(0.0025, cubic=True)
        quiet = without_noise(problem)
        assert belief_resolution(quiet) == process_resolution(quiet) == Resolution(0.0005, cubic=False)


def test_settled_spreads_are_those_of_the_fixed_point():
    problem = full_problem("hev")
    innovation, belief = settled_spreads(problem)
    soc = np.linspace(problem.concept.window.low, problem.concept.window.high, 101)
    measured = problem.uncertainty.mu * np.min(problem.pack.ocv.alpha(soc))
    drift = problem.uncertainty.process_variance(20.0, 1.0)
    variance = steady_variance(measured, drift)
    assert belief == pytest.approx(math.sqrt(variance), rel=1e-9)
    # At rest what is learnt is what drifts.
    assert innovation == pytest.approx(math.sqrt(drift), rel=1e-9)


@pytest.mark.parametrize("policy", ["stochastic", "certainty_equivalent", "perfect_information"])
def test_the_footprint_is_known_before_the_solve(policy):
    problem = build_problem(load_concept("phev"), short_cycle(400))
    build_policy(policy, problem)
    said = footprint(problem, policy)
    tracemalloc.start()
    try:
        problem = build_problem(load_concept("phev"), short_cycle(400))
        solution = build_policy(policy, problem).solution
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert solution.shape == (said.steps + 1, 2, said.rows, said.nodes)
    assert said.controls == problem.stages.power_W.shape[1]
    assert 0.5 * peak < said.solve_bytes < 2.0 * peak
    assert said.file_bytes > solution.cost_to_go_kg.nbytes

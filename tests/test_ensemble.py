"""Policies over an ensemble of trips: what a policy looks up elsewhere, and how members are put together."""

import numpy as np
import pytest
from ems_cases import short_cycle, short_problem

from drivecycles import DriveCycle
from ems import EmsError, GridSettings, load_concept
from ems.compare import compare
from ems.ensemble import PER_MEMBER, compare_ensemble
from ems.ensemble_summary import by_member, ensemble_json
from ems.policies import build_policy
from ems.problem import build_problem
from ems.statistics import mean_and_error
from ems.summary import to_json
from ems.transfer import planned_stage, transfer

COARSE = GridSettings(soc_step=0.01, deterministic_soc_step=0.005, variance_rows=5, torque_levels=5)
OPTIONS = {"mus": [0.002], "settings": COARSE, "jobs": 1, "seed": 7}


def slower(cycle, factor, name="slower"):
    """The same road at speeds lower by a factor, so that every place is reached later by it."""
    time_s = np.arange(0.0, np.ceil(cycle.duration_s * factor) + 1.0)
    return DriveCycle(name, time_s, np.interp(time_s / factor, cycle.time_s, cycle.speed_mps) / factor)


def test_on_the_planned_cycle_the_stage_is_the_step():
    """Stops, where the place does not tell the step, among them."""
    cycle = short_cycle(300)
    assert np.count_nonzero(cycle.speed_mps == 0.0) > 20
    assert np.array_equal(planned_stage(cycle, cycle), np.arange(301.0))


def test_at_half_speed_every_place_comes_twice_as_late():
    time_s = np.arange(101.0)
    cycle = DriveCycle("c", time_s, 10.0 + 5.0 * np.sin(time_s / 9.0))
    stage = planned_stage(cycle, slower(cycle, 2.0))
    assert stage[-1] == 100.0 and np.all(np.diff(stage) > 0.0)
    np.testing.assert_allclose(stage, 0.5 * np.arange(201.0), atol=0.02)


def test_a_stop_that_is_not_planned_holds_the_stage():
    still = np.concatenate([np.full(50, 10.0), np.zeros(30), np.full(51, 10.0)])
    planned = DriveCycle("p", np.arange(101.0), np.full(101, 10.0))
    stage = planned_stage(planned, DriveCycle("d", np.arange(131.0), still))
    assert np.ptp(stage[52:79]) == 0.0 and np.all(np.diff(stage) >= 0.0)
    assert stage[0] == 0.0 and stage[-1] == 100.0
    # The other way round the planned stop is walked past in one step.
    stage = planned_stage(DriveCycle("d", np.arange(131.0), still), planned)
    assert np.diff(stage).max() > 25.0


@pytest.mark.parametrize("name", ["stochastic", "certainty_equivalent"])
def test_a_policy_taken_to_its_own_cycle_is_the_same(name):
    problem = short_problem("hev")
    policy = build_policy(name, problem)
    moved = transfer(policy, problem)
    assert np.array_equal(moved.solution.cost_to_go_kg, policy.solution.cost_to_go_kg)


def test_between_stages_the_cost_to_go_is_linear():
    problem = short_problem("hev")
    policy = build_policy("certainty_equivalent", problem)
    other = build_problem(load_concept("hev"), slower(problem.cycle, 1.5), settings=COARSE)
    moved = transfer(policy, other)
    stage = planned_stage(problem.cycle, other.cycle)
    table = policy.solution.cost_to_go_kg
    assert moved.solution.cost_to_go_kg.shape[0] == other.steps + 1
    for k in (1, 60, other.steps):
        low = min(int(stage[k]), problem.steps - 1)
        expected = table[low] + (stage[k] - low) * (table[low + 1] - table[low])
        np.testing.assert_allclose(moved.solution.cost_to_go_kg[k], expected, rtol=1e-5, atol=1e-6)
    assert moved.problem is other
    assert transfer(build_policy("rule_based", problem), other).problem is other


def test_an_ensemble_of_one_and_the_same_cycle_is_the_plain_comparison():
    cycle, concepts = short_cycle(), [load_concept("hev")]
    ensemble = compare_ensemble(concepts, cycle, [cycle] * 3, **OPTIONS)
    plain = compare(concepts, cycle, realizations=6, **OPTIONS)
    for ours, theirs in zip(ensemble.cases, plain.cases, strict=True):
        assert (ours.policy, ours.value_kg) == (theirs.policy, theirs.value_kg)
        assert np.array_equal(ours.rollout.cost_kg, theirs.rollout.cost_kg)
        assert np.array_equal(ours.rollout.soc, theirs.rollout.soc)
        assert np.array_equal(ours.fuel_l_per_100km, theirs.fuel_l_per_100km)
    assert to_json(ensemble)["paired"] == to_json(plain)["paired"]
    assert ensemble_json(plain) == {}


def test_members_of_different_lengths_stand_side_by_side():
    cycle = short_cycle()
    members = [cycle, slower(cycle, 1.2), slower(cycle, 1.4)]
    found = compare_ensemble(
        [load_concept("hev")], cycle, members, policies=["stochastic", "rule_based"],
        facts={"plan": "mean"}, **OPTIONS,
    )  # fmt: skip
    longest = int(members[2].duration_s)
    assert found.time_s.size == found.speed_mps.size == longest + 1
    assert np.all(found.speed_mps[121:] == 0.0) and found.distance_m == pytest.approx(cycle.distance_m)
    for case in found.cases:
        rollout = case.rollout
        assert rollout.soc.shape == (6, longest + 1) and rollout.current_A.shape == (6, longest)
        for number, member in enumerate(members):
            after = int(member.duration_s)
            rows = slice(PER_MEMBER * number, PER_MEMBER * (number + 1))
            assert np.all(rollout.soc[rows, after:] == rollout.soc[rows, after : after + 1])
            assert np.all(rollout.current_A[rows, after:] == 0.0)
            assert not rollout.engine_on[rows, after + 1 :].any()
            assert np.any(rollout.current_A[rows, after - 1] != 0.0)
    said = ensemble_json(found)["ensemble"]
    assert [member["duration_s"] for member in said["members"]] == [120.0, 144.0, 168.0]
    assert said["duration_s"]["mean"] == 144.0 and said["duration_s"]["sd"] == pytest.approx(24.0)
    first, other = (case.rollout.cost_kg for case in found.cases)
    difference = by_member(first) - by_member(other)
    assert said["paired"][0]["cost_kg_by_member"] == difference.tolist()
    assert said["paired"][0]["cheaper_share"] == np.mean(difference < 0.0)
    # One pair to a member: the standard error is that of the members' means.
    assert mean_and_error(first - other)[1] == pytest.approx(difference.std(ddof=1) / np.sqrt(3.0))
    assert said["members"][1]["cases"][0]["cost_kg"] == pytest.approx(first[2:4].mean())
    assert found.settings["ensemble"]["plan"] == "mean"


def test_an_ensemble_does_not_depend_on_the_number_of_workers():
    cycle = short_cycle()
    pair = [cycle, slower(cycle, 1.3)]
    one, two = (
        compare_ensemble([load_concept("hev")], cycle, pair, **{**OPTIONS, "jobs": jobs}) for jobs in (1, 2)
    )
    for ours, theirs in zip(one.cases, two.cases, strict=True):
        assert np.array_equal(ours.rollout.cost_kg, theirs.rollout.cost_kg)


def test_an_ensemble_of_one_is_refused():
    with pytest.raises(EmsError, match="two cycles or more, got 1"):
        compare_ensemble([load_concept("hev")], short_cycle(), [short_cycle()], **OPTIONS)

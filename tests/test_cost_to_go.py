"""The cost-to-go in parts is the cost-to-go kept whole, and what memory it takes is known before."""

import dataclasses

import numpy as np
import pytest
from ems_cases import short_problem

import ems.cost_to_go
import ems.memory
from ems import build_policy, draw_noise, roll_out
from ems.cost_to_go import Kept, Recomputed, part_starts, table_bytes
from ems.errors import EmsError
from ems.memory import available_bytes, require_memory, solve_bytes


@pytest.fixture(scope="module", params=["stochastic", "certainty_equivalent", "perfect_information"])
def policy(request):
    return build_policy(request.param, short_problem("hev"))


def in_parts(policy):
    """The same problem, solved as if no table fitted: its policy."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ems.cost_to_go, "KEEP_BYTES", 0)
        other = build_policy(policy.name, policy.problem)
    assert isinstance(other.solution.cost_to_go, Recomputed)
    return other


def test_parts_have_the_bits_of_the_whole(policy):
    whole, parts = policy.solution, in_parts(policy).solution
    assert isinstance(whole.cost_to_go, Kept)
    assert parts.cost_to_go.after.shape[0] > 3
    assert np.array_equal(parts.cost_to_go_kg, whole.cost_to_go_kg)
    assert np.array_equal(parts.offset_kg, whole.offset_kg)
    assert np.array_equal(parts.first_kg, whole.first_kg)


def test_a_stage_is_the_same_wherever_it_lies(policy):
    stored = in_parts(policy).solution.cost_to_go
    steps = policy.problem.steps
    for k in (0, 1, int(stored.starts[1]), int(stored.starts[1]) + 1, steps - 1, steps):
        assert np.array_equal(stored.stage(k), policy.solution.cost_to_go.stage(k))


def test_a_rollout_in_parts_has_the_bits_of_one_at_once(policy):
    noise = draw_noise(3, 4, policy.problem.steps)
    one, two = (roll_out(policy.problem, each, noise) for each in (policy, in_parts(policy)))
    for field in dataclasses.fields(one):
        assert np.array_equal(getattr(one, field.name), getattr(two, field.name)), field.name


def test_parts_cover_every_step_once():
    for steps in (1, 2, 3, 50, 2134, 83042):
        starts = part_starts(steps)
        assert starts[0] == 0
        assert starts[-1] == steps
        assert np.all(np.diff(starts) > 0)
    longest = np.diff(part_starts(83042)).max()
    assert longest < 2 * np.sqrt(2 * 83042)


def test_memory_is_what_was_said():
    problem = short_problem("hev")
    solution = build_policy("stochastic", problem).solution
    _, _, rows, nodes = solution.shape
    said = solve_bytes(problem.steps, rows, nodes, keep_bytes=0)
    stored = in_parts(build_policy("stochastic", problem)).solution.cost_to_go
    held = stored.after.nbytes + max(table.nbytes for _, _, table in stored.parts())
    assert said == held
    assert solve_bytes(problem.steps, rows, nodes) == solution.cost_to_go_kg.nbytes


def test_a_day_on_the_road_takes_little():
    whole = table_bytes(83042, 10, 361)
    assert whole > 2e9
    assert solve_bytes(83042, 10, 361) < 0.02 * whole


def test_what_does_not_fit_is_refused_with_what_to_do(monkeypatch):
    monkeypatch.setattr(ems.memory, "available_bytes", lambda: 10_000_000)
    with pytest.raises(EmsError, match=r"takes 0\.\d GB of memory, and 0\.0 GB are available; take a larger"):
        require_memory(4268, 10, 361)
    monkeypatch.setattr(ems.memory, "available_bytes", lambda: None)
    require_memory(4268, 10, 361)


def test_available_memory_is_read_where_the_machine_says():
    found = available_bytes()
    assert found is None or 1e6 < found < 1e15

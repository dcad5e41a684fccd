"""A policy as bytes says at every node what the policy itself decides there."""

import numpy as np
import pytest
from ems_cases import short_problem

from bms import SocBelief
from ems import GridSettings, build_policy, build_problem
from ems.errors import EmsError
from ems.policy_map import policy_map


@pytest.mark.parametrize("name", ["stochastic", "certainty_equivalent", "perfect_information"])
def test_the_map_is_what_the_policy_decides(name):
    policy = build_policy(name, short_problem("hev"))
    found = policy_map(policy, 20, 23)
    assert found.code.shape == (3, 2, found.variance.size, found.soc.size)
    assert found.code.dtype == np.uint8
    rng = np.random.default_rng(1)
    for _ in range(200):
        k, e, r, j = (rng.integers(size) for size in found.code.shape)
        belief = SocBelief(float(found.soc[j]), float(found.variance[r]))
        action = policy.act(belief, 20 + int(k), bool(e))
        assert (found.control[k, e, r, j], found.engine_next[k, e, r, j]) == tuple(action)
    assert np.all(found.control[:, 0] == 0)
    assert np.all(found.control[:, 1] > 0)


def test_steps_that_do_not_exist_and_too_many_controls_are_refused():
    policy = build_policy("certainty_equivalent", short_problem("hev"))
    with pytest.raises(EmsError, match=r"steps 5 to 999 are asked for; the trip has steps 0 to \d+"):
        policy_map(policy, 5, 1000)
    few = short_problem("hev")
    settings = GridSettings(torque_levels=200)
    many = build_problem(few.concept, few.cycle, settings=settings)
    with pytest.raises(EmsError, match="do not fit in a byte; 128 do"):
        policy_map(build_policy("certainty_equivalent", many), 0, 1)

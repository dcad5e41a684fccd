"""Policies and estimators of the user's own take part in a comparison, on the same noise as socwise's."""

import numpy as np
import pytest
from ems_cases import short_cycle

from bms import BatteryError, SocBelief
from bms.estimators import EstimatorKind
from bms.estimators.catalogue import make_estimator
from ems import EmsError, GridSettings, load_concept
from ems.closed import ClosedLoop, Training, compare_closed
from ems.compare import compare
from ems.policies import TRUTH, Action, PolicyKind, build_policy

SETTINGS = GridSettings(soc_step=0.01, deterministic_soc_step=0.005, variance_rows=5, torque_levels=5)
CYCLE = short_cycle(120)


class Wrapped:
    """A policy of socwise's in other clothes, so that the loop has to call it at every step."""

    def __init__(self, name, inner):
        self.name, self.inner, self.value_kg = name, inner, inner.value_kg
        if name == "all_knowing":
            self.acts_on = TRUTH

    def act(self, belief, step, engine_on):
        return self.inner.act(belief, step, engine_on)


class Fixed:
    """Takes the same action whatever happens."""

    def __init__(self, *action):
        self.name, self.action = "fixed", Action(*action)

    def act(self, belief, step, engine_on):
        return self.action


def wrap(name, inner):
    return PolicyKind(name, lambda problem: Wrapped(name, build_policy(inner, problem)))


def both(own, inner, **options):
    arguments = {"mus": (0.002,), "realizations": 4, "seed": 3, "settings": SETTINGS} | options
    return compare([load_concept("hev")], CYCLE, policies=[inner, wrap(own, inner)], **arguments).cases


@pytest.mark.parametrize(
    ("own", "inner"),
    [("mine", "stochastic"), ("rules", "rule_based"), ("all_knowing", "perfect_information")],
)
def test_an_own_policy_meets_the_same_noise_as_ours(own, inner):
    ours, theirs = both(own, inner)
    assert (theirs.policy, theirs.value_kg) == (own, ours.value_kg)
    np.testing.assert_allclose(theirs.rollout.cost_kg, ours.rollout.cost_kg, rtol=1e-9)
    np.testing.assert_allclose(theirs.rollout.soc, ours.rollout.soc, atol=1e-7)


def test_an_own_policy_is_made_once_where_it_does_not_depend_on_mu():
    made = []

    def build(problem):
        made.append(problem.uncertainty.mu)
        return build_policy("rule_based", problem)

    def mus_of(depends_on_mu):
        made.clear()
        kinds = [PolicyKind("mine", build, depends_on_mu)]
        compare([load_concept("hev")], CYCLE, mus=(0.001, 0.004), policies=kinds, realizations=2, jobs=1)
        return sorted(made)

    assert mus_of(False) == [0.001]
    assert mus_of(True) == [0.001, 0.004]


@pytest.mark.parametrize("action", [(1, 0), (-1, 0), (0, 2), (99, 1)])
def test_what_cannot_be_done_is_refused(action):
    kind = PolicyKind("fixed", lambda problem: Fixed(*action))
    with pytest.raises(EmsError, match=r"'fixed' decided \(.*\) at step 0 with the engine off; allowed"):
        compare(
            [load_concept("hev")], CYCLE, mus=(0.002,), policies=[kind], realizations=2, settings=SETTINGS
        )


def test_a_clutch_cannot_close_on_an_engine_that_is_off():
    kind = PolicyKind("fixed", lambda problem: Fixed(0, 1))
    with pytest.raises(EmsError, match="at step 1 with the engine on; allowed are the controls 1 to"):
        compare(
            [load_concept("hev")], CYCLE, mus=(0.002,), policies=[kind], realizations=2, settings=SETTINGS
        )


def test_names_and_builders_that_are_none_are_refused():
    with pytest.raises(EmsError, match="no name for a policy"):
        PolicyKind("My Policy", Fixed)
    with pytest.raises(EmsError, match="cannot be built"):
        PolicyKind("mine", "rule_based")
    with pytest.raises(EmsError, match="call yours otherwise"):
        both("stochastic", "stochastic")
    with pytest.raises(EmsError, match="given twice"):
        compare([load_concept("hev")], CYCLE, policies=[wrap("a", "rule_based"), wrap("a", "rule_based")])


class Doubting:
    """The EKF, reporting twice its standard deviation."""

    def __init__(self, cell, belief, sensors):
        self.inner = make_estimator(
            "ekf", cell, soc=belief.mean, soc_sd=belief.variance**0.5, sensors=sensors, capacity_sd=0.02
        )

    @property
    def belief(self):
        inner = self.inner.belief
        return SocBelief(inner.mean, min(4.0 * inner.variance, 1 / 12))

    def observe(self, measurement, step_s):
        self.inner.observe(measurement, step_s)
        return self.belief


def closed(estimator, jobs=1, **options):
    loop = ClosedLoop(estimator=estimator, **options)
    return compare_closed(
        [load_concept("hev")],
        CYCLE,
        loop,
        Training(CYCLE, realizations=4),
        policies=["rule_based", PolicyKind("mine", lambda problem: build_policy("rule_based", problem))],
        mus=[0.002],
        realizations=4,
        settings=SETTINGS,
        jobs=jobs,
    )


def test_own_estimator_and_policy_in_a_closed_loop():
    plain = closed("ekf", options={"relaxation_sd": 0.3, "resistance_sd": 0.3})
    doubting = closed(EstimatorKind("doubting", Doubting))
    assert doubting.settings["estimator"] == "doubting"
    for comparison in (plain, doubting):
        ours, theirs = comparison.cases
        np.testing.assert_array_equal(ours.rollout.cost_kg, theirs.rollout.cost_kg)
    ratio = doubting.cases[0].rollout.variance / plain.cases[0].rollout.variance
    assert ratio[:, -1] == pytest.approx(4.0, rel=0.2)


def test_an_own_estimator_takes_no_options():
    with pytest.raises(BatteryError, match=r"options \(gains\) are for socwise's own"):
        closed(EstimatorKind("doubting", Doubting), options={"gains": 1})

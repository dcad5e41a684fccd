"""The closed loop through the protocols equals the rollout kernel, realization by realization."""

import numpy as np
import pytest
from ems_cases import short_problem

from bms import BatteryError, SocBelief
from bms.estimators import ModelEstimator
from bms.filtering import tabulate_filter
from bms.measurement import Measurement
from bms.plants import ModelPlant
from ems import build_policy, draw_noise, policy_names, roll_out
from ems.loop import run_closed_loop


@pytest.mark.parametrize("name", policy_names())
@pytest.mark.parametrize("concept", ["hev", "phev"])
def test_loop_equals_kernel(concept, name):
    problem = short_problem(concept, 300)
    policy = build_policy(name, problem)
    noise = draw_noise(3, 2, problem.steps)
    kernel = roll_out(problem, policy, noise)
    known = tabulate_filter(problem.pack, problem.uncertainty)
    start = problem.concept.initial_soc
    for r in range(2):
        truth = start + problem.concept.initial_soc_sd * noise.initial[r]
        plant = ModelPlant(
            truth, problem.pack.capacity_C, problem.uncertainty, known, noise.process[r], noise.measurement[r]
        )
        belief = SocBelief(start, problem.concept.initial_soc_sd**2)
        estimator = ModelEstimator(belief, problem.pack.capacity_C, problem.uncertainty, known)
        loop = run_closed_loop(problem, policy, plant, estimator, knows_truth=name == "perfect_information")
        assert np.array_equal(loop.engine_on[0], kernel.engine_on[r])
        assert np.array_equal(loop.engine_torque_Nm[0], kernel.engine_torque_Nm[r])
        assert np.allclose(loop.soc[0], kernel.soc[r], atol=1e-7)
        assert np.allclose(loop.soc_estimate[0], kernel.soc_estimate[r], atol=1e-7)
        assert np.allclose(loop.variance[0], kernel.variance[r], rtol=1e-6)
        assert loop.cost_kg[0] == pytest.approx(kernel.cost_kg[r], rel=1e-9)
        assert loop.engine_starts[0] == kernel.engine_starts[r]


def test_plant_and_estimator_refuse_what_they_cannot_take():
    problem = short_problem("hev")
    known = tabulate_filter(problem.pack, problem.uncertainty)
    one = np.zeros(1)
    with pytest.raises(BatteryError, match="give as many"):
        ModelPlant(0.6, 26e3, problem.uncertainty, known, one, np.zeros(2))
    plant = ModelPlant(0.6, 26e3, problem.uncertainty, known, one, one)
    assert plant.step(0.0, 0.0, 1.0).soc_from_voltage == 0.6
    with pytest.raises(BatteryError, match="1 steps"):
        plant.step(0.0, 0.0, 1.0)
    estimator = ModelEstimator(SocBelief(0.6, 1e-4), 26e3, problem.uncertainty, known)
    with pytest.raises(BatteryError, match="choose another estimator"):
        estimator.observe(Measurement(current_A=1.0, voltage_V=200.0), 1.0)

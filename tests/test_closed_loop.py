"""Policies in a loop with a real estimator: paired, reproducible; a crash costs one realization."""

import dataclasses
from contextlib import contextmanager

import numpy as np
import pytest
from ems_cases import short_cycle, short_problem

from bms import BatteryError, Pack, UncertaintyModel
from bms.cells import load_cell
from bms.pack_cell import cell_from_pack
from bms.plants.fmu.errors import FmuCrash
from bms.plants.sensed import SensorNoise
from drivecycles import load_cycle
from ems import EmsError, GridSettings, build_policy, load_concept, policy_names
from ems.closed import ClosedLoop, Scatter, Training, battery_for, compare_closed, identify
from ems.closed import run as closed_run
from ems.closed.identify import behaviour_of, training_trip
from ems.closed.run import run_ensemble
from ems.closed.scatter import TRAINING, draw_realization
from ems.summary import to_json

COARSE = GridSettings(soc_step=0.01, deterministic_soc_step=0.005, variance_rows=5, torque_levels=5)
QUIET = SensorNoise(**dict.fromkeys(SensorNoise.model_fields, 0.0))
ALIKE = Scatter(capacity_sd=0.0, resistance_sd=0.0, relaxation_sd=0.0, time_sd=0.0)


def learning(problem):
    """The problem with an uncertainty that a real estimator might have."""
    return dataclasses.replace(
        problem, uncertainty=UncertaintyModel(gamma=1e-10, beta=1e-9, mu=1.0), least_reach=4e-4
    )


@pytest.fixture(scope="module")
def setup():
    problem = learning(short_problem("hev"))
    policies = {name: build_policy(name, problem) for name in policy_names()}
    return problem, policies, cell_from_pack(problem.pack)


def test_the_same_bits_whatever_the_number_of_processes(setup):
    problem, policies, cell = setup
    one, two = (
        run_ensemble(problem, policies, ClosedLoop(), cell, seed=3, realizations=6, jobs=jobs)
        for jobs in (1, 2)
    )
    assert one.kept == two.kept == tuple(range(6))
    for key in policies:
        for first, second in zip(one.tracks[key], two.tracks[key], strict=True):
            assert np.array_equal(first, second)
    few = run_ensemble(problem, policies, ClosedLoop(), cell, seed=3, realizations=2)
    for key in policies:
        assert np.array_equal(few.tracks[key].soc, one.tracks[key].soc[:2])


def test_every_policy_meets_the_same_realization(setup):
    problem, policies, cell = setup
    found = run_ensemble(problem, policies, ClosedLoop(), cell, seed=0, realizations=4)
    soc = np.array([found.tracks[key].soc[:, 0] for key in policies])
    assert np.ptp(soc, axis=0).max() == 0.0 and np.ptp(soc[0]) > 1e-3
    assert np.allclose(soc[0, ::2] + soc[0, 1::2], 2.0 * problem.concept.initial_soc)
    truth = found.tracks["perfect_information"]
    assert np.array_equal(truth.estimate, truth.soc) and not truth.variance.any()
    for key in set(policies) - {"perfect_information"}:
        tracks = found.tracks[key]
        assert np.all(tracks.estimate[:, 0] == problem.concept.initial_soc)
        assert np.all(tracks.variance[:, 0] == problem.concept.initial_soc_sd**2)
        # The current that flowed moves the true SOC, by the specimen's own capacity.
        factor = [draw_realization(0, r, problem.steps).factors(Scatter()).capacity for r in range(4)]
        moved = np.cumsum(tracks.current_A, axis=1) / cell.capacity_C / np.array(factor)[:, None]
        assert np.allclose(tracks.soc[:, 1:] - tracks.soc[:, :1], moved, atol=1e-12)


def test_with_nothing_uncertain_the_estimator_counts_the_charge():
    """No noise, one specimen, a known start: whatever the estimator, it stays with the truth."""
    problem = learning(short_problem("phev", 300))
    concept = problem.concept.model_copy(update={"initial_soc_sd": 1e-6})
    concept._folder = problem.concept._folder
    problem = dataclasses.replace(problem, concept=concept)
    policies, cell = {"rule_based": build_policy("rule_based", problem)}, cell_from_pack(problem.pack)
    for name in ("coulomb", "ekf", "ukf", "gpc-ekf"):
        loop = ClosedLoop(estimator=name, scatter=ALIKE, sensors=QUIET)
        tracks = run_ensemble(problem, policies, loop, cell, seed=0, realizations=1).tracks["rule_based"]
        assert np.abs(tracks.soc - tracks.estimate).max() < 2e-5
        assert np.ptp(tracks.soc) > 0.005


def crashing(numbers):
    """A plant whose FMU dies in some realizations."""
    usual = closed_run.open_plant
    doomed = {draw_realization(5, number, 120).initial for number in numbers}

    @contextmanager
    def opened(loop, concept, cell):
        with usual(loop, concept, cell) as start:

            def begin(draws):
                if draws.initial in doomed:
                    raise FmuCrash("the FMU crashed in the step from 3 s to 4 s: segmentation fault")
                return start(draws)

            yield begin

    return opened


def test_a_crash_costs_its_realization_for_every_policy(setup, monkeypatch):
    problem, policies, cell = setup
    whole = run_ensemble(problem, policies, ClosedLoop(), cell, seed=5, realizations=6)
    monkeypatch.setattr(closed_run, "open_plant", crashing([1, 4]))
    found = run_ensemble(problem, policies, ClosedLoop(), cell, seed=5, realizations=6)
    assert set(found.dropped) == {1, 4} and "segmentation fault" in found.dropped[4]
    # A complete pair first, then those whose mirror image is gone.
    assert found.kept == (2, 3, 0, 5)
    for key in policies:
        assert np.array_equal(found.tracks[key].soc, whole.tracks[key].soc[list(found.kept)])
    monkeypatch.setattr(closed_run, "open_plant", crashing(range(6)))
    with pytest.raises(EmsError, match=r"every one of 6 realizations broke off.*segmentation fault"):
        run_ensemble(problem, policies, ClosedLoop(), cell, seed=5, realizations=6)


def test_training_has_a_noise_of_its_own():
    first, other = draw_realization(0, 0, 9), draw_realization(0, 0, 9, TRAINING)
    assert first.initial != other.initial
    mirrored = draw_realization(0, 1, 9)
    assert np.array_equal(mirrored.noise, -first.noise) and np.array_equal(mirrored.specimen, -first.specimen)
    assert draw_realization(0, 1, 9, TRAINING).initial != -other.initial
    factors = [draw_realization(1, n, 2, TRAINING).factors(Scatter()) for n in range(2000)]
    assert np.std([np.log(one.capacity) for one in factors]) == pytest.approx(0.02, rel=0.08)
    assert np.std([np.log(one.resistance) for one in factors]) == pytest.approx(0.05, rel=0.08)
    errors = draw_realization(1, 0, 5000).sensor_errors(SensorNoise(), 52)
    assert np.std(errors.voltage_V) == pytest.approx(52 * 0.002, rel=0.05)
    assert np.mean(errors.voltage_V) == pytest.approx(
        52 * 0.001 * draw_realization(1, 0, 5000).offset[1], abs=0.01
    )
    assert training_trip("larsson") != "larsson" and training_trip("wltc-3b") == "larsson"


def test_an_estimator_that_counts_has_no_mu_and_an_uncertainty_that_grows():
    loop, concept = ClosedLoop(estimator="coulomb"), load_concept("phev")
    found = identify(concept, loop, load_cycle("us06"), realizations=8, error_weight=0.0)
    assert found.fitted.model.mu > 1.0
    assert found.fitted.fit.explained_believed > 0.8
    claimed = found.behaviour.variance
    assert claimed[:, -1].min() > 1.2 * claimed[0, 0]
    # The claim is that of the module's formula: start, offset and capacity, beside a little noise.
    charge = np.abs(found.behaviour.soc[:, -1] - found.behaviour.soc[:, 0])
    drift = loop.sensors.current_bias_sd_A * 600.0 / concept.load_pack().capacity_C
    expected = concept.initial_soc_sd**2 + drift**2 + (loop.scatter.capacity_sd * charge) ** 2
    assert np.allclose(claimed[:, -1], expected, rtol=0.01)
    with pytest.raises(EmsError, match="at least 2"):
        identify(concept, loop, load_cycle("us06"), realizations=1)


def test_the_battery_is_the_concepts_or_as_many_cells_as_fill_it():
    concept = load_concept("hev")
    own = battery_for(concept, ClosedLoop())
    assert own.pack == concept.load_pack() and own.cell.series == 52
    filled = battery_for(concept, ClosedLoop(cell=load_cell("a123-26650")))
    assert (filled.cell.series, filled.cell.capacity_Ah) == (58, pytest.approx(6.9))
    assert filled.pack.ocv_V == filled.cell.ocv_V and isinstance(filled.pack, Pack)
    with pytest.raises(BatteryError, match="did you mean"):
        ClosedLoop(estimator="ekff").make_estimator(own.cell, 0.6, 0.01)
    with pytest.raises(BatteryError, match="unknown key speed"):
        ClosedLoop(options={"speed": 1}).make_estimator(own.cell, 0.6, 0.01)


def test_a_comparison_says_what_it_identified():
    training = Training(short_cycle(200), realizations=4)
    arguments = {"realizations": 4, "settings": COARSE, "jobs": 1}
    told = []
    found = compare_closed(
        [load_concept("hev"), load_concept("phev")], short_cycle(), ClosedLoop(), training,
        progress=lambda done, of: told.append((done, of)), **arguments,
    )  # fmt: skip
    assert told[-1] == (16, 16)
    summary = to_json(found)
    assert (summary["plant"], summary["estimator"], summary["dropped"]) == ("ecm", "ekf", [])
    for concept in ("hev", "phev"):
        entry = summary["identified"][concept]
        cases = [case for case in summary["cases"] if case["concept"] == concept]
        assert [case["policy"] for case in cases] == list(policy_names())
        assert {case["mu"] for case in cases} == {entry["mu"]["value"]}
        assert entry["trip"] == "short" and entry["realizations"] == 4
        assert entry["fit_on_the_trip"]["nees_estimator"] > 0.0
        informed = cases[policy_names().index("perfect_information")]
        assert informed["soc_rmse"] == 0.0 and cases[0]["soc_rmse"] > 0.0
    # Given mus replace the identified one, gamma and beta stay; who does not depend on mu drives once.
    again = compare_closed(
        [load_concept("hev")], short_cycle(), ClosedLoop(), training, mus=(1e-3, 1e-2), **arguments
    )
    assert [case.mu for case in again.cases] == [1e-3] * 4 + [1e-2] * 4
    assert again.cases[1].rollout is again.cases[5].rollout and again.cases[5].solve_s == 0.0
    same = again.settings["closed_loop"]["identified"]["hev"], summary["identified"]["hev"]
    assert all(same[0][name] == same[1][name] for name in ("gamma", "beta", "mu", "fit"))
    with pytest.raises(EmsError, match="at least 1"):
        compare_closed([load_concept("hev")], short_cycle(), ClosedLoop(), training, realizations=0)


def test_one_realization_shows_no_scatter(setup):
    problem, policies, cell = setup
    tracks = run_ensemble(problem, policies, ClosedLoop(), cell, seed=0, realizations=1).tracks["stochastic"]
    with pytest.raises(EmsError, match="too few"):
        behaviour_of(tracks, problem.step_s)

"""What `make bench` times agrees, on a small problem; no test here depends on how fast anything is."""

import dataclasses
import io

import naive
import numpy as np
import pytest
from battery_cases import drive_current_A
from rich.console import Console

from benchmarks.battery import (
    filter_tasks,
    gradient_tasks,
    member_tasks,
    other_estimator_tasks,
    require_equal,
    simulation_tasks,
)
from benchmarks.battery_log import measure
from benchmarks.cases import certain_case, hev_problem, stochastic_case
from benchmarks.cpp_sweep import compiled
from benchmarks.driving import rollout_tasks, table_tasks
from benchmarks.errors import UnavailableError
from benchmarks.rivals import CERTAIN, STOCHASTIC, DisagreementError
from benchmarks.scaling import Line, fit_together, work_of
from benchmarks.table import Section, build_table
from benchmarks.timing import Task, Timing, interleave
from bms.cells import load_cell
from bms.estimators.catalogue import estimator_names
from bms.filtering import tabulate_filter
from ems import GridSettings
from ems.smoothing import smoothing_weights

SMALL = GridSettings(soc_step=0.0025, deterministic_soc_step=0.002, variance_rows=15, torque_levels=5)


@pytest.fixture(scope="module")
def problem():
    return hev_problem(12, SMALL)


@pytest.fixture(scope="module")
def stochastic(problem):
    return stochastic_case(problem)


@pytest.fixture(scope="module")
def log():
    return measure(load_cell("lfp-2ah"), drive_current_A(1000))


def deviation(rival, case, ours):
    """What a rival finds, or a skip where it cannot run."""
    try:
        return rival.require_agreement(case, ours)
    except UnavailableError as reason:
        pytest.skip(str(reason))


@pytest.mark.parametrize("rival", STOCHASTIC, ids=lambda rival: rival.name)
def test_rivals_of_the_stochastic_solve_agree(rival):
    """Over 200 steps: with few left, the jump of the penalty parts them more at the smallest variances."""
    stochastic = stochastic_case(hev_problem(200, SMALL))
    assert 0.0 < deviation(rival, stochastic, stochastic.solve()) <= rival.tolerance


@pytest.mark.parametrize("rival", CERTAIN, ids=lambda rival: rival.name)
def test_rivals_of_the_deterministic_solve_agree(problem, rival):
    case = certain_case(problem)
    assert deviation(rival, case, case.solve()) <= 1e-12


@pytest.mark.parametrize("rival", [*STOCHASTIC[:2], STOCHASTIC[3], *CERTAIN], ids=lambda rival: rival.name)
def test_a_rival_with_another_problem_is_refused(problem, stochastic, rival):
    case = certain_case(problem) if rival in CERTAIN else stochastic
    dearer = dataclasses.replace(case, stages=case.stages._replace(cost_kg=case.stages.cost_kg + 1e-3))
    with pytest.raises(DisagreementError, match="no time is taken"):
        deviation(rival, dearer, case.solve())


def test_a_compiled_rival_leaves_the_arithmetic_of_this_process_alone(stochastic):
    """What -ffast-math links in flushes small numbers to zero, everywhere, from then on."""
    try:
        STOCHASTIC[0].solve(stochastic)
    except UnavailableError as missing:
        pytest.skip(str(missing))
    assert np.float64(5e-324) + np.float64(0.0) > 0.0


def test_a_rival_whose_compiler_is_missing_is_left_out(stochastic, monkeypatch):
    compiled.cache_clear()
    monkeypatch.setenv("CXX", "no-such-compiler")
    with pytest.raises(UnavailableError, match=r"no C\+\+ compiler found \(no-such-compiler\)"):
        STOCHASTIC[0].require_agreement(stochastic, stochastic.solve())
    compiled.cache_clear()


def test_a_value_that_is_not_a_number_is_refused(stochastic):
    with pytest.raises(DisagreementError):
        STOCHASTIC[3].require_agreement(stochastic, np.full_like(stochastic.solve(), np.nan))


def test_evaluations_are_those_of_distinct_controls(stochastic):
    cost, power = stochastic.stages
    expected = sum(
        c < 2 or (power[k, c], cost[k, c]) != (power[k, c - 1], cost[k, c - 1])
        for k in range(power.shape[0])
        for c in range(power.shape[1])
    )
    assert stochastic.evaluations == expected * stochastic.penalty_kg.size
    assert stochastic.every(3).stages.power_W.shape == (4, 8)


def test_the_deterministic_case_is_that_of_the_tests_twin(problem):
    """The kernel that is timed solves the problem that the plain twin of the test suite solves."""
    coarse = SMALL.model_copy(update={"deterministic_soc_step": 0.01})
    case = certain_case(dataclasses.replace(problem, settings=coarse)).every(4)
    twin = naive.sweep(case.grid, case.scalars, case.stages, case.penalty_kg, case.terminal_kg)
    assert np.allclose(case.solve(), twin[0], rtol=1e-12)


def test_kernel_and_loop_drive_alike_and_the_units_are_counted(problem):
    paired, others = rollout_tasks(problem, 2)
    assert [task.units for task in paired] == [24, 12]
    assert len(others) == 3
    controls, known = table_tasks(problem)
    assert controls[0].units == 4268 * 8
    assert known[0].units == tabulate_filter(problem.pack, problem.uncertainty).measured.size
    timings = interleave([*paired, *others], 1)
    assert all((timing.cpu >= 0.0).all() and (timing.wall > 0.0).all() for timing in timings)


def test_cells_and_plain_loop_agree_and_the_steps_are_counted(log):
    paired, others = simulation_tasks(log, 200)
    assert [task.units for task in paired] == [1000, 200]
    assert paired[0].run().shape == (1000,)
    assert [task.units for task in others] == [1000] * 4
    np.testing.assert_array_equal(others[0].run(), paired[0].run())
    np.testing.assert_array_equal(others[1].run().voltage_V, paired[0].run())


@pytest.mark.slow
def test_the_reports_estimator_and_its_equations_agree(log):
    ours, theirs = gradient_tasks(log, 300)
    assert (ours.units, theirs.units) == (1000, 300)
    assert ours.run().soc.shape == (17,)
    assert theirs.run().shape == (300, 6)


@pytest.mark.parametrize("joint", [False, True])
def test_the_filter_is_that_of_the_textbook_with_model_error_and_watch_off(log, joint):
    ours, plain, *rivals = filter_tasks(log, 300, joint)
    assert len(ours.run().parameters) == len(plain.run().parameters) == (3 if joint else 0)
    assert [task.units for task in rivals] == [300] * len(rivals)
    assert rivals != []


def test_every_estimator_is_timed(log):
    tasks = [*gradient_tasks(log, 50), *filter_tasks(log, 50, joint=True), *other_estimator_tasks(log, 100)]
    named = {task.name.split(",")[0] for task in tasks}
    assert set(estimator_names()) <= named
    timings = interleave(tasks, 1)
    assert all((timing.wall > 0.0).all() for timing in timings)


def test_members_are_counted_and_estimate_what_one_alone_does(log):
    cells, estimators = member_tasks(log, 3)
    assert [task.units for task in (*cells, *estimators)] == [3000, 1000] * 2
    assert [task.run().voltage_V.shape for task in cells] == [(3, 1000), (1, 1000)]
    many, one = (task.run().soc for task in estimators)
    assert (many.shape, one.shape) == ((3, 17), (1, 17))
    np.testing.assert_array_equal(many[2], one[0])


@pytest.mark.parametrize("theirs", [[1.0, 2.1], [1.0, np.nan]])
def test_tracks_that_differ_are_refused(theirs):
    assert require_equal("tracks", np.ones(2), np.full(2, 1.0 + 1e-12), 1e-9) > 0.0
    with pytest.raises(DisagreementError, match=r"tracks differ .* no time is taken"):
        require_equal("tracks", np.array([1.0, 2.0]), np.array(theirs), 1e-9)


def line(size, cpu_s, work=None):
    return Line("x", size, np.zeros((size.size, 3)) if work is None else work, cpu_s, size)


def test_a_line_is_fitted_and_judged():
    x = np.array([1.0, 2.0, 3.0, 4.0])
    assert line(x, 0.5 + 0.25 * x).fit() == pytest.approx((0.5, 0.25, 1.0))
    # Least squares by hand: slope 0.8, intercept 0.5, residuals -0.3, 0.9, -0.9, 0.3 over a spread of 5.
    assert line(x, np.array([1.0, 3.0, 2.0, 4.0])).fit() == pytest.approx((0.5, 0.8, 1.0 - 1.8 / 5.0))


def test_all_lines_are_fitted_together(stochastic):
    work = np.array([[1.0, 5.0, 2.0], [2.0, 1.0, 9.0], [4.0, 4.0, 4.0], [3.0, 8.0, 1.0]])
    cpu_s = work @ [0.5, 0.25, 0.0]
    lines = [line(cpu_s[:2], cpu_s[:2], work[:2]), line(cpu_s, cpu_s, work)]
    each, determination, worst = fit_together(lines)
    assert each == pytest.approx([0.5, 0.25, 0.0], abs=1e-12)
    assert (determination, worst) == pytest.approx((1.0, 0.0))


def test_work_is_counted(stochastic):
    rows, nodes = stochastic.penalty_kg.shape
    circuits, look_ups, tables, taps = work_of(stochastic)
    assert rows == 15  # padded to two vectors of eight
    assert 16 * circuits == look_ups
    assert stochastic.evaluations == rows * circuits
    steps = stochastic.stages.power_W.shape[0]
    assert tables == steps * nodes * rows
    weights = smoothing_weights(stochastic.spread, stochastic.grid.soc_step)
    whole_blocks = -(-nodes // 16) * 16
    assert 3 * tables < taps <= steps * whole_blocks * rows * rows * weights.shape[1]


def test_rounds_are_interleaved():
    order = []
    tasks = [Task(name, lambda name=name: order.append(name), 1) for name in "ab"]
    interleave(tasks, 3)
    assert "".join(order) == "ab" * 4


def test_ratios_are_those_of_minima_and_of_rounds():
    ours = Timing("ours", np.array([1.0, 2.0, 4.0]), np.array([2.0, 2.0, 2.0]))
    theirs = Timing("theirs", np.array([10.0, 60.0, 16.0]), np.array([3.0, 5.0, 9.0]))
    console = Console(width=120, file=io.StringIO())
    console.print(build_table([Section("Solve", "step", [ours, theirs])], 3))
    row = next(line for line in console.file.getvalue().splitlines() if "theirs" in line)
    assert [cell.strip() for cell in row.split("│")[2:6]] == [
        "10.0 / 16.0",
        "3.00 / 5.00",
        "10.0 / 10.0",
        "1.50 / 2.50",
    ]

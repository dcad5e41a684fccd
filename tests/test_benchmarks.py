"""What `make bench` times agrees, on a small problem; no test here depends on how fast anything is."""

import dataclasses
import io

import naive
import numpy as np
import pytest
from rich.console import Console

from benchmarks.cases import certain_case, hev_problem, stochastic_case
from benchmarks.driving import rollout_tasks, table_tasks
from benchmarks.rivals import CERTAIN, STOCHASTIC, DisagreementError
from benchmarks.table import Section, build_table
from benchmarks.timing import Task, Timing, interleave
from bms.filtering import tabulate_filter
from ems import GridSettings

SMALL = GridSettings(soc_step=0.0025, deterministic_soc_step=0.002, variance_rows=12, torque_levels=5)


@pytest.fixture(scope="module")
def problem():
    return hev_problem(12, SMALL)


@pytest.fixture(scope="module")
def stochastic(problem):
    return stochastic_case(problem)


@pytest.mark.parametrize("rival", STOCHASTIC, ids=lambda rival: rival.name)
def test_rivals_of_the_stochastic_solve_agree(stochastic, rival):
    assert 0.0 < rival.require_agreement(stochastic, stochastic.solve()) <= rival.tolerance


@pytest.mark.parametrize("rival", CERTAIN, ids=lambda rival: rival.name)
def test_rivals_of_the_deterministic_solve_agree(problem, rival):
    case = certain_case(problem)
    assert rival.require_agreement(case, case.solve()) <= 1e-12


@pytest.mark.parametrize("rival", [*STOCHASTIC[::2], *CERTAIN], ids=lambda rival: rival.name)
def test_a_rival_with_another_problem_is_refused(problem, stochastic, rival):
    case = certain_case(problem) if rival in CERTAIN else stochastic
    dearer = dataclasses.replace(case, stages=case.stages._replace(cost_kg=case.stages.cost_kg + 1e-3))
    with pytest.raises(DisagreementError, match="no time is taken"):
        rival.require_agreement(dearer, case.solve())


def test_a_value_that_is_not_a_number_is_refused(stochastic):
    with pytest.raises(DisagreementError):
        STOCHASTIC[2].require_agreement(stochastic, np.full_like(stochastic.solve(), np.nan))


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
        "3.0 / 5.0",
        "10.0 / 10.0",
        "1.5 / 2.5",
    ]

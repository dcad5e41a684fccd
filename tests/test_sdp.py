"""The compiled kernels against their plain twins, and against an oracle that smooths in the control loop."""

import dataclasses
import math

import naive
import numpy as np
import pytest
from ems_cases import short_problem
from hypothesis import given, settings
from hypothesis import strategies as st

from ems._choose import CERTAIN, ESTIMATE, TRUTH, choose, expected_cost_to_go
from ems._interpolate import node_slopes
from ems._moves import solve_current
from ems._sdp import Scalars, Stages, sweep
from ems.grid import deterministic_grid, perfect_information_grid, soc_nodes, stochastic_grid, variance_rows
from ems.solution import node_penalties


def build(kind, seed, nodes=None):
    """A random problem on real packs: (grid, scalars, stages, penalty, terminal)."""
    rng = np.random.default_rng(seed)
    problem = short_problem("hev" if seed % 2 else "phev")
    uncertainty = problem.uncertainty.model_copy(update={"mu": float(rng.uniform(5e-4, 6e-3))})
    soc = soc_nodes(problem.concept, problem.settings, 0.01)[:nodes]
    variances = np.zeros(1)
    if kind == "stochastic":
        variances = variance_rows(problem.concept, problem.pack, uncertainty, 1.0, problem.settings)
        grid = stochastic_grid(soc, variances, problem.pack, uncertainty, 1.0)
    elif kind == "perfect":
        grid = perfect_information_grid(soc, 4, problem.pack, uncertainty, 1.0)
    else:
        grid = deterministic_grid(soc, problem.pack)
    penalty, terminal = node_penalties(problem, soc, variances, grid.soc_step)
    steps, controls = 4, 5
    stages = Stages(rng.uniform(0.0, 2e-3, (steps, controls)), rng.uniform(-7e4, 5e4, (steps, controls)))
    scalars = Scalars(1.0, 1.0 / problem.pack.capacity_C, uncertainty.gamma, uncertainty.beta, 4e-4, 1e-6)
    return grid, scalars, stages, penalty, terminal


def both(terminal):
    return np.array([terminal, terminal])


@pytest.mark.parametrize("kind", ["stochastic", "perfect", "deterministic"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_sweep_equals_its_twin(kind, seed):
    grid, scalars, stages, penalty, terminal = build(kind, seed)
    rows, n = penalty.shape
    kept, offset = np.empty((5, 2, rows, n), np.float32), np.empty(5)
    first = sweep(grid, scalars, stages, penalty, both(terminal), False, kept, offset)
    twin = naive.sweep(grid, scalars, stages, penalty, terminal)
    assert np.allclose(first, twin[0], rtol=1e-12, atol=1e-12)
    assert np.allclose(kept + offset[:, None, None, None], twin, rtol=1e-5, atol=1e-6)
    assert np.allclose(offset, twin.min(axis=(1, 2, 3)), rtol=1e-12)


def test_a_steep_end_of_the_voltage_curve_does_not_blow_up():
    """Near a steep end alpha, and so the next variance, changes by several rows within a few nodes."""
    problem = short_problem("hev")
    soc = np.linspace(0.0, 1.0, 401)
    volts = 190.0 + 2.0 * soc + 40.0 * np.exp(-(1.0 - soc) / 0.006)
    data = problem.pack.model_dump() | {"soc": tuple(soc), "ocv_V": tuple(volts), "slope_floor": 0.001}
    data |= {"resistance_ohm": (0.3,) * 401}
    pack = type(problem.pack)(**data)
    nodes = np.arange(212, 401) * 0.0025  # the last segment reaches from the plateau to the end
    fine = problem.settings.model_copy(update={"variance_rows": 10})
    wide = problem.concept.model_copy(update={"initial_soc_sd": 0.03})
    rows = variance_rows(wide, pack, problem.uncertainty, 1.0, fine)
    grid = stochastic_grid(nodes, rows, pack, problem.uncertainty, 1.0)
    penalty, terminal = node_penalties(problem, nodes, rows, 0.0025)
    steps = 200
    rng = np.random.default_rng(0)
    stages = Stages(rng.uniform(0.0, 2e-3, (steps, 5)), rng.uniform(-2e4, 2e4, (steps, 5)))
    kept, offset = np.empty((steps + 1, 2, *penalty.shape), np.float32), np.empty(steps + 1)
    first = sweep(grid, problem.scalars, stages, penalty, both(terminal), False, kept, offset)
    assert first.max() < steps * (penalty.max() + 2e-3 + problem.concept.start_fuel_kg) + terminal.max()
    assert first.min() > 0.0


def oracle_stage(grid, scalars, cost_kg, power_W, after, penalty, spread):
    """One Bellman step with 21-point quadrature in the control loop, at the spread of the node it leaves."""
    points, weights = np.polynomial.hermite_e.hermegauss(21)
    weights = weights / weights.sum()
    n, rows = len(grid.ocv_V), penalty.shape[0]
    tables = [[naive.interpolator(row, True) for row in each] for each in after.tolist()]
    now = np.full((2, rows, n), np.inf)
    for r in range(rows):
        for j in range(n):
            for c in range(len(power_W)):
                i, missing_W = naive.current(
                    power_W[c],
                    grid.ocv_V[j],
                    grid.discharge_ohm[j],
                    grid.charge_ohm[j],
                    grid.current_low_A[j],
                    grid.current_high_A[j],
                )
                variance = grid.posterior[r, j] + scalars.drift_per_A * abs(i)
                q = naive.lowest_level(grid, variance)
                x = j + (scalars.charge_to_soc * i + spread[r, j] * points) / grid.soc_step
                x = np.clip(x, 0.0, n - 1.0)
                off, on = (
                    sum(
                        share * weights @ [tables[e][q + m](float(at)) for at in x]
                        for m, share in enumerate(naive.parabola(grid.level, q, variance))
                    )
                    for e in (0, 1)
                )
                engine = min(c, 1)
                go = on if engine else on + scalars.start_cost_kg
                cost = cost_kg[c] + missing_W * scalars.step_s * scalars.shortfall_kg_per_J + min(off, go)
                now[engine, r, j] = min(now[engine, r, j], cost)
    return now + penalty


def test_smoothing_once_per_row_agrees_with_quadrature_in_the_control_loop():
    """The two differ by what alpha changes over one move: far less than what smoothing itself does."""
    grid, scalars, stages, penalty, terminal = build("stochastic", 1)
    from bms.uncertainty import innovation_spread

    problem = short_problem("hev")
    soc = grid.soc_first + grid.soc_step * np.arange(grid.ocv_V.size)
    measured = 2e-3 * problem.pack.ocv.alpha.expectation(
        *np.broadcast_arrays(soc[None, :], grid.level[:, None])
    )
    uncertainty = problem.uncertainty.model_copy(update={"mu": 2e-3})
    grid = stochastic_grid(soc, grid.level, problem.pack, uncertainty, 1.0)
    spread = innovation_spread(np.broadcast_to(grid.level[:, None], measured.shape), measured)
    smooth_after = np.array([terminal, terminal])
    ours = naive.stage(grid, scalars, stages.cost_kg[0], stages.power_W[0], smooth_after, penalty)
    exact = oracle_stage(grid, scalars, stages.cost_kg[0], stages.power_W[0], smooth_after, penalty, spread)
    rows, inside = slice(2, None), slice(6, -6)
    effect = np.abs(exact - penalty - terminal.min())[:, rows, inside].max()
    assert np.abs(ours - exact)[:, rows, inside].max() < 5e-3 * effect


@given(
    power_W=st.floats(-2e5, 2e5),
    ocv_V=st.floats(50.0, 500.0),
    ohm=st.floats(1e-3, 1.0),
    charge_ohm=st.floats(1e-3, 1.0),
)
@settings(max_examples=200, deadline=None)
def test_current_solves_the_circuit_within_its_limits(power_W, ocv_V, ohm, charge_ohm):
    low, high = max(-300.0, -0.5 * ocv_V / ohm), 300.0
    i, missing_W = solve_current(power_W, ocv_V, ohm, charge_ohm, low, high)
    assert (i, missing_W) == pytest.approx(naive.current(power_W, ocv_V, ohm, charge_ohm, low, high))
    assert low <= i <= high
    used = ohm if power_W < 0.0 else charge_ohm
    delivered = i * (ocv_V + used * i)
    if power_W < 0.0:
        assert delivered - missing_W == pytest.approx(power_W, rel=1e-9, abs=1e-6)
    elif i < high:
        assert delivered == pytest.approx(power_W, rel=1e-9, abs=1e-6)
    assert missing_W >= -1e-6 * abs(power_W)


def test_hermite_cells_reproduce_a_cubic_and_never_leave_their_nodes():
    x = np.arange(12.0)
    cubic = 0.3 * x**3 + x**2 + 5.0 * x
    slope = np.empty(12)
    node_slopes(cubic, slope)
    for at in range(3, 8):
        for t in (0.2, 0.7):
            cell = [cubic[at], slope[at], cubic[at + 1], slope[at + 1]]
            value = np.dot(naive.hermite(t), cell)
            assert value == pytest.approx(0.3 * (at + t) ** 3 + (at + t) ** 2 + 5.0 * (at + t), rel=1e-12)
    jump = np.where(x < 6, 0.0, 1.0)
    node_slopes(jump, slope)
    for at in range(11):
        cell = [jump[at], slope[at], jump[at + 1], slope[at + 1]]
        values = [np.dot(naive.hermite(t), cell) for t in np.linspace(0, 1, 9)]
        assert min(values) >= -1e-15
        assert max(values) <= 1.0 + 1e-15


@pytest.mark.parametrize("nodes", [None, 9, 17, 33])
def test_a_program_without_noise_has_the_same_bits_either_way_round(nodes):
    """The short cut takes the nodes for the vector, the general kernel the (one) variance row."""
    grid, scalars, stages, penalty, terminal = build("deterministic", 2, nodes)
    none, offset = np.empty((0, 2, *penalty.shape), np.float32), np.empty(5)
    short = sweep(grid, scalars, stages, penalty, both(terminal), False, none, offset)
    assert np.array_equal(short, sweep(grid, scalars, stages, penalty, both(terminal), True, none, offset))


@pytest.mark.parametrize("rows", [4, 8, 9, 17, 25])
def test_any_number_of_rows_fits_the_blocks(rows):
    problem = short_problem("hev")
    soc = soc_nodes(problem.concept, problem.settings, 0.013)
    few = problem.settings.model_copy(update={"variance_rows": rows})
    levels = variance_rows(problem.concept, problem.pack, problem.uncertainty, 1.0, few)
    grid = stochastic_grid(soc, levels, problem.pack, problem.uncertainty, 1.0)
    penalty, terminal = node_penalties(problem, soc, levels, grid.soc_step)
    stages = Stages(problem.stages.cost_kg[10:12], problem.stages.power_W[10:12])
    none, offset = np.empty((0, 2, *penalty.shape), np.float32), np.empty(3)
    first = sweep(grid, problem.scalars, stages, penalty, both(terminal), False, none, offset)
    assert np.allclose(
        first, naive.sweep(grid, problem.scalars, stages, penalty, terminal)[0], rtol=1e-12, atol=1e-12
    )


def fields(grid):
    return grid.soc_first, grid.soc_step, grid.level_step, grid.level, grid.cubic


@pytest.mark.parametrize("acts_on", [ESTIMATE, CERTAIN, TRUTH])
def test_choice_is_the_least_expected_cost(acts_on):
    """The chosen control's cost, recomputed by hand for every control, is the minimum."""
    kind = {ESTIMATE: "stochastic", CERTAIN: "deterministic", TRUTH: "perfect"}[acts_on]
    grid, scalars, stages, penalty, terminal = build(kind, 1)
    rows, n = penalty.shape
    kept, offset = np.empty((5, 2, rows, n), np.float32), np.empty(5)
    sweep(grid, scalars, stages, penalty, both(terminal), False, kept, offset)
    soc, posterior, spread = 0.613, 9e-5, 0.003
    for engine_on in (0, 1):
        control, engine_next = choose(
            grid,
            scalars,
            kept[1],
            stages.cost_kg[0],
            stages.power_W[0],
            acts_on,
            soc,
            posterior,
            spread,
            engine_on,
        )
        costs = {}
        for c in range(1, 5) if engine_on else range(1):
            tables = [
                np.interp(soc, grid.soc_first + grid.soc_step * np.arange(n), column)
                for column in (
                    grid.ocv_V,
                    grid.discharge_ohm,
                    grid.charge_ohm,
                    grid.current_low_A,
                    grid.current_high_A,
                )
            ]
            i, missing_W = naive.current(stages.power_W[0, c], *tables)
            drift = scalars.drift + scalars.drift_per_A * abs(i)
            width = {ESTIMATE: spread, CERTAIN: 0.0, TRUTH: math.sqrt(drift)}[acts_on]
            off, on = expected_cost_to_go(
                *fields(grid), kept[1], soc + scalars.charge_to_soc * i, width, posterior + drift
            )
            base = stages.cost_kg[0, c] + missing_W * scalars.shortfall_kg_per_J
            costs[c, 0] = base + off
            costs[c, 1] = base + on + (0.0 if engine_on else scalars.start_cost_kg)
        assert costs[control, engine_next] == pytest.approx(min(costs.values()), rel=1e-12)


def test_expected_cost_to_go_of_a_parabola_adds_its_variance():
    grid, _, _, penalty, _ = build("stochastic", 1)
    n = penalty.shape[1]
    soc = grid.soc_first + grid.soc_step * np.arange(n)
    table = (4.0 * soc**2)[None, None, :] + 100.0 * grid.level[None, :, None] + np.zeros((2, 1, 1))
    off, on = expected_cost_to_go(*fields(grid), table.astype(np.float32), 0.63, 0.004, 2.2e-4)
    assert off == pytest.approx(4.0 * (0.63**2 + 0.004**2) + 0.022, rel=1e-6)
    assert on == off


def test_problem_tables_are_what_the_kernels_take():
    problem = short_problem("hev")
    assert problem.stages.power_W.flags["C_CONTIGUOUS"]
    assert problem.stages.cost_kg.shape == problem.engine_torque_Nm.shape == problem.fuel_kgps.shape
    assert dataclasses.replace(problem).steps == problem.steps == 120

"""Kinematic waves: the report's values, exact solutions, conservation, bounds, twins, messages."""

import numpy as np
import pytest
from naive_traffic import fan, godunov, osher, shock, upwind

from drivecycles.traffic import (
    Bottleneck,
    Demand,
    Greenberg,
    Greenshields,
    Road,
    TrafficError,
    TrafficWarning,
    Triangular,
    Underwood,
)
from drivecycles.traffic._lwr import decay
from drivecycles.traffic.lwr import simulate, simulate_members, split_duration

MPH, MILE = 0.44704, 1609.344
CELLS = (6, 11, 26, 51)
DEMAND = 2400.0 / 3600.0
GREENSHIELDS, UNDERWOOD = Greenshields(75.0 * MPH, 250.0 / MILE), Underwood(75.0 * MPH, 50.0 / MILE)
REPORT = Road(5.2 * MILE, 52)
ALL = (
    Greenshields(30.0, 0.15),
    Underwood(30.0, 0.03),
    Greenberg(30.0, 0.15, 12.0),
    Triangular(30.0, 0.02, 0.15),
)
each = pytest.mark.parametrize("diagram", ALL, ids=lambda d: d.kind)


@pytest.mark.parametrize(
    ("diagram", "scheme", "at_150", "at_300"),
    [
        (
            GREENSHIELDS,
            "report",
            (63.6966, 63.7331, 69.4868, 74.9996),
            (63.6964, 63.6964, 63.7057, 68.8630),
        ),
        (UNDERWOOD, "report", (74.9946, 74.5831, 66.6555, 74.9989), (75.0, 75.0, 74.9993, 66.9138)),
        (
            UNDERWOOD,
            "godunov",
            (42.0941, 49.4578, 67.0755, 74.9991),
            (35.8352, 40.2230, 51.6252, 67.0499),
        ),
    ],
)
@pytest.mark.filterwarnings("ignore::drivecycles.traffic.TrafficWarning")
def test_the_reports_road_gives_the_known_speeds(diagram, scheme, at_150, at_300):
    field = simulate(REPORT, diagram, demand=DEMAND, duration_s=300.0, scheme=scheme, step_s=1.0)
    speed = field.speed_mps[:, CELLS] / MPH
    np.testing.assert_allclose(speed[150], at_150, atol=6e-5)
    np.testing.assert_allclose(speed[300], at_300, atol=6e-5)
    assert np.all(speed[1] == 75.0)
    assert field.courant == pytest.approx(75.0 / 360.0, rel=1e-12)


def test_cell_one_of_the_reports_underwood_road_jams_at_14_s():
    with pytest.warns(TrafficWarning, match="piles it up in the first cell"):
        field = simulate(REPORT, UNDERWOOD, demand=DEMAND, duration_s=30.0, scheme="report", step_s=1.0)
    assert int(np.argmax(field.density_per_m[:, 0] > UNDERWOOD.critical_per_m)) == 14


def errors(diagram, left, right, exact, start_s, end_s=40.0, length_m=4000.0):
    """L1 errors on ever finer roads, of a jump in the middle or of what it has become by ``start_s``."""
    if exact is shock:
        # 400 m are whole cells on every road: a shock's error depends on where in a cell it is.
        chord = (diagram.flow_per_s(right) - diagram.flow_per_s(left)) / (right - left)
        end_s = 400.0 / float(abs(chord))
    found = []
    for cells in (100, 200, 400, 800):
        road = Road(length_m, cells)
        inside = (np.arange(40) + 0.5) / 40 - 0.5
        x = (road.position_m - 0.5 * length_m)[:, None] + inside * road.cell_m

        def average(time_s, x=x):
            if time_s == 0.0:
                return np.where(x < 0.0, left, right).mean(axis=1)
            return exact(diagram, left, right, x, time_s).mean(axis=1)

        duration = end_s - start_s
        steps = int(np.ceil(duration * diagram.fastest_wave_mps / (0.9 * road.cell_m)))
        field = simulate(
            road,
            diagram,
            demand=float(diagram.flow_per_s(left)),
            initial=average(start_s),
            duration_s=duration,
            step_s=duration / steps,
        )
        assert field.imbalance_veh < 1e-10
        found.append(np.abs(field.density_per_m[-1] - average(end_s)).sum() * road.cell_m)
    return np.array(found)


@pytest.mark.parametrize(
    ("diagram", "left", "right", "exact", "start_s", "orders"),
    [
        (ALL[0], 0.02, 0.07, shock, 0.0, (0.95, 1.1)),
        (ALL[1], 0.004, 0.025, shock, 0.0, (0.85, 1.15)),
        (ALL[0], 0.12, 0.03, fan, 20.0, (0.95, 1.1)),
        (ALL[0], 0.07, 0.02, fan, 20.0, (0.95, 1.1)),
        (ALL[1], 0.03, 0.0, fan, 20.0, (0.95, 1.1)),
        (ALL[1], 0.05, 0.01, fan, 20.0, (0.8, 1.1)),
        # From the jump itself a fan costs a logarithm.
        (ALL[0], 0.07, 0.02, fan, 0.0, (0.7, 1.0)),
    ],
)
def test_godunov_meets_the_exact_solution_at_first_order(diagram, left, right, exact, start_s, orders):
    found = errors(diagram, left, right, exact, start_s)
    order = np.log2(found[:-1] / found[1:])
    assert orders[0] < order.mean() < orders[1]
    assert found[-1] < 0.005 * abs(left - right) * 4000.0


def test_a_shock_between_equal_flows_stands_still():
    diagram = ALL[0]
    road = Road(2000.0, 100)
    start = np.where(road.position_m < 1000.0, 0.03, 0.12)
    field = simulate(
        road, diagram, demand=float(diagram.flow_per_s(0.03)), initial=start, duration_s=20.0, step_s=0.5
    )
    np.testing.assert_allclose(field.density_per_m[-1, 20:58], start[20:58], rtol=1e-12)


@each
def test_any_jump_follows_oshers_formula(diagram):
    """Beyond twice the critical density Underwood's flow is convex, and the solution composite."""
    road, end_s = Road(4000.0, 400), 30.0
    left, right = 0.12, 0.01
    x = road.position_m - 2000.0
    found = simulate(
        road,
        diagram,
        demand=float(diagram.flow_per_s(left)),
        initial=np.where(x < 0.0, left, right),
        duration_s=end_s,
    )
    exact = osher(diagram, left, right, x / end_s)
    inside = np.abs(x) < 900.0
    assert np.abs(found.density_per_m[-1] - exact)[inside].mean() < 0.02 * abs(left - right)


def random_road(diagram, generator):
    cells = int(generator.integers(3, 30))
    most = min(diagram.full_per_m, 0.3)
    start = generator.choice([0.0, most, -1.0], cells)
    start = np.where(start < 0.0, generator.uniform(0.0, most, cells), start)
    places = generator.uniform(0.0, 100.0 * cells, 2)
    gates = tuple(
        Bottleneck(float(place), float(generator.uniform(0.0, 0.5)), 20.0, 60.0) for place in places
    )
    flows = generator.uniform(0.0, 2.0, 5)
    return Road(100.0 * cells, cells, gates), start, Demand([0.0, 20.0, 40.0, 60.0, 80.0], flows)


@each
@pytest.mark.filterwarnings("ignore::drivecycles.traffic.TrafficWarning")
def test_kernel_is_its_twin_vehicles_stay_and_density_keeps_its_bounds(diagram):
    generator = np.random.default_rng(1)
    for courant in (0.3, 0.95, 1.0):
        for _ in range(5):
            road, start, demand = random_road(diagram, generator)
            steps = int(np.ceil(100.0 * diagram.fastest_wave_mps / (courant * road.cell_m)))
            if courant == 1.0:
                steps, diagram_step = int(100.0 * diagram.fastest_wave_mps / road.cell_m), 1.0
                step = diagram_step * road.cell_m / diagram.fastest_wave_mps
            else:
                step = 100.0 / steps
            field = simulate(
                road, diagram, demand=demand, initial=start, duration_s=step * steps, step_s=step
            )
            limit = np.full((steps, road.cells + 1), np.inf)
            middle = (np.arange(steps) + 0.5) * step
            for gate in road.bottlenecks:
                there = (middle >= gate.start_s) & (middle < gate.end_s)
                face = road.face_at(gate.position_m)
                limit[there, face] = np.minimum(limit[there, face], gate.capacity_per_s)
            density, flow = godunov(diagram, start, demand.at(middle), step / road.cell_m, steps, limit)
            np.testing.assert_allclose(field.density_per_m, density, rtol=1e-9, atol=1e-13)
            np.testing.assert_allclose(field.flow_per_s, flow, rtol=1e-9, atol=1e-12)
            assert field.imbalance_veh < 1e-10
            assert field.density_per_m.min() >= -1e-16
            assert field.density_per_m.max() <= diagram.full_per_m * (1.0 + 1e-14)
            assert np.all(field.flow_per_s <= limit)


@each
def test_the_reports_scheme_is_its_twin(diagram):
    road, steps = Road(2000.0, 20), 60
    demand = 0.4 * diagram.capacity_per_s
    field = simulate(road, diagram, demand=demand, duration_s=60.0, scheme="report", step_s=1.0)
    twin = upwind(diagram, np.zeros(20), np.full(steps, demand), 1.0 / road.cell_m, steps)
    np.testing.assert_allclose(field.density_per_m, twin, rtol=1e-10, atol=1e-15)
    below = simulate(road, diagram, demand=demand, duration_s=60.0, step_s=1.0)
    np.testing.assert_allclose(field.density_per_m, below.density_per_m, rtol=1e-12, atol=1e-15)


def test_members_are_their_own_runs():
    """Over more than one block, and in the order of the times asked for."""
    generator = np.random.default_rng(2)
    members = [Underwood(30.0 + v, 0.03 + 0.005 * v) for v in generator.uniform(-1.0, 1.0, 131)]
    kept = simulate_members(
        REPORT, members, demand=0.2, duration_s=60.0, step_s=1.0, time_s=[60, 10, 60], position_m=[900, 0.0]
    )
    assert kept.density_per_m.shape == (3, 2, 131)
    np.testing.assert_array_equal(kept.time_s, [60.0, 10.0, 60.0])
    for m in (0, 63, 64, 130):
        field = simulate(REPORT, members[m], demand=0.2, duration_s=60.0, step_s=1.0)
        np.testing.assert_array_equal(
            kept.density_per_m[:, :, m], field.density_per_m[np.ix_([60, 10, 60], [5, 0])]
        )
        np.testing.assert_allclose(kept.speed_mps[:, 1, m], field.speed_at(0.0)[[60, 10, 60]], rtol=1e-12)


def test_the_series_of_the_exponential_is_one():
    x = np.concatenate([np.linspace(0.0, 64.0, 5001), np.geomspace(1e-12, 1.0, 50)])
    found = np.array([decay(value) for value in x])
    np.testing.assert_allclose(found, np.exp(-x), rtol=1e-12)
    assert decay(1e6) == decay(64.0) < 1e-27


def test_a_closed_road_queues_at_the_jam_density_and_lets_go():
    diagram = ALL[0]
    road = Road(2000.0, 40, (Bottleneck(1000.0, 0.0, 0.0, 60.0),))
    with pytest.warns(TrafficWarning, match="vehicles found no room"):
        field = simulate(road, diagram, demand=1.2, duration_s=120.0, initial=0.05)
    at = int(np.argmin(np.abs(field.time_s - 59.0)))
    assert field.density_per_m[at, 19] == pytest.approx(0.15, rel=1e-2)
    assert field.density_per_m[at, 20] < 0.01
    assert field.density_per_m[-1, 20] > 0.05
    assert field.refused_veh > 0.0


def test_demand_changes_in_steps_and_what_finds_no_room_is_told():
    demand = Demand([0.0, 30.0], [0.2, 0.0])
    np.testing.assert_array_equal(demand.at([-5.0, 0.0, 29.9, 30.0, 99.0]), [0.2, 0.2, 0.2, 0.0, 0.0])
    field = simulate(REPORT, ALL[0], demand=demand, duration_s=60.0, step_s=1.0)
    assert field.vehicles[-1] == pytest.approx(6.0, rel=1e-12)
    assert field.refused_veh == pytest.approx(0.0, abs=1e-12)


def test_a_step_is_chosen_that_divides_the_second_and_keeps_the_courant_number():
    for cells in (20, 100, 400):
        field = simulate(Road(2000.0, cells), ALL[0], demand=0.1, duration_s=7.0)
        assert field.courant <= 0.9
        assert 1.0 / field.step_s == pytest.approx(round(1.0 / field.step_s), rel=1e-12)
    assert split_duration(2.5, None, 10.0, 30.0)[0] == 9


def test_positions_belong_to_cells():
    road = Road(1600.0, 16)
    assert [road.cell_at(x) for x in (0.0, 99.9, 100.0, 300.0, 1600.0)] == [0, 0, 1, 3, 15]
    assert road.face_at(149.0) == 1
    with pytest.raises(TrafficError, match="1601 m is outside the road, which goes from 0 to 1600 m"):
        road.cell_at(1601.0)


def test_speeds_between_steps_are_linear():
    field = simulate(REPORT, ALL[0], demand=0.5, duration_s=20.0, step_s=1.0)
    np.testing.assert_allclose(field.at(10.25), 0.75 * field.speed_mps[10] + 0.25 * field.speed_mps[11])
    np.testing.assert_array_equal(field.at([-1.0, 99.0]), field.speed_mps[[0, -1]])


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"step_s": 6.0}, r"crosses 1\.25 cells of 160\.\d+ m \(the Courant number\), and 1 is the most"),
        ({"step_s": 0.7}, "does not divide the duration"),
        ({"step_s": -1.0}, "above 0 and at most the duration"),
        ({"duration_s": 0.0}, "duration must be positive"),
        ({"scheme": "goduno"}, "did you mean 'godunov'"),
        ({"initial": [0.1, 0.2]}, r"one for each of the 52 cells, got shape \(2,\)"),
        ({"initial": 1.0}, "within 0 and the jam density"),
        ({"initial": -0.1}, "within 0 and the jam density"),
        ({"demand": -1.0}, "0 veh/s or more"),
        ({"demand": float("nan")}, "finite"),
    ],
)
def test_what_cannot_be_run_is_refused(changed, said):
    known = {"demand": 0.5, "duration_s": 60.0, "step_s": 1.0} | changed
    with pytest.raises(TrafficError, match=said):
        simulate(REPORT, GREENSHIELDS, **known)


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: Road(0.0, 10), "length must be positive"),
        (lambda: Road(100.0, 1), "2 to 100000 cells"),
        (lambda: Road(100.0, 10, (Bottleneck(200.0, 1.0),)), "a bottleneck at 200 m is outside the road"),
        (lambda: Bottleneck(-1.0, 1.0), "0 m or more"),
        (lambda: Bottleneck(1.0, -1.0), "0 veh/s or more"),
        (lambda: Bottleneck(1.0, 1.0, 5.0, 5.0), "must start before it ends"),
        (lambda: Demand([0.0, 0.0], [1.0, 1.0]), "must be finite and increase"),
        (lambda: Demand([0.0], [1.0, 1.0]), "as many times as flows"),
        (
            lambda: simulate(
                Road(100.0, 5, (Bottleneck(50.0, 1.0),)), GREENSHIELDS, demand=0.1, duration_s=1.0,
                scheme="report",
            ),
            "knows no bottleneck",
        ),
        (lambda: simulate_members(REPORT, [], demand=0.1, duration_s=1.0), "one diagram or more"),
        (
            lambda: simulate_members(REPORT, [GREENSHIELDS, UNDERWOOD], demand=0.1, duration_s=1.0),
            "greenshields and underwood",
        ),
        (
            lambda: simulate_members(REPORT, [GREENSHIELDS], demand=0.1, duration_s=9.0, time_s=[9.3]),
            "multiples of the step",
        ),
        (
            lambda: simulate_members(REPORT, [GREENSHIELDS], demand=0.1, duration_s=9.0, cells=[52]),
            "numbers from 0 to 51",
        ),
        (
            lambda: simulate_members(
                REPORT, [GREENSHIELDS], demand=0.1, duration_s=9.0, cells=[5], position_m=[5.0]
            ),
            "not both",
        ),
    ],
)  # fmt: skip
def test_what_is_no_road_is_refused(made, said):
    with pytest.raises(TrafficError, match=said):
        made()

"""The probe vehicle: limits, stops, a plain twin of its kernel, and the ensemble of cycles it makes."""

import warnings

import numpy as np
import pytest

from drivecycles import CycleError, DriveCycle
from drivecycles.traffic.diagrams import Triangular
from drivecycles.traffic.ensemble import draw_cycles, mean_cycle
from drivecycles.traffic.errors import TrafficError, TrafficWarning
from drivecycles.traffic.field import TrafficField
from drivecycles.traffic.lwr import simulate
from drivecycles.traffic.probe import Probe, drive_through
from drivecycles.traffic.road import Bottleneck, Road
from drivecycles.traffic.scenario_file import load_scenario

MOVING = {"from_rest": False, "to_rest": False}


def field_of(speed, length_m=6000.0, step_s=1.0, bottlenecks=()):
    """A field of given speeds, shape (n, cells); densities and flows do not matter to a probe."""
    speed = np.asarray(speed, dtype=float)
    road = Road(length_m, speed.shape[1], tuple(bottlenecks))
    time_s = step_s * np.arange(speed.shape[0])
    none = np.zeros((speed.shape[0] - 1, speed.shape[1] + 1))
    return TrafficField(road, "given", time_s, 0.0 * speed, speed, none, none[:, 0], 0.5)


def jam(until_s, cells=60, n=1500, free=30.0):
    """Free traffic with a standing queue on 3 to 4 km of 6 until a time."""
    speed = np.full((n, cells), free)
    speed[:until_s, 30:40] = 0.0
    return field_of(speed)


def naive(field, probe):
    """The law of `probe`, in plain Python."""
    cell, length = field.road.cell_m, field.road.length_m
    comfort, jerk = min(probe.comfort_mps2, probe.deceleration_mps2), probe.jerk_mps3
    dt, out = 0.05, [0.0]
    if not probe.from_rest:
        out = [np.interp(probe.depart_s, field.time_s, field.speed_mps[:, 0])]
    x, v, a, t = 0.0, out[0], 0.0, probe.depart_s
    rows = np.arange(field.time_s.size)
    faces = [(field.road.face_at(g.position_m), g) for g in field.road.bottlenecks]

    def seen(place, row):
        columns = np.interp(place, field.position_m, np.arange(field.road.cells))
        for face, gate in faces:
            if gate.start_s <= t < gate.end_s:
                columns = min(columns, face - 1.0) if x < face * cell else max(columns, face)
        j = min(int(columns), field.road.cells - 2)
        over = [np.interp(row, rows, field.speed_mps[:, j + k]) for k in (0, 1)]
        return over[0] + (columns - j) * (over[1] - over[0])

    for step in range(1, 200_000):
        row = t / field.step_s
        lead = v * comfort / jerk
        waits = [f * cell - 1.0 for f, g in faces if x < f * cell and g.start_s <= t < g.end_s]
        line = min(waits, default=np.inf)
        reach = min(v * v / 2.0 / comfort + lead, length - x, line - x)
        places = [0.0]
        while places[-1] < reach:
            places.append(min(places[-1] + 0.25 * cell, reach))
        wanted = [np.sqrt(seen(x + s, row) ** 2 + 2.0 * comfort * max(s - lead, 0.0)) for s in places]
        wanted[0] = seen(x, row)
        if probe.to_rest:
            wanted.append(np.sqrt(2.0 * comfort * max(length - x - lead, 0.0)))
        wanted.append(np.sqrt(2.0 * comfort * max(line - x - lead, 0.0)))
        e = min(wanted) - v
        asked = np.sign(e) * min(abs(e) / probe.reaction_s, np.sqrt(2.0 * jerk * abs(e)))
        turn = max(a + comfort, 0.0) / jerk
        later = max(v + a * turn - jerk * turn**2 / 2.0, 0.0)
        room = line - x - max(v * turn + a * turn**2 / 2.0 - jerk * turn**3 / 6.0, 0.0)
        room -= comfort**3 / 24.0 / jerk**2
        if later**2 > 2.0 * comfort * room:
            asked = min(asked, -comfort, -(later**2) / 2.0 / max(room, 0.05))
        most = min(probe.acceleration_mps2, probe.specific_power_Wpkg / max(v, 1e-3))
        asked = min(max(asked, -probe.deceleration_mps2), most)
        a = max(a + np.clip(asked - a, -jerk * dt, jerk * dt), -np.sqrt(2.0 * jerk * v))
        x += max(v * dt + 0.5 * a * dt * dt, 0.0)
        v = max(v + a * dt, 0.0)
        t += dt
        if (probe.to_rest and length - x < 0.5 and v < 0.2) or (not probe.to_rest and x >= length):
            return np.array([*out, 0.0 if probe.to_rest else v])
        if step % 20 == 0:
            out.append(v)
    raise AssertionError


def test_in_steady_traffic_the_probe_is_traffic():
    cycle = drive_through(field_of(np.full((400, 20), 20.0)), Probe(**MOVING))
    np.testing.assert_allclose(cycle.speed_mps, 20.0)
    assert cycle.duration_s == 300.0 and cycle.distance_m == pytest.approx(6000.0)


@pytest.mark.parametrize("start", ["rest", "moving"])
def test_the_kernel_is_its_naive_twin(start):
    rng = np.random.default_rng(3)
    knots = rng.uniform(2.0, 30.0, (12, 8))
    time = np.linspace(0.0, 11.0, 900)
    rows = np.stack([np.interp(time, np.arange(12.0), column) for column in knots.T], axis=1)
    field = field_of(rows, 3000.0)
    probe = Probe(depart_s=20.0) if start == "rest" else Probe(depart_s=20.0, **MOVING)
    np.testing.assert_allclose(drive_through(field, probe).speed_mps, naive(field, probe), atol=1e-9)
    barred = [Bottleneck(1130.0, 0.0, 0.0, 300.0), Bottleneck(2000.0, 0.0, 0.0, 330.0)]
    closed = field_of(rows, 3000.0, bottlenecks=barred)
    waited = drive_through(closed, probe)
    np.testing.assert_allclose(waited.speed_mps, naive(closed, probe), atol=1e-9)
    assert np.flatnonzero(waited.position_m >= 1125.0)[0] > 280


@pytest.mark.parametrize("seed", range(6))
def test_limits_hold_whatever_the_traffic_does(seed):
    """Traffic that jumps from cell to cell and second to second, standing here and there."""
    rng = np.random.default_rng(seed)
    speed = np.repeat(np.repeat(rng.uniform(0.0, 35.0, (100, 12)), 20, axis=0), 5, axis=1)
    speed[speed < 6.0] = 0.0
    limits = Probe(acceleration_mps2=1.2, deceleration_mps2=2.5, jerk_mps3=0.8, specific_power_Wpkg=10.0)
    cycle = drive_through(field_of(speed), limits)
    a = np.diff(cycle.speed_mps)
    assert a.max() <= 1.2 + 1e-9 and a.min() >= -2.5 - 1e-9
    assert np.abs(np.diff(a)).max() <= 0.8 + 1e-2
    assert np.all(a * cycle.speed_mps[:-1] <= 10.0 + 1e-9)
    assert cycle.speed_mps[0] == cycle.speed_mps[-1] == 0.0
    assert cycle.distance_m == pytest.approx(6000.0, rel=2e-3)


def test_it_stops_before_a_standing_queue_and_goes_on():
    cycle = drive_through(jam(400), Probe(**MOVING))
    standing = np.flatnonzero(cycle.speed_mps < 0.05)
    assert standing.size > 200
    where = cycle.position_m[standing]
    # The queue's first cell begins at 3,000 m, and the field is linear between the middles of cells.
    assert np.all((where > 2900.0) & (where < 3060.0)) and np.ptp(where) < 5.0
    assert cycle.time_s[standing[-1]] == pytest.approx(400.0, abs=5.0)
    # Seen in time, a queue is braked for at about the deceleration that is planned with.
    assert np.diff(cycle.speed_mps[: standing[0]]).min() > -1.35 * 1.5


def signal(cells):
    """Two kilometres with a signal in the middle that is red for 60 of every 120 s, from 30 s on."""
    red = [Bottleneck(1000.0, 0.0, 120.0 * k + 30.0, 120.0 * k + 90.0) for k in range(7)]
    diagram = Triangular(50.0 / 3.6, 0.03, 0.14)
    road = Road(2000.0, cells, tuple(red))
    return simulate(road, diagram, demand=600.0 / 3600.0, duration_s=900.0, initial=0.012)


@pytest.mark.parametrize("cells", [20, 40, 200])
def test_it_waits_at_a_red_signal_unless_it_is_too_close_to_stop(cells):
    field, waits, passes = signal(cells), 0, 0
    limits = Probe()
    for depart_s in np.arange(100.0, 500.0, 4.3):
        cycle = drive_through(field, limits.model_copy(update={"depart_s": depart_s}))
        time_s, place = depart_s + cycle.time_s, cycle.position_m
        # At rest several samples lie at one place; it leaves at the last of them.
        leaves = np.append(np.diff(place) > 0.0, True)
        crosses_s = np.interp(1000.0, place[leaves], time_s[leaves])
        assert np.diff(cycle.speed_mps).min() > -2.5
        since_s = (crosses_s - 30.0) % 120.0
        standing = (cycle.speed_mps < 0.05) & (place > 995.0) & (place < 1000.0)
        if standing.sum() > 10:
            waits += 1
            opened_s = crosses_s - (crosses_s - 90.0) % 120.0
            assert 0.0 < crosses_s - opened_s < 5.0
        if since_s < 60.0:
            passes += 1
            left_m = 1000.0 - np.interp(crosses_s - since_s, time_s, place)
            v = np.interp(crosses_s - since_s, time_s, cycle.speed_mps)
            # What is left is less than a comfortable stop takes.
            assert left_m < 0.5 * v**2 / limits.comfort_mps2 + v * limits.comfort_mps2 / limits.jerk_mps3
    # In short cells most wait in the queue behind the line, not at it.
    assert waits >= 5 and 0 < passes < 8


@pytest.mark.parametrize("seed", range(8))
def test_no_driver_crosses_what_has_long_been_closed(seed):
    rng = np.random.default_rng(seed)
    comfort, harder = rng.uniform(0.5, 2.5), rng.uniform(1.0, 2.0)
    driver = Probe(
        acceleration_mps2=rng.uniform(0.5, 2.5),
        comfort_mps2=comfort,
        deceleration_mps2=harder * comfort,
        jerk_mps3=rng.uniform(0.8, 5.0),
        reaction_s=rng.uniform(0.5, 20.0),
        to_rest=bool(seed % 2),
    )
    face, until_s = 300.0 * rng.integers(1, 9), rng.uniform(200.0, 500.0)
    speed = np.full((1500, 10), rng.uniform(5.0, 30.0))
    cycle = drive_through(field_of(speed, 3000.0, bottlenecks=[Bottleneck(face, 0.0, 0.0, until_s)]), driver)
    before = cycle.time_s <= until_s
    assert cycle.position_m[before].max() < face
    assert np.diff(cycle.speed_mps).min() > -harder * comfort - 1e-9
    assert cycle.position_m[-1] > 2990.0


def test_a_closed_exit_holds_a_vehicle_that_would_drive_on():
    closed = [Bottleneck(0.0, 0.0), Bottleneck(3000.0, 0.0, 0.0, 400.0)]
    field = field_of(np.full((900, 10), 20.0), 3000.0, bottlenecks=closed)
    waits, ends = (drive_through(field, Probe(to_rest=rests)) for rests in (False, True))
    assert waits.duration_s > 400.0 and waits.speed_mps[-1] > 0.0
    assert ends.duration_s < 200.0 and ends.speed_mps[-1] == 0.0


def test_a_trip_without_an_end_is_refused():
    with pytest.raises(CycleError, match=r"at 30\d\d m of 6000 m .* simulate longer"):
        drive_through(jam(1500), Probe(**MOVING))
    with pytest.raises(CycleError, match="departs at 5000 s"):
        drive_through(jam(100), Probe(depart_s=5000.0))


def test_the_mean_cycle_arrives_at_the_mean_time():
    fast, slow = (
        DriveCycle("c", np.arange(0.0, t + 1.0), np.full(int(t) + 1, 6000.0 / t)) for t in (200, 300)
    )
    mean = mean_cycle([fast, slow], "mean")
    assert mean.duration_s == 250.0
    np.testing.assert_allclose(mean.speed_mps, 2.0 / (1.0 / 30.0 + 1.0 / 20.0), rtol=1e-3)
    one = drive_through(jam(300), Probe())
    again = mean_cycle([one, one], "again")
    assert again.duration_s == one.duration_s
    # A stop has no speed of its own over distance, but its time is kept.
    away = np.abs(again.position_m - one.position_m)
    assert away.max() < 30.0


def test_members_do_not_depend_on_how_many_there_are():
    scenario = load_scenario("report")
    few, many = draw_cycles(scenario, cycles=2, seed=4), draw_cycles(scenario, cycles=5, seed=4)
    assert np.array_equal(few.values, many.values[:2])
    assert np.array_equal(few.members[1].speed_mps, many.members[1].speed_mps)
    assert not np.array_equal(few.values, draw_cycles(scenario, cycles=2, seed=5).values)
    sds = many.values.std(axis=0) / many.values.mean(axis=0)
    assert np.all(sds < 0.15) and few.names == ("free_flow_mps", "jam_per_m")


def test_the_plan_is_the_mean_or_the_nominal_trip():
    scenario = load_scenario("report")
    nominal = scenario.model_copy(
        update={"ensemble": scenario.ensemble.model_copy(update={"plan": "nominal"})}
    )
    alone = drive_through(scenario.simulate(), scenario.probe)
    assert np.array_equal(draw_cycles(nominal, cycles=2).planned.speed_mps, alone.speed_mps)
    found = draw_cycles(scenario, cycles=3)
    expected = np.mean([one.duration_s for one in found.members])
    assert found.planned.duration_s == pytest.approx(expected, abs=1.0)


def test_an_ensemble_says_once_how_often_the_demand_found_no_room():
    scenario = load_scenario("commute")
    busy = scenario.model_copy(
        update={"demand": scenario.demand.model_copy(update={"time_s": None, "flow_vehph": 3700.0})}
    )
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        draw_cycles(busy, cycles=4)
    assert [one.category for one in caught] == [TrafficWarning]
    said = str(caught[0].message)
    assert "of 4 cycles; the first: " in said and "vehicles found no room" in said
    with pytest.raises(TrafficError, match="two cycles or more"):
        draw_cycles(scenario, cycles=1)

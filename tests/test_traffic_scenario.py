"""Scenario files: units, presets, and every mistake with a message of its own."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from traffic_cases import SMALL, changed

from drivecycles import CycleError
from drivecycles.traffic.diagrams import Greenshields
from drivecycles.traffic.ensemble import draw_cycles
from drivecycles.traffic.errors import TrafficError
from drivecycles.traffic.scenario_file import load_scenario, parse_scenario, scenario_names
from socwise.traffic import estimate_scenario


def parsed(*changes):
    return parse_scenario(tomllib.loads(changed(*changes)), "small.toml")


def test_the_file_is_in_kilometres_and_hours_and_the_scenario_in_si():
    scenario = parsed()
    assert scenario.build_road().length_m == 2000.0
    diagram = scenario.diagram.build()
    assert isinstance(diagram, Greenshields)
    assert diagram.free_flow_mps == pytest.approx(25.0) and diagram.jam_per_m == pytest.approx(0.15)
    assert scenario.build_demand().at([0.0, 1e6]).tolist() == pytest.approx([1500.0 / 3600.0] * 2)
    uncertain = scenario.build_uncertain()
    assert uncertain.names == ("free_flow_mps", "jam_per_m")
    assert uncertain.distributions["free_flow_mps"].sd == pytest.approx(5.0 / 3.6)
    assert uncertain.distributions["jam_per_m"].mean == pytest.approx(0.15)
    assert scenario.build_detectors().noise_mps == pytest.approx(0.44704)
    assert scenario.locations_m == (500.0, 1500.0)


def test_a_demand_over_time_a_bottleneck_and_a_correlation():
    bottleneck = "[[bottleneck]]\nposition_km = 1.5\ncapacity_vehph = 900.0\nstart_s = 60.0\n\n[run]"
    correlation = '[[correlation]]\nparameters = ["jam_per_km", "free_flow_kmh"]\nvalue = 0.4\n\n[detectors]'
    scenario = parsed(
        "flow_vehph = 1500.0", "flow_vehph = [1500.0, 600.0]\ntime_s = [0.0, 100.0]",
        "[run]", bottleneck, "[detectors]", correlation,
    )  # fmt: skip
    assert scenario.build_demand().at([50.0, 150.0]).tolist() == pytest.approx(
        [1500.0 / 3600.0, 600.0 / 3600.0]
    )
    gate = scenario.build_road().bottlenecks[0]
    assert (gate.capacity_per_s, gate.start_s, gate.end_s) == (0.25, 60.0, np.inf)
    np.testing.assert_array_equal(scenario.build_uncertain().correlation, [[1.0, 0.4], [0.4, 1.0]])
    assert scenario.simulate().speed_at(1400.0)[-1] < 0.9 * 25.0


def test_a_second_order_model_runs_and_is_refused_where_waves_are_meant():
    scenario = parsed("duration_s = 240.0", 'duration_s = 240.0\nmodel = "zhang"')
    field = scenario.simulate()
    assert field.scheme == "zhang" and np.all(np.isfinite(field.speed_mps))
    with pytest.raises(TrafficError, match="the estimate takes the model lwr, not zhang"):
        scenario.require_lwr("the estimate")


@pytest.mark.parametrize("name", scenario_names())
def test_presets_hold_together(name):
    scenario = load_scenario(name)
    assert scenario.name == name
    field = scenario.simulate()
    assert field.imbalance_veh < 1e-9 and field.courant <= 1.0


def test_the_report_preset_is_the_report_s_road():
    scenario = load_scenario("Report")
    diagram, road = scenario.diagram.build(), scenario.build_road()
    assert diagram.free_flow_mps == pytest.approx(75.0 * 0.44704)
    assert diagram.jam_per_m == pytest.approx(250.0 / 1609.344)
    assert road.cell_m == pytest.approx(160.9344)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (("free_flow_kmh = 90.0", "free_flow_kmh = -90.0"), "free_flow_mps of the greenshields .* positive"),
        (("jam_per_km = 150.0", "jam_per_km = 0.0"), "jam_per_m of the greenshields .* positive"),
        (
            ("jam_per_km = 150.0", "critical_density_per_km = 50.0"),
            "has no parameter 'critical_density_per_m'",
        ),
        (('"greenshields"', '"greenshield"'), "did you mean 'greenshields'"),
        (("length_km = 2.0", "length_km = 0.0"), "road.length_km: .*greater than 0"),
        (("cells = 20", "cells = 20\nlanes = 2"), "road.lanes: there is no such key.*length_km, cells"),
        (("duration_s", "duration"), "did you mean 'duration_s'"),
        (("[0.3, 1.0, 1.7]", "[0.3, 1.0, 2.7]"), "a detector at 2700 m is outside the road"),
        (("[0.5, 1.5]", "[0.5, 15.0]"), "a location at 15000 m is outside the road"),
        (("sd = 5.0", "sd = 30.0"), "uncertain.free_flow_kmh: .* reaches below zero"),
        (("sd = 5.0", "sd = -5.0"), "uncertain.free_flow_kmh: the standard deviation .* positive"),
        (('"lognormal"', '"beta"'), "uncertain.jam_per_km: a beta distribution needs lower and upper"),
        (('"lognormal"', '"gamma"'), "uncertain.jam_per_km.distribution: .*'normal', 'lognormal' or 'beta'"),
        (("[uncertain.jam_per_km]", "[uncertain.jam_per_mile]"), "did you mean 'jam_per_km'"),
        (("flow_vehph = 1500.0", "flow_vehph = [1500.0, 2.0]"), "a time for each flow"),
        (("flow_vehph = 1500.0", "flow_vehph = -1.0"), "0 veh/s or more"),
        (("depart_s = 20.0", "jerk_mps3 = 0.0"), "probe.jerk_mps3: .*greater than or equal to 0.1"),
        (("cycles = 3", "cycles = 1"), "ensemble.cycles: .*greater than or equal to 2"),
        (("duration_s = 240.0", 'duration_s = 240.0\nmodel = "zang"'), "did you mean 'zhang'"),
    ],
)
def test_mistakes_in_a_file_are_explained(changes, said):
    with pytest.raises(TrafficError, match=rf"(?s)small.toml.*{said}"):
        parsed(*changes)


def test_a_correlation_names_two_uncertain_parameters():
    wrong = '[[correlation]]\nparameters = ["jam_per_km", "jam_per_km"]\nvalue = 0.4\n\n[detectors]'
    with pytest.raises(TrafficError, match="two different uncertain parameters"):
        parsed("[detectors]", wrong)


def test_a_file_that_is_no_scenario(tmp_path):
    with pytest.raises(CycleError, match=r"cannot read the scenario .*none\.toml"):
        load_scenario(tmp_path / "none.toml")
    with pytest.raises(TrafficError, match="did you mean 'commute'"):
        load_scenario("comute")
    path = tmp_path / "bad.toml"
    path.write_text("name = ", encoding="utf-8")
    with pytest.raises(TrafficError, match="not valid TOML"):
        load_scenario(path)
    path.write_text(SMALL, encoding="utf-8")
    assert load_scenario(path).name == "small"


def test_the_file_of_the_documentation_is_a_scenario():
    page = (Path(__file__).parents[1] / "docs" / "traffic.md").read_text(encoding="utf-8")
    text = re.search(r"```\{code-block\} toml\n:caption: my-road.toml\n(.*?)```", page, re.DOTALL)[1]
    scenario = parse_scenario(tomllib.loads(text), "my-road.toml")
    assert scenario.build_uncertain().correlation[0, 1] == 0.3
    found = draw_cycles(scenario, cycles=2)
    assert found.planned.distance_m == pytest.approx(6000.0, rel=0.01)
    assert min(cycle.speed_mps[60:-60].min() for cycle in found.members) < 0.5 * 25.0
    assert abs(estimate_scenario(scenario).estimate.mean[-1, 0] / 25.0 - 1.0) < 0.02

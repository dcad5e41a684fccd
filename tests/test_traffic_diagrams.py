"""Fundamental diagrams: closed forms, limits, messages."""

import math

import numpy as np
import pytest

from drivecycles.errors import CycleError
from drivecycles.traffic import (
    DIAGRAMS,
    Greenberg,
    Greenshields,
    TrafficError,
    Triangular,
    Underwood,
    make_diagram,
)

ALL = (
    Greenshields(30.0, 0.15),
    Underwood(30.0, 0.03),
    Greenberg(30.0, 0.15, 12.0),
    Triangular(30.0, 0.02, 0.15),
    Triangular(20.0, 0.1, 0.15),
)
each = pytest.mark.parametrize("diagram", ALL, ids=lambda d: f"{d.kind}-{d.free_flow_mps:g}")


def densities(diagram, points=4001):
    return np.linspace(0.0, min(diagram.full_per_m, 0.3), points)


@each
def test_the_critical_density_carries_the_capacity(diagram):
    flow = diagram.flow_per_s(densities(diagram))
    assert flow.max() <= diagram.capacity_per_s * (1.0 + 1e-12)
    assert flow.max() >= diagram.capacity_per_s * (1.0 - 1e-3)


def test_capacities_are_those_of_the_books():
    assert ALL[0].capacity_per_s == pytest.approx(30.0 * 0.15 / 4.0, rel=1e-14)
    assert ALL[1].capacity_per_s == pytest.approx(30.0 * 0.03 / math.e, rel=1e-14)
    assert ALL[2].capacity_per_s == pytest.approx(12.0 * 0.15 / math.e, rel=1e-14)
    assert ALL[3].capacity_per_s == pytest.approx(30.0 * 0.02, rel=1e-14)
    assert ALL[3].backward_mps == pytest.approx(30.0 * 0.02 / 0.13, rel=1e-14)


@each
def test_speed_is_free_on_the_empty_road_and_falls(diagram):
    speed = diagram.speed_mps(densities(diagram))
    assert speed[0] == diagram.free_flow_mps
    assert np.all(np.diff(speed) <= 1e-12)
    if diagram.full_per_m < math.inf:
        assert float(diagram.speed_mps(diagram.full_per_m)) == pytest.approx(0.0, abs=1e-12)
    else:
        assert speed[-1] > 0.0


@each
def test_waves_are_the_slope_of_the_flow(diagram):
    k = densities(diagram)[5:-5] + 1.2345e-6
    h = 1e-8
    slope = (diagram.flow_per_s(k + h) - diagram.flow_per_s(k - h)) / (2.0 * h)
    kinks = {"greenberg": "capped_per_m", "triangular": "critical_per_m"}
    away = np.abs(k - getattr(diagram, kinks.get(diagram.kind, "critical_per_m"))) > 1e-4
    np.testing.assert_allclose(diagram.wave_mps(k)[away], slope[away], rtol=1e-5, atol=1e-5)
    assert np.abs(slope).max() <= diagram.fastest_wave_mps * (1.0 + 1e-6)
    assert np.abs(diagram.wave_mps(densities(diagram))).max() == pytest.approx(diagram.fastest_wave_mps)


@each
def test_demand_and_supply_are_the_envelopes_of_the_flow(diagram):
    k = densities(diagram)
    demand, supply, flow = diagram.demand_per_s(k), diagram.supply_per_s(k), diagram.flow_per_s(k)
    np.testing.assert_allclose(np.minimum(demand, supply), flow, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(np.maximum(demand, supply), diagram.capacity_per_s, rtol=1e-12)
    assert np.all(np.diff(demand) >= -1e-15)
    assert np.all(np.diff(supply) <= 1e-15)


@each
def test_a_flow_is_found_on_the_free_branch(diagram):
    for share in (0.0, 0.3, 0.9, 1.0):
        flow = share * diagram.capacity_per_s
        density = diagram.free_density_per_m(flow)
        assert density <= diagram.critical_per_m * (1.0 + 1e-12)
        assert float(diagram.flow_per_s(density)) == pytest.approx(flow, abs=1e-12)
    with pytest.raises(TrafficError, match=r"veh/h is not within 0 and the capacity"):
        diagram.free_density_per_m(1.01 * diagram.capacity_per_s)


def test_diagrams_are_made_by_name():
    assert make_diagram(" Greenshields", free_flow_mps=30.0, jam_per_m=0.15) == ALL[0]
    assert set(DIAGRAMS) == {"greenshields", "underwood", "greenberg", "triangular"}


@pytest.mark.parametrize(
    ("kind", "parameters", "said"),
    [
        ("greenshield", {}, "did you mean 'greenshields'"),
        ("greenshields", {"free_flow_mps": 30.0}, "needs jam_per_m"),
        ("greenshields", {"free_flow_mps": 30.0, "jam": 0.1}, "did you mean 'jam_per_m'"),
        ("greenshields", {"free_flow_mps": 30.0, "jam_per_m": 0.0}, "jam_per_m .* must be positive"),
        ("underwood", {"free_flow_mps": -1.0, "critical_density_per_m": 0.1}, "free_flow_mps .* got -1.0"),
        ("underwood", {"free_flow_mps": math.nan, "critical_density_per_m": 0.1}, "got nan"),
        ("greenberg", {"free_flow_mps": 30.0, "jam_per_m": 0.15, "optimum_mps": 30.0}, "must lie below"),
        (
            "triangular",
            {"free_flow_mps": 30.0, "jam_per_m": 0.15, "critical_density_per_m": 0.15},
            "must lie below",
        ),
    ],
)
def test_what_makes_no_diagram_is_refused(kind, parameters, said):
    with pytest.raises(TrafficError, match=said) as caught:
        make_diagram(kind, **parameters)
    assert isinstance(caught.value, CycleError)

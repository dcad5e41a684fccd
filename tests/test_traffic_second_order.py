"""Second-order models: conservation, equilibria, closed forms, exact solutions, limits, messages."""

import numpy as np
import pytest

from drivecycles.traffic import (
    Bottleneck,
    Greenberg,
    Greenshields,
    Road,
    TrafficError,
    TrafficWarning,
    Triangular,
    Underwood,
)
from drivecycles.traffic._second_order import pressure, sound
from drivecycles.traffic.lwr import simulate
from drivecycles.traffic.second_order import (
    MODELS,
    AwRascle,
    Kuehne,
    Payne,
    Ross,
    Zhang,
    make_model,
    simulate_second_order,
)

DIAGRAM = Greenshields(30.0, 0.15)
ALL = (
    DIAGRAM,
    Underwood(30.0, 0.03),
    Greenberg(30.0, 0.15, 12.0),
    Triangular(30.0, 0.03, 0.15),
)
MODEL = (Payne(5.0), Ross(5.0), Kuehne(5.0, 12.0, 50.0), Zhang(5.0), AwRascle(1.5, 20.0, 0.15, 5.0))
each_model = pytest.mark.parametrize("model", MODEL, ids=lambda m: m.name)
each_diagram = pytest.mark.parametrize("diagram", ALL, ids=lambda d: d.kind)
HUMP = Road(4000.0, 100)


def hump(road, low, high):
    return low + (high - low) * np.exp(-(((road.position_m - 0.5 * road.length_m) / 300.0) ** 2))


@each_model
@each_diagram
def test_vehicles_are_conserved_and_densities_positive(model, diagram):
    road = Road(4000.0, 100, (Bottleneck(3000.0, 0.2, 10.0, 30.0),))
    start = hump(road, 0.0, 0.025)
    field = simulate_second_order(road, diagram, model, demand=0.3, initial=start, duration_s=40.0)
    assert field.imbalance_veh < 1e-10
    assert field.density_per_m.min() >= 0.0
    assert field.courant <= 1.0
    assert field.scheme == model.name


@each_model
@each_diagram
def test_even_traffic_in_equilibrium_stays_as_it_is(model, diagram):
    density = 0.4 * diagram.critical_per_m
    if model.name == "ross":
        # Nobody keeps below the free-flow speed, so only the empty road is in equilibrium.
        density = 0.0
    flow = float(diagram.flow_per_s(density))
    field = simulate_second_order(HUMP, diagram, model, demand=flow, initial=density, duration_s=60.0)
    np.testing.assert_allclose(field.density_per_m, density, rtol=1e-9)
    np.testing.assert_allclose(field.speed_mps, diagram.speed_mps(density), rtol=1e-9)


@pytest.mark.parametrize("model", [m for m in MODEL if m.name != "ross"], ids=lambda m: m.name)
def test_even_traffic_relaxes_exponentially(model):
    density, start = 0.03, 10.0
    wanted = float(DIAGRAM.speed_mps(density))
    field = simulate_second_order(
        HUMP,
        DIAGRAM,
        model,
        demand=float(DIAGRAM.flow_per_s(density)),
        initial=density,
        initial_mps=start,
        duration_s=6.0,
        step_s=0.2,
    )
    exact = wanted + (start - wanted) * np.exp(-field.time_s / 5.0)
    # The middle has not heard of the ends yet.
    np.testing.assert_allclose(field.speed_mps[:, 50], exact, rtol=1e-10)


@each_diagram
@pytest.mark.parametrize("model", [Payne(5.0), Kuehne(5.0), Zhang(5.0)], ids=lambda m: m.name)
def test_the_pressure_is_the_integral_of_the_squared_speed_of_sound(model, diagram):
    law = model.law(diagram)
    full = min(diagram.full_per_m, 0.15)
    edge = getattr(diagram, "capped_per_m", diagram.critical_per_m)
    for low, high in ((0.0, edge), (edge, full)):
        nodes, weights = np.polynomial.legendre.leggauss(60)
        k = low + 0.5 * (high - low) * (1.0 + nodes)
        squares = np.array([sound(law, density) ** 2 for density in k])
        integral = 0.5 * (high - low) * weights @ squares
        assert pressure(law, high) - pressure(law, low) == pytest.approx(integral, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize(
    ("model", "speeds"),
    [
        (Payne(1e3), lambda k, v: (v - (30.0 / 0.15 / 2e3) ** 0.5, v + (30.0 / 0.15 / 2e3) ** 0.5)),
        (Kuehne(1e6, 8.0, 0.0), lambda k, v: (v - 8.0, v + 8.0)),
        (Zhang(1e6), lambda k, v: (v - k * 200.0, v + k * 200.0)),
        (AwRascle(1.5, 20.0, 0.15), lambda k, v: (v - 1.5 * 20.0 * (k / 0.15) ** 1.5, v)),
    ],
    ids=lambda m: getattr(m, "name", ""),
)
def test_small_disturbances_travel_at_the_characteristic_speeds(model, speeds):
    """A bump of density splits into two waves, whose weights and speeds the linear theory gives."""
    road, base, end_s = Road(6000.0, 3000), 0.05, 60.0
    v = float(DIAGRAM.speed_mps(base))
    x = road.position_m
    bump = 1e-5 * np.exp(-(((x - 2000.0) / 150.0) ** 2))
    field = simulate_second_order(
        road,
        DIAGRAM,
        model,
        demand=float(DIAGRAM.flow_per_s(base)),
        initial=base + bump,
        initial_mps=v,
        duration_s=end_s,
    )
    found = field.density_per_m[-1] - base
    slow, fast = speeds(base, v)
    # dv = 0: the bump is the sum of both eigenvectors (dk, dv) = (1, (wave - v) / k).
    weight = (v - slow) / (fast - slow)
    centre = 2000.0 + end_s * (weight * fast + (1.0 - weight) * slow)
    if np.isfinite(model.relaxation_s):
        # What relaxes of the speed meanwhile moves the centre as well.
        late = model.relaxation_s * -np.expm1(-end_s / model.relaxation_s)
        centre -= base * 200.0 * (end_s - late)
    inside = (x > 300.0) & (x < 5700.0)
    assert np.sum(found[inside]) == pytest.approx(bump.sum(), rel=1e-2)
    assert np.sum(found[inside] * x[inside]) / np.sum(found[inside]) == pytest.approx(centre, abs=1.0)
    spread = np.sum(found[inside] * (x[inside] - centre) ** 2) / np.sum(found[inside])
    apart = weight * (1.0 - weight) * (end_s * (fast - slow)) ** 2
    assert spread == pytest.approx(apart + 0.5 * 150.0**2, rel=0.1)


def aw_rascle_riemann(left, right, slope, exponent, unit):
    """A shock or fan of the first family up to the contact, which carries the right-hand speed."""
    (k0, v0), (k1, v1) = left, right
    w = v0 + unit * k0**exponent
    middle = ((w - v1) / unit) ** (1.0 / exponent)

    def speed(k):
        return w - unit * k**exponent

    if middle > k0:
        front = (middle * v1 - k0 * v0) / (middle - k0)
        k = np.where(slope < front, k0, middle)
    else:
        # Along the fan v - k p' is the slope.
        inside = np.maximum((w - slope) / (unit * (1.0 + exponent)), 0.0) ** (1.0 / exponent)
        k = np.clip(inside, middle, k0)
    v = speed(k)
    return np.where(slope < v1, k, k1), np.where(slope < v1, v, v1)


@pytest.mark.parametrize(
    ("left", "right"),
    [((0.03, 22.0), (0.06, 8.0)), ((0.08, 6.0), (0.03, 14.0)), ((0.04, 12.0), (0.02, 12.0))],
    ids=["shock", "fan", "contact"],
)
def test_aw_rascle_meets_its_exact_solution(left, right):
    exponent, unit = 1.0, 25.0 / 0.15
    model = AwRascle(exponent, 25.0, 0.15)
    found, end_s = [], 40.0
    for cells in (200, 400, 800, 1600):
        road = Road(4000.0, cells)
        x = road.position_m - 2000.0
        start, speed = (np.where(x < 0.0, left[i], right[i]) for i in range(2))
        field = simulate_second_order(
            road, DIAGRAM, model, demand=0.5, initial=start, initial_mps=speed, duration_s=end_s
        )
        exact, _ = aw_rascle_riemann(left, right, x / end_s, exponent, unit)
        inside = np.abs(x) < 800.0
        found.append(np.abs(field.density_per_m[-1] - exact)[inside].mean())
    order = np.log2(found[0] / found[-1]) / 3.0
    # A contact is smeared like the root of the cell.
    assert order > 0.42
    assert found[-1] < 0.05 * abs(left[0] - right[0])


def test_fast_relaxation_gives_kinematic_waves():
    """Payne's too, whose traffic is stable for short reaction times; Aw and Rascle's above the pressure."""
    road = Road(4000.0, 400)
    start = hump(road, 0.02, 0.09)
    wave = simulate(road, DIAGRAM, demand=0.5, initial=start, duration_s=60.0)
    for model in (Zhang(0.05), Payne(0.5), AwRascle(1.0, 30.0, 0.15, 0.05)):
        field = simulate_second_order(
            road, DIAGRAM, model, demand=0.5, initial=start, duration_s=60.0, step_s=0.1
        )
        apart = np.abs(field.density_per_m[-1] - wave.density_per_m[-1]).mean()
        assert apart < 0.03 * 0.07


def test_ross_keeps_within_the_jam_and_drives_no_faster_than_the_road_lets_out():
    road = Road(2000.0, 50, (Bottleneck(1000.0, 0.0),))
    with pytest.warns(TrafficWarning, match="the queue reaches the entrance"):
        field = simulate_second_order(road, DIAGRAM, Ross(5.0), demand=1.0, initial=0.05, duration_s=300.0)
    assert field.density_per_m.max() <= 0.15 * (1.0 + 1e-12)
    assert field.density_per_m[-1, 24] == pytest.approx(0.15, rel=1e-6)
    assert field.speed_mps[-1, :25].max() < 0.5
    assert field.speed_mps.min() >= 0.0


def test_what_daganzo_objects_to_is_told():
    road = Road(4000.0, 200)
    x = road.position_m
    start = np.where((x > 2000.0) & (x < 3000.0), 0.14, 0.03)
    with pytest.warns(TrafficWarning) as caught:
        field = simulate_second_order(road, DIAGRAM, Payne(20.0), demand=0.5, initial=start, duration_s=30.0)
    said = " ".join(str(warning.message) for warning in caught)
    assert "beyond the jam density" in said
    assert ("drives vehicles backwards" in said) == (field.speed_mps.min() < 0.0)
    assert field.density_per_m.max() > 0.15


def test_models_are_made_by_name():
    assert make_model(" Payne", relaxation_s=3.0) == Payne(3.0)
    assert set(MODELS) == {"payne", "ross", "kuehne", "zhang", "aw-rascle"}


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: make_model("pain"), "did you mean 'payne'"),
        (lambda: make_model("payne", relaxation=1.0), "did you mean 'relaxation_s'"),
        (lambda: Payne(0.0), "relaxation_s of payne must be positive"),
        (lambda: Zhang(float("inf")), "must be positive and finite"),
        (lambda: Kuehne(1.0, 1.0, -1.0), "viscosity_m2ps"),
        (lambda: AwRascle(0.0), "exponent of aw-rascle"),
        (lambda: AwRascle(relaxation_s=0.0), "relaxation_s of aw-rascle"),
        (lambda: AwRascle().law(ALL[1]), "give reference_per_m"),
    ],
)
def test_what_is_no_model_is_refused(made, said):
    with pytest.raises(TrafficError, match=said):
        made()


@pytest.mark.parametrize(
    ("model", "changed", "said"),
    [
        (Payne(), {"step_s": 2.0}, "Courant number"),
        (Kuehne(5.0, 5.0, 2000.0), {"step_s": 0.5}, "too long for the viscosity"),
        (Payne(), {"initial_mps": -1.0}, "initial speed of 0 m/s or more"),
        (Payne(), {"initial_mps": [1.0, 2.0]}, r"got shape \(2,\)"),
        # The start is slower than what comes of it: only the run itself can tell.
        (Kuehne(1e3, 30.0, 0.0), {"step_s": 0.625, "initial": np.linspace(0.14, 0.0, 100)}, "step was too"),
    ],
)
def test_what_cannot_be_run_is_refused(model, changed, said):
    known = {"demand": 0.3, "duration_s": 10.0} | changed
    with pytest.raises(TrafficError, match=said):
        simulate_second_order(HUMP, DIAGRAM, model, **known)

"""Table 1 and Figures 1, 2, 4 and 5 of Larsson et al.: what needs no simulation of a trip."""

import math

import numpy as np
import pytest
from scipy.stats import norm

from bms import Pack, PiecewiseLinear, load_pack
from ems.concept import load_concept
from socwise.reproduce import forward, ocv_figure, penalty_figure, run, table1

FAST = ("larsson-table1", "larsson-fig1", "larsson-fig2", "larsson-fig4", "larsson-fig5")
FLAT = PiecewiseLinear.continuous([0.0, 1.0], [1.0, 1.0])


@pytest.fixture(scope="module")
def found():
    return {item: run(item) for item in FAST}


@pytest.mark.parametrize("item", FAST)
def test_every_row_is_right(found, item):
    assert found[item].rows
    assert [row.label for row in found[item].rows if not row.ok] == []
    assert len({row.name for row in found[item].rows}) == len(found[item].rows)


@pytest.mark.parametrize("item", FAST[1:])
def test_every_axis_of_a_picture_has_a_unit(found, item):
    panels = found[item].draw().axes
    bottom = [ax for ax in panels if ax.get_xlabel()]
    assert bottom
    assert all("[" in ax.get_xlabel() for ax in bottom)
    assert all("[" in ax.get_ylabel() for ax in panels if ax.get_ylabel())


def test_usable_energy_is_the_window_or_the_depletion():
    hev, phev = load_concept("hev"), load_concept("phev")
    pack = load_pack("phev")
    kWh = pack.energy_J / 3.6e6
    assert table1.usable_kWh(phev, pack) == pytest.approx(0.60 * kWh)
    assert table1.usable_kWh(hev, pack) == pytest.approx(0.20 * kWh)


def test_table_1_sees_another_car(found):
    names = {row.name: row for row in found["larsson-table1"].rows}
    assert names["PHEV battery: usable"].published == 4.8
    assert names["PHEV battery: share allowed (section 3)"].published == 65.0
    heavier = load_concept("hev").load_vehicle()
    chassis = heavier.chassis.model_copy(update={"mass_kg": 1501.0})
    rows = table1._platform(type(heavier)(**{**vars(heavier), "chassis": chassis}))
    assert [row.name for row in rows if not row.ok] == ["mass"]


def test_slope_of_a_straight_curve():
    table = {"soc": (0.0, 0.5, 1.0), "ocv_V": (90.0, 100.0, 110.0), "resistance_ohm": (0.1, 0.1, 0.1)}
    straight = Pack(**{**load_pack("hev").model_dump(), **table})
    assert ocv_figure.mean_slope(straight, 100.0, (0.2, 0.9)) == pytest.approx(0.2)


def test_variance_without_drift_falls_as_averaging_does():
    """With no drift and constant measurement variance w, eq 9 gives 1/p_k = 1/p_0 + k/w."""
    settings = forward.Settings(gamma=0.0, beta=0.0, mu=2e-3)
    variance = forward.simulate_variance(settings, FLAT, 50, start=1e-3)[:, 0]
    np.testing.assert_allclose(1.0 / variance, 1e3 + np.arange(51) / 2e-3, rtol=1e-12)


def test_settled_variance_solves_its_quadratic_and_is_where_the_simulation_ends():
    settings = forward.Settings(current_A=(0.0, 23.0, -50.0), mu=(0.7e-3, 2e-3, 6e-3))
    drift, mu = 1e-6 + 3.9e-7 * np.array([0.0, 23.0, 50.0]), np.array([0.7e-3, 2e-3, 6e-3])
    settled = forward.settled_variance(settings, FLAT)
    np.testing.assert_allclose(settled**2, drift * (settled + mu), rtol=1e-12)
    alpha = load_pack("hev").ocv.alpha
    at_ends = forward.Settings(soc=(0.1, 0.6, 0.95))
    end = forward.simulate_variance(at_ends, alpha, 600)[-1]
    np.testing.assert_allclose(forward.settled_variance(at_ends, alpha), end, rtol=1e-8)


def test_rest_begins_when_it_should():
    moving = forward.simulate_variance(forward.Settings(), FLAT, 30)
    resting = forward.simulate_variance(forward.Settings(), FLAT, 30, rest_from_s=20)
    np.testing.assert_array_equal(moving[:21], resting[:21])
    assert moving[21, 0] - resting[21, 0] == pytest.approx(3.9e-7 * 23.0)


def test_penalty_at_an_edge_is_half_the_jump_and_the_slope_times_the_mean_shortfall():
    """The Beta belief is close to a Gaussian one, for which the expectation at the edge is known."""
    window = load_concept("hev").window
    expected = 0.5 * window.jump_below_kgps + window.slope_below_kgps * penalty_figure.SQRT_P * norm.pdf(0.0)
    found = penalty_figure.expected(window.penalty_kgps(), window.low)
    assert found == pytest.approx(expected, rel=0.02)


def test_figure_4_tells_a_window_without_cost(found):
    concept = load_concept("hev")
    free = dict.fromkeys(("jump_above_kgps", "slope_above_kgps"), 0.0)
    soft = concept.model_copy(update={"window": concept.window.model_copy(update=free)})
    wrong = [row.name for row in penalty_figure._rows("HEV", soft) if not row.ok]
    assert wrong == ["HEV: Gamma 1 % SOC above the window, above zero"]


def test_figure_2_shows_variance_over_soc_and_five_families_over_time(found):
    panels = found["larsson-fig2"].draw().axes
    assert [ax.get_xlabel() for ax in panels] == ["SOC [%]"] + 5 * ["time [s]"]
    top = max(line.get_ydata().max() for line in panels[0].lines)
    assert top == pytest.approx(6.0)
    transient = panels[3]
    assert "zero after 200 s" in transient.get_title()
    for line in transient.lines[:3]:
        sqrt_p = line.get_ydata()
        assert sqrt_p[500] < sqrt_p[200]
        assert math.isclose(sqrt_p[500], transient.lines[0].get_ydata()[500], rel_tol=0.01)


def test_figure_5_draws_the_whole_cycle(found):
    speed, altitude = found["larsson-fig5"].draw().axes
    assert speed.get_xlim() == (0.0, 4268.0)
    assert speed.lines[0].get_ydata().max() == pytest.approx(96.4, abs=0.5)
    ends = altitude.lines[0].get_ydata()[[0, -1]]
    assert ends == pytest.approx([0.0, 0.0], abs=1e-6)

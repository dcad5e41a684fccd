"""Tables 7 and 8 and Figures 25 to 33 of the MAUTC report, part 3: the battery and its estimator."""

import dataclasses
import json

import numpy as np
import pytest

from bms.ageing import age
from bms.cells import load_cell
from bms.cycling import CyclingProfile, CyclingState, cycling_profile
from bms.degradation import DegradationMap
from bms.simulation import simulate
from ems.concept import load_concept
from socwise import reproduce
from socwise.reproduce import battery_case, estimates_figure, lifetime_figures
from socwise.reproduce.battery_case import DAY_S, GAINS, SIGMA_PER_S, TABLE_7, battery_profile, estimate
from socwise.reproduce.current_figures import cycles
from socwise.reproduce.fade_map import fade_map
from socwise.reproduce.gain_stability import BLOCK, modes_over_time, sensitivities
from socwise.reproduce.lifetime import EVERY, live
from socwise.reproduce.phev_current import cell_share, phev_trip
from socwise.reproduce.pulse_figure import pulse_test

QUICK = ["table7", "table8", "fig25", "fig26", "fig27", "fig28", "fig31", "fig32"]
NO_FADE = DegradationMap(
    np.array([0.0, 9.0]), np.array([0.0, 1.0]), np.array([25.0]), *np.zeros((2, 2, 2, 1))
)


def wrong(found):
    return [f"{row.label}: {row.ours}" for row in found.rows if not row.ok]


def check(found, panels):
    """Every row is right and can be written, and the picture's axes say what they show."""
    assert found.rows
    assert wrong(found) == []
    json.dumps(found.to_json(), allow_nan=False)
    axes = [] if found.draw is None else found.draw().axes
    assert [ax.get_ylabel() for ax in axes] == panels
    assert all(ax.get_xlabel() for ax in axes[-1:])


PANELS = {
    "table7": [],
    "table8": ["eigenvalue of Γ H [-]"],
    "fig25": ["voltage [V]", "voltage [V]"],
    "fig26": ["current [A],\n> 0 charges", "voltage [V]"],
    "fig27": ["speed [km/h]", "cell current [A],\n> 0 charges"],
    "fig28": ["cell current [A],\n> 0 charges", "SOC [%]"],
    "fig31": ["SOC estimate − true\n[% SOC]", "|voltage residual| [mV]"],
    "fig32": ["SOC [%]"],
}


@pytest.mark.parametrize("place", QUICK)
def test_every_row_of_the_quick_items_is_right(place):
    found = reproduce.run(f"mautc-{place}")
    assert found.id == f"mautc-{place}"
    check(found, PANELS[place])


def test_figure_30_holds_and_tells_the_numbers_of_terms_apart():
    ticks = []
    found = estimates_figure.reproduce(
        realizations=2, progress=lambda done, total: ticks.append((done, total))
    )
    assert ticks[-1] == (8, 8)
    check(found, ["$Q$ [Ah]", "$R$ [mΩ]", "$C_r$ [F]", "$R_r$ [mΩ]"])
    two, four = ([estimate(terms, k) for k in range(2)] for terms in (2, 4))
    judged = [row.name for row in estimates_figure._rows(4, two) if not row.ok]
    assert judged == [f"N = 4: largest error of {name}, wanted at most 1" for name in ("C_r", "R_r")]
    judged = [row.name for row in estimates_figure._rows(2, four) if not row.ok]
    assert judged == ["N = 2: least of the larger error of C_r and R_r, wanted at least 4"]


def test_the_number_of_threads_changes_nothing():
    one = estimate(2, 1)
    battery_case.estimate.cache_clear()
    both = battery_case.estimate_many([("gpc_gradient", 2)], 2, jobs=2)["gpc_gradient", 2]
    np.testing.assert_array_equal(both[1].trace.soc, one.trace.soc)
    assert np.any(both[0].trace.soc != one.trace.soc)


@pytest.mark.slow
def test_figure_30_holds_on_20_realizations():
    found = estimates_figure.reproduce()
    assert len(found.rows) == 22
    assert wrong(found) == []


def test_figure_33_holds_from_the_fifth_day_that_the_estimator_is_on():
    ticks = []
    found = lifetime_figures.figure33(days=7.0, off_days=1.0, progress=lambda *n: ticks.append(n))
    assert ticks[-1] == (28, 28)
    check(found, ["Q [Ah]", "R [mΩ]"])
    assert found.draw().axes[0].get_title() == "ageing accelerated 3 times"


@pytest.mark.slow
def test_figure_33_holds_over_a_hundred_days():
    found = lifetime_figures.figure33()
    assert wrong(found) == []
    lost = {row.name: row.ours for row in found.rows if "capacity lost" in row.name}
    assert lost["real rate: capacity lost in 100 days"] == pytest.approx(3.8, abs=0.3)
    assert lost["ageing accelerated 3 times: capacity lost in 100 days"] == pytest.approx(11.4, abs=0.6)


def test_the_noise_is_that_of_the_report_and_each_realization_has_its_own():
    n = 200_000
    current, voltage = battery_case.add_noise(np.zeros(n), np.zeros(n), battery_case.generator(3))
    assert current.std() == pytest.approx(0.010, rel=0.01)
    assert voltage.std() == pytest.approx(0.002, rel=0.01)
    again, _ = battery_case.add_noise(np.zeros(n), np.zeros(n), battery_case.generator(3))
    other, _ = battery_case.add_noise(np.zeros(n), np.zeros(n), battery_case.generator(4))
    np.testing.assert_array_equal(again, current)
    assert abs(np.corrcoef(other, current)[0, 1]) < 0.02


def test_one_lap_is_driven_electrically_and_its_charge_is_what_the_pack_lost():
    trip, pack = phev_trip(2.0, laps=1), load_concept("phev").load_pack()
    assert trip.engine_share == 0.0
    assert trip.fuel_l_per_100km == 0.0
    lost_C = (trip.soc[0] - trip.soc[1]) * pack.capacity_C
    assert -trip.current_A.sum() == pytest.approx(lost_C * cell_share(pack, 2.0), rel=1e-5)
    np.testing.assert_allclose(phev_trip(5.0, laps=1).current_A, 2.5 * trip.current_A, rtol=1e-12)


def test_the_cell_has_the_c_rate_of_a_pack_of_16_kwh():
    pack = load_concept("phev").load_pack()
    # At the same power the current is the same in a pack with twice the capacity at the same voltage.
    double = pack.model_copy(update={"capacity_Ah": 2.0 * pack.capacity_Ah})
    assert cell_share(double, 2.0) == pytest.approx(cell_share(pack, 2.0), rel=1e-12)
    mean_V = pack.energy_J / pack.capacity_C
    assert cell_share(pack, 2.0) == pytest.approx(2.0 * mean_V / 16e3, rel=1e-12)


def test_cycles_are_counted_from_charge_to_charge():
    tooth = np.repeat([-1.0, 2.0], [2000, 1000])
    profile = CyclingProfile(np.tile(tooth, 5), np.zeros(15_000), 1.0, CyclingState())
    assert cycles(profile) == pytest.approx(5.0)


def test_sensitivities_are_derivatives_of_the_simulated_voltage():
    cell = load_cell("lfp-2ah")
    profile = cycling_profile(2.0, phev_trip(2.0, laps=1).current_A, 6000.0)
    pair = cell.relaxation[0]
    alpha, ohm, beta = 1.0 / cell.capacity_C, cell.resistance_ohm, 1.0 / pair.capacitance_F
    sigma, x10 = beta / pair.resistance_ohm, 0.7 * cell.capacity_C

    def voltage(theta):
        a, r, b, s, x = theta
        twin = cell.with_values(
            capacity_Ah=1.0 / a / 3600.0,
            resistance_ohm=r,
            relaxation=({"resistance_ohm": b / s, "capacitance_F": 1.0 / b},),
        )
        return simulate(twin, profile.current_A, 1.0, soc=a * x).voltage_V

    theta = np.array([alpha, ohm, beta, sigma, x10])
    found = sensitivities(cell, profile)
    half = 0.5 * (SIGMA_PER_S[1] - SIGMA_PER_S[0])
    for k, size in enumerate((1.0, 1.0, 1.0, half, 1.0)):
        step = np.where(np.arange(5) == k, 1e-4 * theta, 0.0)
        slope = size * (voltage(theta + step) - voltage(theta - step)) / (2.0 * step[k])
        np.testing.assert_allclose(found[:, k], slope, atol=2e-3 * np.abs(slope).max())


def test_modes_are_those_of_the_forgetful_sum():
    cell = load_cell("lfp-2ah")
    profile = cycling_profile(2.0, phev_trip(2.0, laps=1).current_A, 2.5 * BLOCK)
    modes = modes_over_time(cell, profile, GAINS)
    assert modes.time_s.tolist() == [BLOCK, 2.0 * BLOCK]
    total = np.zeros((5, 5))
    for row in sensitivities(cell, profile)[: 2 * BLOCK]:
        total = 0.99999 * total + np.outer(row, row)
    gain = np.diag([2e-14, 1e-8, 1e-10, 1e-5, 100.0])
    expected = np.sort(np.linalg.eigvals(gain @ total).real)[::-1]
    np.testing.assert_allclose(modes.eigenvalue[1], expected, rtol=1e-6)
    assert sorted(modes.leading[1].tolist()) == [0, 1, 2, 3, 4]


def test_without_fade_a_life_is_the_profile_of_figure_28():
    life = live(1.0, 0.5, NO_FADE)
    expected = battery_profile().soc[: round(DAY_S) : EVERY]
    np.testing.assert_allclose(life.soc, expected, atol=1e-12)
    np.testing.assert_array_equal(life.capacity_Ah, 2.0)
    np.testing.assert_array_equal(life.time_s, np.arange(48) * 1800.0)
    before = life.time_s < life.off_s
    for parameter in TABLE_7:
        np.testing.assert_allclose(life.estimates[parameter.name][before], parameter.guess, rtol=1e-12)


def test_a_life_loses_what_the_map_says():
    """The cell's own profile, aged in one go by the same map, within what the shrinking cycles change."""
    life = live(2.0, 1.0, fade_map(), acceleration=20.0)
    profile = battery_profile()
    n = round(life.time_s[-1] - life.time_s[-1] % 21_600)
    whole = age(fade_map(), profile.current_A[:n], profile.soc[:n], 25.0, 1.0, acceleration=20.0)
    assert life.capacity_Ah[-1] / 2.0 == pytest.approx(whole.capacity_factor[-1], abs=1e-4)
    assert 1.0 - whole.capacity_factor[-1] > 0.01


def test_errors_of_a_life_are_those_of_the_truth_at_the_time():
    life = live(1.0, 0.5, NO_FADE)
    estimates = {"capacity_Ah": np.full(48, 2.02), "resistance_ohm": np.full(48, 0.0079)}
    life = dataclasses.replace(life, estimates=estimates, capacity_Ah=np.linspace(2.0, 1.9, 48))
    capacity = life.capacity_error_percent(DAY_S / 2.0)
    assert capacity.size == 24
    assert capacity[-1] == pytest.approx(100.0 * (2.02 / 1.9 - 1.0))
    np.testing.assert_allclose(life.resistance_error_percent(0.0), -1.25)


def test_pulses_find_the_model_whatever_the_noise():
    cell = load_cell("lfp-2ah")
    for realization in range(5):
        found = pulse_test(cell, realization).found.parameters
        assert found["resistance_ohm"] == pytest.approx(8e-3, rel=0.03)
        assert found["relaxation_1_resistance_ohm"] == pytest.approx(11e-3, rel=0.03)
        assert found["relaxation_1_time_constant_s"] == pytest.approx(29.7, rel=0.05)

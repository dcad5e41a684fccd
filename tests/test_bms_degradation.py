"""The ageing map, the laws of fade behind it, and ageing along a profile."""

import subprocess
import sys
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from pydantic import ValidationError
from scipy.interpolate import RegularGridInterpolator

from bms.ageing import CHUNK, age
from bms.degradation import DegradationMap, load_degradation_map
from bms.errors import BatteryError, BatteryWarning
from bms.fade_laws import CalendarFade, CycleFade, FadeLaws, MONTH_s, ResistanceGrowth, Wear
from bms.plot_degradation import plot_ageing, plot_degradation_map

CYCLE_ONLY = FadeLaws(calendar=None)
CALENDAR_ONLY = FadeLaws(cycle=None)
BOTH = FadeLaws()
FULL = FadeLaws(resistance=ResistanceGrowth(), resistance_per_fade=1.5)


def law_of_paper():
    with pytest.warns(BatteryWarning, match=r"falls with current between 0\.5C and"):
        return CycleFade.with_table_of_paper()


def wang_percent(b, c_rate, kelvin, ah):
    return b * np.exp(-(31700.0 - 370.3 * c_rate) / (8.314 * kelvin)) * ah**0.55


def swierczynski_percent(soc_percent, celsius, months):
    by_soc = 0.019 * soc_percent**0.823 + 0.5195
    return by_soc * (3.258e-9 * celsius**5.087 + 0.295) * months**0.8


def driven(samples, seed=0):
    """A profile within the ranges of the laws, of a 2 Ah cell: current, SOC, temperature."""
    rng = np.random.default_rng(seed)
    current = rng.choice([-1.0, 1.0], samples) * rng.uniform(1.0, 8.0, samples)
    return current, rng.uniform(0.2, 0.8, samples), rng.uniform(25.0, 45.0, samples)


# The laws


def test_throughput_to_20_percent_with_the_table_of_the_paper():
    """At 25 degC and 1C, where the table gives B = 31630 - 9949 / 3."""
    law = law_of_paper()
    assert law.throughput_Ah(0.2, 1.0, 25.0) == pytest.approx(17825.0, abs=0.5)
    assert 100.0 * law.fade(17825.0, 1.0, 25.0) == pytest.approx(
        wang_percent(31630.0 - 9949.0 / 3.0, 1.0, 298.15, 17825.0), rel=1e-12
    )


@pytest.mark.parametrize(
    ("c_rate", "b"), [(0.5, 31630.0), (2.0, 21681.0), (4.0, 17307.5), (6.0, 12934.0), (10.0, 15512.0)]
)
def test_prefactors(c_rate, b):
    """The table's nodes and a middle; the default keeps the one of C/2."""
    assert law_of_paper().coefficient(c_rate, 40.0) == pytest.approx(
        wang_percent(b, c_rate, 313.15, 1.0), rel=1e-12
    )
    assert CycleFade().coefficient(-c_rate, 40.0) == pytest.approx(
        wang_percent(31630.0, c_rate, 313.15, 1.0), rel=1e-12
    )


def test_wear_per_ampere_hour_rises_with_current_unless_the_table_is_asked_for():
    c_rate = np.linspace(0.0, 10.0, 401)
    assert np.all(np.diff(CycleFade().fade(1000.0, c_rate[20:], 25.0)) > 0.0)
    assert np.all(np.diff(CycleFade().exposure_per_s(c_rate[1:] * 2.0, 25.0, 2.0) / c_rate[1:]) > 0.0)
    between = (c_rate >= 0.5) & (c_rate <= 2.0)
    assert np.all(np.diff(law_of_paper().coefficient(c_rate[between], 25.0)) < 0.0)


def test_calendar_fade_after_a_year():
    law = CalendarFade()
    assert 100.0 * law.fade(12.0, 0.5, 25.0) == pytest.approx(2.45, abs=0.005)
    for soc, celsius, months in ((0.1, 25.0, 1.0), (0.9, 55.0, 30.0)):
        assert 100.0 * law.fade(months, soc, celsius) == pytest.approx(
            swierczynski_percent(100.0 * soc, celsius, months), rel=1e-12
        )


def test_calendar_fade_stays_finite_in_the_cold_and_when_empty():
    cold = CalendarFade().coefficient([0.0, 0.0], [-30.0, 0.0])
    np.testing.assert_allclose(cold, 0.5195 * 0.295, rtol=1e-14)


def test_resistance_growth_of_a_year():
    law = ResistanceGrowth()
    year_s = 12.0 * MONTH_s
    assert law.growth_per_s(0.5, 25.0) * year_s == pytest.approx(3.4194e-10 * 1.5604 * year_s, rel=1e-12)
    assert law.growth_per_s(0.0, 25.0) == pytest.approx(3.4194e-10 * (1.5604 - 3.3903 / 4.0), rel=1e-12)
    hot = law.growth_per_s(0.5, 45.0) / law.growth_per_s(0.5, 25.0)
    assert np.log(hot) == pytest.approx(71827.0 / 8.314 * (1.0 / 298.15 - 1.0 / 318.15), rel=1e-12)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: CycleFade().fade(10.0, 12.0, 25.0), r"C-rate is 12 to 12, outside the 0\.5 to 10 of Wang"),
        (lambda: CycleFade().fade(10.0, 1.0, [25.0, -10.0]), "temperature in degC is -10 to 25, outside"),
        (lambda: CalendarFade().fade(10.0, 0.95, 25.0), r"SOC is 0\.95 .* Swierczynski"),
        (lambda: CalendarFade().fade(10.0, 0.5, 70.0), "the law is extrapolated"),
    ],
)
def test_outside_its_range_a_law_warns(call, said):
    with pytest.warns(BatteryWarning, match=said):
        assert np.all(call() > 0.0)


@pytest.mark.parametrize(
    ("build", "said"),
    [
        (lambda: CycleFade(prefactor=(1.0, 2.0)), "2 values for 1 C-rates"),
        (lambda: CycleFade(prefactor=(1.0, 2.0), prefactor_c_rate=(2.0, 1.0)), "increasing"),
        (lambda: CycleFade(prefactor=(-1.0,)), "must be positive"),
        (lambda: CycleFade(exponent=1.5), "less than or equal to 1"),
        (lambda: CycleFade(C_rate=1.0), "Extra inputs"),
        (lambda: CalendarFade(exponent=float("nan")), "finite number"),
        (lambda: ResistanceGrowth(soc_curvature=-10.0), "must not shrink"),
        (lambda: FadeLaws(resistance_per_fade=-1.0), "greater than or equal to 0"),
    ],
)
def test_bad_laws_are_refused(build, said):
    with pytest.raises(ValidationError, match=said):
        build()


# Ageing along a profile


def naive_ageing(laws, current, soc, temperature, step_s, capacity_Ah, wear):
    """Step by step through the virtual throughput and the virtual months, from the formulas as printed."""
    cycle, calendar, resistance = wear.cycle, wear.calendar, wear.resistance
    for i, s, celsius in zip(current, soc, temperature, strict=True):
        before = cycle + calendar
        k = wang_percent(31630.0, abs(i) / capacity_Ah, celsius + 273.15, 1.0) / 100.0
        virtual_Ah = (cycle / k) ** (1.0 / 0.55)
        delivered_Ah = 0.5 * abs(i) * step_s / 3600.0 * 2.2 / capacity_Ah
        cycle = k * (virtual_Ah + delivered_Ah) ** 0.55
        k = swierczynski_percent(100.0 * s, celsius, 1.0) / 100.0
        virtual_months = (calendar / k) ** (1.0 / 0.8)
        calendar = k * (virtual_months + step_s / (365.25 / 12.0 * 86400.0)) ** 0.8
        heat = np.exp(-71827.0 / 8.314 * (1.0 / (celsius + 273.15) - 1.0 / 298.15))
        growth = 3.4194e-10 * heat * (1.5604 - 3.3903 * (s - 0.5) ** 2)
        resistance += laws.resistance_per_fade * (cycle + calendar - before) + growth * step_s
    return cycle, calendar, resistance


@pytest.mark.parametrize("wear", [Wear(), Wear(0.03, 0.02, 0.1)])
def test_ageing_equals_the_virtual_throughput_step_by_step(wear):
    current, soc, temperature = driven(400)
    done = age(FULL, current, soc, temperature, 60.0, capacity_Ah=2.0, wear=wear).final
    expected = naive_ageing(FULL, current, soc, temperature, 60.0, 2.0, wear)
    np.testing.assert_allclose((done.cycle, done.calendar, done.resistance), expected, rtol=1e-10)


def test_a_constant_stress_gives_the_law_at_every_row():
    """A year at 1C and 25 degC in hours: fade in closed form, from the throughput delivered."""
    hours = np.arange(8767.0)
    done = age(BOTH, np.full(8766, -2.2), 0.5, 25.0, 3600.0, capacity_Ah=2.2)
    np.testing.assert_allclose(done.time_s, 3600.0 * hours)
    np.testing.assert_allclose(done.cycle_fade, CycleFade().fade(1.1 * hours, 1.0, 25.0), rtol=1e-10)
    np.testing.assert_allclose(done.calendar_fade, CalendarFade().fade(hours / 730.5, 0.5, 25.0), rtol=1e-10)
    np.testing.assert_allclose(done.capacity_factor, 1.0 - done.cycle_fade - done.calendar_fade, rtol=1e-14)
    assert done.calendar_fade[-1] == pytest.approx(0.0245, abs=5e-5)
    assert np.all(done.resistance_factor == 1.0)


@pytest.mark.parametrize("model", ["laws", "map"])
def test_neither_the_step_nor_the_block_changes_the_result(model):
    """A minute-wise profile in steps of 60, 1 and 0.5 s, over several chunks of the sum."""
    known = FULL if model == "laws" else map_of_laws(FULL)
    minutes = driven(2 * CHUNK // 60 + 7)
    coarse = age(known, *minutes, 60.0, capacity_Ah=2.0, every=10)
    for split in (60, 120):
        fine = [np.repeat(values, split) for values in minutes]
        assert fine[0].size > 2 * CHUNK
        done = age(known, *fine, 60.0 / split, capacity_Ah=2.0, every=10 * split)
        np.testing.assert_allclose(done.time_s, coarse.time_s)
        np.testing.assert_allclose(done.capacity_factor, coarse.capacity_factor, rtol=1e-12)
        np.testing.assert_allclose(done.resistance_factor, coarse.resistance_factor, rtol=1e-12)
        whole = age(known, *fine, 60.0 / split, capacity_Ah=2.0, every=fine[0].size)
        assert whole.capacity_factor[-1] == pytest.approx(coarse.capacity_factor[-1], rel=1e-12)


@settings(deadline=None, max_examples=40)
@given(cut=st.integers(1, 119), every=st.integers(1, 150), seed=st.integers(0, 1000))
def test_a_profile_may_be_cut_anywhere(cut, every, seed):
    current, soc, temperature = driven(120, seed)
    whole = age(FULL, current, soc, temperature, 900.0, capacity_Ah=2.0, every=every).final
    first = age(FULL, current[:cut], soc[:cut], temperature[:cut], 900.0, capacity_Ah=2.0).final
    second = age(
        FULL, current[cut:], soc[cut:], temperature[cut:], 900.0, capacity_Ah=2.0, every=every, wear=first
    ).final
    assert second.cycle == pytest.approx(whole.cycle, rel=1e-11)
    assert second.calendar == pytest.approx(whole.calendar, rel=1e-11)
    assert second.resistance == pytest.approx(whole.resistance, rel=1e-10)


def test_100_days_at_1_s_are_the_day_repeated_and_take_little_time():
    """8.64 million steps; measured 0.2 s for the laws and as much for a map."""
    day = driven(86400)
    days = [np.tile(values, 100) for values in day]
    for known in (FULL, map_of_laws(FULL)):
        repeated = age(known, *day, 1.0, capacity_Ah=2.0, repeats=100, acceleration=0.1)
        started = time.perf_counter()
        long = age(known, *days, 1.0, capacity_Ah=2.0, acceleration=0.1)
        assert time.perf_counter() - started < 5.0
        assert long.time_s.size == 2401
        np.testing.assert_allclose(repeated.time_s, long.time_s)
        np.testing.assert_allclose(repeated.capacity_factor, long.capacity_factor, rtol=1e-11)
        np.testing.assert_allclose(repeated.resistance_factor, long.resistance_factor, rtol=1e-11)


def test_rows_stand_at_the_ends_of_blocks():
    done = age(BOTH, np.full(25, 2.0), 0.5, 25.0, 10.0, capacity_Ah=2.0, every=10, repeats=2)
    np.testing.assert_allclose(done.time_s, [0.0, 100.0, 200.0, 250.0, 350.0, 450.0, 500.0])
    assert done.capacity_factor[0] == 1.0
    assert np.all(np.diff(done.capacity_factor) < 0.0)
    hourly = age(BOTH, np.full(25, 2.0), 0.5, 25.0, 900.0, capacity_Ah=2.0)
    np.testing.assert_allclose(hourly.time_s[:3], [0.0, 3600.0, 7200.0])


def test_acceleration_is_a_faster_clock():
    """A day that counts as 36 is 36 days of the same, at the day's end."""
    day = driven(1440)
    fast = age(FULL, *day, 60.0, capacity_Ah=2.0, acceleration=36.0)
    slow = age(FULL, *day, 60.0, capacity_Ah=2.0, repeats=36)
    assert fast.acceleration == 36.0
    assert fast.time_s[-1] == 86400.0
    assert fast.final.cycle == pytest.approx(slow.final.cycle, rel=1e-12)
    assert fast.final.calendar == pytest.approx(slow.final.calendar, rel=1e-12)
    assert fast.final.resistance == pytest.approx(slow.final.resistance, rel=1e-10)


def test_a_larger_cell_ages_by_its_equivalent_full_cycles():
    current, soc, temperature = driven(200)
    small = age(FULL, current, soc, temperature, 60.0, capacity_Ah=2.0)
    large = age(FULL, 25.0 * current, soc, temperature, 60.0, capacity_Ah=50.0)
    np.testing.assert_allclose(large.capacity_factor, small.capacity_factor, rtol=1e-13)


def test_throughput_counts_discharge_only_by_default():
    """The paper counts a cycle's charge once; counting both directions is twice the throughput."""
    profile = (np.tile([2.0, -2.0], 500), 0.5, 25.0, 60.0)
    once = age(CYCLE_ONLY, *profile, capacity_Ah=2.2).final.cycle
    twice = age(
        FadeLaws(cycle=CycleFade(throughput_share=1.0), calendar=None), *profile, capacity_Ah=2.2
    ).final.cycle
    assert once == pytest.approx(CycleFade().fade(1000.0 / 60.0, 2.0 / 2.2, 25.0), rel=1e-12)
    assert twice == pytest.approx(2.0**0.55 * once, rel=1e-12)


def test_rest_ages_by_time_alone():
    done = age(BOTH, np.zeros(100), 0.5, 25.0, 3600.0, capacity_Ah=2.0)
    assert done.cycle_fade[-1] == 0.0
    assert done.calendar_fade[-1] > 0.0
    assert done.remarks == ()


def test_laws_can_be_switched_off():
    profile = (np.full(100, 2.0), 0.5, 25.0, 3600.0)
    wear = Wear(0.01, 0.02, 0.03)
    for laws, moved in ((CYCLE_ONLY, "cycle"), (CALENDAR_ONLY, "calendar")):
        final = age(laws, *profile, capacity_Ah=2.0, wear=wear).final
        for part in ("cycle", "calendar"):
            assert (getattr(final, part) > getattr(wear, part)) == (part == moved)
        assert final.resistance == pytest.approx(0.03, rel=1e-12)
    none = FadeLaws(cycle=None, calendar=None)
    assert age(none, *profile, capacity_Ah=2.0).capacity_factor[-1] == 1.0


def test_resistance_grows_with_the_capacity_lost_when_asked():
    laws = FadeLaws(resistance_per_fade=2.0)
    done = age(laws, *driven(300), 60.0, capacity_Ah=2.0, wear=Wear(0.05, 0.05))
    lost = done.capacity_factor[0] - done.capacity_factor
    np.testing.assert_allclose(done.resistance_factor - 1.0, 2.0 * lost, rtol=1e-10)


def test_a_profile_outside_the_ranges_is_remarked():
    half_slow = np.tile([0.2, -1.8], 500)
    with pytest.warns(BatteryWarning, match=r"for 10 % of the charge the C-rate is outside the 0\.5 to 10"):
        done = age(CYCLE_ONLY, half_slow, 0.5, 25.0, 1.0, capacity_Ah=2.0)
    assert len(done.remarks) == 1
    hardly_slow = np.append(np.full(999, 2.0), 0.1)
    assert age(CYCLE_ONLY, hardly_slow, 0.5, 25.0, 1.0, capacity_Ah=2.0).remarks == ()
    with pytest.warns(BatteryWarning) as caught:
        age(FULL, np.full(10, 2.0), 0.95, 5.0, 1.0, capacity_Ah=2.0)
    said = " ".join(str(warning.message) for warning in caught)
    assert "100 % of the time soc" in said
    assert "100 % of the charge temperature_C" in said
    assert said.count("of the time temperature_C") == 2


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"current_A": [1.0, np.nan, 1.0]}, "current_A is nan at sample 1"),
        ({"soc": [0.5, 0.5, np.inf]}, "soc is inf at sample 2"),
        ({"soc": 50.0}, "fractions between 0 and 1"),
        ({"soc": [0.5, 0.5]}, "one value per sample of the current \\(3\\), or a single one"),
        ({"current_A": []}, "current_A has the shape \\(0,\\)"),
        ({"current_A": [[1.0, 2.0]]}, "current_A has the shape \\(1, 2\\)"),
        ({"temperature_C": -300.0}, "absolute zero"),
        ({"step_s": 0.0}, "step_s must be positive, got 0"),
        ({"capacity_Ah": None}, "need the cell's initial capacity_Ah"),
        ({"capacity_Ah": -2.0}, "got -2"),
        ({"acceleration": 0.0}, "1 is real time"),
        ({"repeats": 0}, "at least 1, got 3 and 0"),
        ({"every": 0}, "at least 1, got 0 and 1"),
        ({"acceleration": 1e9}, "nothing is left of the capacity after"),
    ],
)
def test_bad_profiles_are_refused(changed, said):
    given = {
        "current_A": [2.0, -2.0, 2.0],
        "soc": 0.5,
        "temperature_C": 25.0,
        "step_s": 1.0,
        "capacity_Ah": 2.0,
    }
    with pytest.raises(BatteryError, match=said):
        age(BOTH, **(given | changed))


@pytest.mark.parametrize("parts", [(-0.1, 0.0, 0.0), (0.6, 0.5, 0.0), (0.0, np.nan, 0.0), (0.0, 0.0, np.inf)])
def test_impossible_wear_is_refused(parts):
    with pytest.raises(BatteryError, match=r"must not be negative|leaves no capacity"):
        Wear(*parts)


# The map


def map_of_laws(laws, wear=None):
    return DegradationMap.from_laws(
        laws,
        current_A=np.linspace(0.0, 8.0, 9),
        soc=np.linspace(0.2, 0.8, 4),
        temperature_C=[25.0, 35.0, 45.0],
        capacity_Ah=2.0,
        wear=wear or Wear(0.05, 0.03),
    )


def random_map(rng, shape, signed=False):
    current = np.sort(rng.uniform(-9.0 if signed else 0.0, 9.0, shape[0]))
    if signed:
        current[0] = -9.0
    axes = (current, np.sort(rng.uniform(0.0, 1.0, shape[1])), np.sort(rng.uniform(-20.0, 60.0, shape[2])))
    return DegradationMap(*axes, rng.uniform(0.0, 1e-7, shape), rng.uniform(0.0, 1e-7, shape))


def test_the_map_of_a_trilinear_function_is_that_function():
    current, soc, heat = [0.0, 1.0, 5.0], [0.0, 0.3, 1.0], [0.0, 40.0]
    i, s, t = np.meshgrid(current, soc, heat, indexing="ij")
    known = DegradationMap(current, soc, heat, 1e-9 * (1.0 + i) * (2.0 - s) * (1.0 + t), 1e-9 * i * s * t)
    rng = np.random.default_rng(1)
    i, s, t = rng.uniform(-5.0, 5.0, 50), rng.uniform(0.0, 1.0, 50), rng.uniform(0.0, 40.0, 50)
    fade, growth = known.rates_per_s(i, s, t)
    np.testing.assert_allclose(fade, 1e-9 * (1.0 + abs(i)) * (2.0 - s) * (1.0 + t), rtol=1e-12)
    np.testing.assert_allclose(growth, 1e-9 * abs(i) * s * t, rtol=1e-12, atol=1e-22)


@pytest.mark.parametrize("signed", [False, True])
def test_the_map_and_its_kernel_against_scipy(signed):
    """Points beyond the grid are clamped to it, with a warning."""
    rng = np.random.default_rng(2)
    known = random_map(rng, (6, 5, 4), signed)
    i, s, t = rng.uniform(-10.0, 10.0, 500), rng.uniform(0.0, 1.0, 500), rng.uniform(-30.0, 70.0, 500)
    axes = (known.current_A, known.soc, known.temperature_C)
    inside = [
        np.clip(v, axis[0], axis[-1]) for v, axis in zip((i if signed else abs(i), s, t), axes, strict=True)
    ]
    points = np.stack(inside, axis=-1)
    with pytest.warns(BatteryWarning, match="outside the .* of the degradation map; its end is taken"):
        fade, growth = known.rates_per_s(i, s, t)
    with pytest.warns(BatteryWarning, match="of the degradation map, whose ends it takes"):
        history = age(known, i, s, t, 2.0, every=7, acceleration=3.0)
    for rates, table in ((fade, known.capacity_fade_per_s), (growth, known.resistance_growth_per_s)):
        np.testing.assert_allclose(rates, RegularGridInterpolator(axes, table)(points), rtol=1e-12)
    ends = np.append(np.arange(7, 500, 7), 500)
    np.testing.assert_allclose(history.cycle_fade[1:], 6.0 * np.cumsum(fade)[ends - 1], rtol=1e-12)
    np.testing.assert_allclose(
        history.resistance_factor[1:], 1.0 + 6.0 * np.cumsum(growth)[ends - 1], rtol=1e-14
    )
    assert len(history.remarks) == 3


def test_a_map_takes_scalars_and_single_nodes():
    known = DegradationMap([0.0, 4.0], [0.5], [25.0], [[[0.0]], [[4e-9]]], np.zeros((2, 1, 1)))
    fade, _ = known.rates_per_s(-1.0, 0.5, 25.0)
    assert fade == pytest.approx(1e-9, rel=1e-12)
    done = age(known, np.full(100, -1.0), 0.5, 25.0, 10.0)
    assert done.final.cycle == pytest.approx(1e-6, rel=1e-12)
    assert done.remarks == ()


def test_a_map_of_laws_is_their_slope_at_that_wear():
    """Against a central difference of the law's closed form."""
    wear = Wear(0.05, 0.03)
    fade, growth = map_of_laws(FULL, wear).rates_per_s(2.0, 0.4, 25.0)
    throughput = CycleFade().throughput_Ah(0.05, 1.0, 25.0)
    months = (0.03 / (0.01 * CalendarFade().coefficient(0.4, 25.0))) ** 1.25
    hour = 0.5 * np.array([-1.0, 1.0])
    by_cycle = np.diff(CycleFade().fade(throughput + 1.1 * hour, 1.0, 25.0))[0] / 3600.0
    by_time = np.diff(CalendarFade().fade(months + hour / 730.5, 0.4, 25.0))[0] / 3600.0
    assert fade == pytest.approx(by_cycle + by_time, rel=1e-6)
    assert growth == pytest.approx(1.5 * fade + ResistanceGrowth().growth_per_s(0.4, 25.0), rel=1e-12)


def test_ageing_by_a_map_is_ageing_by_its_laws_as_long_as_the_wear_hardly_moves():
    """On nodes of the map, so that what differs is the linearisation alone."""
    rng = np.random.default_rng(3)
    profile = (rng.integers(-8, 9, 500).astype(float), 0.4, 35.0, 1.0)
    wear = Wear(0.05, 0.03)
    by_laws = age(FULL, *profile, capacity_Ah=2.0, wear=wear)
    by_map = age(map_of_laws(FULL, wear), *profile, wear=wear)
    lost = 1.0 - by_laws.capacity_factor / by_laws.capacity_factor[0]
    assert 1e-5 < lost[-1] < 1e-3
    np.testing.assert_allclose(
        by_map.capacity_factor - wear.capacity_factor,
        by_laws.capacity_factor - wear.capacity_factor,
        rtol=3e-3,
        atol=1e-12,
    )


def test_a_new_cell_has_no_finite_rate():
    with pytest.raises(BatteryError, match=r"such as Wear\(cycle=0\.02\)"):
        map_of_laws(BOTH, Wear(0.0, 0.01))
    with pytest.raises(BatteryError, match=r"Wear\(calendar=0\.02\)"):
        map_of_laws(BOTH, Wear(0.01, 0.0))
    assert map_of_laws(CALENDAR_ONLY, Wear(0.0, 0.01)).capacity_fade_per_s.min() > 0.0


def test_a_map_comes_back_from_its_csv_to_the_bit(tmp_path):
    rng = np.random.default_rng(4)
    known = random_map(rng, (4, 3, 2), signed=True)
    known.to_csv(tmp_path / "map.csv")
    read = load_degradation_map(tmp_path / "map.csv")
    for name in ("current_A", "soc", "temperature_C", "capacity_fade_per_s", "resistance_growth_per_s"):
        np.testing.assert_array_equal(getattr(read, name), getattr(known, name))
    lines = (tmp_path / "map.csv").read_text().splitlines()
    (tmp_path / "shuffled.csv").write_text("\n".join([lines[0], *rng.permutation(lines[1:])]))
    shuffled = load_degradation_map(tmp_path / "shuffled.csv")
    np.testing.assert_array_equal(shuffled.capacity_fade_per_s, known.capacity_fade_per_s)


HEADER = "current_A,soc,temperature_C,capacity_fade_per_s\n"
GRID = "0,0,25,1e-9\n0,1,25,1e-9\n5,0,25,2e-9\n5,1,25,4e-9\n"


def test_resistance_growth_may_be_left_out(tmp_path):
    (tmp_path / "map.csv").write_text("# measured\n" + HEADER + GRID)
    known = load_degradation_map(tmp_path / "map.csv")
    assert known.shape == (2, 2, 1)
    assert known.source == "map.csv"
    assert np.all(known.resistance_growth_per_s == 0.0)
    assert known.rates_per_s(2.5, 0.5, 25.0)[0] == pytest.approx(2e-9, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("soc,temperature_C,capacity_fade_per_s\n0,25,1\n", "required: current_A, soc, temperature_C"),
        (HEADER.replace("current_A", "C_rate") + GRID, "its columns are C_rate"),
        (HEADER + GRID.replace("5,1,25,4e-9\n", ""), "no row for current_A = 5, soc = 1, temperature_C = 25"),
        (HEADER + GRID + "5,1,25,4e-9\n", r"2 rows for current_A = 5, soc = 1, .* \(2 x 2 x 1\)"),
        (HEADER + GRID.replace("4e-9", "-4e-9"), "is -4e-09 at current_A = 5, soc = 1, temperature_C = 25"),
        (HEADER + GRID.replace("4e-9", "fast"), "line 5: capacity_fade_per_s is 'fast', not a number"),
        (HEADER + GRID.replace("4e-9", "inf"), "NaN or inf"),
        (HEADER + GRID.replace("5,1,", "nan,1,"), "must be finite numbers in every row"),
        (HEADER + GRID.replace(",1,25", ",100,25"), "fractions between 0 and 1, not per cent"),
        (HEADER + "".join(f"{k},{k / 2e3},{k},1\n" for k in range(1500)), r"\(1500 x 1500 x 1500\)"),
    ],
)
def test_bad_maps_are_refused(tmp_path, text, said):
    """The last one is scattered points: refused before a grid of 3e9 nodes is laid out."""
    (tmp_path / "map.csv").write_text(text)
    with pytest.raises(BatteryError, match=said) as caught:
        load_degradation_map(tmp_path / "map.csv")
    assert "map.csv" in str(caught.value)


def test_a_missing_map_is_refused(tmp_path):
    with pytest.raises(BatteryError, match="cannot read the table"):
        load_degradation_map(tmp_path / "none.csv")


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"current_A": [1.0, 0.0]}, "current_A of a degradation map must increase strictly"),
        ({"soc": []}, "soc of a degradation map must increase"),
        ({"capacity_fade_per_s": np.zeros((2, 2))}, r"has the shape \(2, 2\), its axes ask for \(2, 1, 1\)"),
    ],
)
def test_bad_grids_are_refused(changed, said):
    given = {
        "current_A": [0.0, 1.0],
        "soc": [0.5],
        "temperature_C": [25.0],
        "capacity_fade_per_s": np.zeros((2, 1, 1)),
        "resistance_growth_per_s": np.zeros((2, 1, 1)),
    }
    with pytest.raises(BatteryError, match=said):
        DegradationMap(**(given | changed))


# The pictures


def test_the_map_is_drawn_as_a_surface(tmp_path):
    known = map_of_laws(FULL)
    ax = plot_degradation_map(known)
    assert ax.name == "3d"
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("current [A]", "SOC [%]")
    assert ax.get_zlabel() == "capacity fade [%/day]"
    assert "35 °C" in ax.get_title()
    top = 100.0 * 86400.0 * known.capacity_fade_per_s[:, :, 1].max()
    assert ax.zz_dataLim.intervalx[1] == pytest.approx(top, rel=1e-12)
    picture = tmp_path / "map.png"
    ax.figure.savefig(picture)
    assert picture.stat().st_size > 5000


def test_the_map_is_drawn_as_contours_on_given_axes():
    given = Figure().subplots()
    known = map_of_laws(FULL)
    ax = plot_degradation_map(known, given, temperature_C=25.0, quantity="resistance", capacity_Ah=2.0)
    assert ax is given
    assert ax.get_xlabel() == "C-rate [1/h]"
    assert ax.get_xlim() == (0.0, 4.0)
    assert ax.get_ylim() == pytest.approx((20.0, 80.0))
    assert ax.figure.axes[1].get_ylabel() == "resistance growth [%/day]"


def test_a_map_without_extent_or_quantity_is_not_drawn():
    flat = DegradationMap([1.0], [0.5], [25.0], [[[0.0]]], [[[0.0]]])
    with pytest.raises(BatteryError, match="two currents and two SOCs"):
        plot_degradation_map(flat)
    with pytest.raises(BatteryError, match="no 'voltage'; known are capacity, resistance"):
        plot_degradation_map(map_of_laws(BOTH), quantity="voltage")


def test_the_picture_of_a_fade_declares_its_acceleration():
    day = driven(1440)
    ax = plot_ageing(age(FULL, *day, 60.0, capacity_Ah=2.0, acceleration=20.0))
    assert ax.get_title() == "ageing accelerated 20 times"
    assert ax.get_xlabel() == "time [days]"
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["capacity", "resistance"]
    real = age(BOTH, *day, 60.0, capacity_Ah=2.0)
    ax = plot_ageing(real, Figure().subplots())
    assert ax.get_title() == ""
    days, percent = (np.asarray(values) for values in ax.lines[0].get_data())
    assert days[-1] == 1.0
    assert percent[-1] == pytest.approx(100.0 * real.capacity_factor[-1])


def test_ageing_is_imported_without_numba_and_matplotlib():
    code = "import sys, bms.ageing, bms.plot_degradation; print({'numba', 'matplotlib'} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"

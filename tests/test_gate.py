"""The gate before every estimator: each flag's condition, what stands in for a reading, rest, full charge."""

import math

import numpy as np
import pytest
from battery_cases import drive_current_A, linear_cell

from bms.cells import load_cell
from bms.estimators import _gate
from bms.estimators.catalogue import make_estimator
from bms.estimators.gate import Sensors, gate_for
from bms.faults import Dropout, Gap, NotANumber, Spikes, Stuck, inject
from bms.flags import MEANINGS, Flag

CELL = linear_cell(full_charge_voltage_V=3.55, full_charge_current_A=0.1)
GATE = gate_for(CELL, Sensors())
NAN, INF = math.nan, math.inf


class Screen:
    """The gate with its memory: one sample in, what it makes of it out."""

    def __init__(self, gate=GATE):
        self.gate, self.memory = gate, np.zeros(_gate.SIZE)
        self.memory[_gate.TEMPERATURE_C] = 25.0
        self.count = 0

    def __call__(self, current, voltage, step=1.0, temperature=NAN):
        self.count += 1
        return _gate.screen(self.gate, self.memory, current, voltage, step, temperature)

    def fresh(self):
        """A voltage of some 3.3 V that was not there before."""
        return 3.3 + 1e-7 * self.count

    def settle(self, current=-2.0, swing=0.0, samples=9000):
        """Feed ordinary samples until the start is forgotten; no reading comes twice."""
        for k in range(samples):
            seen = self(current + swing * (-1.0) ** k + 1e-9 * k, self.fresh())
            assert seen.flags == 0
        return self


def test_every_flag_has_a_meaning_and_only_rest_and_full_are_trusted():
    assert set(MEANINGS) == set(Flag)
    assert [flag for flag in Flag if flag.trusted] == [Flag.REST, Flag.FULL]
    assert Flag(0).trusted
    assert (Flag.REST | Flag.FULL).trusted
    assert not (Flag.REST | Flag.GAP).trusted


@pytest.mark.parametrize(
    ("current", "voltage", "flag"),
    [
        (NAN, 3.3, Flag.CURRENT_MISSING),
        (INF, 3.3, Flag.CURRENT_MISSING),
        (-INF, 3.3, Flag.CURRENT_MISSING),
        (90.0, 3.3, Flag(0)),  # 1.5 times the larger limit of 60 A
        (-90.0, 3.3, Flag(0)),
        (math.nextafter(90.0, INF), 3.3, Flag.CURRENT_RANGE),
        (-1e300, 3.3, Flag.CURRENT_RANGE),
        (5e-324, 3.3, Flag(0)),
        (-2.0, NAN, Flag.VOLTAGE_MISSING),
        (-2.0, -INF, Flag.VOLTAGE_MISSING),
        (-2.0, 1.7, Flag(0)),  # the window 2 to 4 V and 15 % of it on either side
        (-2.0, math.nextafter(1.7, 0.0), Flag.VOLTAGE_RANGE),
        (-2.0, math.nextafter(4.3, 5.0), Flag.VOLTAGE_RANGE),
        (-2.0, 1e300, Flag.VOLTAGE_RANGE),
        (NAN, INF, Flag.CURRENT_MISSING | Flag.VOLTAGE_MISSING),
        (1e9, 0.0, Flag.CURRENT_RANGE | Flag.VOLTAGE_RANGE),
    ],
)
@pytest.mark.parametrize("settled", [False, True])
def test_missing_readings_and_ranges(current, voltage, flag, settled):
    screen = Screen()
    if settled:
        screen.settle(samples=3)
    seen = screen(current, voltage)
    assert Flag(seen.flags) == flag
    assert seen.usable == (not flag & (Flag.VOLTAGE_MISSING | Flag.VOLTAGE_RANGE))
    bad = bool(flag & (Flag.CURRENT_MISSING | Flag.CURRENT_RANGE))
    assert (seen.doubt_A > 0.0) == bad
    assert math.isfinite(seen.now_A)
    if not bad:
        assert seen.now_A == current


def test_ranges_can_be_set():
    gate = gate_for(CELL, Sensors(current_limit_A=10.0, voltage_margin_V=0.05))
    assert (gate.current_limit_A, gate.voltage_low_V, gate.voltage_high_V) == (10.0, 1.95, 4.05)


def test_a_current_is_held_until_the_next_sample_or_since_the_last():
    from_here, until_here = Screen(), Screen(gate_for(CELL, Sensors(holds="until")))
    for screen in (from_here, until_here):
        screen(-1.0, 3.3)
    first, second = from_here(-3.0, 3.31), until_here(-3.0, 3.31)
    assert (first.drive_A, first.now_A) == (-1.0, -3.0)
    assert (second.drive_A, second.now_A) == (-3.0, -3.0)


def test_the_step_to_the_first_sample_means_nothing():
    seen = Screen()(-1.0, 3.3, step=1e9)
    assert (seen.step_s, seen.charge_variance_C2, seen.flags) == (0.0, 0.0, 0)


@pytest.mark.parametrize(
    ("step", "taken"), [(5e-324, 0.0), (0.99e-6, 0.0), (1e-6, 1e-6), (1e9, 1e9), (1e300, 1e9)]
)
def test_a_step_is_nothing_or_one_that_can_be_reckoned_with(step, taken):
    screen = Screen().settle(samples=20)
    seen = screen(-2.0, screen.fresh(), step)
    assert seen.step_s == taken
    assert math.isfinite(seen.charge_variance_C2)


def test_the_last_current_then_the_mean_stand_in_for_a_missing_one():
    screen = Screen().settle(-2.0, swing=1.5)
    last = screen(-4.0, screen.fresh())
    for bad in (NAN, 1e300, -INF, NAN, INF):
        seen = screen(bad, screen.fresh(), step=2.0)
        assert (seen.drive_A, seen.now_A) == (last.now_A, last.now_A)
        assert seen.doubt_A == pytest.approx(1.5 + 0.2 * CELL.capacity_Ah, abs=0.01)
    seen = screen(NAN, screen.fresh())
    assert seen.now_A == pytest.approx(-2.0, abs=0.01)
    assert seen.doubt_A == pytest.approx(1.5 + 0.2 * CELL.capacity_Ah, abs=0.01)
    # Readings that are not believed leave no trace in them.
    for bad in (1e300, -1e300, INF, NAN):
        again = screen(bad, screen.fresh())
    assert (again.now_A, again.doubt_A) == (seen.now_A, seen.doubt_A)


def test_a_load_that_changes_while_most_readings_are_missing_is_followed():
    # With nine of ten readings gone, the mean over ten minutes of readings takes hours to come after.
    screen = Screen().settle(-2.0)
    charge_C = 0.0
    for k in range(600):
        current = 1.0 + 1e-9 * k if k % 10 == 0 else NAN
        charge_C += screen(current, screen.fresh()).drive_A
    assert charge_C == pytest.approx(600.0, abs=5.0)


@pytest.mark.parametrize("holds", ["from", "until"])
@pytest.mark.parametrize("every", [11, 20, 60])
def test_sparse_readings_of_a_constant_current_count_it_right_from_the_first(every, holds):
    screen = Screen(gate_for(CELL, Sensors(holds=holds)))
    charge_C = sum(
        screen(-2.0 if k % every == 0 else NAN, screen.fresh()).drive_A for k in range(3601)
    )  # of the first step none is known
    assert charge_C == pytest.approx(-2.0 * 3600.0, abs=2.0 * 1.001)


@pytest.mark.parametrize("every", [1, 10, 20, 60])
def test_the_mean_forgets_by_time_however_few_the_readings(every):
    screen = Screen().settle(-2.0)
    for k in range(1, 1201):
        screen(1.0 + 1e-9 * k if k % every == 0 else NAN, screen.fresh())
    mean_A = 1.0 - 3.0 * (1.0 - every / 600.0) ** (1200 // every)
    for _ in range(12):
        seen = screen(NAN, screen.fresh())
    assert seen.now_A == pytest.approx(mean_A, abs=1e-5)


def test_the_first_reading_is_the_mean_and_may_be_anything_usual():
    screen = Screen()
    screen(NAN, 3.3)
    screen(-3.0, 3.31)
    for _ in range(12):
        seen = screen(NAN, screen.fresh())
    assert seen.now_A == pytest.approx(-3.0)
    assert seen.doubt_A == pytest.approx((0.5 + 0.2) * CELL.capacity_Ah, rel=0.01)


def test_a_stuck_current_is_not_held():
    screen = Screen().settle(-2.0, swing=1.0, samples=9001)
    for k in range(20):
        seen = screen(-3.5, 3.0 + 0.1 * (k // 4) + 1e-7 * k)
    assert Flag(seen.flags) == Flag.STUCK
    assert seen.now_A == pytest.approx(-2.0, abs=0.05)


def test_before_any_current_was_seen_it_may_be_anything_usual():
    seen = Screen()(NAN, 3.3)
    assert (seen.now_A, seen.doubt_A) == (0.0, (0.5 + 0.2) * CELL.capacity_Ah)


def test_doubt_about_a_replaced_current_persists_so_its_variance_grows_with_the_square():
    screen = Screen().settle()
    first = screen(NAN, screen.fresh())
    assert first.charge_variance_C2 == 0.0  # what flowed up to here was measured
    total = 0.0
    for k in range(1, 400):
        seen = screen(NAN, screen.fresh(), step=2.0)
        total += seen.charge_variance_C2
        assert total == pytest.approx((seen.doubt_A * 2.0 * k) ** 2, rel=1e-9)
    # The current of the last bad sample flowed until the first good one; then the doubt begins anew.
    back = screen(-2.0, screen.fresh(), step=2.0)
    assert total + back.charge_variance_C2 == pytest.approx((seen.doubt_A * 2.0 * 400) ** 2, rel=1e-9)
    assert screen(-2.001, screen.fresh(), step=2.0).charge_variance_C2 == 0.0
    assert screen(NAN, screen.fresh(), step=2.0).charge_variance_C2 == 0.0
    assert screen(NAN, screen.fresh(), step=2.0).charge_variance_C2 == pytest.approx(
        (seen.doubt_A * 2.0) ** 2, rel=0.01
    )


@pytest.mark.parametrize(
    ("step", "flag"), [(60.0, Flag(0)), (60.001, Flag.GAP), (1800.0, Flag.GAP), (1e7, Flag.GAP)]
)
@pytest.mark.parametrize("temperature", [NAN, 25.0])
def test_a_gap_is_bridged_by_the_recent_mean_and_a_long_one_by_rest(step, flag, temperature):
    screen = Screen().settle(-2.0, swing=1.0)
    doubt = 1.0 + 0.2 * CELL.capacity_Ah
    last = screen(-2.75, screen.fresh())
    seen = screen(30.0, screen.fresh(), step, temperature)
    assert Flag(seen.flags) == flag
    assert seen.step_s == step
    if not flag:
        assert (seen.drive_A, seen.charge_variance_C2) == (last.now_A, 0.0)
    elif step <= 1800.0:
        # The one sample beyond the gap says nothing of what flowed in it.
        assert seen.drive_A == pytest.approx(-2.0, abs=0.01)
        assert math.sqrt(seen.charge_variance_C2) == pytest.approx(doubt * step, rel=0.01)
    else:
        assert seen.drive_A == 0.0
        assert math.sqrt(seen.charge_variance_C2) == pytest.approx(doubt * 1800.0, rel=0.01)
    after = screen(NAN, screen.fresh(), step=11.0)
    # Nor does it make up the mean: it counts as 60 s of 600.
    assert after.now_A == pytest.approx(-2.0 + 0.1 * 32.0, abs=0.02)


def test_a_voltage_that_repeats_itself_is_stuck_when_the_current_moved():
    screen = Screen().settle(samples=20)
    least = GATE.stuck_A  # 16 mV over 8 mohm
    assert least == pytest.approx(2.0)
    held = screen.fresh()
    screen(-1.0, held)
    for k in range(9):
        assert screen(-1.0 + least + 0.01 + 1e-6 * k, held).flags == 0
    seen = screen(-1.0, held)
    assert (Flag(seen.flags), seen.usable, seen.doubt_A) == (Flag.STUCK, False, 0.0)
    assert Flag(screen(-1.5, held).flags) == Flag.STUCK
    seen = screen(-1.5, screen.fresh())
    assert (seen.flags, seen.usable) == (0, True)


def test_a_voltage_may_repeat_itself_while_the_current_moves_little():
    screen = Screen().settle(samples=20)
    held = screen.fresh()
    for k in range(500):
        assert screen(-1.0 + 0.99 * GATE.stuck_A * (k % 2), held, 0.1).flags == 0


def test_a_current_that_repeats_itself_is_stuck_when_the_voltage_jumps():
    screen = Screen().settle(-2.0, samples=9000)
    assert GATE.jump_V == pytest.approx(0.018)
    flags = [screen(-5.0, 3.3 + 0.04 * (k // 4 % 2) + 1e-6 * k) for k in range(24)]
    # 10 repetitions and 3 jumps, at samples 4, 8 and 12
    assert [Flag(seen.flags) for seen in flags] == [Flag(0)] * 12 + [Flag.STUCK] * 12
    assert flags[11].now_A == -5.0
    assert flags[12].now_A == pytest.approx(-2.05, abs=0.02)
    assert flags[12].doubt_A > 0.2 * CELL.capacity_Ah
    assert all(seen.usable for seen in flags)
    assert screen(-5.1, 3.3).flags == 0


def test_a_constant_current_is_not_stuck_while_the_voltage_creeps_or_spikes():
    screen = Screen().settle(samples=20)
    for k in range(2000):
        spike = 0.3 if k % 100 == 50 else 0.0
        assert screen(-2.0, 3.4 - 1e-4 * k + spike).flags == 0
        if k == 1000:  # out of range, that is no jump either
            assert Flag(screen(-2.0, 9.0).flags) == Flag.VOLTAGE_RANGE


def test_a_voltage_out_of_range_is_no_jump():
    screen = Screen().settle(samples=20)
    for k in range(60):
        # Off for two samples at a time, so that no spike of one sample comes back.
        beyond = k % 10 in (3, 4)
        seen = screen(-2.0, 9.0 + 0.1 * (k % 10) if beyond else screen.fresh())
        assert Flag(seen.flags) == (Flag.VOLTAGE_RANGE if beyond else Flag(0))


def test_both_are_stuck_when_charge_passes_and_nothing_moves():
    screen = Screen().settle(-2.0, samples=20)
    held = screen.fresh()
    flags = [Flag(screen(-2.5, held).flags) for _ in range(200)]
    # 3 % of 7200 C at 2.5 A
    first = 1 + math.floor(0.03 * 7200.0 / 2.5) + 1
    assert flags.index(Flag.STUCK) in (first - 1, first)
    assert set(flags[first:]) == {Flag.STUCK}


def test_at_rest_both_may_stay_as_they_are():
    screen = Screen(gate_for(CELL, Sensors(rest_after_s=1e9)))
    assert {screen(0.0, 3.3).flags for _ in range(5000)} == {0}


def test_a_current_spike_out_of_range_does_not_make_the_voltage_stuck():
    screen = Screen()
    for _ in range(20):
        screen(0.0, 3.3)
    assert Flag(screen(1e300, 3.3).flags) == Flag.CURRENT_RANGE
    assert screen(0.0, 3.3).flags == 0


def test_rest_counts_after_it_has_lasted():
    screen = Screen().settle(samples=20)
    assert GATE.rest_A == pytest.approx(0.005 * 2.0 + 0.03)
    flags = [Flag(screen(0.04 - 1e-6 * (k % 7), screen.fresh(), 10.0).flags) for k in range(371)]
    assert flags == [Flag(0)] * 360 + [Flag.REST] * 11
    assert screen(0.041, screen.fresh()).flags == 0
    assert screen(0.0, screen.fresh()).flags == 0
    # A missing current is no rest, whatever stands in for it.
    resting = Screen()
    for _ in range(400):
        resting(0.0, resting.fresh(), 10.0)
    assert Flag(resting(NAN, resting.fresh(), 10.0).flags) == Flag.CURRENT_MISSING
    assert resting(0.0, resting.fresh(), 10.0).flags == 0


@pytest.mark.parametrize("holds", ["from", "until"])
@pytest.mark.parametrize("step", [1.0, 60.0, 600.0, 1800.0, 3600.0])
def test_an_hour_of_rest_is_no_shorter_where_steps_are_long(step, holds):
    screen = Screen(gate_for(CELL, Sensors(holds=holds, gap_s=5.0 * step)))
    for _ in range(5):
        assert screen(-0.4, screen.fresh(), step).flags == 0
    # A current that is the mean since the last sample tells of the step before it.
    rested_s = 0.0 if holds == "from" else step
    while not screen(0.0, screen.fresh(), step).flags & Flag.REST:
        rested_s += step
    assert rested_s == 3600.0


@pytest.mark.parametrize("holds", ["from", "until"])
def test_a_gap_over_which_the_battery_rested_is_rest(holds):
    screen = Screen(gate_for(CELL, Sensors(holds=holds))).settle(samples=20)
    assert Flag(screen(0.0, screen.fresh(), 3599.0).flags) == Flag.GAP
    assert Flag(screen(0.0, screen.fresh(), 1.0).flags) == Flag.REST
    # A short one is none: what flowed in it is unknown.
    screen = Screen(gate_for(CELL, Sensors(rest_after_s=600.0))).settle(samples=20)
    assert Flag(screen(0.0, screen.fresh(), 1800.0).flags) == Flag.GAP


def test_the_load_of_a_small_cell_is_no_rest():
    coin = linear_cell(capacity_Ah=0.04, full_charge_voltage_V=3.55, full_charge_current_A=0.002)
    gate = gate_for(coin, Sensors())
    assert gate.rest_A == pytest.approx(0.04 * (0.005 + 3 * 0.01))
    assert gate.full_A == pytest.approx(0.002 + 2 * 0.01 * 0.04)
    # A noise that is given is taken at its word, and above 1 Ah the default.
    assert gate_for(coin, Sensors(current_sd_A=0.01)).rest_A == pytest.approx(0.04 * 0.005 + 0.03)
    assert gate_for(linear_cell(capacity_Ah=1.0), Sensors()).rest_A == pytest.approx(0.005 + 0.03)
    screen = Screen(gate)
    assert not any(screen(-0.012, screen.fresh(), 60.0).flags for _ in range(120))


def test_full_counts_after_voltage_and_current_have_lasted():
    full_V, full_A = GATE.full_V, GATE.full_A
    assert (full_V, full_A) == (pytest.approx(3.55 - 0.004), pytest.approx(0.1 + 0.02))
    wiggle = iter(np.arange(1000) * 1e-9)
    screen = Screen().settle(1.0, samples=20)
    flags = [Flag(screen(full_A - next(wiggle), full_V + next(wiggle)).flags) for _ in range(40)]
    assert flags == [Flag(0)] * 30 + [Flag.FULL] * 10
    for current, voltage in (
        (full_A + 0.001, full_V),
        (full_A, full_V - 0.001),
        (-0.05, full_V),
        (NAN, full_V),
        (0.1, NAN),
    ):
        again = [Flag(screen(full_A - next(wiggle), full_V + next(wiggle)).flags) for _ in range(31)]
        assert again[-1] == Flag.FULL
        assert not Flag(screen(current, voltage).flags) & Flag.FULL
        assert screen(full_A, full_V).flags == 0


def test_a_cell_without_full_charge_is_never_full():
    screen = Screen(gate_for(linear_cell(), Sensors()))
    assert not any(screen(0.05, 3.99 + 1e-6 * k).flags & Flag.FULL for k in range(100))


@pytest.mark.parametrize("absurd", [NAN, INF, -INF, -300.0, -273.15, 1e6, 1e300])
def test_an_absurd_temperature_is_passed_over(absurd):
    screen = Screen()
    assert screen(-1.0, 3.3, 1.0, absurd).temperature_C == 25.0
    assert screen(-1.1, 3.31, 1.0, -20.0).temperature_C == -20.0
    assert screen(-1.2, 3.32, 1.0, absurd).temperature_C == -20.0


def spoilt_log(seed):
    """A drive with rest and a full charge in it, readings rounded as by a sensor, and every kind of fault."""
    rng = np.random.default_rng(seed)
    n = 6000
    current = drive_current_A(n, seed, noise_A=0.1)
    current[1000:1400] = 0.0
    current[3000:3200] = 0.05
    voltage = 3.3 + 0.02 * current + 0.002 * rng.normal(size=n)
    voltage[3000:3200] = 3.56
    current, voltage = np.round(current, 2), np.round(voltage, 3)
    faults = [
        Dropout(start_s=500.0, duration_s=60.0, channel="current"),
        NotANumber(start_s=600.0, duration_s=200.0, channel="both"),
        Stuck(start_s=1500.0, duration_s=100.0, channel="voltage"),
        Stuck(start_s=1700.0, duration_s=100.0, channel="current"),
        Stuck(start_s=1900.0, duration_s=400.0, channel="both"),
        Gap(start_s=2500.0, duration_s=200.0),
        Spikes(start_s=3500.0, duration_s=300.0, channel="voltage", size=5.0),
        Spikes(start_s=3900.0, duration_s=300.0, channel="current", size=500.0),
    ]
    log = inject(np.arange(n, dtype=float), current, voltage, faults, seed)
    return log.current_A, log.voltage_V, np.diff(log.time_s, prepend=log.time_s[0])


@pytest.mark.parametrize("holds", ["from", "until"])
@pytest.mark.parametrize("seed", range(3))
def test_the_short_way_through_the_gate_is_the_long_one(seed, holds):
    gate = gate_for(CELL, Sensors(holds=holds, rest_after_s=300.0))
    short, long = Screen(gate), Screen(gate)
    flags, calm = 0, 0
    for current, voltage, step in zip(*spoilt_log(seed), strict=True):
        # A temperature that is given bars the short way.
        one, two = short(current, voltage, step, NAN), long(current, voltage, step, 25.0)
        assert one == two
        flags |= one.flags
        calm += short.memory[_gate.CALM] == 1.0
    assert calm > 1000
    expected = Flag(flags)
    for flag in (Flag.CURRENT_MISSING, Flag.CURRENT_RANGE, Flag.VOLTAGE_MISSING, Flag.VOLTAGE_RANGE):
        assert flag in expected
    assert Flag.STUCK | Flag.GAP | Flag.REST | Flag.FULL in expected


def test_the_limits_of_the_presets_let_their_own_window_pass():
    for name in ("lfp-2ah", "a123-26650", "nmc-lgm50"):
        cell = load_cell(name)
        gate = gate_for(cell, Sensors())
        assert gate.voltage_low_V < cell.voltage_min_V < cell.voltage_max_V < gate.voltage_high_V
        assert gate.current_limit_A >= 1.5 * cell.charge_limit_A
        assert make_estimator("coulomb", cell).update(cell.charge_limit_A, cell.voltage_max_V, 1.0)

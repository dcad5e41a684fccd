"""`bms.faults`: what each fault does to a log, and where."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from bms.errors import BatteryError
from bms.faults import (
    Dropout,
    Fault,
    Gap,
    Infinite,
    NotANumber,
    SensorGain,
    SensorOffset,
    Spikes,
    Stuck,
    inject,
)

TIME = np.arange(100.0)
CURRENT = np.linspace(-3.0, 4.0, 100)
VOLTAGE = np.linspace(3.2, 3.7, 100)
WINDOW = {"start_s": 20.0, "duration_s": 30.0}
INSIDE = (TIME >= 20.0) & (TIME < 50.0)


def spoil(*faults, seed=0):
    return inject(TIME, CURRENT, VOLTAGE, faults, seed)


def test_without_faults_a_log_is_copied():
    log = spoil()
    assert np.array_equal(log.current_A, CURRENT)
    assert np.array_equal(log.voltage_V, VOLTAGE)
    assert np.array_equal(log.kept, np.arange(100))
    assert log.bad == {}
    assert not log.any_bad.any()
    log.current_A[0] = 99.0
    assert CURRENT[0] == -3.0


def test_offset_and_gain():
    log = spoil(
        SensorOffset(channel="current", size=0.5, **WINDOW), SensorGain(channel="both", size=1.1, **WINDOW)
    )
    assert np.array_equal(log.current_A, np.where(INSIDE, (CURRENT + 0.5) * 1.1, CURRENT))
    assert np.array_equal(log.voltage_V, np.where(INSIDE, VOLTAGE * 1.1, VOLTAGE))
    assert np.array_equal(log.bad["offset"], INSIDE)
    assert np.array_equal(log.bad["gain"], INSIDE)
    assert np.array_equal(log.any_bad, INSIDE)


def test_stuck_repeats_the_first_reading_or_a_number():
    log = spoil(Stuck(channel="both", **WINDOW))
    assert np.array_equal(log.current_A, np.where(INSIDE, CURRENT[20], CURRENT))
    assert np.array_equal(log.voltage_V, np.where(INSIDE, VOLTAGE[20], VOLTAGE))
    assert np.all(spoil(Stuck(channel="voltage", size=0.0, **WINDOW)).voltage_V[INSIDE] == 0.0)


def test_dropout_takes_every_reading_and_scattered_faults_some():
    log = spoil(Dropout(channel="current", **WINDOW))
    assert np.array_equal(np.isnan(log.current_A), INSIDE)
    assert np.array_equal(log.voltage_V, VOLTAGE)
    log = spoil(NotANumber(channel="both", share=0.2, **WINDOW))
    assert np.isnan(log.current_A).sum() == 6  # of 30
    assert np.array_equal(np.isnan(log.current_A), np.isnan(log.voltage_V))
    assert np.array_equal(np.isnan(log.voltage_V), log.bad["nan"])
    assert not (log.bad["nan"] & ~INSIDE).any()
    log = spoil(Infinite(channel="voltage", share=0.5, **WINDOW))
    assert set(log.voltage_V[log.bad["infinite"]]) == {-np.inf, np.inf}
    assert log.bad["infinite"].sum() == 15


def test_spikes_go_both_ways_by_their_size():
    log = spoil(Spikes(channel="voltage", size=0.25, share=1.0, **WINDOW))
    off = log.voltage_V - VOLTAGE
    assert np.allclose(np.abs(off), np.where(INSIDE, 0.25, 0.0))
    assert 0 < (off > 0.1).sum() < 30
    # At least one reading is hit, if there is one.
    assert spoil(Spikes(channel="voltage", size=1.0, share=1e-9, **WINDOW)).bad["spikes"].sum() == 1
    late = Spikes(channel="voltage", size=1.0, start_s=500.0, duration_s=1.0)
    assert not spoil(late).any_bad.any()


def test_a_gap_takes_rows_away_and_marks_the_row_after_it():
    log = spoil(
        Gap(start_s=10.0, duration_s=5.0),
        Gap(start_s=14.0, duration_s=6.0),
        SensorOffset(channel="current", size=1.0, **WINDOW),
    )
    assert np.array_equal(log.kept, np.r_[0:10, 20:100])
    assert np.array_equal(log.time_s, TIME[log.kept])
    assert np.array_equal(np.flatnonzero(log.bad["gap"]), [10])
    assert log.time_s[10] == 20.0
    assert np.array_equal(log.current_A, (CURRENT + INSIDE)[log.kept])
    # There is nothing before a gap at the start to tell it by.
    assert not spoil(Gap(start_s=0.0, duration_s=5.0)).bad["gap"].any()


def test_the_same_seed_draws_the_same_faults():
    fault = Spikes(channel="current", size=1.0, share=0.3, **WINDOW)
    one, two, other = spoil(fault, seed=1), spoil(fault, seed=1), spoil(fault, seed=2)
    assert np.array_equal(one.current_A, two.current_A)
    assert not np.array_equal(one.current_A, other.current_A)
    third = inject(TIME, CURRENT, VOLTAGE, [fault], np.random.default_rng(1))
    assert np.array_equal(one.current_A, third.current_A)


@given(
    start=st.floats(0.0, 120.0), duration=st.floats(1e-3, 200.0), share=st.floats(0.0, 1.0, exclude_min=True)
)
@settings(deadline=None, max_examples=60)
def test_nothing_outside_its_window_is_touched(start, duration, share):
    window = {"start_s": start, "duration_s": duration}
    fault = NotANumber(channel="both", share=share, **window)
    log = spoil(fault)
    outside = (start > TIME) | (fault.end_s <= TIME)
    assert np.array_equal(log.current_A[outside], CURRENT[outside])
    assert np.array_equal(np.isnan(log.voltage_V), log.any_bad)
    assert log.any_bad.any() == (~outside).any()


def test_a_fault_is_read_from_a_table_by_its_kind():
    fault = TypeAdapter(Fault).validate_python({"kind": "gap", "start_s": 3.0, "duration_s": 4.0})
    assert fault == Gap(start_s=3.0, duration_s=4.0)
    kinds = {kind.model_fields["kind"].default for kind in Fault.__origin__.__args__}
    assert kinds == {"offset", "gain", "stuck", "dropout", "nan", "infinite", "spikes", "gap"}


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        (SensorOffset, {"channel": "both", "size": 1.0}, "A or V belongs to one channel"),
        (Spikes, {"channel": "both", "size": 1.0}, "A or V belongs to one channel"),
        (Stuck, {"channel": "both", "size": 1.0}, "A or V belongs to one channel"),
        (Spikes, {"channel": "current", "size": 0.0}, "greater than 0"),
        (NotANumber, {"channel": "current", "share": 1.5}, "less than or equal to 1"),
        (SensorGain, {"channel": "current", "size": float("nan")}, "finite"),
        (Dropout, {"channel": "temperature"}, "'current', 'voltage' or 'both'"),
        (Dropout, {"channel": "current", "size": 1.0}, "Extra inputs"),
        (Gap, {"channel": "both"}, "Extra inputs"),
        (Dropout, {"channel": "both", "duration_s": 0.0}, "greater than 0"),
        (Dropout, {"channel": "both", "start_s": -1.0}, "greater than or equal to 0"),
    ],
)
def test_a_fault_out_of_range_is_refused(kind, values, message):
    with pytest.raises(ValidationError, match=message):
        kind(**(WINDOW | values))


def test_a_log_that_does_not_fit_is_refused():
    with pytest.raises(BatteryError, match=r"got the shapes \(100,\), \(99,\), \(100,\)"):
        inject(TIME, CURRENT[1:], VOLTAGE, [])
    with pytest.raises(BatteryError, match="leave no row"):
        spoil(Gap(start_s=0.0, duration_s=1e9))

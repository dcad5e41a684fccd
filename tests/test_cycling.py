"""The cycling profile of [M] Fig 28: drives down to a limit of the SOC, charges up to the other."""

import time

import numpy as np
import pytest

from bms.cycling import CyclingState, cycling_profile
from bms.errors import BatteryError

RNG = np.random.default_rng(28)
DRIVE = RNG.normal(-1.0, 2.0, 300)


def naive(capacity_Ah, drive, samples, low, high, charge, step_s, soc=0.7):
    """One sample after the other, in plain Python."""
    currents, socs, charging, at = [], [], False, 0
    for _ in range(samples):
        if charging and soc >= high:
            charging, at = False, 0
        elif not charging and soc <= low:
            charging = True
        currents.append(charge if charging else drive[at % len(drive)])
        at += not charging
        socs.append(soc)
        soc += step_s / (3600.0 * capacity_Ah) * currents[-1]
    return np.array(currents), np.array(socs)


def test_the_kernel_is_its_plain_twin():
    found = cycling_profile(
        0.5, DRIVE, 20_000, low=0.3, high=0.75, charge_current_A=1.3, step_s=2.0, state=CyclingState(0.6)
    )
    current, soc = naive(0.5, DRIVE, 10_000, 0.3, 0.75, 1.3, 2.0, soc=0.6)
    np.testing.assert_array_equal(found.current_A, current)
    np.testing.assert_array_equal(found.soc, soc)
    np.testing.assert_array_equal(found.time_s, 2.0 * np.arange(10_000))


def test_a_constant_drive_makes_a_saw_tooth():
    """4096 s of one ampere to fill it: half of it out at 1 A and in at 2 A, to the sample."""
    found = cycling_profile(4096.0 / 3600.0, [-1.0], 4 * 3072, low=0.25, high=0.75, state=CyclingState(0.75))
    np.testing.assert_array_equal(found.current_A, np.tile(np.repeat([-1.0, 2.0], [2048, 1024]), 4))
    tooth = np.concatenate((0.75 - np.arange(2048) / 4096, 0.25 + np.arange(1024) / 2048))
    np.testing.assert_array_equal(found.soc, np.tile(tooth, 4))
    assert found.final == CyclingState(0.75, True, 0)


def test_each_discharge_begins_the_drive_anew():
    found = cycling_profile(0.5, DRIVE, 50_000)
    starts = np.flatnonzero((found.current_A[:-1] == 2.0) & (found.current_A[1:] != 2.0)) + 1
    assert starts.size > 10
    for start in starts[:-1]:
        np.testing.assert_array_equal(found.current_A[start : start + 100], DRIVE[:100])


def test_parts_make_the_whole():
    whole = cycling_profile(0.5, DRIVE, 9_000.0)
    state, parts = None, []
    for length in (1.0, 2_999.0, 6_000.0):
        parts.append(cycling_profile(0.5, DRIVE, length, state=state))
        state = parts[-1].final
    assert state == whole.final
    for name in ("current_A", "soc"):
        np.testing.assert_array_equal(
            np.concatenate([getattr(part, name) for part in parts]), getattr(whole, name)
        )


def test_less_capacity_makes_shorter_cycles():
    def cycles(capacity_Ah):
        current = cycling_profile(capacity_Ah, DRIVE, 100_000.0).current_A
        return np.count_nonzero((current[1:] == 2.0) & (current[:-1] != 2.0))

    assert cycles(0.4) == pytest.approx(cycles(0.5) / 0.8, abs=1.5)


def test_a_hundred_days_take_less_than_two_seconds():
    cycling_profile(2.0, DRIVE, 10.0)
    start = time.perf_counter()
    found = cycling_profile(2.0, DRIVE, 8.64e6)
    assert time.perf_counter() - start < 2.0
    assert found.current_A.size == 8_640_000
    assert 0.19 < found.soc.min() < 0.2001
    assert 0.7999 < found.soc.max() < 0.81


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"capacity_Ah": 0.0}, "capacity_Ah must be positive"),
        ({"charge_current_A": -2.0}, "charge_current_A must be positive"),
        ({"step_s": np.inf}, "step_s must be positive"),
        ({"duration_s": 0.2}, "at least one sample"),
        ({"duration_s": np.nan}, "at least one sample"),
        ({"drive_current_A": []}, "one row of finite numbers"),
        ({"drive_current_A": [-1.0, np.nan]}, "one row of finite numbers"),
        ({"drive_current_A": [1.0, -0.5]}, "a negative sum"),
        ({"low": 20.0, "high": 80.0}, "give fractions"),
        ({"low": 0.8, "high": 0.2}, "must increase"),
        ({"drive_current_A": [-400.0]}, "outside"),
        ({"drive_current_A": np.repeat([1.0, -1.1], 500)}, "outside"),
        ({"state": CyclingState(1.2)}, "no state of a drive"),
        ({"state": CyclingState(0.5, False, 300)}, "no state of a drive"),
    ],
)
def test_what_makes_no_cycles_is_refused(changes, said):
    given = {"capacity_Ah": 0.5, "drive_current_A": DRIVE, "duration_s": 100.0} | changes
    with pytest.raises(BatteryError, match=said):
        cycling_profile(**given)


def test_the_soc_stays_where_the_check_says_it_does():
    """Regeneration at the start of a drive lifts the SOC above the upper limit, and no further than that."""
    drive = np.repeat([1.0, -1.5], 300)
    found = cycling_profile(0.5, drive, 50_000.0)
    assert found.soc.max() == pytest.approx(0.8 + 300 / 1800, abs=0.002)
    with pytest.raises(BatteryError, match=r"0\.199 to 1\.0"):
        cycling_profile(0.5, np.repeat([1.25, -1.5], 300), 50_000.0)

"""The open-circuit voltage found again from slow branches that a known cell was simulated along."""

import numpy as np
import pytest

from bms import BatteryError
from bms.cells import load_cell
from bms.errors import BatteryWarning
from bms.ocv_fit import SlowBranch, fit_ocv
from bms.simulation import CellState, simulate

STEP_S = 20.0


def branches(cell, c_rate=0.04, noise_V=0.0, seed=0):
    """A charge from empty to full after a discharge, and the discharge that follows it."""
    n = round(3600.0 / c_rate / STEP_S)
    rng = np.random.default_rng(seed)
    state = CellState(0.0, hysteresis=-1.0)
    found = []
    for sign in (1.0, -1.0):
        current = np.full(n + 1, sign * c_rate * cell.capacity_Ah)
        run = simulate(cell, current, STEP_S, state=state)
        voltage = run.voltage_V + noise_V * rng.standard_normal(n + 1)
        found.append(SlowBranch(run.time_s, current, voltage))
        state = CellState(run.soc[-1], tuple(run.relaxation_V[-1]), run.hysteresis[-1], run.temperature_C[-1])
    return found[1], found[0]


@pytest.fixture(scope="module")
def a123():
    return load_cell("a123-26650")


def steady_ohm(cell):
    return cell.resistance_ohm + sum(pair.resistance_ohm for pair in cell.relaxation)


def test_ocv_and_hysteresis_are_found_within_a_millivolt(a123):
    """Hysteresis included; with the rate known the ends come out as well."""
    discharge, charge = branches(a123)
    found = fit_ocv(discharge, charge, resistance_ohm=steady_ohm(a123), hysteresis_rate=20.0)
    soc = np.linspace(0.03, 0.97, 95)
    assert np.abs(found.curve(soc) - a123.ocv(soc)).max() < 1e-3
    hysteresis = np.interp(soc, found.soc, found.hysteresis_V)
    assert np.abs(hysteresis - np.interp(soc, a123.soc, a123.hysteresis.voltage_V)).max() < 1e-3
    assert found.capacity_Ah == pytest.approx(2.3, rel=1e-9)
    assert found.smoothing_V == 0.0


def test_without_the_rate_the_ends_are_off_by_what_has_not_flipped_yet(a123):
    """A turn x ago: the mean of the branches is off by M exp(-rate x), half their distance as well."""
    discharge, charge = branches(a123)
    found = fit_ocv(discharge, charge, resistance_ohm=steady_ohm(a123))
    middle = np.linspace(0.3, 0.7, 41)
    assert np.abs(found.curve(middle) - a123.ocv(middle)).max() < 1e-3
    at = np.argmin(np.abs(found.soc - 0.9))
    left = 0.014 * np.exp(-20.0 * 0.1)
    assert found.ocv_V[at] - a123.ocv(0.9) == pytest.approx(left, abs=3e-4)
    assert 0.014 - found.hysteresis_V[at] == pytest.approx(left, abs=3e-4)


def test_resistance_left_in_passes_for_hysteresis(a123):
    plain = a123.with_values(hysteresis=None, thermal=None)
    discharge, charge = branches(plain)
    found = fit_ocv(discharge, charge)
    inner = slice(20, -20)
    np.testing.assert_allclose(found.hysteresis_V[inner], steady_ohm(plain) * 0.04 * 2.3, rtol=0.02)
    none = fit_ocv(discharge, charge, resistance_ohm=steady_ohm(plain))
    assert none.hysteresis_V[inner].max() < 2e-5
    assert np.abs(none.ocv_V - plain.ocv(none.soc))[inner].max() < 2e-4


def test_noise_is_averaged_and_the_result_stays_monotone(a123):
    discharge, charge = branches(a123, noise_V=2e-3)
    found = fit_ocv(discharge, charge, resistance_ohm=steady_ohm(a123), hysteresis_rate=20.0)
    assert np.all(np.diff(found.ocv_V) >= 0.0)
    soc = np.linspace(0.05, 0.95, 91)
    assert np.abs(found.curve(soc) - a123.ocv(soc)).max() < 2e-3


def test_rests_in_a_branch_do_not_matter(a123):
    """A rest moves no charge; its relaxed voltages are not part of the branch."""
    discharge, charge = branches(a123)
    half = charge.time_s.size // 2
    pause = np.arange(1, 200) * STEP_S
    broken = SlowBranch(
        np.concatenate(
            (charge.time_s[:half], charge.time_s[half] + pause - STEP_S, charge.time_s[half:] + pause[-1])
        ),
        np.concatenate((charge.current_A[:half], np.zeros(199), charge.current_A[half:])),
        np.concatenate((charge.voltage_V[:half], np.full(199, 3.0), charge.voltage_V[half:])),
    )
    whole = fit_ocv(discharge, charge, resistance_ohm=0.02)
    paused = fit_ocv(discharge, broken, resistance_ohm=0.02)
    np.testing.assert_allclose(paused.ocv_V, whole.ocv_V, atol=2e-5)


def test_a_cell_is_built_from_the_fit(a123):
    discharge, charge = branches(a123)
    found = fit_ocv(discharge, charge, resistance_ohm=steady_ohm(a123), hysteresis_rate=20.0)
    other = load_cell("lfp-2ah").with_values(resistance_ohm=steady_ohm(a123), relaxation=())
    built = found.apply_to(other, hysteresis_rate=20.0)
    assert built.capacity_Ah == pytest.approx(2.3)
    run = simulate(built, charge.current_A, STEP_S, state=CellState(0.0, hysteresis=-1.0))
    inner = (run.soc > 0.05) & (run.soc < 0.97)
    assert np.abs(run.voltage_V - charge.voltage_V)[inner].max() < 1.5e-3
    assert found.apply_to(other).hysteresis is None
    assert found.apply_to(a123).hysteresis.rate == 20.0


def test_fast_or_unequal_branches_are_remarked_on(a123):
    with pytest.warns(BatteryWarning, match=r"ran at 0\.5 C"):
        fit_ocv(*branches(a123, c_rate=0.5))
    discharge, charge = branches(a123)
    cut = SlowBranch(charge.time_s[:-300], charge.current_A[:-300], charge.voltage_V[:-300])
    with pytest.warns(BatteryWarning, match="between the same ends"):
        fit_ocv(discharge, cut)


def test_bad_branches_are_refused(a123):
    discharge, charge = branches(a123, c_rate=0.1)
    with pytest.raises(BatteryError, match="turn the sign, or swap"):
        fit_ocv(charge, discharge)
    with pytest.raises(BatteryError, match="zero or more"):
        fit_ocv(discharge, charge, resistance_ohm=-0.01)
    with pytest.raises(BatteryError, match="hysteresis_rate positive"):
        fit_ocv(discharge, charge, hysteresis_rate=0.0)
    with pytest.raises(BatteryError, match="give a larger rate"):
        fit_ocv(discharge, charge, hysteresis_rate=0.1)
    with pytest.raises(BatteryError, match="increase strictly from 0 to 1"):
        fit_ocv(discharge, charge, nodes=[0.1, 0.5, 1.0])
    with pytest.raises(BatteryError, match="voltage_V has the shape"):
        SlowBranch(charge.time_s, charge.current_A, charge.voltage_V[1:])
    with pytest.raises(BatteryError, match="holds NaN"):
        SlowBranch(charge.time_s, charge.current_A, charge.voltage_V * np.nan)
    with pytest.raises(BatteryError, match="increase strictly; sort"):
        SlowBranch(charge.time_s[::-1], charge.current_A, charge.voltage_V)

"""BPX files: what they carry is read, what they lack is asked for, and nothing in them is run."""

import copy
import json
import subprocess
import sys
import warnings

import numpy as np
import pytest

from bms import BatteryError
from bms.bpx_expression import evaluate
from bms.bpx_file import read_bpx
from bms.cell import RelaxationPair
from bms.errors import BatteryWarning
from bms.simulation import simulate

NEGATIVE_OCP = (
    "1.9793 * exp(-39.3631 * x) + 0.2482 - 0.0909 * tanh(29.8538 * (x - 0.1234))"
    " - 0.04478 * tanh(14.9159 * (x - 0.2769)) - 0.0205 * tanh(30.4444 * (x - 0.6103))"
)
POSITIVE_OCP = (
    "-0.8090 * x + 4.4875 - 0.0428 * tanh(18.5138 * (x - 0.5542))"
    " - 17.7326 * tanh(15.7890 * (x - 0.3117)) + 17.5842 * tanh(15.9308 * (x - 0.3120))"
)


def negative_V(x):
    return (
        1.9793 * np.exp(-39.3631 * x)
        + 0.2482
        - 0.0909 * np.tanh(29.8538 * (x - 0.1234))
        - 0.04478 * np.tanh(14.9159 * (x - 0.2769))
        - 0.0205 * np.tanh(30.4444 * (x - 0.6103))
    )


def positive_V(y):
    return (
        -0.8090 * y
        + 4.4875
        - 0.0428 * np.tanh(18.5138 * (y - 0.5542))
        - 17.7326 * np.tanh(15.7890 * (y - 0.3117))
        + 17.5842 * np.tanh(15.9308 * (y - 0.3120))
    )


def electrode(ocp, low, high, most, radius, share, thickness, diffusivity):
    return {
        "Thickness [m]": thickness,
        "Particle radius [m]": radius,
        "Surface area per unit volume [m-1]": 3.0 * share / radius,
        "Maximum concentration [mol.m-3]": most,
        "Minimum stoichiometry": low,
        "Maximum stoichiometry": high,
        "Diffusivity [m2.s-1]": diffusivity,
        "OCP [V]": ocp,
        "Reaction rate constant [mol.m-2.s-1]": 1e-6,
    }


def lg_m50():
    """The LG M50 of Chen et al. 2020 as a single-particle BPX."""
    return {
        "Header": {"BPX": "1.1.0", "Title": "LG M50", "References": "Chen et al. 2020", "Model": "SPM"},
        "Parameterisation": {
            "Cell": {
                "Electrode area [m2]": 0.1027,
                "External surface area [m2]": 0.00531,
                "Volume [m3]": 2.42e-5,
                "Number of electrode pairs connected in parallel to make a cell": 1,
                "Lower voltage cut-off [V]": 2.5,
                "Upper voltage cut-off [V]": 4.2,
                "Nominal cell capacity [A.h]": 5.0,
                "Reference temperature [K]": 298.15,
                "Density [kg.m-3]": 2000.0,
                "Specific heat capacity [J.K-1.kg-1]": 1000.0,
            },
            "Negative electrode": electrode(
                NEGATIVE_OCP, 0.0263, 0.9106, 33133.0, 5.86e-6, 0.75, 85.2e-6, 3.3e-14
            ),
            "Positive electrode": electrode(
                POSITIVE_OCP, 0.2638, 0.8539, 63104.0, 5.22e-6, 0.665, 75.6e-6, 4e-15
            ),
        },
        "State": {
            "Initial conditions": {"Initial state-of-charge": 0.8, "Initial temperature [K]": 293.15},
            "Thermal environment": {
                "Ambient temperature [K]": 283.15,
                "Heat transfer coefficient [W.m-2.K-1]": 10.0,
            },
        },
    }


@pytest.fixture
def written(tmp_path):
    def write(data):
        path = tmp_path / "m50.json"
        path.write_text(json.dumps(data), encoding="utf-8")
        return path

    return write


def test_what_the_file_carries_is_read(written):
    found = read_bpx(written(lg_m50()), resistance_ohm=0.03)
    cell = found.cell
    soc = np.linspace(0.0, 1.0, 201)
    expected = positive_V(0.8539 - 0.5901 * soc) - negative_V(0.0263 + 0.8843 * soc)
    np.testing.assert_allclose(cell.ocv(soc), expected, atol=3e-4)
    np.testing.assert_allclose(cell.ocv([0.0, 1.0]), [2.5, 4.2], atol=2e-3)
    assert (cell.capacity_Ah, cell.voltage_min_V, cell.voltage_max_V) == (5.0, 2.5, 4.2)
    assert (cell.discharge_limit_A, cell.charge_limit_A) == (5.0, 5.0)
    assert cell.reference_temperature_C == pytest.approx(25.0)
    assert cell.thermal.heat_capacity_J_per_K == pytest.approx(48.4)
    assert cell.thermal.resistance_K_per_W == pytest.approx(1.0 / 0.0531)
    assert (found.soc, found.temperature_C, found.ambient_C) == pytest.approx((0.8, 20.0, 10.0))
    assert "Chen et al. 2020" in cell.source
    # F c_max L A share (x_max - x_min) / 3600, by hand.
    amount = 33133.0 * 85.2e-6 * 0.1027 * 0.75 * 0.8843, 63104.0 * 75.6e-6 * 0.1027 * 0.665 * 0.5901
    assert found.electrode_capacity_Ah == pytest.approx([26.801481 * mol for mol in amount], rel=1e-6)


def test_what_it_lacks_is_taken_from_the_user(written):
    path = written(lg_m50())
    with pytest.raises(BatteryError, match="no equivalent circuit, so resistance_ohm must be given"):
        read_bpx(path)
    pair = RelaxationPair(resistance_ohm=0.01, time_constant_s=50.0)
    cell = read_bpx(
        path,
        resistance_ohm=0.03,
        relaxation=(pair,),
        discharge_limit_A=10.0,
        charge_limit_A=3.0,
        heat_transfer_W_per_m2_K=20.0,
    ).cell
    assert (cell.discharge_limit_A, cell.charge_limit_A) == (10.0, 3.0)
    assert cell.thermal.resistance_K_per_W == pytest.approx(0.5 / 0.0531)
    run = simulate(cell, np.full(600, -5.0), soc=0.8)
    assert run.voltage_V[0] == pytest.approx(float(cell.ocv(0.8)) - 0.15, abs=1e-12)
    assert run.temperature_C[-1] > 25.0


def test_tables_and_missing_parts(written):
    """Potentials as tables give the same voltage; without a heat transfer there is no thermal node."""
    data = lg_m50()
    for name, low, high in (("Negative electrode", 0.02, 0.92), ("Positive electrode", 0.25, 0.92)):
        x = np.linspace(low, high, 2000)
        section = data["Parameterisation"][name]
        section["OCP [V]"] = {"x": x.tolist(), "y": evaluate(section["OCP [V]"], x).tolist()}
    del data["State"]["Thermal environment"]["Heat transfer coefficient [W.m-2.K-1]"]
    del data["Parameterisation"]["Cell"]["Reference temperature [K]"]
    found = read_bpx(written(data), resistance_ohm=0.03)
    plain = read_bpx(written(lg_m50()), resistance_ohm=0.03)
    np.testing.assert_allclose(found.cell.ocv_V, plain.cell.ocv_V, atol=1e-4)
    assert found.cell.thermal is None
    assert found.cell.reference_temperature_C == 25.0


def test_branches_of_the_potentials_become_hysteresis(written):
    """The negative electrode's branches 20 mV up and down: half the distance of the cell's is 20 mV."""
    data = lg_m50()
    section = data["Parameterisation"]["Negative electrode"]
    section["OCP (lithiation) [V]"] = f"{NEGATIVE_OCP} - 0.02"
    section["OCP (delithiation) [V]"] = f"{NEGATIVE_OCP} + 0.02"
    found = read_bpx(written(data), resistance_ohm=0.03, hysteresis_rate=30.0)
    np.testing.assert_allclose(found.cell.hysteresis.voltage_V, 0.02, rtol=1e-12)
    assert found.cell.hysteresis.rate == 30.0
    with pytest.warns(BatteryWarning, match="give hysteresis_rate"):
        assert read_bpx(written(data), resistance_ohm=0.03).cell.hysteresis is None


def test_a_file_of_bpx_0_is_converted_and_its_state_not_made_up(written):
    data = lg_m50()
    data["Header"]["BPX"] = "0.4.0"
    del data["State"]
    data["Parameterisation"]["Cell"] |= {
        "Initial temperature [K]": 298.15,
        "Ambient temperature [K]": 298.15,
    }
    with pytest.warns(BatteryWarning, match=r"is BPX 0\.x"):
        found = read_bpx(written(data), resistance_ohm=0.03)
    assert found.soc is None
    assert found.cell.thermal is None
    assert found.temperature_C == pytest.approx(25.0)


@pytest.mark.parametrize(
    ("section", "change", "said"),
    [
        ("Cell", {"Nominal cell capacity [A.h]": 6.0}, "its electrodes hold"),
        ("Cell", {"Upper voltage cut-off [V]": 4.1}, "goes beyond its limits"),
    ],
)
def test_what_does_not_fit_together_is_remarked_on(written, section, change, said):
    data = lg_m50()
    data["Parameterisation"][section] |= change
    with pytest.warns(BatteryWarning, match=said):
        read_bpx(written(data), resistance_ohm=0.03)


@pytest.mark.parametrize(
    ("section", "change", "said"),
    [
        ("Negative electrode", {"OCP [V]": "exit(1)"}, "is not an expression of BPX"),
        ("Negative electrode", {"OCP [V]": "__import__('os').remove('x')"}, "is not an expression of BPX"),
        ("Negative electrode", {"OCP [V]": "1 / (x - x)"}, "not finite between"),
        ("Negative electrode", {"OCP [V]": "-10 * x"}, None),
        ("Negative electrode", {"OCP [V]": "10 * x"}, "does not rise with SOC"),
        ("Negative electrode", {"OCP [V]": {"x": [0.2, 0.8], "y": [0.2, 0.1]}}, "the table runs from 0.2"),
        ("Negative electrode", {"OCP [V]": {"x": [0.5, 0.5], "y": [0.2, 0.1]}}, "increase strictly"),
        ("Negative electrode", {"OCP [V]": {"x": [0.0, 1.0], "y": [0.2]}}, "is not valid BPX"),
        ("Negative electrode", {"Particle": {}}, "is a blend"),
        ("Negative electrode", {"Thicknes [m]": 1e-4}, "is not valid BPX"),
        ("Cell", {"Nominal cell capacity [A.h]": -5.0}, "capacity_Ah"),
        ("Cell", {"Lower voltage cut-off [V]": 4.3}, "is not below voltage_max_V"),
    ],
)
def test_bad_content_is_refused(written, section, change, said):
    data = lg_m50()
    data["Parameterisation"][section] |= change
    path = written(data)
    if said is None:
        # A steep potential leaves the voltage limits, but is a potential.
        with pytest.warns(BatteryWarning, match="goes beyond its limits"):
            read_bpx(path, resistance_ohm=0.03)
        return
    with pytest.raises(BatteryError, match=said):
        read_bpx(path, resistance_ohm=0.03)


def test_what_is_no_bpx_file_is_refused(written, tmp_path):
    with pytest.raises(BatteryError, match="cannot read the BPX file"):
        read_bpx(tmp_path / "nowhere.json", resistance_ohm=0.03)
    bad = tmp_path / "bad.json"
    bad.write_text("Header:\n  BPX: 1.0.0\n", encoding="utf-8")
    with pytest.raises(BatteryError, match="not valid JSON"):
        read_bpx(bad, resistance_ohm=0.03)
    bad.write_bytes(b"\xff\xfe{}")
    with pytest.raises(BatteryError, match="not UTF-8"):
        read_bpx(bad, resistance_ohm=0.03)
    with pytest.raises(BatteryError, match="no section Parameterisation"):
        read_bpx(written([1, 2]), resistance_ohm=0.03)
    for name in ("Negative electrode", "Cell", "Header"):
        data = copy.deepcopy(lg_m50())
        (data if name == "Header" else data["Parameterisation"]).pop(name)
        with pytest.raises(BatteryError, match=r"m50\.json"):
            read_bpx(written(data), resistance_ohm=0.03)


def test_no_resistance_that_is_none(written):
    with pytest.raises(BatteryError, match="resistance_ohm must be positive"):
        read_bpx(written(lg_m50()), resistance_ohm=-0.03)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("2 * x ** 2 - -x / 4", lambda x: 2.0 * x**2 + x / 4.0),
        (
            "1.5e-3 + exp(-x) * (tanh(x) + cosh(2*x))",
            lambda x: 1.5e-3 + np.exp(-x) * (np.tanh(x) + np.cosh(2.0 * x)),
        ),
        ("-x**2", lambda x: -(x**2)),
        ("2 ** x ** 2", lambda x: 2.0 ** (x**2)),
        ("7", lambda x: 7.0 + 0.0 * x),
    ],
)
def test_expressions_follow_the_rules_of_python(text, expected):
    x = np.linspace(0.1, 0.9, 9)
    np.testing.assert_allclose(evaluate(text, x), expected(x), rtol=1e-14)


@pytest.mark.parametrize(
    "text",
    ["", "y", "x + ", "sin(x)", "exp(x, 2)", "exp(x=1)", "x.real", "x[0]", "True", "'x'", "1j",
     "x if x else 1", "lambda: 1", "x // 2", "x % 2", "(x, x)", "1" * 20_000, "-" * 9_000 + "x",
     "exp.__class__(x)"],
)  # fmt: skip
def test_other_expressions_are_refused(text):
    with pytest.raises(BatteryError, match="is not an expression of BPX"):
        evaluate(text, 0.5)


def test_huge_powers_cost_nothing():
    """As floats they overflow; as Python's integers they would not end."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert evaluate("9 ** 9 ** 9 ** 9", 0.5) == np.inf


def test_bpx_is_imported_when_it_is_needed_and_missed_in_plain_words(written, monkeypatch):
    code = "import sys, bms.bpx_file; sys.exit('bpx' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    monkeypatch.setitem(sys.modules, "bpx", None)
    with pytest.raises(BatteryError, match="pip install"):
        read_bpx(written(lg_m50()), resistance_ohm=0.03)

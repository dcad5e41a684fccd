"""The equivalent circuit: closed forms, two faces of one model, members, conservation."""

import itertools

import numpy as np
import pytest
from battery_cases import drive_current_A, linear_cell
from naive_bms import simulate as naive_simulate

from bms.cell import Cell, Hysteresis, Thermal
from bms.cells import PRESETS, cell_names, load_cell
from bms.circuit import tabulate
from bms.errors import BatteryError, BatteryWarning
from bms.simulation import CellState, simulate, simulate_members, step


def test_constant_current_gives_the_closed_form():
    cell, current_A, n = linear_cell(), 3.0, 3000
    run = simulate(cell, np.full(n, current_A), 1.0, soc=0.2)
    t = np.arange(n)
    tau = 0.011 * 2700.0
    soc = 0.2 + current_A * t / 7200.0
    expected = 3.0 + 0.5 * soc + 0.011 * current_A * (1.0 - np.exp(-t / tau)) + 0.008 * current_A
    assert soc.max() > 1.0  # beyond full the OCV stays where it is
    expected[soc > 1.0] = expected[soc > 1.0] - 0.5 * (soc[soc > 1.0] - 1.0)
    np.testing.assert_allclose(run.voltage_V, expected, rtol=0, atol=1e-10)
    np.testing.assert_allclose(run.soc, soc, rtol=0, atol=1e-10)


def test_any_current_gives_the_convolution_of_the_linear_circuit():
    """Two pairs, uneven steps: the sum of exponentials since every change of current."""
    cell = linear_cell(
        relaxation=(
            {"resistance_ohm": 0.011, "time_constant_s": 30.0},
            {"resistance_ohm": 0.02, "time_constant_s": 700.0},
        )
    )
    rng = np.random.default_rng(3)
    steps = rng.uniform(0.1, 20.0, 400)
    current = rng.normal(0.0, 3.0, 400)
    run = simulate(cell, current, steps, soc=0.5)
    edge = np.concatenate([[0.0], np.cumsum(steps)])
    for k in (1, 57, 399):
        expected = 3.0 + 0.5 * (0.5 + current[:k] @ steps[:k] / 7200.0) + 0.008 * current[k]
        for ohm, tau in ((0.011, 30.0), (0.02, 700.0)):
            weight = np.exp(-(edge[k] - edge[1 : k + 1]) / tau) - np.exp(-(edge[k] - edge[:k]) / tau)
            expected += ohm * current[:k] @ weight
        assert run.voltage_V[k] == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("name", ["linear", *cell_names()])
def test_simulating_equals_stepping_to_the_bit(name):
    cell = linear_cell() if name == "linear" else load_cell(name)
    current = drive_current_A(300, seed=1)
    steps = np.random.default_rng(0).choice([1.0, 1.0, 0.1, 7.0], 300)
    run = simulate(cell, current, steps, soc=0.6, ambient_C=31.0)
    state = CellState(0.6, temperature_C=31.0)
    for k in range(300):
        assert (state.soc, state.hysteresis, state.temperature_C) == (
            run.soc[k],
            run.hysteresis[k],
            run.temperature_C[k],
        )
        assert state.relaxation_V == tuple(run.relaxation_V[k])
        state, voltage_V = step(cell, state, float(current[k]), float(steps[k]), 31.0)
        assert voltage_V == run.voltage_V[k]
    assert state == run.final


@pytest.mark.parametrize("hysteresis", [None, {"voltage_V": 0.02, "rate": 60.0}])
def test_kernel_equals_its_naive_twin(hysteresis):
    cell = linear_cell(hysteresis=hysteresis)
    current = drive_current_A(500, seed=2)
    run = simulate(cell, current, 2.0, soc=0.55)
    soc, voltage, relaxation = naive_simulate(cell, current, 2.0, soc=0.55)
    np.testing.assert_allclose(run.soc, soc, rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.voltage_V, voltage, rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.relaxation_V[:, 0], relaxation[:, 0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", cell_names())
def test_the_kernels_curve_is_the_cells(name):
    """The guide finds the right cubic everywhere, also at the nodes."""
    cell = load_cell(name)
    soc = np.concatenate([np.linspace(0.0, 1.0, 4001), np.array(cell.soc)])
    rest = simulate_members(cell, [0.0], soc=soc)
    np.testing.assert_allclose(rest.voltage_V[:, 0], cell.ocv(soc), rtol=0, atol=1e-12)


def test_hysteresis_settles_on_its_branches():
    cell = linear_cell(hysteresis=Hysteresis(voltage_V=0.025, rate=100.0))
    up = simulate(cell, np.r_[np.full(720, 1.0), np.zeros(4000)], 1.0, soc=0.5)
    # 10 % of charge at a rate of 100 leaves exp(-10) of the way, and rest keeps what is there.
    assert up.hysteresis[-1] == pytest.approx(1.0 - np.exp(-10.0), abs=1e-12)
    assert up.voltage_V[-1] - cell.ocv(up.soc[-1]) == pytest.approx(0.025 * (1 - np.exp(-10.0)), abs=1e-9)


def test_thermal_node_reaches_its_steady_state():
    cell = linear_cell(thermal=Thermal(heat_capacity_J_per_K=80.0, resistance_K_per_W=5.0))
    current = np.tile(np.r_[np.full(50, 4.0), np.full(50, -4.0)], 200)
    run = simulate(cell, current, 1.0, soc=0.5, ambient_C=20.0)
    late = slice(-2000, None)
    heat_W = np.mean(current[late] * (run.voltage_V[late] - cell.ocv(run.soc[late])))
    assert np.mean(run.temperature_C[late]) == pytest.approx(20.0 + 5.0 * heat_W, abs=0.01)


def test_arrhenius_resistance_halves_where_it_should():
    energy = 8.314462618 * np.log(2.0) / (1.0 / 298.15 - 1.0 / 313.15)
    cell = linear_cell(activation_energy_J_per_mol=energy, relaxation=())
    cold, warm = (simulate(cell, [10.0], ambient_C=c, soc=0.5).voltage_V[0] - 3.25 for c in (25.0, 40.0))
    assert cold == pytest.approx(0.08)
    assert warm == pytest.approx(0.04)


def test_tables_over_temperature_and_soc_are_bilinear():
    soc = tuple(np.linspace(0.0, 1.0, 5))
    rows = ((0.02,) * 5, tuple(0.01 + 0.01 * s for s in soc))
    cell = linear_cell(temperature_C=(0.0, 20.0), resistance_ohm=rows, relaxation=())
    at = simulate(cell, [1.0], soc=0.3, ambient_C=5.0).voltage_V[0] - 3.15
    assert at == pytest.approx(0.75 * 0.02 + 0.25 * 0.013)
    beyond = simulate(cell, [1.0], soc=0.3, ambient_C=90.0).voltage_V[0] - 3.15
    assert beyond == pytest.approx(0.013)


def test_members_are_cells_of_their_own():
    cell = load_cell("lfp-2ah")
    current = drive_current_A(400, seed=4)
    soc = np.array([0.3, 0.5, 0.7])
    factors = np.array([0.9, 1.0, 1.2])
    many = simulate_members(
        cell, current, soc=soc, capacity_factor=factors, resistance_factor=factors, threads=2
    )
    assert many.voltage_V.shape == (3, 400)
    for i in range(3):
        own = cell.with_values(
            capacity_Ah=cell.capacity_Ah * factors[i], resistance_ohm=cell.resistance_ohm * factors[i]
        )
        alone = simulate(own, current, soc=soc[i])
        np.testing.assert_allclose(many.voltage_V[i], alone.voltage_V, rtol=0, atol=1e-12)
        np.testing.assert_allclose(many.soc[i], alone.soc, rtol=0, atol=1e-13)
    rows = np.stack([current, current, current])
    assert np.array_equal(
        simulate_members(cell, rows, soc=soc, capacity_factor=factors, resistance_factor=factors).voltage_V,
        many.voltage_V,
    )


def test_a_pack_is_its_cells():
    cell = load_cell("a123-26650")
    pack = cell.scaled(series=10, parallel=3)
    current = drive_current_A(300, seed=5)
    one, many = simulate(cell, current, soc=0.5), simulate(pack, 3.0 * current, soc=0.5)
    np.testing.assert_allclose(many.voltage_V, 10.0 * one.voltage_V, rtol=1e-12)
    np.testing.assert_allclose(many.temperature_C, one.temperature_C, rtol=1e-12)
    with pytest.raises(ValueError, match="at least 1 cell"):
        cell.scaled(series=0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"current_A": [1.0, np.nan]}, "nan at sample 1"),
        ({"current_A": []}, "one row"),
        ({"current_A": [1.0], "step_s": 0.0}, "longer than 0"),
        ({"current_A": [1.0, 1.0], "step_s": [1.0, 1.0, 1.0]}, "3 values for 2"),
        ({"current_A": [1.0], "soc": 55.0}, "fraction"),
    ],
)
def test_bad_input_is_explained(arguments, message):
    with pytest.raises(BatteryError, match=message):
        simulate(linear_cell(), **arguments)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ocv_V": (3.0, 3.1, 3.05, 3.2, 3.5)}, "must not fall"),
        ({"ocv_V": (3.0, 3.1)}, "2 values for 5"),
        ({"resistance_ohm": -0.01}, "positive"),
        ({"resistance_ohm": (0.01, 0.02)}, "2 values for 5"),
        ({"relaxation": ({"resistance_ohm": 0.01},)}, "one of the two"),
        ({"temperature_C": (20.0, 0.0)}, "increase"),
        ({"resistance_ohm": ((0.01,) * 5, (0.02,) * 5)}, "2 rows for 0"),
        ({"voltage_min_V": 5.0}, "not below"),
        ({"full_charge_voltage_V": 3.5}, "come together"),
        ({"hysteresis": {"voltage_V": -0.01, "rate": 10.0}}, "zero or more"),
        ({"typo_ohm": 1.0}, "typo_ohm"),
    ],
)
def test_a_cell_that_cannot_be_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        linear_cell(**changes)


CSV = "soc,ocv_V,resistance_ohm,relaxation_1_resistance_ohm,relaxation_1_time_constant_s,hysteresis_V"


def test_a_cell_from_a_csv_is_the_cell_from_the_file(tmp_path):
    soc = (0.0, 0.4, 1.0)
    lines = [f"{s},{3 + 0.5 * s},{0.01 + 0.01 * s},0.02,30,0.01" for s in soc]
    (tmp_path / "cell.csv").write_text("\n".join([CSV, *lines]), encoding="utf-8")
    text = """name = "x"
source = "y"
capacity_Ah = 2.0
voltage_min_V = 2.0
voltage_max_V = 4.0
discharge_limit_A = 10.0
charge_limit_A = 10.0
tables = "cell.csv"
[hysteresis]
rate = 40
"""
    (tmp_path / "cell.toml").write_text(text, encoding="utf-8")
    cell = load_cell(tmp_path / "cell.toml")
    assert cell.resistance_ohm == (0.01, 0.014, 0.02)
    assert cell.relaxation[0].time_constant_s == (30.0, 30.0, 30.0)
    assert cell.hysteresis == Hysteresis(voltage_V=(0.01, 0.01, 0.01), rate=40)
    warm = [f"{s},{3 + 0.5 * s},0.005,0.02,30,0.01,{t}" for t, s in itertools.product((0, 25), soc)]
    (tmp_path / "cell.csv").write_text("\n".join([CSV + ",temperature_C", *warm]), encoding="utf-8")
    cell = load_cell(tmp_path / "cell.toml")
    assert cell.temperature_C == (0.0, 25.0)
    assert tabulate(cell).table.shape == (2, 201, 6)
    (tmp_path / "cell.csv").write_text("\n".join([CSV + ",temperature_C", *warm[:-1]]), encoding="utf-8")
    with pytest.raises(BatteryError, match="every pair"):
        load_cell(tmp_path / "cell.toml")
    (tmp_path / "cell.csv").write_text("soc,resistance_ohm\n0,1\n1,1", encoding="utf-8")
    with pytest.raises(BatteryError, match="ocv_V"):
        load_cell(tmp_path / "cell.toml")


def test_unknown_cells_get_a_suggestion(tmp_path):
    with pytest.raises(BatteryError, match="did you mean 'lfp-2ah'"):
        load_cell("lfp-2a")
    (tmp_path / "c.toml").write_text('name = "x"', encoding="utf-8")
    with pytest.raises(BatteryError, match="capacity_Ah is missing"):
        load_cell(tmp_path / "c.toml")


def test_copies_are_validated():
    with pytest.raises(ValueError, match="greater than 0"):
        linear_cell().with_values(capacity_Ah=-1.0)
    assert isinstance(linear_cell().with_values(capacity_Ah=3.0), Cell)


def test_a_cell_can_ask_for_the_reports_polynomial(tmp_path):
    preset = (PRESETS / "lfp-2ah.toml").read_text(encoding="utf-8")
    (tmp_path / "c.toml").write_text('ocv = "polynomial"\n' + preset, encoding="utf-8")
    with pytest.warns(BatteryWarning, match="falls"):
        cell = load_cell(tmp_path / "c.toml")
    table = load_cell("lfp-2ah")
    soc = np.linspace(0.15, 0.8, 50)
    apart_V = np.abs(cell.ocv(soc) - table.ocv(soc))
    assert 1e-4 < apart_V.max() < 0.005
    assert cell.ocv(0.05) == pytest.approx(float(table.ocv(0.05)), abs=1e-6)
    (tmp_path / "c.toml").write_text('ocv = "spline"\n' + preset, encoding="utf-8")
    with pytest.raises(BatteryError, match="table, polynomial"):
        load_cell(tmp_path / "c.toml")


def test_a_full_charge_that_leaves_the_cell_short_is_doubted(tmp_path):
    preset = (PRESETS / "nmc-lgm50.toml").read_text(encoding="utf-8")
    short = preset.replace("full_charge_voltage_V = 4.19", "full_charge_voltage_V = 4.1")
    assert short != preset
    (tmp_path / "c.toml").write_text(short, encoding="utf-8")
    with pytest.warns(BatteryWarning, match="taken for full"):
        load_cell(tmp_path / "c.toml")

"""`socwise estimate`: real estimators over a simulated log; what is shown and stored is what they said."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from command_line import run, tree

from bms.cells import cell_names, load_cell
from bms.estimators.catalogue import make_estimator
from bms.estimators.gate import Sensors
from bms.flags import Flag
from bms.logged_data import LoggedData, read_log
from bms.simulation import simulate
from socwise import estimation
from socwise.estimate_store import nominal_parameters
from socwise.estimation import default_every, run_estimator, to_json
from socwise.figures.estimate_parameters import parameter_names, plot_estimated_parameter
from socwise.figures.estimate_residual import plot_residual
from socwise.figures.estimate_soc import plot_estimated_soc, plot_soc_error
from socwise.figures.estimate_style import time_scale
from socwise.results.estimate import read_series
from socwise.results.staging import StoreError

CELL = "lfp-2ah"
SECONDS = 2400
NAMES = ("coulomb", "ekf", "gpc_gauss_newton")
BAD_VOLTAGE = slice(1000, 1060)


@pytest.fixture(scope="module")
def samples():
    """Forty minutes of pulses, with noise, and a minute without voltage."""
    rng = np.random.default_rng(11)
    current = np.repeat(rng.choice([-4.0, -1.0, 0.0, 2.0, 5.0], SECONDS // 20), 20)
    plant = simulate(load_cell(CELL), current, 1.0, soc=0.6)
    current_A = np.round(current + rng.normal(0, 0.01, SECONDS), 4)
    voltage_V = np.round(plant.voltage_V + rng.normal(0, 0.002, SECONDS), 4)
    voltage_V[BAD_VOLTAGE] = np.nan
    return np.arange(SECONDS), current_A, voltage_V, np.round(plant.soc, 5)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch, samples):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "log.csv", "time_s,current_A,voltage_V,soc", *samples)
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "thesis.txt").write_text("years of work")
    return tmp_path


def write(path, header, *columns, mark=","):
    rows = zip(*(column.tolist() for column in columns), strict=True)
    lines = [header, *(mark.join("" if cell != cell else str(cell) for cell in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def estimate(capsys, *arguments):
    shown = run(capsys, "estimate", "log.csv", "--cell", CELL, *arguments)
    assert (shown.code, shown.err) == (0, "")
    return shown.out


@pytest.fixture(scope="module")
def runs(samples):
    time_s, current_A, voltage_V, soc = samples
    log = LoggedData(time_s.astype(float), current_A, voltage_V, soc_true=soc, source="simulated")
    cell = load_cell(CELL)
    return log, [run_estimator(make_estimator(name, cell, soc=0.5), log) for name in NAMES]


def test_the_numbers_are_those_of_the_estimators(capsys, samples):
    result = json.loads(estimate(capsys, "--estimator", "coulomb,ekf", "--soc0", "0.4", "--json"))
    assert result["schema"] == 1
    assert result["cell"] == CELL
    assert result["data"]["samples"] == SECONDS
    assert result["data"]["missing"] == {"current": 0, "voltage": 60}
    time_s, current_A, voltage_V, soc = samples
    for entry in result["estimators"]:
        direct = make_estimator(entry["name"], load_cell(CELL), soc=0.4)
        trace = direct.run(current_A, voltage_V, time_s=time_s)
        assert entry["soc"]["final"] == direct.belief.mean
        assert entry["soc"]["sd"] == math.sqrt(direct.belief.variance)
        assert entry["soc"]["rmse"] == pytest.approx(np.sqrt(np.mean((trace.soc - soc) ** 2)), rel=1e-12)
        assert entry["soc"]["error"] == pytest.approx(trace.soc[-1] - soc[-1], abs=1e-15)
        inside = np.abs(trace.soc - soc) <= 2 * np.sqrt(trace.variance)
        assert entry["soc"]["inside_2sd"] == inside.mean()
        assert entry["trusted_share"] == np.mean([Flag(flag).trusted for flag in trace.flags.tolist()])
        assert entry["flags"]["voltage_missing"] == 60 / SECONDS
        for name, value in direct.parameters.items():
            stored = entry["parameters"][name]
            assert (stored["value"], stored["sd"]) == (value.value, value.sd)


def test_traces_are_stored_with_all_that_happened_between_rows(capsys, samples):
    estimate(capsys, "--estimator", "ekf", "--every", "7", "--soc0", "0.5")
    stored = read_series(Path("results/estimate/ekf.nc"))
    time_s, current_A, voltage_V, soc = samples
    direct = make_estimator("ekf", load_cell(CELL), soc=0.5)
    trace = direct.run(current_A, voltage_V, time_s=time_s)
    last = np.minimum(np.arange(6, SECONDS + 6, 7), SECONDS - 1)
    np.testing.assert_array_equal(stored["time_s"], time_s[last])
    np.testing.assert_array_equal(stored["soc"], trace.soc[last].astype(np.float32))
    np.testing.assert_array_equal(stored["soc_sd"], np.sqrt(trace.variance[last]).astype(np.float32))
    np.testing.assert_array_equal(stored["soc_true"], soc[last].astype(np.float32))
    flags = [np.bitwise_or.reduce(trace.flags[k : k + 7]) for k in range(0, SECONDS, 7)]
    np.testing.assert_array_equal(stored["flags"], flags)
    for name, values in trace.parameters.items():
        np.testing.assert_array_equal(stored[name], values[last].astype(np.float32))
        np.testing.assert_array_equal(stored[f"{name}_sd"], trace.deviations[name][last].astype(np.float32))


def test_the_log_in_parts_is_the_log_as_a_whole(runs, monkeypatch):
    log, whole = runs
    monkeypatch.setattr(estimation, "CHUNK", 500)
    for one in whole:
        parts = run_estimator(make_estimator(one.name, load_cell(CELL), soc=0.5), log)
        np.testing.assert_array_equal(parts.trace.soc, one.trace.soc)
        np.testing.assert_array_equal(parts.trace.flags, one.trace.flags)
        np.testing.assert_array_equal(parts.trace.residual_V, one.trace.residual_V)
        assert (parts.soc, parts.soc_sd, parts.flags) == (one.soc, one.soc_sd, one.flags)
        assert parts.residual_rms_V == pytest.approx(one.residual_rms_V, rel=1e-12, nan_ok=True)


def test_progress_ends_with_the_log(runs, monkeypatch):
    monkeypatch.setattr(estimation, "CHUNK", 1000)
    done = []
    run_estimator(make_estimator("coulomb", load_cell(CELL)), runs[0], every=3, progress=done.append)
    assert done == [999, 1998, SECONDS]


def test_long_logs_are_thinned():
    assert [default_every(n) for n in (10, 200_000, 200_001, 8_640_000)] == [1, 1, 2, 44]


def test_the_screen(capsys):
    shown = estimate(capsys, "--estimator", "coulomb,EKF,gpc-gauss-newton")
    for part in (
        "log.csv: 2,400 samples in 2399 s, one every 1 s; cell lfp-2ah",
        "note: the voltage is missing in 60 of 2400 samples",
        "SOC at end",
        "capacity",
        "ekf did not trust: voltage missing 2.5 %",
        "Results are in results/estimate",
    ):
        assert part in shown
    rows = [line.split()[0] for line in shown.splitlines() if "±" in line and not line.startswith("±")]
    assert set(rows) == set(NAMES)
    assert max(len(line) for line in shown.splitlines()) <= 100


def test_files_and_their_bytes(capsys, folder):
    arguments = ("--estimator", "coulomb,ekf", "--out", "out")
    estimate(capsys, *arguments)
    first = tree(folder / "out")
    manifest = json.loads(first["manifest.json"])
    assert manifest["files"] == sorted(name for name, content in first.items() if content is not None)
    assert manifest["settings"]["cell"]["name"] == CELL
    assert {"coulomb.nc", "ekf.nc", "summary.csv", "result.json", "figures/soc.png"} <= first.keys()
    assert first["summary.csv"].decode().splitlines()[0].startswith("name,soc_final,soc_sd,")
    estimate(capsys, *arguments)
    again = tree(folder / "out")
    assert again.keys() == first.keys()
    assert [name for name in first if first[name] != again[name] and name != "result.json"] == []
    assert sorted(path.name for path in folder.iterdir()) == ["log.csv", "notes", "out"]


def test_other_names_units_and_sign_give_the_same(capsys, folder, samples):
    time_s, current_A, voltage_V, soc = samples
    expected = json.loads(estimate(capsys, "--estimator", "ekf", "--json"))["estimators"][0]
    write(
        folder / "log.csv", "t [min];I(mA);U;SOC [%]",
        time_s / 60.0, np.round(-1e3 * current_A, 1), np.round(1e3 * voltage_V, 1), 100.0 * soc, mark=";",
    )  # fmt: skip
    arguments = ("--voltage", "U:mV", "--discharge-positive", "--estimator", "ekf", "--json")
    found = json.loads(estimate(capsys, *arguments))
    assert found["estimators"][0]["soc"]["final"] == pytest.approx(expected["soc"]["final"], abs=1e-9)
    assert found["data"]["columns"]["voltage"] == "U"


def test_a_wrong_sign_is_doubted_aloud(capsys):
    shown = run(
        capsys, "estimate", "log.csv", "--cell", CELL, "--estimator", "coulomb", "--discharge-positive"
    )
    assert shown.code == 0
    assert "socwise: warning: the voltage falls when the current rises" in shown.err


def test_options_reach_the_estimators(capsys):
    arguments = ("--estimator", "coulomb,ekf", "--soc0", "0.5", "--json")
    tight = ("--option", "coulomb.bias_sd_A=1.0", "--current-sd", "0.5", "--start-after", "600")
    entry = json.loads(estimate(capsys, *arguments, *tight))
    assert entry["data"]["start_s"] == 600.0
    log = read_log("log.csv").after(600.0)
    direct = make_estimator("coulomb", load_cell(CELL), sensors=Sensors(current_sd_A=0.5), bias_sd_A=1.0)
    direct.run(log.current_A, log.voltage_V, time_s=log.time_s)
    assert entry["estimators"][0]["soc"]["sd"] == math.sqrt(direct.belief.variance)
    more = ("--option", "ekf.current_bias=true", "--option", 'ekf.estimate=["resistance_ohm"]')
    entry = json.loads(estimate(capsys, *arguments, *more))
    assert entry["estimators"][1]["parameters"].keys() == {"current_bias_A", "resistance_ohm"}


@pytest.mark.parametrize("name", cell_names())
def test_nominal_parameters_are_what_estimators_start_from(name):
    """An estimator that has seen one sample, of the voltage it expects, has hardly moved."""
    cell = load_cell(name)
    one = make_estimator("ekf", cell, soc=0.5, soc_sd=0.01)
    one.update(0.0, float(cell.ocv(0.5)), 1.0, cell.reference_temperature_C)
    nominal = nominal_parameters(cell)
    for parameter, value in one.parameters.items():
        assert value.value == pytest.approx(nominal[parameter], rel=1e-3)


def test_a_pack_is_a_cell_of_many(capsys, folder, samples):
    time_s, current_A, voltage_V, soc = samples
    expected = json.loads(estimate(capsys, "--estimator", "coulomb", "--json"))["estimators"][0]
    write(folder / "log.csv", "time_s,current_A,voltage_V,soc", time_s, 3 * current_A, 12 * voltage_V, soc)
    found = json.loads(
        estimate(capsys, "--estimator", "coulomb", "--series", "12", "--parallel", "3", "--json")
    )
    assert found["cell"] == "lfp-2ah 12s3p"
    assert found["estimators"][0]["soc"]["final"] == pytest.approx(expected["soc"]["final"], abs=1e-12)


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--cell", "lfp-2a"], ["'lfp-2a'", "did you mean 'lfp-2ah'?"]),
        (["--cell", "absent.toml"], ["absent.toml"]),
        (["--estimator", "efk"], ["'efk'", "did you mean 'ekf'?"]),
        (["--estimator", "ekf,EKF"], ["'ekf' twice"]),
        (["--estimator", "ekf,"], ["empty item"]),
        (["--soc0", "60"], ["60", "fraction, not per cent"]),
        (["--soc0-sd", "-1"], ["between 0 and 1"]),
        (["--voltage-sd", "0"], ["voltage_sd_V"]),
        (["--option", "joint"], ["--option is 'joint'", "KEY=VALUE"]),
        (["--option", "ukf.joint=true"], ["'ukf'", "--estimator does not name"]),
        (["--option", "colour=3"], ["colour"]),
        (["--option", "ekf.soc=0.3"], ["'soc'", "--soc0"]),
        (["--start-after", "9999"], ["leaves nothing of the 2400 samples of log.csv"]),
        (["--start-after", "2391"], ["leaves 9 of the 2400 samples of log.csv", "at least 10"]),
        (["--temperature", "soc:K"], ["-272.", "degC rather than K", "--temperature 'soc':degC"]),
        (["--current", "strom"], ["no column 'strom'", "'current_A'"]),
        (["--voltage", "soc"], ["'soc' has no unit for the voltage", "--voltage"]),
        (["--out", "log.csv"], ["log.csv", "it is a file"]),
        (["--out", "notes"], ["thesis.txt", "nothing was touched"]),
    ],
)
def test_what_cannot_be_used(capsys, folder, arguments, parts):
    before = tree(folder)
    given = arguments if "--cell" in arguments else ["--cell", CELL, *arguments]
    shown = run(capsys, "estimate", "log.csv", *given)
    assert (shown.code, shown.out) == (2, "")
    assert shown.err.startswith("socwise: ")
    assert [part for part in parts if part not in shown.err] == []
    assert tree(folder) == before


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        (None, ["there is no file bad.csv"]),
        ("time_s,current_A\n" + "1,2\n" * 20, ["bad.csv", "no voltage column"]),
        ("time_s,current_A,voltage\n" + "1,2,3\n" * 20, ["bad.csv", "'voltage' has no unit"]),
        (
            "time_s,current_A,voltage_V\n" + "".join(f"{-k},1,3.3\n" for k in range(20)),
            ["line 3", "time goes back"],
        ),
        ("time_s,current_A,voltage_V\n" + "".join(f"{k},1,33\n" for k in range(20)), ["33 V", "--series"]),
    ],
    ids=["no file", "no column", "no unit", "unsorted", "a pack"],
)
def test_logs_that_cannot_be_used(capsys, folder, content, parts):
    if content is not None:
        (folder / "bad.csv").write_text(content)
    before = tree(folder)
    shown = run(capsys, "estimate", "bad.csv", "--cell", CELL)
    assert (shown.code, shown.out) == (2, "")
    assert [part for part in parts if part not in shown.err] == []
    assert tree(folder) == before


def test_other_results_are_not_touched(capsys, folder):
    estimate(capsys, "--estimator", "coulomb", "--out", "out")
    (folder / "out" / "mine.txt").write_text("keep")
    kept = tree(folder)
    shown = run(capsys, "estimate", "log.csv", "--cell", CELL, "--estimator", "coulomb", "--out", "out")
    assert (shown.code, tree(folder)) == (2, kept)
    assert "also mine.txt" in shown.err
    (folder / "compared").mkdir()
    (folder / "compared" / "manifest.json").write_text('{"format": "socwise comparison", "files": []}')
    shown = run(capsys, "estimate", "log.csv", "--cell", CELL, "--out", "compared")
    assert shown.code == 2
    assert "holds a socwise comparison" in shown.err


def test_a_damaged_file_says_so(tmp_path):
    (tmp_path / "ekf.nc").write_bytes(b"CDF\x02 and no more")
    with pytest.raises(StoreError, match="damaged"):
        read_series(tmp_path / "ekf.nc")


def test_the_documentation_holds(folder, capsys):
    page = (Path(__file__).parents[1] / "docs" / "estimate.md").read_text(encoding="utf-8")
    example = re.search(
        r"```\{code-block\} text\n:caption: log\.csv\n(.*?)^```$", page, re.DOTALL | re.MULTILINE
    )
    (folder / "log.csv").write_text(example[1])
    code = re.search(r"```\{code-block\} python\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    exec(compile(code[1], "estimate.md", "exec"), {})
    shown = capsys.readouterr().out
    assert shown.startswith("10 1.0 ('the voltage is missing in 1 of 10 samples',) SocBelief(mean=0.")
    command = run(capsys, "estimate", "log.csv", "--cell", CELL, "--estimator", "coulomb")
    assert command.code == 0


def test_json_knows_no_nan(runs):
    log, made = runs
    result = to_json(log, CELL, made)
    json.dumps(result, allow_nan=False)
    assert result["estimators"][0]["residual_rms_V"] is None


def test_figures_show_belief_band_and_log(runs):
    _, made = runs
    ax = plot_estimated_soc(made)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time [s]", "SOC [%]")
    assert [line.get_label() for line in ax.lines] == [
        "Coulomb counting ± 2 sd", "EKF ± 2 sd", "gPC Gauss-Newton ± 2 sd", "log",
    ]  # fmt: skip
    np.testing.assert_allclose(ax.lines[1].get_ydata().max(), 100.0 * made[1].trace.soc.max())
    np.testing.assert_allclose(ax.lines[3].get_ydata().min(), 100.0 * made[1].soc_true.min())
    band = ax.collections[0].get_datalim(ax.transData)
    assert (band.y0, band.y1) == pytest.approx((0.0, 100.0))
    error = plot_soc_error(made[1:2])
    low = error.collections[0].get_datalim(error.transData).y0
    assert low == pytest.approx(-200.0 * np.sqrt(made[1].trace.variance[::3].max()), rel=1e-2)
    assert plot_estimated_soc(made, ax) is ax


def test_figures_of_parameters_and_residuals(runs):
    _, made = runs
    assert parameter_names(made)[:2] == ["capacity_Ah", "resistance_ohm"]
    assert parameter_names(made[:1]) == []
    ax = plot_estimated_parameter(made, "resistance_ohm", 0.008)
    assert ax.get_ylabel() == "resistance [mΩ]"
    final = {line.get_label(): line.get_ydata()[-1] for line in ax.lines}
    assert final["nominal"] == 8.0
    gauss_newton = made[NAMES.index("gpc_gauss_newton")]
    shown = final["gPC Gauss-Newton ± 2 sd"]
    assert shown == pytest.approx(1e3 * gauss_newton.parameters["resistance_ohm"].value, rel=0.01)
    residual = plot_residual(gauss_newton)
    assert residual.get_ylabel() == "residual [mV]"
    assert f"{1e3 * gauss_newton.residual_rms_V:.3g} mV" in residual.get_title()


@pytest.mark.parametrize(("duration_s", "unit"), [(60.0, "s"), (7200.0, "h"), (1e6, "d")])
def test_time_is_shown_in_a_unit_that_can_be_read(duration_s, unit):
    assert time_scale(duration_s)[1] == unit

"""Estimators as C: the same bits as in Python, under every fault, and nothing that embedded targets lack."""

import math
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from export_cases import Compiled, compiled, drive, in_python
from fmu_files import COMPILER, needs_compiler

from bms.cells import load_cell
from bms.errors import BatteryError
from bms.estimators.catalogue import estimator_names, make_estimator
from bms.estimators.gate import Sensors
from bms.export.c_source import export_c
from bms.export.replay import write_replay
from bms.flags import Flag
from bms.logged_data import LoggedData
from bms.simulation import simulate
from drivecycles.library import load_cycle

CELL_OF = dict(
    zip(
        ("coulomb", "ekf", "ukf", "gpc_gradient", "gpc_gauss_newton", "gpc_ekf"),
        ("nmc-lgm50", "a123-26650", "nmc-lgm50", "a123-26650", "nmc-lgm50", "lfp-2ah"),
        strict=True,
    )
)
EVERYTHING = ("capacity_Ah", "resistance_ohm", "relaxation_resistance_ohm", "relaxation_capacitance_F")
VARIANTS = [
    ("ekf", "lfp-2ah", {"estimate": ()}, "from"),
    ("ekf", "a123-26650", {"estimate": (), "watches": False, "model_error_V": 0.0}, "until"),
    ("ekf", "nmc-lgm50", {"estimate": EVERYTHING, "current_bias": True, "flat_slope_V": 0.1}, "until"),
    ("ukf", "a123-26650", {"estimate": EVERYTHING, "current_bias": True, "kappa": 0.0}, "from"),
    ("gpc_gradient", "a123-26650", {"terms": 1, "current_bias": True, "resets_at_rest": True}, "until"),
    ("gpc_gauss_newton", "nmc-lgm50", {"terms": 8, "every_s": 5.0, "flat_slope_V": 0.1}, "from"),
    ("gpc_ekf", "lfp-2ah", {"order": 0}, "until"),
    ("gpc_ekf", "a123-26650", {"order": 3, "nodes": "tensor", "estimate": ()}, "from"),
    ("gpc_ekf", "nmc-lgm50", {"estimate": EVERYTHING, "current_bias": True}, "from"),
    ("coulomb", "a123-26650", {"resets_at_full": False}, "until"),
]


def drive_over(cell, cycle):
    """Current of a vehicle that the cell drives along a cycle: acceleration and drag, up to 2 C."""
    speed = cycle.speed_mps
    power = speed * (np.gradient(speed, cycle.time_s) + 0.1 + 0.0004 * speed**2)
    return -2.0 * cell.capacity_Ah * power / np.abs(power).max()


def logged(cell, current_A, time_s, seed=0):
    """A log of a cell along a current, with the sensors' noise."""
    rng = np.random.default_rng(seed)
    clean = simulate(cell, current_A, np.diff(time_s, append=2.0 * time_s[-1] - time_s[-2]), soc=0.7)
    return LoggedData(
        time_s,
        current_A + 0.01 * rng.normal(size=time_s.size),
        clean.voltage_V + 0.002 * rng.normal(size=time_s.size),
    )


def same_bits(a, b):
    return np.array_equal(a, b, equal_nan=True)


@needs_compiler
@pytest.mark.parametrize("name", estimator_names())
def test_every_estimator_gives_the_same_bits_in_c(name, tmp_path):
    cell = load_cell(CELL_OF[name])
    estimator = make_estimator(name, cell, soc=0.6, soc_sd=0.2)
    samples = drive(cell)
    block = compiled(estimator, f"{name}_block", tmp_path)
    expected = in_python(estimator, samples)
    assert same_bits(block.run(samples), expected)
    # The samples lead through every branch of the gate.
    seen = np.bitwise_or.reduce(expected[:, 3].astype(int))
    wanted = Flag.CURRENT_MISSING | Flag.VOLTAGE_MISSING | Flag.CURRENT_RANGE | Flag.VOLTAGE_RANGE
    wanted |= Flag.STUCK | Flag.GAP | Flag.REST | Flag.FULL
    assert seen & wanted == wanted
    # Another belief at the start is the estimator that is made with it.
    other = make_estimator(name, cell, soc=0.35, soc_sd=0.06)
    assert block.start(0.35, 0.06) == 0
    assert np.allclose(block.read()[:2], (0.35, 0.06**2), rtol=1e-15)
    part = samples.part(0, 700)
    np.testing.assert_allclose(block.run(part), in_python(other, part), rtol=1e-12, atol=1e-300)


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize(("name", "cell", "options", "holds"), VARIANTS, ids=range(len(VARIANTS)))
def test_options_are_worked_into_the_c(name, cell, options, holds, tmp_path):
    cell = load_cell(cell).scaled(4, 2)
    sensors = Sensors(holds=holds, ambient_C=10.0)
    estimator = make_estimator(name, cell, sensors=sensors, **options)
    samples = drive(cell, seed=1)
    block = compiled(estimator, "block", tmp_path)
    assert same_bits(block.run(samples), in_python(estimator, samples))


@needs_compiler
def test_a_full_cycle_is_replayed_to_the_last_bit(tmp_path):
    cell, cycle = load_cell("a123-26650"), load_cycle("larsson")
    log = logged(cell, drive_over(cell, cycle), cycle.time_s)
    estimator = make_estimator("ekf", cell)
    replay = write_replay(tmp_path, estimator, log, "bms")
    assert replay.compile.startswith("cc -std=c99")
    strict = [COMPILER, "-Wall", "-Wextra", "-Werror", "-pedantic", *replay.compile.split()[1:]]
    subprocess.run(strict, cwd=tmp_path, check=True)
    done = subprocess.run(
        [tmp_path / "bms_replay", replay.data, "1e-15"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{len(log)} samples, 0 of 10 results differ" in done.stdout
    # One result that is off by a little more than the tolerance, and the replay says so.
    lines = replay.data.read_text().splitlines()
    values = lines[1000].split(",")
    values[4] = repr(float(values[4]) + 1e-8)
    lines[1000] = ",".join(values)
    replay.data.write_text("\n".join(lines))
    done = subprocess.run([tmp_path / "bms_replay", replay.data], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "1 of 10 results differ" in done.stdout
    assert subprocess.run([tmp_path / "bms_replay"], capture_output=True, check=False).returncode == 2


@needs_compiler
def test_what_was_learnt_is_exported(tmp_path):
    cell = load_cell("lfp-2ah")
    estimator, samples = make_estimator("ekf", cell, soc=0.5), drive(cell, 1500, sags=False)
    first, second = samples.part(0, 1000), samples.part(1000)
    whole = in_python(estimator, samples)
    estimator.run(first.current_A, first.voltage_V, first.step_s)
    block = compiled(estimator, "later", tmp_path)
    assert same_bits(block.read(), whole[999])
    assert same_bits(block.run(second), whole[1000:])
    # The default belief is the state as exported, correlations and all.
    assert block.start(estimator.belief.mean, math.sqrt(estimator.belief.variance)) == 0
    assert same_bits(block.run(second), whole[1000:])


@needs_compiler
def test_a_state_is_plain_memory(tmp_path):
    """Copied bytes go on as the original; what is refused leaves them alone."""
    cell = load_cell("nmc-lgm50")
    samples = drive(cell, 300, sags=False)
    block = compiled(make_estimator("gpc_gradient", cell), "plain", tmp_path)
    block.run(samples.part(0, 200))
    kept = bytes(block.state)
    ahead = block.run(samples.part(200))
    block.state[:] = list(type(block.state).from_buffer_copy(kept))
    assert same_bits(block.run(samples.part(200)), ahead)
    before = bytes(block.state)
    for step in (-1.0, math.nan, math.inf):
        assert block.update(1.0, 3.7, step, math.nan) == 1
    for soc, soc_sd in ((-0.1, 0.1), (1.1, 0.1), (0.5, -0.1), (0.5, 2.0), (math.nan, 0.1), (0.5, math.nan)):
        assert block.start(soc, soc_sd) == 1
    assert bytes(block.state) == before


@needs_compiler
def test_below_absolute_zero_means_not_measured(tmp_path):
    cell = load_cell("a123-26650")
    block = compiled(make_estimator("ekf", cell), "cold", tmp_path)
    samples = drive(cell, 100, sags=False)
    without = block.run(samples)
    block.init()
    samples.temperature_C[:] = block.block.inputs[2].start
    assert samples.temperature_C[0] < -273.15
    assert same_bits(block.run(samples), without)


@needs_compiler
def test_the_object_needs_mathematics_and_nothing_else(tmp_path):
    """No heap, no files, no variables of its own: what it takes from elsewhere is a handful of functions."""
    block = Compiled(export_c(make_estimator("gpc_ekf", load_cell("a123-26650")), "lean"), tmp_path)
    subprocess.run([COMPILER, "-std=c99", "-c", "lean.c", "-o", "lean.o"], cwd=tmp_path, check=True)
    listed = subprocess.run(["nm", "lean.o"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    symbols = [line.split()[-2:] for line in listed.splitlines()]
    assert {name for kind, name in symbols if kind == "U"} <= {"copysign", "exp", "sqrt", "memcpy", "memset"}
    assert [name for kind, name in symbols if kind in "bBdDcC"] == []
    public = {name for kind, name in symbols if kind == "T"}
    assert public == {"lean_init", "lean_start", "lean_update", "lean_read"}
    code = re.sub(r"/\*.*?\*/", "", block.block.source, flags=re.DOTALL)
    assert re.search(r"\b(malloc|calloc|realloc|free|goto)\b", code) is None


def test_ports_say_what_they_are():
    estimator = make_estimator("ekf", load_cell("lfp-2ah"), soc=0.4, soc_sd=0.1)
    block = export_c(estimator, "bms")
    assert [port.name for port in block.inputs] == ["current_A", "voltage_V", "temperature_C"]
    assert block.inputs[1].start == pytest.approx(estimator.cell.ocv(0.4))
    outputs = {port.name: port for port in block.outputs}
    assert list(outputs)[:4] == ["soc", "soc_variance", "residual_V", "flags"]
    assert (outputs["soc"].start, outputs["soc_variance"].start) == (0.4, pytest.approx(0.01))
    assert outputs["flags"].kind == "integer"
    for name, estimate in estimator.parameters.items():
        assert (outputs[name].start, outputs[f"{name}_sd"].start) == (estimate.value, estimate.sd)
    assert (outputs["capacity_Ah"].unit, outputs["resistance_ohm"].unit) == ("Ah", "ohm")
    assert [(port.name, port.start) for port in block.parameters] == [
        ("soc_start", 0.4),
        ("soc_sd_start", pytest.approx(0.1)),
    ]
    assert block.state_bytes == 8 * (estimator._memory.size + estimator._row.size)
    for port in block.outputs:
        assert re.search(rf"^    (double|long) {port.c_expression};", block.header, re.MULTILINE)


def test_the_text_is_ascii_and_the_same_every_time():
    cell = load_cell("lfp-2ah").model_copy(update={"name": "Zelle 4 µΩ */ #"})
    one, other = (export_c(make_estimator("ekf", cell), "bms") for _ in range(2))
    assert (one.header, one.source) == (other.header, other.source)
    assert (one.header + one.source).isascii()
    assert max(map(len, one.source.splitlines())) <= 130


@pytest.mark.parametrize("name", ["", "1st", "a-b", "double", "a" * 32, "grüße", "exp"])
def test_names_that_c_does_not_take_are_refused(name):
    with pytest.raises(BatteryError, match="a block cannot be called"):
        export_c(make_estimator("coulomb", load_cell("lfp-2ah")), name)


@needs_compiler
def test_the_page_on_export_compiles_and_runs(tmp_path, monkeypatch, capsys):
    page = (Path(__file__).parents[1] / "docs" / "export.md").read_text("utf-8")
    python = re.findall(r"^```\{code-block\} python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    (main,) = re.findall(
        r"^```\{code-block\} c\n:caption: main.c\n(.*?)^```$", page, re.MULTILINE | re.DOTALL
    )
    monkeypatch.chdir(tmp_path)
    exec(compile(python[0], "export.md", "exec"), {})
    assert "bytes of state; soc soc_variance" in capsys.readouterr().out
    Path("main.c").write_text(main)
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]
    subprocess.run([COMPILER, *strict, "-o", "demo", "main.c", "bms.c", "-lm"], check=True)
    done = subprocess.run([tmp_path / "demo"], capture_output=True, text=True, check=True)
    assert re.search(r"SOC 0\.\d{4}, variance .*, resistance 0\.0\d+ ohm", done.stdout)
    exec(compile(python[1], "export.md", "exec"), {})
    told = capsys.readouterr().out.splitlines()
    subprocess.run(told[0].split(), check=True)
    subprocess.run(told[1].split(), check=True, capture_output=True)

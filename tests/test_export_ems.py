"""A policy as C and as an FMU decides as it does in Python; its tables in every form hold the same."""

import ctypes
import math
import subprocess

import numpy as np
import pytest
from command_line import run, write_cycle
from ems_cases import full_problem, short_problem
from export_fmus import compile_c, fmu_of, load_block, run_alone, undefined_symbols
from fmu_files import needs_compiler

from bms import SocBelief
from bms.errors import BatteryError
from drivecycles import load_cycle
from ems import EmsError, GridSettings, build_policy, build_problem, load_concept
from ems.export.c_source import REFUSALS, export_policy
from ems.export.layout import Layout, Member
from ems.export.tables import narrowed, tables_of
from ems.policies import policy_names

pytestmark = needs_compiler
BOTH = pytest.mark.parametrize("version", [2, 3])
COLUMNS = ("control", "engine_torque_Nm", "battery_power_W", "fuel_kgps", "engine_on", "engine_next")


class Output(ctypes.Structure):
    """NAME_output."""

    _fields_ = (
        ("control", ctypes.c_long),
        ("engine_torque_Nm", ctypes.c_double),
        ("battery_power_W", ctypes.c_double),
        ("fuel_kgps", ctypes.c_double),
        ("engine_on", ctypes.c_int),
        ("engine_next", ctypes.c_int),
    )


class State(ctypes.Structure):
    """NAME_state."""

    _fields_ = (("step", ctypes.c_long), ("last", Output))


class InC:
    """A policy, compiled."""

    def __init__(self, source, folder):
        self.block = source.block
        library = load_block(source.block, folder)
        self._decide, self._start, self._update, self._read = (
            getattr(library, f"{source.block.name}_{name}") for name in ("decide", "start", "update", "read")
        )
        number, pointer = ctypes.c_double, ctypes.c_void_p
        self._decide.argtypes = (pointer, ctypes.c_long, number, number, ctypes.c_int, pointer)
        self._start.argtypes = (pointer, pointer, ctypes.c_int)
        self._update.argtypes = (pointer, pointer, *[number] * 4, pointer)
        self._read.argtypes = (pointer, pointer)
        self.table = ctypes.create_string_buffer(source.block.data)
        self.state, self.out = State(), Output()

    def decide(self, step, soc, variance, engine_on):
        code = self._decide(self.table, step, soc, variance, engine_on, ctypes.byref(self.out))
        return code, self.out

    def start(self, engine_on=False, table=None):
        return self._start(ctypes.byref(self.state), table or self.table, engine_on)

    def update(self, end, step, soc, variance):
        code = self._update(
            ctypes.byref(self.state), self.table, end, step, soc, variance, ctypes.byref(self.out)
        )
        return code, self.out


def row(out):
    return tuple(getattr(out, name) for name in COLUMNS)


def expected(policy, step, soc, variance, engine_on):
    """What the policy says in Python, as the columns of the output."""
    action, problem = policy.act(SocBelief(soc, variance), step, engine_on), policy.problem
    at = step, action.control
    return (
        action.control,
        problem.engine_torque_Nm[at],
        problem.stages.power_W[at],
        problem.fuel_kgps[at],
        int(engine_on),
        action.engine_next,
    )


def states(problem, count, seed=7):
    """Steps, beliefs in and beyond the grid's rows and window, and engine states."""
    rng = np.random.default_rng(seed)
    window = problem.concept.window
    for _ in range(count):
        soc = float(np.clip(rng.uniform(window.low - 0.2, window.high + 0.2), 0.0, 1.0))
        variance = float(rng.choice([0.0, rng.uniform(0.0, 0.15) ** 2]))
        yield int(rng.integers(problem.steps)), soc, variance, bool(rng.integers(2))


@pytest.mark.parametrize("concept", ["hev", "phev"])
@pytest.mark.parametrize("name", policy_names())
def test_decisions_are_the_same(name, concept, tmp_path):
    policy = build_policy(name, short_problem(concept))
    in_c = InC(export_policy(policy, "Pol_1"), tmp_path)
    seen = set()
    for state in states(policy.problem, 500):
        code, out = in_c.decide(*state)
        assert code == 0
        assert row(out) == expected(policy, *state)
        seen.add(row(out)[0])
    assert len(seen) > 3


def test_without_noise_a_policy_is_exported_as_well(tmp_path):
    """Levels and spread of zero: the single middle point, and no division by nothing."""
    from ems_cases import without_noise

    policy = build_policy("stochastic", without_noise(short_problem("hev")))
    in_c = InC(export_policy(policy), tmp_path)
    for step, soc, variance, engine_on in states(policy.problem, 300):
        p = min(variance, 1e-8)
        assert row(in_c.decide(step, soc, p, engine_on)[1]) == expected(policy, step, soc, p, engine_on)


def test_it_holds_its_decision_over_a_step_and_remembers_the_engine(tmp_path):
    policy = build_policy("stochastic", short_problem("hev"))
    in_c = InC(export_policy(policy), tmp_path)
    assert in_c.start() == 0
    engine_on, starts = False, 0
    for k in range(policy.problem.steps):
        soc, variance = 0.6 + 0.04 * math.sin(k / 15), 4e-4
        told = expected(policy, k, soc, variance, engine_on)
        for part in range(4):
            # The SOC of later parts of the step must not matter.
            code, out = in_c.update(k + 0.25 * (part + 1), 0.25, soc if part == 0 else 0.9, variance)
            assert code == 0
            assert row(out) == told
        starts += told[5] > told[4]
        engine_on = bool(told[5])
    assert starts > 0


def test_what_it_refuses_changes_nothing(tmp_path):
    policy = build_policy("stochastic", short_problem("hev"))
    in_c = InC(export_policy(policy), tmp_path)
    steps = policy.problem.steps
    assert in_c.start(True) == 0
    assert in_c.update(1.0, 1.0, 0.6, 1e-4)[0] == 0
    before = bytes(in_c.state)
    bad, beyond, long_step, wrong_table = range(1, 5)
    nan, inf = float("nan"), float("inf")
    for arguments, code in (
        ((2.0, 1.0, nan, 1e-4), bad),
        ((2.0, 1.0, 1.01, 1e-4), bad),
        ((2.0, 1.0, -0.01, 1e-4), bad),
        ((2.0, 1.0, 0.6, -1e-9), bad),
        ((2.0, 1.0, 0.6, nan), bad),
        ((2.0, 1.0, 0.6, inf), bad),
        ((3.0, 2.0, 0.6, 1e-4), long_step),
        ((2.5, 1.0, 0.6, 1e-4), long_step),
        ((2.0, 0.0, 0.6, 1e-4), long_step),
        ((2.0, nan, 0.6, 1e-4), long_step),
        ((steps + 1.0, 1.0, 0.6, 1e-4), beyond),
        ((0.0, 1.0, 0.6, 1e-4), beyond),
        ((nan, 1.0, 0.6, 1e-4), beyond),
        ((1e300, 1.0, 0.6, 1e-4), beyond),
    ):
        assert in_c.update(*arguments)[0] == code, arguments
        assert bytes(in_c.state) == before
    assert len(REFUSALS) == wrong_table
    other = ctypes.create_string_buffer(
        export_policy(build_policy("stochastic", short_problem("phev"))).block.data
    )
    assert in_c.start(table=other) == wrong_table
    assert bytes(in_c.state) == before
    assert in_c.decide(-1, 0.6, 1e-4, 0)[0] == beyond
    assert in_c.decide(steps, 0.6, 1e-4, 0)[0] == beyond


@pytest.mark.parametrize("name", ["perfect_information", "rule_based"])
def test_linked_tables_are_those_of_the_file_and_nothing_needs_a_heap(name, tmp_path):
    source = export_policy(build_policy(name, short_problem("hev", 40)), "car")
    source.block.write(tmp_path)
    (tmp_path / "car_data.c").write_text("".join(source.data_source()))
    (tmp_path / "main.c").write_text(
        '#include "car.h"\n#include <stdio.h>\n'
        "int main(void)\n{\n    return fwrite(&car_data, sizeof car_data, 1, stdout) == 1 ? 0 : 1;\n}\n"
    )
    program = compile_c(tmp_path, ["main.c", "car.c", "car_data.c"], tmp_path / "main")
    done = subprocess.run([str(program)], capture_output=True, check=True)
    assert done.stdout == source.block.data
    compile_c(tmp_path, ["car.c"], tmp_path / "car.o", "-c")
    assert undefined_symbols(tmp_path / "car.o") <= {"sqrt"}


def test_repeated_controls_are_left_out():
    policy = build_policy("stochastic", short_problem("hev"))
    members = {member.name: member.values for member in export_policy(policy).layout.members}
    power_W, cost_kg = policy.problem.stages.power_W, policy.problem.stages.cost_kg
    steps, controls = power_W.shape
    assert members["power_W"].size < steps * controls
    first, number = members["first_choice"], members["control"]
    for k in range(steps):
        kept = number[first[k] : first[k + 1]].tolist()
        assert kept[:2] == [0, 1]
        for c in set(range(controls)) - set(kept):
            same = max(other for other in kept if other < c)
            assert (power_W[k, c], cost_kg[k, c]) == (power_W[k, same], cost_kg[k, same])


def test_a_narrowed_policy_decides_the_same_inside(tmp_path):
    """Far enough inside that neither a step nor a measurement leads out."""
    policy = build_policy("stochastic", short_problem("hev"))
    whole = tables_of(policy)
    part = narrowed(whole, 0.5, 0.8)
    assert part.basis.soc[0] <= 0.5 <= 0.8 <= part.basis.soc[-1]
    assert part.basis.cost_to_go_kg.size < 0.75 * whole.basis.cost_to_go_kg.size
    in_c = InC(export_policy(part), tmp_path)
    for step, soc, _, engine_on in states(policy.problem, 600):
        inside = 0.56 + 0.18 * soc
        assert row(in_c.decide(step, inside, 1e-4, engine_on)[1]) == expected(
            policy, step, inside, 1e-4, engine_on
        )
    for low, high in ((0.8, 0.5), (0.95, 1.0), (0.0, 0.3)):
        with pytest.raises(EmsError, match="leaves nothing"):
            narrowed(whole, low, high)
    rules = tables_of(build_policy("rule_based", policy.problem))
    assert narrowed(rules, 0.5, 0.8) is rules


def test_names_and_layout():
    policy = build_policy("rule_based", short_problem("hev"))
    with pytest.raises(BatteryError, match="cannot be called '2fast'"):
        export_policy(policy, "2fast")
    with pytest.raises(ValueError, match="padding"):
        _ = Member("x", np.zeros((3, 3), dtype=np.float32), "").bytes
    one = Layout((Member("x", np.arange(3, dtype=np.float32), "odd"),))
    assert len(one.image()) == 8 + 4 * 4
    other = Layout((Member("x", np.arange(3, dtype=np.float32) + 1, "odd"),))
    assert one.check != other.check
    # The largest and the smallest numbers come back from their text.
    extremes = np.array([np.finfo(np.float32).max, np.finfo(np.float32).tiny, -1 / 3], dtype=np.float32)
    text = "".join(Layout((Member("x", extremes, ""),)).initialiser("n"))
    numbers = text.partition("/* x */")[2].split("}")[0].replace("{", "").replace("f", "").split(",")
    assert [np.float32(number) for number in numbers[:3]] == extremes.tolist()


def drive(policy, seed=1):
    """A full cycle: a SOC that wanders, with its variance, and what the policy says to it."""
    steps = policy.problem.steps
    rng = np.random.default_rng(seed)
    window = policy.problem.concept.window
    middle = 0.5 * (window.low + window.high)
    soc = np.clip(middle + np.cumsum(rng.normal(0.0, 0.004, steps)), window.low - 0.1, window.high + 0.1)
    variance = np.square(0.02 + 0.015 * np.sin(np.arange(steps) / 60.0))
    told, engine_on = [], False
    for k in range(steps):
        told.append(expected(policy, k, float(soc[k]), float(variance[k]), engine_on))
        engine_on = bool(told[-1][5])
    return soc, variance, np.array(told, dtype=np.float64)


def check_fmu(policy, version, tmp_path, tmp_path_factory):
    source = export_policy(policy)
    path = fmu_of(source.block, version, tmp_path_factory, timing=source.timing, refusals=REFUSALS)
    soc, variance, told = drive(policy)
    steps = policy.problem.steps
    inputs = {
        "time": np.arange(steps + 1.0),
        "soc": np.append(soc, soc[-1]),
        "soc_variance": np.append(variance, variance[-1]),
    }
    problems, result = run_alone(path, tmp_path, inputs=inputs, stop=float(steps))
    assert problems == []
    got = np.column_stack([result[name] for name in COLUMNS])
    assert got.shape == (steps + 1, len(COLUMNS))
    assert got[0].tolist() == [0.0] * len(COLUMNS)
    assert np.array_equal(got[1:, 0], told[:, 0])
    assert got[1:] == pytest.approx(told, rel=0.0, abs=1e-9)
    assert 0 < told[:, 4].sum() < steps


@BOTH
def test_a_whole_cycle_as_an_fmu_where_socwise_is_not(version, tmp_path, tmp_path_factory):
    coarse = GridSettings(soc_step=0.01, deterministic_soc_step=0.005, variance_rows=5, torque_levels=7)
    problem = build_problem(load_concept("hev"), load_cycle("ftp72"), settings=coarse)
    check_fmu(build_policy("stochastic", problem), version, tmp_path, tmp_path_factory)


@pytest.mark.slow
@pytest.mark.parametrize(("concept", "version"), [("hev", 2), ("phev", 3)])
@pytest.mark.parametrize("name", policy_names())
def test_whole_cycles_of_all_policies_on_their_full_grids(name, concept, version, tmp_path, tmp_path_factory):
    check_fmu(build_policy(name, full_problem(concept)), version, tmp_path, tmp_path_factory)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_cycle(tmp_path / "trip.csv")
    return tmp_path


@pytest.mark.parametrize("name", ["stochastic", "certainty_equivalent", "perfect_information"])
def test_a_policy_file_holds_all_that_is_exported(capsys, folder, name):
    from socwise.commands.policy_tables import read_policy

    arguments = ("solve", "--cycle", "trip.csv", "--policy", name, "--mu", "0.002", "--out", "p.nc")
    assert run(capsys, *arguments).code == 0
    policy = build_policy(name, build_problem(load_concept("hev"), load_cycle("trip.csv")).with_mu(0.002))
    direct, read = tables_of(policy), read_policy(folder / "p.nc")
    assert (read.policy, read.concept, read.cycle, read.step_s) == (name, "hev", "trip", 1.0)
    ours = {m.name: m.values for m in export_policy(direct).layout.members}
    theirs = {m.name: m.values for m in export_policy(read).layout.members}
    assert ours.keys() == theirs.keys()
    for member, values in ours.items():
        assert np.array_equal(values, theirs[member]), member
    assert read.basis.soc_step == pytest.approx(direct.basis.soc_step, rel=1e-14)
    assert read.basis.scalars == direct.basis.scalars


def test_the_command(capsys, folder):
    assert run(capsys, "solve", "--cycle", "trip.csv", "--out", "p.nc").code == 0
    shown = run(capsys, "export", "ems", "p.nc", "--form", "c,fmu3", "--name", "car", "--out", "there")
    assert shown.code == 0, shown.err
    assert "MB of constant memory" in shown.err
    assert sorted(path.name for path in (folder / "there").iterdir()) == [
        "car-fmi3.fmu", "car.bin", "car.c", "car.h", "car_data.c",
    ]  # fmt: skip
    small = run(
        capsys, "export", "ems", "p.nc", "--form", "c", "--soc", "0.6,0.7", "--out", "narrow", "--json"
    )
    assert small.code == 0
    assert '"table_bytes"' in small.out
    narrow = (folder / "narrow" / "ems.bin").stat().st_size
    assert narrow < 0.5 * (folder / "there" / "car.bin").stat().st_size
    rules = run(capsys, "export", "ems", "rule-based", "--cycle", "trip.csv", "--form", "c", "--out", "r")
    assert (rules.code, rules.err) == (0, "")


def test_what_the_command_cannot_do(capsys, folder, monkeypatch):
    for arguments, says in (
        (("p.nc",), "no policy file"),
        (("trip.csv",), "is no policy file of socwise"),
        (("p.nc", "--form", "exe"), "known are c, fmu2, fmu3"),
        (("p.nc", "--soc", "0.5"), "two fractions"),
        (("rule-based", "--cycle", "trip.csv", "--name", "a b", "--form", "c"), "cannot be called"),
    ):
        shown = run(capsys, "export", "ems", *arguments)
        assert shown.code == 2
        assert says in shown.err
        assert len(shown.err.splitlines()) == 1
    monkeypatch.setenv("CC", "no-such-compiler")
    shown = run(capsys, "export", "ems", "rule-based", "--cycle", "trip.csv", "--form", "fmu2", "--out", "x")
    assert (shown.code, shown.out) == (2, "")
    assert "needs a C compiler" in shown.err
    assert not list((folder / "x").glob("*"))


def test_a_pack_of_ones_own_needs_its_concept(capsys, folder):
    from command_line import preset_text

    from bms.library import PRESETS
    from socwise.commands.errors import CommandError
    from socwise.commands.policy_tables import read_policy

    concept = load_concept("hev")
    pack = (PRESETS / f"{concept.pack}.toml").read_text(encoding="utf-8")
    (folder / "own_pack.toml").write_text(pack, encoding="utf-8")
    text = preset_text("hev").replace(f'pack = "{concept.pack}"', 'pack = "own_pack.toml"')
    assert "own_pack" in text
    (folder / "own.toml").write_text(text, encoding="utf-8")
    assert run(capsys, "solve", "--concept", "own.toml", "--cycle", "trip.csv", "--out", "p.nc").code == 0
    with pytest.raises(CommandError, match=r"--concept FILE\.toml"):
        read_policy(folder / "p.nc")
    own = load_concept(folder / "own.toml")
    assert read_policy(folder / "p.nc", own).basis.known is not None
    with pytest.raises(CommandError, match="is not the one"):
        read_policy(folder / "p.nc", load_concept("phev"))

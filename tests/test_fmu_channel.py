"""A running FMU in this process, against fmpy's own simulation of it, and against closed forms."""

import ctypes
import gc
import math
import os
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from fmu_files import COMPILER, REFERENCES, build_fmu, needs_compiler

from bms.plants.fmu import library, logs
from bms.plants.fmu.archive import unpack
from bms.plants.fmu.channel import Wiring
from bms.plants.fmu.cvode import ROOT, Cvode
from bms.plants.fmu.description import Variable
from bms.plants.fmu.errors import FmuCrash, FmuError
from bms.plants.fmu.in_process import open_channel
from bms.plants.fmu.restore import keep_way, kept_way
from bms.plants.fmu.values import TYPES_3, Port, Reader

BOTH = pytest.mark.parametrize("fmi", ["2.0", "3.0"])
KINDS = pytest.mark.parametrize("kind", ["co-simulation", "model-exchange"])
OUTPUTS = ("voltage", "soc", "temperature", "crossings")
MOST_US = 5.0


def wiring(kind="co-simulation", **changes):
    values = {"input": "current", "outputs": OUTPUTS, "starts": ("initial_soc",), "tolerance": 1e-9} | changes
    return Wiring(kind=kind, **values)


@pytest.fixture(scope="module", params=["2.0", "3.0"])
def folder(request, tmp_path_factory):
    """An unpacked FMU of either version."""
    if COMPILER is None:
        pytest.skip("there is no C compiler called cc")
    path = build_fmu(tmp_path_factory.mktemp("fmu"), fmi=request.param, event_time=21.5, kick=0.05)
    with unpack(path) as found:
        yield found


@pytest.fixture
def opened(folder):
    """Open channels that are closed in the end."""
    channels = []

    def open_one(kind="co-simulation", **changes):
        channels.append(open_channel(folder, wiring(kind, **changes)))
        return channels[-1]

    yield open_one
    for channel in channels:
        channel.close()


def drive_A(steps=60):
    return np.repeat(np.random.default_rng(5).normal(0.0, 4.0, steps // 4), 4)


@needs_compiler
@KINDS
def test_the_channel_is_fmpys_simulation(kind, folder, opened):
    """After every step, events included; at the start fmpy lets the first current flow already."""
    from fmpy import simulate_fmu

    current_A = drive_A()
    channel = opened(kind)
    channel.start((0.55,))
    found = np.array([channel.step(float(current), 1) for current in current_A])
    held = np.array(list(enumerate(current_A)), dtype=[("time", float), ("current", float)])
    theirs = simulate_fmu(
        str(folder),
        fmi_type="CoSimulation",
        stop_time=float(current_A.size),
        output_interval=1.0,
        start_values={"initial_soc": 0.55},
        input=held,
        output=list(OUTPUTS),
    )
    expected = np.column_stack([theirs[name] for name in OUTPUTS])[1:]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12 if kind[0] == "c" else 1e-7)
    assert abs(found[21, 0] - found[20, 0]) > 0.04


@needs_compiler
@KINDS
def test_several_steps_at_once_are_the_same_as_one_by_one(kind, opened):
    channel = opened(kind)
    channel.start((0.5,))
    once = channel.step(2.0, 30)
    channel.start((0.5,))
    single = [channel.step(2.0, 1) for _ in range(30)][-1]
    assert once == pytest.approx(single, abs=0.0 if kind[0] == "c" else 1e-8)


@needs_compiler
@KINDS
@pytest.mark.parametrize("way", ["reset", "state", "instance"])
def test_a_realization_knows_nothing_of_the_last(way, kind, folder):
    keep_way(folder, way)
    assert kept_way(folder) == way
    channel = open_channel(folder, wiring(kind))
    current_A = drive_A(24).tolist()
    runs = [
        [channel.start((soc,)), *(channel.step(current, 1) for current in current_A)]
        for soc in (0.6, 0.4, 0.6, 0.4)
    ]
    channel.close()
    keep_way(folder, "reset")
    assert runs[0] == runs[2]
    assert runs[1] == runs[3]
    assert runs[0][0][1] == 0.6
    assert runs[1][0][1] == 0.4


@needs_compiler
def test_inputs_and_parameters_arrive(opened):
    channel = opened(inputs=(("ambient_temperature", 310.0),), parameters=(("resistance_factor", 2.0),))
    plain = opened()
    start, _ = channel.start((0.5,)), plain.start((0.5,))
    assert start[2] == pytest.approx(310.0)
    rise = [each.step(10.0, 1)[0] - each.step(0.0, 1)[0] for each in (channel, plain)]
    assert rise[0] - rise[1] > 0.1


@needs_compiler
def test_order_of_calls_is_watched(opened, folder):
    channel = opened()
    with pytest.raises(FmuError, match="start one first"):
        channel.step(0.0, 1)
    with pytest.raises(FmuError, match="2 start values for 1"):
        channel.start((0.5, 0.5))
    channel.start((0.5,))
    channel.close()
    channel.close()
    with pytest.raises(FmuError, match="start one first"):
        channel.step(0.0, 1)
    with pytest.raises(FmuError, match="step_s"):
        open_channel(folder, wiring(outputs=("step_s",)))


@needs_compiler
@BOTH
def test_what_failed_is_not_continued_but_started_anew(fmi, tmp_path):
    path = build_fmu(tmp_path, fmi=fmi, fault="error", fault_time=3.0, fault_below_soc=0.4)
    with unpack(path) as folder:
        channel = open_channel(folder, wiring(outputs=("voltage",)))
        channel.start((0.3,))
        channel.step(0.0, 3)
        with pytest.raises(FmuCrash, match="from 3 s to 4 s"):
            channel.step(0.0, 1)
        with pytest.raises(FmuError, match="start one first"):
            channel.step(0.0, 1)
        channel.start((0.5,))
        assert channel.step(0.0, 10)[0] > 3.0
        channel.close()


def assert_no_leak(fmi, kind, way, count, folder):
    with unpack(build_fmu(folder, fmi=fmi)) as unpacked:
        keep_way(unpacked, way)
        channel = open_channel(unpacked, wiring(kind, outputs=("voltage",), tolerance=1e-3))
        before = 0, 0
        for at in range(count):
            channel.start((0.2 + 0.5 * at / count,))
            channel.step(1.0, 2)
            if at == count // 4:
                gc.collect()
                before = resident_bytes(), handles()
        gc.collect()
        grown = resident_bytes() - before[0]
        assert handles() == before[1]
        channel.close()
    assert grown < 2_000_000


@needs_compiler
@BOTH
def test_two_thousand_realizations_leak_nothing(fmi, tmp_path):
    assert_no_leak(fmi, "co-simulation", "reset", 2000, tmp_path)


@needs_compiler
@pytest.mark.slow
@KINDS
@BOTH
@pytest.mark.parametrize("way", ["reset", "state", "instance"])
def test_realizations_leak_nothing_in_any_way(way, fmi, kind, tmp_path):
    assert_no_leak(fmi, kind, way, 2000, tmp_path)


def resident_bytes():
    path = Path("/proc/self/statm")
    if not path.is_file():
        return 0
    return int(path.read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")


def handles():
    path = Path("/proc/self/fd")
    return len(list(path.iterdir())) if path.is_dir() else 0


@needs_compiler
def test_a_step_costs_little_more_than_fmpys_own(folder):
    """At most 5 microseconds above fmpy's set, doStep and get; the best of some tries, turn by turn."""
    channel = open_channel(folder, wiring(outputs=("voltage", "soc")))
    fmu = channel._instance._fmu
    kind = "Real" if channel._instance.version == 2 else "Float64"
    put, get = getattr(fmu, f"set{kind}"), getattr(fmu, f"get{kind}")
    drive, outputs = [REFERENCES["drive"]], [REFERENCES["voltage"], REFERENCES["soc"]]
    count, best = 400, [math.inf, math.inf]
    for _ in range(12):
        channel.start((0.5,))
        begin = time.perf_counter()
        for _ in range(count):
            channel.step(0.1, 1)
        best[0] = min(best[0], time.perf_counter() - begin)
        channel.start((0.5,))
        begin = time.perf_counter()
        for at in range(count):
            put(drive, [0.1])
            fmu.doStep(float(at), 1.0)
            get(outputs)
        best[1] = min(best[1], time.perf_counter() - begin)
    channel.close()
    assert 1e6 * (best[0] - best[1]) / count < MOST_US


@needs_compiler
@BOTH
def test_a_library_is_loaded_once_whatever_its_folder(fmi, tmp_path):
    here = Path.cwd()
    dlls = set()
    for kind in ("cs", "me", "both"):
        with unpack(build_fmu(tmp_path, fmi=fmi, kind=kind, file=f"{kind}.fmu")) as folder:
            channel = open_channel(folder, wiring("model-exchange" if kind == "me" else "co-simulation"))
            dlls.add(channel._instance.dll._handle)
            channel.close()
    assert len(dlls) == 1
    assert Path.cwd() == here
    assert len(library._loaded) <= 2


def test_a_log_is_kept_to_its_end():
    sink = logs.LogSink()
    for at in range(1000):
        sink.take(0, b"line %d " % at + bytes(10**5))
    assert sink.lines == 1000
    assert not sink.flooded
    assert "line 999" in sink.tail()
    assert len(sink.tail()) < 2 * logs.LINES * logs.LINE_BYTES
    sink.take(3, b"no licence")
    assert sink.tail() == "; it said: no licence"
    sink.clear()
    assert (sink.tail(), sink.lines) == ("", 0)


def test_a_flood_is_noticed_once():
    calls = []
    sink = logs.LogSink(lambda: calls.append(1))
    for _ in range(logs.FLOOD + 10):
        sink.take(0, b"")
    assert sink.flooded
    assert calls == [1]


FLOATS = """
#include <stddef.h>
static float f[4]; static unsigned char b[4]; static signed char s[4]; static _Bool t[4];
#define BOTH(Name, type, kept) \\
    int fmi3Set##Name(void *c, const unsigned *r, size_t n, const type *v, size_t m) \\
    { (void)c; for (size_t i = 0; i < n && n == m; i++) kept[r[i]] = v[i]; return 0; } \\
    int fmi3Get##Name(void *c, const unsigned *r, size_t n, type *v, size_t m) \\
    { (void)c; for (size_t i = 0; i < n && n == m; i++) v[i] = kept[r[i]]; return 0; }
BOTH(Float32, float, f) BOTH(UInt8, unsigned char, b) BOTH(Int8, signed char, s) BOTH(Boolean, _Bool, t)
"""


@needs_compiler
def test_numbers_of_any_type_go_in_and_out(tmp_path):
    """In an order that mixes types; what a Float32 cannot hold is rounded by it."""
    source, target = tmp_path / "floats.c", tmp_path / "floats.so"
    source.write_text(FLOATS)
    subprocess.run([COMPILER, "-shared", "-fPIC", "-o", str(target), str(source)], check=True)
    dll, component = ctypes.CDLL(str(target)), ctypes.c_void_p()
    kinds = ["Float32", "UInt8", "Float32", "Boolean", "Int8"]
    variables = tuple(
        Variable(f"v{at}", at % 4, kind, "output", "continuous", None, None, None, None, True)
        for at, kind in enumerate(kinds)
    )
    for variable, value in zip(variables, (0.1, 200, -2.5, True, -7), strict=True):
        port = Port(dll, 3, component, (variable,))
        port.values[0] = value
        assert port.set[1](*port.set[2]) == 0
    reader = Reader(dll, 3, component, variables)
    for port in reader.ports:
        assert port.get[1](*port.get[2]) == 0
    assert reader.numbers() == (float(np.float32(0.1)), 200.0, -2.5, 1.0, -7.0)
    assert {name for name, (_, number) in TYPES_3.items() if ctypes.sizeof(number) == 8} == {
        "Float64",
        "Int64",
        "UInt64",
        "Enumeration",
    }


def doubles(address, size):
    return (ctypes.c_double * size).from_address(address)


def solve(derivatives, x0, end, tolerance=1e-9, crossings=None, size=1):
    """Integrate to an end or an event."""
    no_roots = crossings is None
    solver = Cvode(size, 0 if no_roots else 1, derivatives, crossings or derivatives, tolerance)
    try:
        for at in range(size):
            solver.states[at], solver.nominals[at] = x0[at], 1.0
        solver.restart(0.0)
        flag, reached = 0, 0.0
        while flag in (0, 1) and reached < end:
            flag, reached = solver.advance(end)
        return flag, reached, list(solver.states)
    finally:
        solver.close()
        solver.close()


def decay(time_s, states, out):
    doubles(out, 1)[0] = -2.0 * doubles(states, 1)[0]
    return 0


def swing(time_s, states, out):
    x, v = doubles(states, 2)
    doubles(out, 2)[:] = [v, -x]
    return 0


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
def test_solver_decays_as_it_should(tolerance):
    flag, reached, (x,) = solve(decay, [1.0], 1.5, tolerance)
    assert (flag >= 0, reached) == (True, 1.5)
    assert x == pytest.approx(math.exp(-3.0), abs=20.0 * tolerance)


def test_solver_finds_an_event():
    """A pendulum from rest passes the middle after a quarter of its period."""

    def middle(time_s, states, out):
        doubles(out, 1)[0] = doubles(states, 2)[0]
        return 0

    flag, reached, states = solve(swing, [1.0, 0.0], 5.0, crossings=middle, size=2)
    assert flag == ROOT
    assert reached == pytest.approx(math.pi / 2.0, abs=1e-6)
    assert states == pytest.approx([0.0, -1.0], abs=1e-6)


def test_solver_never_asks_beyond_its_end():
    seen = []

    def watched(time_s, states, out):
        seen.append(time_s)
        return decay(time_s, states, out)

    solve(watched, [1.0], 0.7)
    assert max(seen) <= 0.7


def test_solver_gives_up_and_passes_on_what_was_raised():
    assert solve(lambda *_: -1, [1.0], 1.0)[0] < 0

    def interrupted(*_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        solve(interrupted, [1.0], 1.0)

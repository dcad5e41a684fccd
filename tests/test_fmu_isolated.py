"""An FMU in a process of its own: the same numbers, and whatever it does to itself ends one realization only.

The FMUs are real ones, compiled here, with faults of choice; nothing is left behind by any of them.
"""

import gc
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest
from fmu_files import FAULTS, build_fmu, needs_compiler

from bms.plants.fmu import process
from bms.plants.fmu.archive import unpack
from bms.plants.fmu.channel import Wiring
from bms.plants.fmu.errors import FmuCrash, FmuError
from bms.plants.fmu.in_process import open_channel
from bms.plants.fmu.isolated import IsolatedChannel, Limits
from bms.plants.fmu.pipes import ThreadedPipes

pytestmark = [
    needs_compiler,
    pytest.mark.skipif(sys.platform != "linux", reason="looks for processes and handles in /proc"),
]

WIRING = Wiring(
    kind="co-simulation",
    input="current",
    outputs=("voltage", "soc", "temperature"),
    starts=("initial_soc", "fault", "fault_time", "fault_size"),
)
QUICK = Limits(step_deadline_s=0.4, start_deadline_s=20.0, close_deadline_s=0.4, memory_bytes=2**28)
SOUND = (0.7, 0.0, 0.0, 0.0)
WAITS_S = 10.0


def fault(name, size=0.0):
    """Start values of a realization that goes wrong in its third step."""
    return (0.7, float(FAULTS[name]), 2.0, size)


def drive(channel, starts=SOUND, steps=5):
    """Outputs of a short realization."""
    return [channel.start(starts), *(channel.step(1.0 - k, 1) for k in range(steps))]


def children():
    """Processes that this one has started and not buried."""
    return {pid for each in Path("/proc/self/task").glob("*/children") for pid in each.read_text().split()}


def handles(pid="self"):
    """Number of open handles, the one that counts them included."""
    return sum(1 for _ in Path(f"/proc/{pid}/fd").iterdir())


def gone(pid):
    """Wait for a process to be gone, or dead and left to somebody else to bury."""
    due = time.monotonic() + WAITS_S
    while time.monotonic() < due:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
        except FileNotFoundError:
            return True
        if state == "Z":
            return True
        time.sleep(0.01)
    return False


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """An unpacked battery FMU of each version."""
    place = tmp_path_factory.mktemp("fmus")
    paths = [build_fmu(place, fmi=fmi, file=f"battery-{fmi}.fmu") for fmi in ("2.0", "3.0")]
    with unpack(paths[0]) as two, unpack(paths[1]) as three:
        yield {"2.0": two, "3.0": three}


@pytest.fixture
def channel(folders):
    """An isolated FMU that may take little, and nothing left of it afterwards."""
    before = children(), handles()
    channel = IsolatedChannel(folders["2.0"], WIRING, QUICK)
    yield channel
    channel.close()
    assert (children(), handles()) == before


@pytest.fixture(scope="module")
def shared(folders):
    """One for tests that leave it as they found it."""
    channel = IsolatedChannel(folders["2.0"], WIRING, QUICK)
    yield channel
    channel.close()


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize("kind", ["co-simulation", "model-exchange"])
def test_the_numbers_are_those_of_the_same_fmu_in_process(folders, fmi, kind):
    wiring = replace(WIRING, kind=kind)
    here, there = open_channel(folders[fmi], wiring), IsolatedChannel(folders[fmi], wiring, Limits())
    for soc in (0.7, 0.3):
        assert drive(there, (soc, 0.0, 0.0, 0.0)) == drive(here, (soc, 0.0, 0.0, 0.0))
    assert there.step(1.5, 7) == here.step(1.5, 7)
    here.close()
    there.close()


@pytest.mark.parametrize(
    ("starts", "message"),
    [
        (fault("segfault"), "in the step from 2 s to 3 s: its process ended: SIGSEGV, a bad memory access"),
        pytest.param(fault("stack"), "SIGSEGV, .* a stack overflow", marks=pytest.mark.slow),
        pytest.param(fault("abort"), "SIGABRT, it called abort", marks=pytest.mark.slow),
        pytest.param(fault("exit"), r"it left by exit\(3\)", marks=pytest.mark.slow),
        (fault("floating_point"), "SIGFPE, a floating-point trap"),
        pytest.param(fault("kill"), "SIGKILL, it was killed from outside", marks=pytest.mark.slow),
        (fault("endless"), "it gave no answer within 0.4 s and was killed"),
        pytest.param(
            fault("memory", 1e12), "SIGSEGV, .* or memory that it was refused", marks=pytest.mark.slow
        ),
        (fault("close_files"), "it closed its process's pipe"),
        pytest.param(fault("fatal"), "the cell has left at 2 s", marks=pytest.mark.slow),
    ],
    ids=lambda value: next((n for n, f in FAULTS.items() if f == value[1]), "") if len(value) == 4 else "",
)
def test_a_realization_ends_and_the_next_one_runs(shared, starts, message):
    sound = drive(shared)
    with pytest.raises(FmuCrash, match=message):
        drive(shared, starts)
    with pytest.raises(FmuError, match="start one first"):
        shared.step(1.0, 1)
    assert drive(shared) == sound


def test_what_is_asked_wrongly_costs_no_worker(shared):
    sound, worker = drive(shared), shared.pid
    with pytest.raises(FmuError, match="1 start values for 4") as refused:
        shared.start((0.5,))
    assert not isinstance(refused.value, FmuCrash)
    with pytest.raises(FmuError, match="start one first"):
        shared.step(1.0, 1)
    assert drive(shared) == sound
    assert shared.pid == worker


@pytest.mark.slow
def test_crashes_leave_no_handle_and_no_process(channel):
    before = handles(), len(children())
    for _ in range(3):
        with pytest.raises(FmuCrash):
            drive(channel, fault("segfault"))
        channel.start(SOUND)
    assert (handles(), len(children())) == before


def test_a_flood_of_the_streams_neither_blocks_nor_stays(channel):
    """More than any pipe holds, in one step; the end of it is kept, and quoted when the FMU dies later."""
    channel.start(fault("stream_flood", 2.0**24))
    for _ in range(2):
        channel.step(1.0, 1)
    channel.step(1.0, 1)
    os.kill(channel.pid, signal.SIGKILL)
    with pytest.raises(FmuCrash, match=r"SIGKILL.*its log ends: (y{200}\.\.\.; ){4}y{200}\.\.\.$"):
        channel.step(1.0, 1)


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_what_an_fmu_logs_is_known_when_it_dies(folders, fmi):
    channel = IsolatedChannel(folders[fmi], WIRING, QUICK)
    drive(channel, fault("warning"))
    os.kill(channel.pid, signal.SIGKILL)
    with pytest.raises(
        FmuCrash, match=r"its log ends: the cell is warm at 2 s; .*; the cell is warm at 4 s$"
    ):
        channel.step(1.0, 1)
    with pytest.raises(FmuCrash, match=r"integer division by zero$"):
        drive(channel, fault("floating_point"))
    channel.close()


def test_a_flood_of_log_lines_ends_in_the_middle(folders):
    channel = IsolatedChannel(folders["2.0"], WIRING, replace(QUICK, step_deadline_s=60.0))
    with pytest.raises(FmuCrash, match="floods its log: more than 100,000 lines"):
        drive(channel, fault("log_flood", 1e15))
    assert channel.pid is None
    channel.close()


def test_traps_that_an_fmu_leaves_on_stay_in_its_process(channel):
    channel.start(fault("trap_left_on"))
    channel.step(1.0, 3)
    assert float("inf") - float("inf") != 0.0
    assert drive(channel) != []


def test_an_fmu_that_does_not_survive_being_loaded(folders, tmp_path):
    before = children(), handles()
    with (
        unpack(build_fmu(tmp_path, fault="at_instantiate")) as folder,
        pytest.raises(FmuCrash, match="SIGSEGV"),
    ):
        IsolatedChannel(folder, WIRING, QUICK).start(SOUND)
    hangs = replace(QUICK, start_deadline_s=1.0)
    with (
        unpack(build_fmu(tmp_path, fault="endless_instantiate")) as folder,
        pytest.raises(FmuCrash, match="no answer within 1 s"),
    ):
        IsolatedChannel(folder, WIRING, hangs).start(SOUND)
    with pytest.raises(FmuError, match="'voltage'"):
        IsolatedChannel(folders["2.0"], replace(WIRING, outputs=("voltagee",)), QUICK)
    assert (children(), handles()) == before


@pytest.mark.parametrize("name", ["at_free", "endless_free", "at_terminate"])
def test_an_fmu_that_cannot_be_freed_is_ended_anyway(folders, name):
    before = children(), handles()
    channel = IsolatedChannel(folders["2.0"], WIRING, QUICK)
    drive(channel, fault(name))
    channel.close()
    channel.close()
    assert (children(), handles()) == before
    with pytest.raises(FmuError, match="has been closed"):
        channel.start(SOUND)


def test_a_fresh_worker_on_request_and_none_for_what_was_dropped(folders):
    before = children(), handles()
    channel = IsolatedChannel(folders["2.0"], WIRING, QUICK)
    first = channel.pid
    sound = drive(channel)
    channel.renew()
    assert channel.pid is None
    assert drive(channel) == sound
    assert children() - before[0] == {str(channel.pid)} != {str(first)}
    del channel
    gc.collect()
    assert (children(), handles()) == before


def test_many_realizations_leak_nothing(channel):
    """Pages of this process and of the worker after 200 and after 2,000 realizations."""
    worker = channel.pid

    def pages():
        return [int(Path(f"/proc/{pid}/statm").read_text().split()[1]) for pid in ("self", worker)]

    def run(count):
        for _ in range(count):
            channel.start(SOUND)
            channel.step(1.0, 1)
        return handles(), handles(worker)

    open_before, before = run(200), pages()
    open_after, after = run(1800), pages()
    assert open_after == open_before
    assert all(late - early < 256 for early, late in zip(before, after, strict=True))
    assert channel.pid == worker


def test_an_interrupted_step_is_not_taken_for_the_next(channel):
    sound = drive(channel)
    channel.start(fault("slow", 0.3))
    channel.step(1.0, 1)
    ours = signal.signal(signal.SIGALRM, lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.1)
        with pytest.raises(KeyboardInterrupt):
            for _ in range(9):
                channel.step(1.0, 1)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, ours)
    assert drive(channel) == sound


def test_one_channel_per_thread(folders):
    """A channel outlives the thread that opened it."""
    channels, found = {}, {}

    def open_and_drive(soc):
        channels[soc] = IsolatedChannel(folders["2.0"], WIRING, QUICK)
        found[soc] = drive(channels[soc], (soc, 0.0, 0.0, 0.0))

    threads = [threading.Thread(target=open_and_drive, args=(soc,)) for soc in (0.3, 0.6, 0.9)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for soc, channel in channels.items():
        assert drive(channel, (soc, 0.0, 0.0, 0.0)) == found[soc]
        channel.close()
    assert len({outputs[0] for outputs in found.values()}) == 3


def test_pipes_that_cannot_be_polled(folders, monkeypatch):
    """The way of Windows, which works here as well."""
    monkeypatch.setattr(process, "pipes_of", ThreadedPipes)
    before = children(), handles(), threading.active_count()
    channel = IsolatedChannel(folders["2.0"], WIRING, QUICK)
    sound = drive(channel)
    for name, message in (("segfault", "SIGSEGV"), ("endless", "no answer within 0.4 s")):
        with pytest.raises(FmuCrash, match=message):
            drive(channel, fault(name))
    channel.start(fault("stream_flood", 2.0**22))
    channel.step(1.0, 3)
    os.kill(channel.pid, signal.SIGKILL)
    with pytest.raises(FmuCrash, match=r"SIGKILL.*its log ends: (y{200}\.\.\.; ){4}y{200}\.\.\.$"):
        channel.step(1.0, 1)
    assert drive(channel) == sound
    channel.close()
    assert (children(), handles(), threading.active_count()) == before


ORPHAN = """
import os, sys, threading
from pathlib import Path
from bms.plants.fmu.channel import Wiring
from bms.plants.fmu.isolated import IsolatedChannel, Limits

def run(folder, starts, way):
    names = ("initial_soc", "fault", "fault_time", "fault_size")
    wiring = Wiring("co-simulation", "current", ("voltage",), names)
    channel = IsolatedChannel(Path(folder), wiring, Limits(close_deadline_s=0.3))
    children = Path(f"/proc/self/task/{threading.get_native_id()}/children").read_text()
    channel.start(starts)
    if way == "fork" and os.fork() == 0:
        os._exit(0) if channel.close() is None else None
    if way == "fork":
        os.wait()
        channel.step(1.0, 1)
    print(children, flush=True)
    if way == "raise":
        raise SystemExit(7)
    if way == "hang":
        channel.step(1.0, 1)
    return channel

starts = tuple(float(value) for value in sys.argv[3:])
if sys.argv[2] == "thread":
    thread = threading.Thread(target=run, args=(sys.argv[1], starts, "hang"))
    thread.start()
    thread.join()
kept = run(sys.argv[1], starts, sys.argv[2])
"""


def orphan(folder, way, name="none"):
    """Start a process that has a worker; return it and the worker's id."""
    code = [sys.executable, "-c", ORPHAN, str(folder), way, "0.7", str(FAULTS[name]), "0", "0"]
    started = subprocess.Popen(code, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    return started, int(started.stdout.readline())


@pytest.mark.parametrize(
    ("way", "status"), [("end", 0), ("fork", 0), pytest.param("raise", 7, marks=pytest.mark.slow)]
)
def test_a_worker_ends_with_its_parent(folders, way, status):
    parent, worker = orphan(folders["2.0"], way)
    _, errors = parent.communicate(timeout=WAITS_S)
    assert (parent.returncode, errors) == (status, "")
    assert gone(worker)


@pytest.mark.parametrize("way", ["hang", "thread"])
def test_a_worker_in_an_endless_loop_does_not_outlive_a_killed_parent(folders, way):
    """Started by a main thread Linux ends it; otherwise it looks after its parent itself."""
    parent, worker = orphan(folders["2.0"], way, "endless")
    assert Path(f"/proc/{worker}").exists()
    parent.kill()
    parent.communicate()
    assert gone(worker)


def test_a_worker_loads_no_compiler_and_keeps_to_its_limits(channel):
    worker = Path("/proc") / str(channel.pid)
    loaded = (worker / "maps").read_text()
    assert "battery.so" in loaded
    assert [name for name in ("llvmlite", "/scipy/", "matplotlib", "casadi") if name in loaded] == []
    limits = {
        line[:25].strip(): line[25:].split()[0] for line in (worker / "limits").read_text().splitlines()
    }
    assert limits["Max core file size"] == "1"
    assert limits["Max file size"] == str(2**30)
    assert 2**28 < int(limits["Max address space"]) < 2**28 + 2**31
    assert (worker / "oom_score_adj").read_text().strip() == "1000"
    opened = [str(entry.readlink()) for entry in (worker / "fd").iterdir()]
    assert sorted(name.split(":")[0] for name in opened) == ["/dev/null", "pipe", "pipe", "pipe", "pipe"]

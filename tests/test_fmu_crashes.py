"""FMUs that fail while they run: that realization ends with one clear message, the others finish.

A realization that starts below 40 % SOC meets the fault after 30 of 40 steps; its neighbours do not.
"""

import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from fmu_files import build_fmu, needs_compiler
from fmu_sessions import CALM, QUICK, drive, nothing_left, session

from bms.plants.fmu.errors import FmuCrash, FmuError

pytestmark = [needs_compiler, pytest.mark.usefixtures("nothing_left")]
_ = nothing_left

GB = 1e9
SMALL = replace(CALM, memory_bytes=256 << 20)
PATIENT = replace(CALM, step_deadline_s=120.0)

SAYS = {
    "nan": ("voltage", "nan"),
    "infinite": ("voltage", "inf"),
    "discard": ("discard", "too long"),
    "error": ("error", "on fire"),
    "fatal": ("fatal", "has left"),
    "segfault": ("SIGSEGV",),
    "abort": ("SIGABRT",),
    "exit": ("exit(3)",),
    "floating_point": ("SIGFPE",),
    "stack": ("SIGSEGV",),
    "kill": ("SIGKILL",),
    "endless": ("0.5 s",),
    "close_files": ("pipe",),
}
"""What the message has to say of each."""

IN_PROCESS = ("nan", "infinite", "discard", "error")
"""Faults that a process survives."""


def assert_others_finish(fmu, says):
    """A good realization, a bad one, a good one again that is the same."""
    before = drive(fmu.start(0.7))
    plant = fmu.start(0.3)
    with pytest.raises(FmuCrash) as caught:
        drive(plant)
    message = str(caught.value)
    assert "\n" not in message
    assert [word for word in says if word.lower() not in message.lower()] == [], message
    assert drive(fmu.start(0.7)) == before
    return message


INTERFACES = [(fmi, kind) for fmi in ("2.0", "3.0") for kind in ("cs", "me")]


def by_turns(cases, others, first):
    """All pairs of two lists; those beyond one partner per case, in turns from ``first``, are slow."""
    return [
        pytest.param(
            *(case if isinstance(case, tuple) else (case,)),
            *(other if isinstance(other, tuple) else (other,)),
            marks=() if (at + first) % len(others) == i else pytest.mark.slow,
        )
        for at, case in enumerate(cases)
        for i, other in enumerate(others)
    ]


@pytest.mark.parametrize(("fault", "fmi", "kind"), by_turns(SAYS, INTERFACES, 0))
def test_fault_ends_one_realization(fault, fmi, kind, tmp_path):
    path = build_fmu(tmp_path, fmi=fmi, kind=kind, fault=fault, fault_time=30.0, fault_below_soc=0.4)
    with session(path, limits=QUICK if fault == "endless" else CALM) as fmu:
        message = assert_others_finish(fmu, SAYS[fault])
    assert "30" in message


@pytest.mark.parametrize(("fault", "fmi"), by_turns(IN_PROCESS, ("2.0", "3.0"), 0))
def test_fault_in_this_process(fault, fmi, tmp_path):
    path = build_fmu(tmp_path, fmi=fmi, kind="cs", fault=fault, fault_time=30.0, fault_below_soc=0.4)
    with session(path, isolate=False) as fmu:
        assert_others_finish(fmu, SAYS[fault])


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_fatal_in_this_process_is_the_end_of_it(fmi, tmp_path):
    """FMI allows no further call to any instance, not even to free it; the battery aborts at one."""
    path = build_fmu(tmp_path, fmi=fmi, fault="fatal", fault_time=30.0, fault_below_soc=0.4)
    with session(path, isolate=False) as fmu:
        drive(fmu.start(0.7))
        with pytest.raises(FmuCrash, match=r"fatal error.*has left"):
            drive(fmu.start(0.3))
        with pytest.raises(FmuCrash, match="isolated"):
            fmu.start(0.7)


@pytest.mark.parametrize("isolate", [True, False], ids=["isolated", "in process"])
def test_warning_is_passed_over(isolate, tmp_path):
    path = build_fmu(tmp_path, fault="warning", fault_time=5.0)
    good = build_fmu(tmp_path, file="good.fmu")
    with session(path, isolate=isolate) as fmu, session(good, isolate=isolate) as other:
        assert drive(fmu.start(0.7)) == drive(other.start(0.7))


def test_a_realization_that_ended_is_not_continued(tmp_path):
    with session(build_fmu(tmp_path, fault="error", fault_time=30.0)) as fmu:
        plant = fmu.start(0.3)
        with pytest.raises(FmuCrash):
            drive(plant)
        with pytest.raises(FmuError):
            plant.step(1.0, 0.0, 1.0)


def test_exhausted_memory(tmp_path):
    path = build_fmu(tmp_path, fault="memory", fault_time=30.0, fault_below_soc=0.4, fault_size=4.0 * GB)
    with session(path, limits=SMALL) as fmu:
        assert_others_finish(fmu, ("memory",))


def peak_bytes(pid="self"):
    """Largest memory that a process has held so far."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    return next(int(line.split()[1]) << 10 for line in status.splitlines() if line.startswith("VmHWM"))


@pytest.mark.parametrize("fmi", ["2.0", pytest.param("3.0", marks=pytest.mark.slow)])
def test_gigabyte_of_log_lines(fmi, tmp_path):
    path = build_fmu(
        tmp_path, fmi=fmi, fault="log_flood", fault_time=30.0, fault_below_soc=0.4, fault_size=1.0 * GB
    )
    before = peak_bytes()
    with session(path, limits=PATIENT) as fmu:
        assert_others_finish(fmu, ("log",))
    assert peak_bytes() - before < 100e6


def test_gigabyte_of_log_lines_in_this_process(tmp_path):
    path = build_fmu(tmp_path, fault="log_flood", fault_time=30.0, fault_below_soc=0.4, fault_size=0.2 * GB)
    before = peak_bytes()
    with session(path, isolate=False) as fmu:
        assert_others_finish(fmu, ("log",))
    assert peak_bytes() - before < 100e6


@pytest.mark.parametrize("size", [0.05 * GB, pytest.param(GB, marks=pytest.mark.slow)])
def test_gigabyte_on_the_standard_streams(size, tmp_path):
    """Neither memory nor disk nor the protocol takes harm, and the FMU may go on if it is fast enough."""
    path = build_fmu(tmp_path, fault="stream_flood", fault_time=30.0, fault_below_soc=0.4, fault_size=size)
    good = build_fmu(tmp_path, file="good.fmu")
    before = peak_bytes()
    with session(path, limits=PATIENT) as fmu, session(good) as other:
        try:
            flooded = drive(fmu.start(0.3))
        except FmuCrash as error:
            assert "log" in str(error) or "output" in str(error)
        else:
            assert flooded[:31] == drive(other.start(0.3))[:31]
        assert drive(fmu.start(0.7)) == drive(other.start(0.7))
    assert peak_bytes() - before < 100e6


NO_START = [
    ("at_instantiate", "SIGSEGV"),
    ("no_instance", "no licence for the battery"),
    ("initialise_error", "no start for a battery"),
    ("endless_instantiate", "1 s"),
]


@pytest.mark.parametrize(("fault", "says", "fmi"), by_turns(NO_START, ("2.0", "3.0"), 0))
def test_an_fmu_that_does_not_start(fault, says, fmi, tmp_path):
    endless = replace(CALM, start_deadline_s=1.0)
    path = build_fmu(tmp_path, fmi=fmi, fault=fault)
    with (
        pytest.raises(FmuError) as caught,
        session(path, limits=endless if fault.startswith("endless") else CALM) as fmu,
    ):
        fmu.start(0.5)
    assert says in str(caught.value)


NO_END = ("at_reset", "at_terminate", "at_free", "endless_free")


@pytest.mark.parametrize(("fault", "fmi"), by_turns(NO_END, ("2.0", "3.0"), 1))
def test_an_fmu_that_does_not_end(fault, fmi, tmp_path):
    """What it did before stands, and the next realization runs."""
    path = build_fmu(tmp_path, fmi=fmi, kind="cs", fault=fault, fault_time=30.0)
    good = build_fmu(tmp_path, fmi=fmi, file="good.fmu")
    with session(path) as fmu, session(good) as other:
        expected = drive(other.start(0.5))
        assert drive(fmu.start(0.5)) == expected
        assert drive(fmu.start(0.5)) == expected


RESTORED = [
    ("none", "reset"),
    ("reset_keeps", "state"),
    ("state_keeps", "instance"),
    ("instance_keeps", "worker"),
]


@pytest.mark.parametrize("isolate", [True, False], ids=["isolated", "in process"])
@pytest.mark.parametrize(("fault", "way", "fmi", "kind"), by_turns(RESTORED, INTERFACES, 1))
def test_realizations_start_afresh_whatever_reset_does(fault, way, fmi, kind, isolate, tmp_path):
    path = build_fmu(tmp_path, fmi=fmi, kind=kind, fault=fault)
    if way == "worker" and not isolate:
        with pytest.raises(FmuError, match="isolate"), session(path, isolate=False):
            pass
        return
    with session(path, isolate=isolate) as fmu:
        assert fmu.restoration == way
        first = drive(fmu.start(0.6))
        drive(fmu.start(0.4))
        assert drive(fmu.start(0.6)) == first


@pytest.mark.parametrize("isolate", [True, False], ids=["isolated", "in process"])
def test_without_access_to_its_state_a_fresh_instance_is_taken(isolate, tmp_path):
    path = build_fmu(tmp_path, fault="reset_keeps", state_access=False)
    with session(path, isolate=isolate) as fmu:
        assert fmu.restoration == "instance"
        assert drive(fmu.start(0.6)) == drive(fmu.start(0.6))


def test_a_trap_left_on_does_not_hurt_this_process(tmp_path):
    path = build_fmu(tmp_path, fault="trap_left_on", fault_time=10.0)
    with session(path) as fmu:
        drive(fmu.start(0.6))
        assert len(drive(fmu.start(0.6))) == 40


def alone(code, *arguments):
    """Run code in an interpreter of its own that knows the helpers here."""
    here = Path(__file__).parent
    code = f"import os, sys; sys.path.insert(0, {str(here)!r})\nfrom fmu_sessions import *\n{code}"
    command = [sys.executable, "-c", code, *(str(argument) for argument in arguments)]
    # Not what a library has written into the environment of this process, such as how often it was loaded.
    kept = dict(os.environ)
    return subprocess.run(command, cwd=here.parent, env=kept, capture_output=True, text=True, check=False)


def test_the_library_is_loaded_once(tmp_path):
    """One tool's FMUs crash after 1,021 cycles of loading and unloading; this one after a second."""
    path = build_fmu(tmp_path, loads_max=1)
    sessions = """
for isolate in (False, False, False, True):
    with session(sys.argv[1], isolate=isolate) as fmu:
        print(len(drive(fmu.start(0.6))))
"""
    done = alone(sessions, path)
    assert done.stdout.split() == 4 * ["40"], done.stderr
    plainly = """
import fmpy
tempfile.tempdir = sys.argv[2]
for _ in range(2):
    fmpy.simulate_fmu(sys.argv[1], stop_time=1.0)
"""
    assert alone(plainly, path, tmp_path).returncode == -signal.SIGABRT


def test_parent_that_dies_takes_its_workers_along(tmp_path, nothing_left):
    """What it could not remove can be told by its name."""
    path = build_fmu(tmp_path)
    code = """
fmu = session(sys.argv[1]).__enter__()
drive(fmu.start(0.5))
print(*children(), flush=True)
os.kill(os.getpid(), 9)
"""
    done = alone(code, path)
    workers = [int(pid) for pid in done.stdout.split()]
    assert workers != [], done.stderr
    due = time.monotonic() + 10.0
    while any(alive(pid) for pid in workers) and time.monotonic() < due:
        time.sleep(0.05)
    assert [pid for pid in workers if alive(pid)] == []
    for folder in nothing_left.iterdir():
        assert folder.name.startswith("socwise-fmu-")
        shutil.rmtree(folder)


def alive(pid):
    """Whether a process runs; one that nobody has reaped does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False

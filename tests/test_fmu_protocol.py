"""What parent and worker say to each other, and what is made of how a worker ended."""

import json
import math
import os
import signal
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from bms.plants.fmu import protocol
from bms.plants.fmu.channel import Wiring
from bms.plants.fmu.errors import FmuError
from bms.plants.fmu.isolated import IsolatedChannel
from bms.plants.fmu.limits import Limits
from bms.plants.fmu.obituary import cause_of_death, last_lines
from bms.plants.fmu.process import BOOT, WorkerLostError, WorkerProcess

WIRING = Wiring(
    kind="model-exchange",
    input="Strom [A]",
    outputs=("Spannung", "Ladezustand %"),
    starts=("a",),
    inputs=(("ambient", 298.15),),
    parameters=(("R", 0.1), ("n", -1e-300)),
    step_s=0.1,
)


@pytest.mark.parametrize(
    "limits", [Limits(), Limits(memory_bytes=None, file_bytes=None, step_deadline_s=1e-3)]
)
def test_what_to_open_arrives_as_it_was(limits):
    folder = Path("/tmp/Bätterie \udcff 電池")
    request = protocol.open_request(folder, WIRING, limits)
    kind, size, patience_s = protocol.REQUEST.unpack_from(request)
    assert (kind, patience_s) == (protocol.OPEN, limits.close_deadline_s)
    assert len(request) == protocol.REQUEST.size + size
    assert protocol.read_open(request[-size:]) == (folder, WIRING, limits)


@pytest.mark.parametrize("values", [(), (0.1,), (math.pi, -0.0, math.inf, 5e-324)])
def test_numbers_keep_every_bit(values):
    answer = protocol.outputs_answer(values)
    assert protocol.answer_bytes(answer) == len(answer)
    found = protocol.numbers_from_bytes(answer, protocol.ANSWER.size)
    assert struct.pack(f"{len(values)}d", *found) == struct.pack(f"{len(values)}d", *values)


def test_an_answer_is_whole_or_none():
    answer = protocol.text_answer(protocol.CRASHED, "ähm")
    assert [protocol.answer_bytes(answer[:n]) for n in (1, 8, 9, 12)] == [9, 9, 13, 13]
    assert len(protocol.text_answer(protocol.REFUSED, "x" * 2**21)) == protocol.LONGEST_ANSWER
    for nonsense in (b"hello, world", struct.pack("=Bq", protocol.OUTPUTS, -2), struct.pack("=Bq", 2, 2**40)):
        assert protocol.answer_bytes(nonsense) == 0


def test_reading_ends_where_the_other_side_does():
    read, write = os.pipe()
    protocol.write_all(write, b"abcdef")
    assert protocol.read_exactly(read, 4) == b"abcd"
    os.close(write)
    assert protocol.read_exactly(read, 4) == b"ef"
    os.close(read)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"step_deadline_s": 0.0}, "step_deadline_s is 0.0; give seconds above zero, at most 1e\\+06"),
        ({"start_deadline_s": math.nan}, "start_deadline_s is nan"),
        ({"close_deadline_s": math.inf}, "close_deadline_s is inf"),
        ({"memory_bytes": 0}, "memory_bytes is 0; .* None for no limit"),
        ({"file_bytes": -1}, "file_bytes is -1"),
    ],
)
def test_limits_that_are_none(wrong, message):
    with pytest.raises(FmuError, match=message):
        Limits(**wrong)


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (-int(signal.SIGSEGV), "SIGSEGV, a bad memory access, a stack overflow"),
        (-int(signal.SIGTERM), "SIGTERM"),
        (-250, "signal 250"),
        (0, "it left by exit(0)"),
        (3, "it left by exit(3)"),
        (0xC0000005, "STATUS_ACCESS_VIOLATION, a bad memory access"),
    ],
)
def test_how_a_process_ended(code, words):
    assert cause_of_death(code).startswith(words)


def test_what_is_quoted_of_a_log_is_short_and_harmless():
    log = b"\n".join(b"line %d" % i for i in range(9)) + b"\n\n  \n\x1b[31mred\xff\r\n" + b"z" * 999
    quoted = last_lines(log)
    assert quoted.startswith("line 6; line 7; line 8; [31mred\ufffd; zzz")
    assert len(quoted) < 300
    assert last_lines(b" \n\0\n") == ""


@pytest.fixture
def worker(tmp_path):
    worker = WorkerProcess(tmp_path, Limits(close_deadline_s=5.0))
    yield worker
    worker.close()


def test_a_worker_that_is_asked_nonsense_says_why_it_leaves(worker):
    """Its own errors are told as well: the end of its log is the end of the traceback."""
    nonsense = protocol.REQUEST.pack(protocol.OPEN, 2, 1.0) + b"{]"
    with pytest.raises(WorkerLostError, match=r"its log ends: .*JSONDecodeError"):
        worker.ask(nonsense, 30.0)


def test_a_folder_that_holds_no_fmu(tmp_path):
    with pytest.raises(FmuError, match=r"modelDescription\.xml"):
        IsolatedChannel(tmp_path, WIRING)
    with pytest.raises(FmuError, match="no process can be started"):
        IsolatedChannel(tmp_path / "nowhere", WIRING)


def test_a_worker_needs_little(tmp_path):
    """Its modules import without what estimators need, entered as the worker enters them."""
    heavy = {"numba", "scipy", "matplotlib", "casadi", "fmpy"}
    packages = {name: [*sys.modules[name].__path__] for name in ("bms", "bms.plants")}
    code = BOOT.replace("main(at_once)", f"print(sorted({heavy} & sys.modules.keys()))")
    arguments = json.dumps([sys.path, packages, False])
    done = subprocess.run(
        [sys.executable, "-P", "-c", code, arguments],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout.strip(), done.stderr) == ("[]", "")

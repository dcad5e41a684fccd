"""The command line as a whole: start, help, version, clashes, interruption, and the small commands."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import run, tree, write_cycle
from test_doctor import install

import socwise
from drivecycles import cycle_names
from ems import EmsError
from socwise.commands.errors import CommandError, user_errors

ROOT = Path(socwise.__file__).resolve().parents[1]
COMMANDS = ("compare", "solve", "reproduce", "report", "doctor", "cycles")


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def started(*arguments, **options):
    """Start a new interpreter on the command line."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "100"}
    return subprocess.Popen(
        [sys.executable, "-m", "socwise", *arguments],
        env=environment,
        stdout=subprocess.PIPE,
        **{"stderr": subprocess.PIPE, "text": True, **options},
    )


def test_help_names_every_command_and_is_quick(capsys):
    shown = run(capsys, "--help")
    assert shown.code == 0
    assert all(command in shown.out for command in COMMANDS)
    # Quick because nothing is imported that computes or draws.
    slow = {"numpy", "scipy", "numba", "matplotlib", "plotly", "bms", "ems", "vehicle", "drivecycles"}
    code = f"import sys, socwise.cli; print(sorted(set({sorted(slow)}) & sys.modules.keys()))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(capsys, command):
    shown = run(capsys, command, "--help")
    assert (shown.code, shown.err) == (0, "")
    assert f"socwise {command}" in shown.out


def test_the_default_of_mu_is_the_one_that_is_shown(capsys):
    from ems.compare import DEFAULT_MU, DEFAULT_POLICIES

    assert ",".join(f"{mu:g}" for mu in DEFAULT_MU) in run(capsys, "compare", "--help").out
    assert len(DEFAULT_POLICIES) == 4


def test_version(capsys):
    shown = run(capsys, "--version")
    assert (shown.code, shown.out) == (0, f"socwise {socwise.__version__}\n")


def test_as_a_module():
    process = started("--version")
    out, err = process.communicate()
    assert (process.returncode, out, err) == (0, f"socwise {socwise.__version__}\n", "")


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["comapre"],
        ["compare", "--nope"],
        ["compare", "--jobs", "0"],
        ["compare", "--realizations", "few"],
    ],
)
def test_wrong_usage_is_exit_code_2(capsys, arguments):
    shown = run(capsys, *arguments)
    assert shown.code == 2
    assert "Traceback" not in shown.out + shown.err


def test_a_clash_stops_every_command_but_doctor(capsys, tmp_path, monkeypatch):
    install(tmp_path / "site", "ems", {"ems/__init__.py": "", "ems/more.py": ""}, version="0.4")
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path / "site")])
    before = tree(tmp_path)
    for arguments in (["compare"], ["solve"], ["cycles", "list"], ["reproduce", "list"], ["report", "x"]):
        shown = run(capsys, *arguments)
        assert (shown.code, shown.out) == (2, "")
        assert shown.err.startswith("socwise: The distribution ems 0.4 also installs a package called 'ems'")
        assert "`python -m pip uninstall ems`" in shown.err
    shown = run(capsys, "doctor", "--json")
    assert shown.code == 1
    report = json.loads(shown.out)
    assert report["ok"] is False
    assert [c["name"] for c in report["checks"] if c["status"] == "fail"] == ["package ems"]
    assert "pip uninstall ems" in run(capsys, "doctor").out.replace("\n", " ")
    assert tree(tmp_path) == before


def test_doctor_of_a_healthy_environment(capsys):
    shown = run(capsys, "doctor")
    assert (shown.code, shown.err) == (0, "")
    assert "All is well." in shown.out
    shown = run(capsys, "doctor", "--json")
    assert shown.code == 0
    report = json.loads(shown.out)
    assert set(report) == {"ok", "checks"}
    assert all(set(check) == {"name", "status", "detail", "cure"} for check in report["checks"])


def test_errors_for_the_user_are_those_of_our_packages():
    import pydantic

    import bms.errors
    import drivecycles
    import vehicle.errors
    from socwise.store import StoreError

    expected = {
        bms.errors.BatteryError,
        drivecycles.CycleError,
        vehicle.errors.VehicleError,
        EmsError,
        StoreError,
        pydantic.ValidationError,
        CommandError,
    }
    assert set(user_errors()) == expected


def test_an_error_that_is_ours_keeps_its_traceback(monkeypatch, tmp_path):
    import drivecycles
    from socwise.cli import main

    def broken(name):
        raise ZeroDivisionError(name)

    monkeypatch.setattr(drivecycles, "load_cycle", broken)
    with pytest.raises(ZeroDivisionError):
        main(["cycles", "show", "hwfet"])


def test_letters_that_a_terminal_lacks_are_no_error(tmp_path):
    write_cycle(tmp_path / "größe.csv")
    process = subprocess.run(
        [sys.executable, "-m", "socwise", "cycles", "show", "größe.csv"],
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "ascii"},
        capture_output=True,
        check=False,
    )
    assert (process.returncode, process.stderr) == (0, b"")
    assert b"distance" in process.stdout


@pytest.mark.skipif(sys.platform == "win32", reason="needs a POSIX terminal")
def test_interrupted_while_a_bar_is_shown(tmp_path):
    """The bar appears on a terminal; Ctrl-C ends in one line, exit code 130 and nothing written."""
    import pty

    mine, theirs = pty.openpty()
    process = started("compare", "--out", "results", stderr=theirs, text=False)
    os.close(theirs)
    seen = b""
    while b"solving" not in seen:
        seen += os.read(mine, 4096)
    process.send_signal(signal.SIGINT)
    try:
        while chunk := os.read(mine, 4096):
            seen += chunk
    except OSError:  # how Linux says that the other end is closed
        pass
    os.close(mine)
    assert process.communicate()[0] == b""
    # An interrupt in the middle of an import ends the interpreter by the signal itself.
    assert process.returncode in {130, -signal.SIGINT}
    assert b"socwise: interrupted\r\n" in seen
    assert b"Traceback" not in seen
    assert tree(tmp_path) == {}


def test_cycles_list(capsys):
    shown = run(capsys, "cycles", "list")
    assert shown.code == 0
    assert all(name in shown.out for name in cycle_names())
    assert "16.51" in shown.out


def test_cycles_show(capsys, tmp_path):
    shown = run(capsys, "cycles", "show", "HWFET")
    assert shown.code == 0
    assert "16.507 km" in shown.out and "765 s" in shown.out and "fastsim" in shown.out
    shown = run(capsys, "cycles", "show", "hwfet+hwfet")
    assert "33.0" in shown.out and "1530 s" in shown.out
    shown = run(capsys, "cycles", "show", write_cycle(tmp_path / "mine.csv"))
    # 60 km/h sin(pi t / 60 s): 60 / 3.6 * 60 * 2 / pi m, less what the trapezoid rule cuts off.
    assert "0.636 km" in shown.out and "60.0 km/h" in shown.out


@pytest.mark.parametrize(
    ("name", "start"), [("a.png", b"\x89PNG"), ("new/b.svg", b"<?xml"), ("c.pdf", b"%PDF")]
)
def test_cycles_plot(capsys, tmp_path, name, start):
    shown = run(capsys, "cycles", "plot", "hwfet", "--out", name)
    assert shown.code == 0
    assert name in shown.out
    assert (tmp_path / name).read_bytes().startswith(start)
    assert [path for path in tree(tmp_path) if path not in {name, "new"}] == []


def test_cycles_plot_has_a_place_of_its_own(capsys, tmp_path):
    assert run(capsys, "cycles", "plot", "nedc").code == 0
    assert set(tree(tmp_path)) == {"results", "results/nedc.png"}


def test_reproduce_list(capsys):
    from socwise.reproduce import ids

    shown = run(capsys, "reproduce", "list")
    assert shown.code == 0
    assert all(item in shown.out for item in ids())
    shown = run(capsys, "reproduce", "list", "--json")
    assert tuple(entry["id"] for entry in json.loads(shown.out)) == ids()


def test_reproduce_prints_published_and_ours(capsys, tmp_path):
    shown = run(capsys, "reproduce", "larsson-table1")
    assert shown.code == 0
    assert "published" in shown.out and "wheel radius" in shown.out
    shown = run(capsys, "reproduce", "larsson-table1", "--json")
    found = json.loads(shown.out)
    assert set(found) == {"id", "source", "rows", "figure"}
    assert (found["id"], found["figure"]) == ("larsson-table1", None)
    assert all(set(row) == {"name", "published", "ours", "tolerance", "ok"} for row in found["rows"])
    assert tree(tmp_path) == {}


def test_reproduce_several_with_pictures(capsys, tmp_path):
    shown = run(capsys, "reproduce", "larsson-fig5", "larsson-table1", "--out", "pictures", "--json")
    assert shown.code == 0
    found = json.loads(shown.out)
    assert [one["id"] for one in found] == ["larsson-fig5", "larsson-table1"]
    assert Path(found[0]["figure"]) == Path("pictures/larsson-fig5.png")
    assert (tmp_path / found[0]["figure"]).read_bytes().startswith(b"\x89PNG")


def test_reproduce_fails_if_a_row_does(capsys, monkeypatch):
    from socwise import reproduce
    from socwise.reproduce import Reproduction, Row

    rows = (Row.near("right", 1.0, 1.0, 0.1), Row.near("wrong", 1.0, 2.0, 0.1))
    monkeypatch.setattr(reproduce, "run", lambda item, **_: Reproduction(item, "nowhere", rows))
    shown = run(capsys, "reproduce", "larsson-table1")
    assert shown.code == 1
    assert "1 of 2 rows are not as they should be" in shown.out
    assert run(capsys, "reproduce", "larsson-table1", "--json").code == 1

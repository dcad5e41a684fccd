"""Compiled kernels find a place wherever socwise runs, and a change of a callee recompiles its callers."""

import os
import re
import shutil
import stat
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path

import pytest

from gpc import kernel_cache

ROOT = Path(kernel_cache.__file__).resolve().parents[1]


def run(folder):
    script = """
    import demo_callee, demo_caller
    from gpc.kernel_cache import discard_stale
    discarded = discard_stale([demo_callee, demo_caller])
    print(discarded, demo_caller.double())
    """
    environment = dict(
        os.environ, PYTHONPATH=os.pathsep.join([str(folder), *sys.path]), PYTHONDONTWRITEBYTECODE="1"
    )
    environment.pop("NUMBA_CACHE_DIR", None)
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.split()


def write(path, text, time_s):
    path.write_text(textwrap.dedent(text))
    os.utime(path, (time_s, time_s))


@pytest.fixture(scope="module")
def read_only(tmp_path_factory):
    """Our packages where nothing can be written, not even by root: a file is where a folder would be made."""
    site = tmp_path_factory.mktemp("site")
    for package in ("gpc", "bms"):
        shutil.copytree(ROOT / package, site / package, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in kernel_cache.FOLDERS:
        if (site / folder).is_dir():
            (site / folder / "__pycache__").write_text("")
    return site


def load_a_kernel(site, temporary, **variables):
    """Run a kernel of the copied packages in a new interpreter of a user without a home."""
    code = """
    import numpy as np
    from bms import _levels
    q, weights = _levels.level_weights(np.array([0.0, 1.0, 4.0]), 1.0, 2.0)
    print(q, round(sum(weights), 12), sum(_levels.level_weights.stats.cache_hits.values()))
    print(_levels.level_weights.stats.cache_path)
    """
    nowhere = str(site / "gpc" / "__pycache__")
    kept = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)],
        env={
            **kept,
            "PYTHONPATH": str(site),
            "PYTHONDONTWRITEBYTECODE": "1",
            "TMPDIR": str(temporary),
            **dict.fromkeys(("HOME", "XDG_CACHE_HOME", "LOCALAPPDATA"), nowhere),
            **variables,
        },
        cwd=temporary,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.split(maxsplit=3), [line for line in done.stderr.splitlines() if "Warning" in line]


@pytest.mark.skipif(os.name != "posix", reason="TMPDIR, and folders that belong to a user")
def test_kernels_run_where_nothing_can_be_written(tmp_path, read_only):
    (q, total, hits, place), warned = load_a_kernel(read_only, tmp_path)
    assert (q, total, hits) == ("0", "1.0", "0")
    folder = tmp_path / f"socwise-kernels-{os.getuid()}"
    assert Path(place.strip()).parent == folder
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert len(warned) == 1
    assert f"compiled kernels are kept in {folder}" in warned[0]
    assert "name a lasting folder in NUMBA_CACHE_DIR" in warned[0]
    # The next process finds what this one compiled.
    (_, _, hits, _), _ = load_a_kernel(read_only, tmp_path)
    assert hits == "1"


@pytest.mark.skipif(os.name != "posix", reason="TMPDIR, and folders that belong to a user")
def test_a_chosen_folder_that_cannot_be_written_is_named(tmp_path, read_only):
    chosen = str(read_only / "gpc" / "__pycache__" / "cache")
    (_, _, _, place), warned = load_a_kernel(read_only, tmp_path, NUMBA_CACHE_DIR=chosen)
    assert str(tmp_path) in place
    assert len(warned) == 1
    assert f"NUMBA_CACHE_DIR is {chosen}, where nothing can be written" in warned[0]


def test_a_folder_that_can_be_written_is_left_to_numba(tmp_path, monkeypatch, recwarn):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "new"))
    assert kernel_cache.provide_folder.__wrapped__() is None
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    assert kernel_cache.provide_folder.__wrapped__() is None
    assert list(recwarn) == []


@pytest.mark.skipif(os.name != "posix", reason="folders that belong to a user")
@pytest.mark.parametrize("trap", ["open to others", "a link"])
def test_a_temporary_folder_of_somebody_else_is_not_used(tmp_path, monkeypatch, trap):
    """Whoever can write there could have us execute anything."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    usual = tmp_path / f"socwise-kernels-{os.getuid()}"
    if trap == "a link":
        (tmp_path / "theirs").mkdir(mode=0o700)
        usual.symlink_to(tmp_path / "theirs")
    else:
        usual.mkdir()
        usual.chmod(0o777)
    found = kernel_cache.temporary_folder.__wrapped__()
    assert found != usual
    assert stat.S_IMODE(found.lstat().st_mode) == 0o700


def test_every_folder_with_kernels_is_looked_at():
    packages = {folder.partition("/")[0] for folder in kernel_cache.FOLDERS}
    found = {
        path.parent.relative_to(ROOT).as_posix()
        for package in packages
        for path in (ROOT / package).rglob("_*.py")
        if re.search(r"^@njit", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert found == set(kernel_cache.FOLDERS)


def test_callers_follow_their_callees(tmp_path):
    callee, caller = tmp_path / "demo_callee.py", tmp_path / "demo_caller.py"
    kernel = "from numba import njit\n@njit(cache=True)\ndef one():\n    return {}\n"
    write(callee, kernel.format(1), 1_000_000_000)
    write(
        caller,
        "from numba import njit\nfrom demo_callee import one\n"
        "@njit(cache=True)\ndef double():\n    return 2 * one()\n",
        1_000_000_000,
    )
    assert run(tmp_path)[1] == "2"
    assert run(tmp_path) == ["False", "2"]
    write(callee, kernel.format(5), 1_000_000_000)
    assert run(tmp_path) == ["True", "10"]
    assert list(tmp_path.rglob("kernels.sha256"))


def test_the_house_checks_its_own_kernels():
    import ems

    assert ems.__doc__
    code = "import ems, ems._sdp as k; print(k.sweep.stats.cache_path)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert len((Path(done.stdout.strip()) / "kernels.sha256").read_text(encoding="ascii")) == 64


def test_every_kernel_of_the_battery_is_stamped():
    """A kernel that is left out would run with yesterday's callees."""
    from bms import _filter, _kernels, _levels
    from ems._kernels import MODULES as OF_EMS
    from gpc import _small

    folder = Path(_kernels.__file__).parent
    kernels = {path for path in folder.rglob("_*.py") if path.stem not in ("__init__", "_kernels")}
    kernels.add(Path(_small.__file__))
    stamped = {Path(module.__file__) for module in (*_kernels.MODULES, _filter, _levels)}
    assert kernels == stamped
    assert {_filter, _levels} <= set(OF_EMS)
    stamps = [path for path in folder.rglob("battery.sha256") if len(path.read_text(encoding="ascii")) == 64]
    assert stamps != []


def test_every_kernel_of_the_inertia_estimation_is_stamped():
    import gpc
    from vehicle.inertia import _kernels

    folders = [Path(gpc.__file__).parent, Path(_kernels.__file__).parent]
    kernels = {path for folder in folders for path in folder.glob("_*.py")}
    kernels = {path for path in kernels if path.stem not in ("__init__", "_kernels")}
    assert kernels == {Path(module.__file__) for module in _kernels.MODULES}
    stamps = [path for folder in folders for path in folder.rglob("inertia.sha256")]
    assert [len(path.read_text(encoding="ascii")) for path in stamps] == [64] * 2

"""A change of a callee recompiles its callers."""

import os
import subprocess
import sys
import textwrap
from pathlib import Path


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

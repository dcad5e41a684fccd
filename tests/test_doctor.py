"""Name clashes with other distributions, and the examination of the environment."""

import base64
import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import run, write_cycle

import socwise
from gpc.kernel_cache import FOLDERS
from socwise import doctor, warm
from socwise.clashes import PACKAGES
from socwise.doctor import _judge_disk, environment, name_clashes

ROOT = Path(socwise.__file__).resolve().parents[1]


def install(site, name, files, *, version="1.2", top_level=None, requires=(), python=None, direct_url=None):
    """Lay a distribution into a folder as pip does: its files, METADATA and RECORD, or top_level.txt."""
    info = site / f"{name.lower().replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True)
    metadata = [f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}"]
    metadata += [f"Requires-Dist: {line}" for line in requires]
    metadata += [f"Requires-Python: {python}"] if python else []
    (info / "METADATA").write_text("\n".join(metadata) + "\n")
    record = [f"{info.name}/METADATA,,", f"{info.name}/RECORD,,"]
    for file, content in files.items():
        (site / file).parent.mkdir(parents=True, exist_ok=True)
        (site / file).write_text(content)
        digest = base64.urlsafe_b64encode(hashlib.sha256(content.encode()).digest()).rstrip(b"=").decode()
        record.append(f"{file},sha256={digest},{len(content)}")
    (info / "RECORD").write_text("\n".join(record) + "\n")
    if top_level is not None:
        (info / "top_level.txt").write_text("\n".join(top_level) + "\n")
    if direct_url is not None:
        (info / "direct_url.json").write_text(json.dumps(direct_url))


def installed_socwise(site, **options):
    """Lay our own packages into a folder as a wheel would, without the data that no check reads."""
    files = {f"{package}/__init__.py": f'"""Ours: {package}."""\n' for package in PACKAGES}
    files["socwise/clashes.py"] = (ROOT / "socwise" / "clashes.py").read_text(encoding="utf-8")
    install(site, "socwise", files, **options)


def clashes_in(site, cwd=None):
    """What a new interpreter finds whose path begins with a folder."""
    code = "from socwise.clashes import name_clashes as n\nfor c in n(): print(c.package, c.message, sep='|')"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(site), "PYTHONSAFEPATH": "" if cwd else "1"},
        cwd=cwd or site,
        capture_output=True,
        text=True,
        check=True,
    )
    return dict(line.split("|", 1) for line in done.stdout.splitlines())


def append(monkeypatch, folder):
    """Put a folder at the end of the path, where it claims names but shadows nothing."""
    monkeypatch.setattr(sys, "path", [*sys.path, str(folder)])


def test_this_environment_is_clean():
    assert name_clashes() == []


@pytest.mark.parametrize("declared", [None, ["bms"]], ids=["by its files", "by top_level.txt"])
def test_another_bms_is_found_and_the_cure_named(tmp_path, monkeypatch, declared):
    install(
        tmp_path, "bms", {"bms/__init__.py": "", "bms/charge.py": ""}, version="0.3.1", top_level=declared
    )
    append(monkeypatch, tmp_path)
    (clash,) = name_clashes()
    assert (clash.package, clash.distribution) == ("bms", "bms")
    assert "The distribution bms 0.3.1 also installs a package called 'bms'" in clash.message
    assert "`python -m pip uninstall bms`, then `python -m pip install" in clash.message
    assert "fresh environment" in clash.message


def test_one_distribution_can_clash_twice_and_two_can_clash(tmp_path, monkeypatch):
    install(
        tmp_path, "fleet-tools", {"vehicle/__init__.py": "", "ems/__init__.py": "", "fleet/__init__.py": ""}
    )
    install(tmp_path, "ems", {"ems/extra.py": ""})
    append(monkeypatch, tmp_path)
    found = [(clash.package, clash.distribution) for clash in name_clashes()]
    assert found == [("vehicle", "fleet-tools"), ("ems", "ems"), ("ems", "fleet-tools")]


def test_socwise_itself_is_no_clash_however_often_it_is_listed(tmp_path, monkeypatch):
    files = {f"{package}/__init__.py": "" for package in PACKAGES}
    for folder, name in (("one", "socwise"), ("two", "SocWise")):
        install(tmp_path / folder, name, files)
        append(monkeypatch, tmp_path / folder)
    # An editable installation has a path file and no packages at all.
    install(tmp_path / "three", "socwise", {"_editable_impl_socwise.pth": str(ROOT)})
    append(monkeypatch, tmp_path / "three")
    assert name_clashes() == []


def test_an_unrelated_or_broken_distribution_is_no_clash(tmp_path, monkeypatch):
    install(tmp_path, "bms-tools", {"bms_tools/__init__.py": ""})
    install(tmp_path, "half", {"bms/__init__.py": ""})
    next(tmp_path.glob("half-*")).joinpath("METADATA").write_text("Metadata-Version: 2.1\n")
    append(monkeypatch, tmp_path)
    assert name_clashes() == []


def test_a_wheel_as_installed_is_clean(tmp_path):
    installed_socwise(tmp_path)
    assert clashes_in(tmp_path) == {}


def test_an_overwritten_package_is_found(tmp_path):
    """The other distribution may be gone, or have no record: the file itself betrays it."""
    installed_socwise(tmp_path)
    (tmp_path / "bms" / "__init__.py").write_text("charge = 1\n")
    found = clashes_in(tmp_path)
    assert list(found) == ["bms"]
    assert "not the file that socwise installed" in found["bms"]
    assert "`python -m pip install --force-reinstall --no-deps socwise`" in found["bms"]


@pytest.mark.parametrize("rest", [True, False], ids=["files left", "folder gone"])
def test_a_removed_package_is_found(tmp_path, rest):
    """`pip uninstall bms` takes our __init__.py along."""
    installed_socwise(tmp_path)
    (tmp_path / "vehicle" / "engine.py").write_text("")
    (tmp_path / "vehicle" / "__init__.py").unlink()
    if not rest:
        shutil.rmtree(tmp_path / "vehicle")
    found = clashes_in(tmp_path)
    # Without the folder the name may still be found on another entry of the path.
    assert list(found) == ["vehicle"]
    assert "has removed it" in found["vehicle"] or "which is not socwise's" in found["vehicle"]


def test_a_file_that_shadows_a_package_is_found(tmp_path):
    site, work = tmp_path / "site", tmp_path / "work"
    installed_socwise(site)
    work.mkdir()
    (work / "ems.py").write_text("")
    assert clashes_in(site) == {}
    found = clashes_in(site, cwd=work)
    assert list(found) == ["ems"]
    assert f"loads {(work / 'ems.py').resolve()}" in found["ems"]


@pytest.mark.parametrize(
    ("origin", "command"),
    [
        (None, "--no-deps socwise`"),
        ({"url": "file:///src/my%20socwise", "dir_info": {"editable": True}}, "--editable /src/my socwise`"),
        ({"url": "file:///src/socwise.whl", "archive_info": {}}, "--no-deps /src/socwise.whl`"),
        ({"url": "https://host.invalid/s.whl", "archive_info": {}}, "--no-deps https://host.invalid/s.whl`"),
    ],
)
@pytest.mark.skipif(sys.platform == "win32", reason="POSIX paths")
def test_the_cure_reinstalls_from_where_we_came(tmp_path, origin, command):
    installed_socwise(tmp_path, direct_url=origin)
    install(tmp_path, "bms", {"bms/more.py": ""})
    assert command in clashes_in(tmp_path)["bms"]


def test_the_check_needs_nothing_but_the_standard_library():
    code = (
        "import sys; import socwise.doctor as d; d.environment(); d.name_clashes();"
        "print(sorted({'numpy', 'pydantic', 'numba', 'bms', 'ems', 'typer'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def by_name():
    return {check.name: check for check in environment()}


def test_this_environment_can_work():
    checks = by_name()
    assert {"socwise", "python", "platform", "compiler cache", "cores", "disk"} <= set(checks)
    assert [check for check in checks.values() if check.status == "fail"] == []
    assert all(check.cure for check in checks.values() if check.status != "ok")


def test_dependencies_are_held_against_our_own_metadata(tmp_path, monkeypatch):
    requires = ["numpy>=1.5", "pytest>=999.1", "no-such-thing>=2", "nor-this>=1; extra == 'test'"]
    install(tmp_path, "socwise", {}, version="7.0", requires=requires, python=">=3.11,<3.99")
    monkeypatch.syspath_prepend(tmp_path)
    checks = by_name()
    assert checks["socwise"].detail.startswith("7.0 in ")
    assert checks["python"].status == "ok"
    assert checks["numpy"].status == "ok"
    assert checks["numpy"].detail.endswith("(at least 1.5)")
    assert checks["pytest"].status == "fail"
    assert checks["pytest"].cure == 'python -m pip install --upgrade "pytest>=999.1"'
    assert checks["no-such-thing"].detail == "not installed; socwise needs 2 or later"
    assert "nor-this" not in checks


@pytest.mark.parametrize("python", [">=3.99", ">=3.8,<3.11"])
def test_an_unsuitable_python_is_named(tmp_path, monkeypatch, python):
    install(tmp_path, "socwise", {}, python=python)
    monkeypatch.syspath_prepend(tmp_path)
    assert by_name()["python"].status == "fail"
    assert f"socwise needs {python}" in by_name()["python"].detail


@pytest.mark.parametrize(
    ("bound", "status"),
    [("1.2", "ok"), ("1.2.0", "ok"), ("1.2.1", "fail"), ("1.10", "fail"), ("1.1.9", "ok")],
)
def test_versions_are_compared_by_number(tmp_path, monkeypatch, bound, status):
    install(tmp_path, "socwise", {}, requires=[f"thing>={bound}"])
    install(tmp_path, "thing", {}, version="1.2")
    monkeypatch.syspath_prepend(tmp_path)
    assert by_name()["thing"].status == status


def test_a_compiler_cache_that_cannot_be_written(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "cache"))
    check = by_name()["compiler cache"]
    assert check.status == "warn"
    assert "set NUMBA_CACHE_DIR" in check.cure
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "new" / "cache"))
    assert by_name()["compiler cache"].detail == str(tmp_path / "new" / "cache")
    # Looking does not make it.
    assert not (tmp_path / "new").exists()


def test_nothing_can_be_written_anywhere(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(doctor, "_user_cache", lambda: tmp_path / "file")
    monkeypatch.setattr(doctor, "__file__", str(tmp_path / "file" / "socwise" / "doctor.py"))
    check = by_name()["compiler cache"]
    assert check.status == "warn"
    assert "in a temporary folder, for as long as that lasts" in check.detail
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "cache"))
    assert "a temporary folder will be used" in by_name()["compiler cache"].detail


def test_the_folders_with_kernels_are_those_of_the_core():
    assert doctor.KERNELS == FOLDERS


def test_kernels_are_compiled_ahead_and_what_is_done_is_told(capsys, monkeypatch):
    few = {name: warm.JOBS[name] for name in ("cells", "traffic")}
    monkeypatch.setattr(warm, "JOBS", few)
    told = []
    assert warm.warm(lambda *step: told.append(step)) > 0.0
    assert told == [("cells", 0, 2), ("traffic", 1, 2), ("", 2, 2)]
    done = run(capsys, "doctor", "--warm", "--json")
    kernels = json.loads(done.out)["checks"][-1]
    assert kernels["name"] == "kernels"
    assert kernels["status"] == "ok"
    assert "compiled ahead in" in kernels["detail"]


@pytest.mark.slow
def test_after_warming_up_no_command_compiles(tmp_path):
    """In a fresh cache; every command that has kernels, on something small."""
    cache, out = tmp_path / "cache", tmp_path / "out"
    log = tmp_path / "log.csv"
    rows = [f"{k},{1.0 if k % 20 < 10 else -1.0},{3.3 + 0.01 * (k % 7)}" for k in range(100)]
    log.write_text("time [s],current [A],voltage [V]\n" + "\n".join(rows) + "\n")
    cycle = write_cycle(tmp_path / "cycle.csv")

    def socwise(*arguments):
        done = subprocess.run(
            [sys.executable, "-m", "socwise", *map(str, arguments)],
            cwd=tmp_path,
            env={**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr

    socwise("doctor", "--warm")
    compiled = {path: path.stat().st_mtime_ns for path in cache.rglob("*.nb?")}
    assert len(compiled) > 100
    small = ("--cycle", cycle, "--realizations", 2)
    estimators = "coulomb,ekf,ukf,gpc-gradient,gpc-gauss-newton,gpc-ekf"
    loop = ("--plant", "ecm", "--training", cycle, "--training-realizations", 2, "--jobs", 1)
    for number, command in enumerate(
        [
            ("compare", *small),
            ("compare", "--concept", "phev", "--policy", "stochastic", *small, *loop),
            ("estimate", log, "--cell", "a123-26650", "--estimator", estimators),
            ("inertia", "mass-spring", "--duration", 5),
            ("inertia", "ride", "--duration", 8),
            ("inertia", "load-transfer", "--duration", 30),
            ("traffic", "run", "report"),
            ("traffic", "uncertainty", "report"),
            ("traffic", "estimate", "report"),
            ("traffic", "cycles", "commute", "--cycles", 2),
        ]
    ):
        socwise(*command, "--out", out / str(number))
        after = {path: path.stat().st_mtime_ns for path in cache.rglob("*.nb?")}
        assert after == compiled, command


def test_a_senseless_number_of_threads_is_named(monkeypatch):
    for value, status in (("0", "warn"), ("many", "warn"), ("1", "ok")):
        monkeypatch.setenv("NUMBA_NUM_THREADS", value)
        assert by_name()["cores"].status == status


def test_a_full_disk_is_named():
    assert [_judge_disk(Path("out"), free).status for free in (5e9, 5e8, 1e7)] == ["ok", "warn", "fail"]
    assert _judge_disk(Path("out"), 5e8).detail == "0.5 GB free at out"


def test_the_version_is_that_of_the_distribution():
    from importlib import metadata

    try:
        expected = metadata.version("socwise")
    except metadata.PackageNotFoundError:
        expected = "0+unknown"
    assert socwise.__version__ == expected

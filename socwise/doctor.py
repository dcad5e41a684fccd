"""What `socwise doctor` looks at: the environment, piece by piece, each with a cure where it needs one.

Only the standard library is imported here, so that a broken environment can still be examined.
"""

from __future__ import annotations

import os
import platform
import re
import shutil
import sys
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

from socwise.clashes import DISTRIBUTION, PACKAGES, Clash, name_clashes

__all__ = ["Check", "Clash", "environment", "name_clashes"]

Status = Literal["ok", "warn", "fail"]

LITTLE_DISK_BYTES = 1e9
NO_DISK_BYTES = 1e8
KERNELS = (
    "gpc", "drivecycles/traffic", "vehicle/inertia", "bms", "bms/estimators", "bms/plants", "ems",
)  # fmt: skip
"""Folders that hold kernels, as in `gpc.kernel_cache`, which needs more than the standard library."""


@dataclass(frozen=True)
class Check:
    """One thing looked at.

    Parameters
    ----------
    name : str
        What was looked at.
    status : {"ok", "warn", "fail"}
        ``fail``: socwise will not work; ``warn``: it may be slow or stop later.
    detail : str
        What was found.
    cure : str
        What to do; empty where nothing needs to be done.
    """

    name: str
    status: Status
    detail: str
    cure: str = ""


def environment() -> list[Check]:
    """Examine interpreter, dependencies, compiler cache, processor and disk.

    Returns
    -------
    list of Check
        In the order in which they are to be shown. Name clashes are apart, see `name_clashes`.
    """
    return [_installation(), _python(), _machine(), *_dependencies(), _compiler_cache(), _cores(), _disk()]


def _installation() -> Check:
    folder = Path(__file__).resolve().parents[1]
    try:
        version = metadata.version(DISTRIBUTION)
    except metadata.PackageNotFoundError:
        return Check(
            DISTRIBUTION,
            "warn",
            f"runs from {folder} without being installed; versions of dependencies are not checked",
            f"python -m pip install --editable {folder}",
        )
    return Check(DISTRIBUTION, "ok", f"{version} in {folder}, packages {', '.join(PACKAGES)}")


def _python() -> Check:
    found = f"{platform.python_version()} ({platform.python_implementation()}) at {sys.executable}"
    try:
        wanted = " ".join(metadata.metadata(DISTRIBUTION).get_all("Requires-Python", []))
    except metadata.PackageNotFoundError:
        wanted = ""
    low, high = re.search(r">=\s*([0-9.]+)", wanted), re.search(r"<\s*([0-9.]+)", wanted)
    running = sys.version_info[:3]
    if (low and running < _release(low[1])) or (high and running >= _release(high[1])):
        return Check(
            "python", "fail", f"{found}; socwise needs {wanted}", "make an environment with such a Python"
        )
    return Check("python", "ok", found)


def _machine() -> Check:
    detail = f"{platform.platform()}, {platform.machine()}"
    if sys.maxsize < 2**32:
        return Check(
            "platform", "warn", f"{detail}, 32 bits", "use a 64-bit Python: tables may not fit in memory"
        )
    return Check("platform", "ok", detail)


def _dependencies() -> list[Check]:
    """Compare what is installed with the lower bounds in our own metadata."""
    try:
        requirements = metadata.requires(DISTRIBUTION) or []
    except metadata.PackageNotFoundError:
        return []
    checks: list[Check] = []
    for requirement in requirements:
        match = re.match(r"([A-Za-z0-9][A-Za-z0-9._-]*)\s*>=\s*([0-9][0-9.]*)", requirement)
        if match is None or "extra" in requirement.partition(";")[2]:
            continue
        name, bound = match.groups()
        cure = f'python -m pip install --upgrade "{name}>={bound}"'
        try:
            version = metadata.version(name)
        except metadata.PackageNotFoundError:
            checks.append(Check(name, "fail", f"not installed; socwise needs {bound} or later", cure))
            continue
        if _release(version) < _release(bound):
            checks.append(Check(name, "fail", f"{version}; socwise needs {bound} or later", cure))
        else:
            checks.append(Check(name, "ok", f"{version} (at least {bound})"))
    return checks


def _compiler_cache() -> Check:
    """Look for the folder in which numba will keep compiled kernels (`gpc.kernel_cache` finds it one)."""
    name, home = "compiler cache", Path(__file__).resolve().parents[1]
    beside = [home / package for package in KERNELS]
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen and _writable(Path(chosen)):
        return Check(name, "ok", chosen)
    found: Path | str = "a temporary folder"
    if all(_writable(folder / "__pycache__") for folder in beside):
        found = f"{home}, beside the source"
    elif _writable(_user_cache() / "numba"):
        found = _user_cache() / "numba"
    elif not chosen:
        return Check(
            name,
            "warn",
            f"nothing can be written in {beside[0]} or {_user_cache() / 'numba'}; compiled kernels are kept"
            " in a temporary folder, for as long as that lasts",
            "set NUMBA_CACHE_DIR to a folder that can be written",
        )
    if chosen:
        return Check(
            name,
            "warn",
            f"NUMBA_CACHE_DIR is {chosen}, where nothing can be written; {found} will be used",
            "set NUMBA_CACHE_DIR to a folder that can be written, or unset it",
        )
    return Check(name, "ok", str(found))


def _user_cache() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def _writable(folder: Path) -> bool:
    """Tell whether files can be written into a folder, or the folder be made."""
    existing = folder
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    return existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)


def _cores() -> Check:
    total = os.cpu_count() or 1
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else total
    detail = f"{usable} of {total} usable"
    threads = os.environ.get("NUMBA_NUM_THREADS")
    if threads is None:
        return Check("cores", "ok", detail)
    if not (threads.isdecimal() and int(threads) >= 1):
        return Check(
            "cores", "warn", f"{detail}; NUMBA_NUM_THREADS is {threads!r}", "set it to 1 or more, or unset it"
        )
    return Check("cores", "ok", f"{detail}; NUMBA_NUM_THREADS is {threads}")


def _disk() -> Check:
    return _judge_disk(Path.cwd(), shutil.disk_usage(Path.cwd()).free)


def _judge_disk(folder: Path, free: float) -> Check:
    detail = f"{free / 1e9:.1f} GB free at {folder}"
    if free >= LITTLE_DISK_BYTES:
        return Check("disk", "ok", detail)
    status: Status = "warn" if free >= NO_DISK_BYTES else "fail"
    return Check("disk", status, detail, "make room, or name another place with --out")


def _release(version: str) -> tuple[int, ...]:
    """Leading numbers of a version; zeros at the end do not count, so 2 and 2.0.0 are equal."""
    match = re.match(r"\d+(\.\d+)*", version)
    numbers = [int(part) for part in match[0].split(".")] if match else []
    while numbers and numbers[-1] == 0:
        numbers.pop()
    return tuple(numbers)

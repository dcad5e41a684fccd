"""Find numba a place for compiled kernels, and keep what is there honest across kernels that call each other.

*A place.* numba keeps kernels in ``NUMBA_CACHE_DIR``, else beside their source, else in the user's cache.
Where nothing can be written in any of them it refuses to load a kernel at all: a read-only installation run
by a user without a home, say. A private folder among the temporary files is then named instead, and one
warning says so.

*Honesty.* numba recompiles a cached function when *its own* file changes, not when a function that it calls
does. So a kernel can run with yesterday's callee: after an edit, and after an upgrade too, because wheels
carry fixed file times. Kernels that belong together are therefore stamped together: when the source of any of
them changes, all are compiled anew.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat
import sys
import tempfile
import warnings
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from types import ModuleType

CHOICE = "NUMBA_CACHE_DIR"
HOME = Path(__file__).resolve().parents[1]
FOLDERS = (
    "gpc",
    "drivecycles/traffic",
    "vehicle/inertia",
    "bms",
    "bms/estimators",
    "bms/plants",
    "ems",
)
"""Folders with modules that hold kernels."""


class CacheWarning(UserWarning):
    """Compiled kernels are kept somewhere else than they should be."""


@cache
def provide_folder() -> Path | None:
    """Make sure that numba can keep compiled kernels; to be called before any of them is loaded.

    Returns
    -------
    Path or None
        The temporary folder that had to be chosen; None where numba finds a place itself.

    Warns
    -----
    CacheWarning
        Nothing can be written where it should be.
    """
    chosen = os.environ.get(CHOICE)
    if chosen and is_writable(Path(chosen)):
        return None
    beside = [HOME / folder / "__pycache__" for folder in FOLDERS]
    spare = all(map(is_writable, beside)) or is_writable(user_folder())
    if chosen:
        where = "beside the source or in the user's cache" if spare else str(temporary_folder())
        _warn(f"{CHOICE} is {chosen}, where nothing can be written; compiled kernels are kept {where}")
    elif not spare:
        _warn(
            f"compiled kernels are kept in {temporary_folder()}, because nothing can be written beside the"
            f" source or in {user_folder()}; name a lasting folder in {CHOICE}"
        )
    if spare:
        return None
    folder = temporary_folder()
    os.environ[CHOICE] = str(folder)  # processes started from here find it, and are silent
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = str(folder)
    return folder


def is_writable(folder: Path) -> bool:
    """Tell whether a file can be written into a folder, by doing so; the folder is made if need be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def user_folder() -> Path:
    """Folder in which numba keeps what it cannot keep beside the source."""
    try:
        home = Path.home()
    except RuntimeError:  # a user who is unknown to the system
        home = Path(os.sep)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", home / "AppData" / "Local")) / "numba" / "Cache"
    if sys.platform == "darwin":
        return home / "Library" / "Caches" / "numba"
    return Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache") / "numba"


@cache
def temporary_folder() -> Path:
    """Folder among the temporary files that belongs to this user alone, the same in every process.

    What is in it will be executed. So one that others can write to, or that is theirs, is not used; a new
    one is made then.
    """
    user = os.getuid() if hasattr(os, "getuid") else ""
    folder = Path(tempfile.gettempdir()) / f"socwise-kernels-{user}"
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        private = not hasattr(os, "getuid") or (found.st_uid == user and not found.st_mode & 0o077)
        if stat.S_ISDIR(found.st_mode) and private and is_writable(folder):
            return folder
    return Path(tempfile.mkdtemp(prefix="socwise-kernels-"))


def _warn(message: str) -> None:
    # Three levels up is the line that imports the package whose kernels are meant.
    warnings.warn(message, CacheWarning, stacklevel=3)


def discard_stale(modules: Iterable[ModuleType], name: str = "kernels") -> bool:
    """Delete the cached kernels of modules whose joint source is not the one that was stamped.

    Parameters
    ----------
    modules : iterable of module
        Modules that hold ``@njit(cache=True)`` kernels and call each other.
    name : str
        Name of the stamp; groups that share a folder need different ones.

    Returns
    -------
    bool
        Whether anything was discarded. A cache that cannot be written is left alone: numba then keeps none.
    """
    held = [module for module in modules if module.__file__]
    digest = hashlib.sha256(
        b"\0".join(Path(str(module.__file__)).read_bytes() for module in held)
    ).hexdigest()
    discarded = False
    for folder in {path for module in held for path in cache_folders(module)}:
        stamp = folder / f"{name}.sha256"
        with contextlib.suppress(OSError):
            if stamp.is_file() and stamp.read_text(encoding="ascii") == digest:
                continue
            for module in held:
                stem = Path(str(module.__file__)).stem
                for cached in (*folder.glob(f"{stem}.*.nbi"), *folder.glob(f"{stem}.*.nbc")):
                    cached.unlink(missing_ok=True)
                    discarded = True
            folder.mkdir(parents=True, exist_ok=True)
            stamp.write_text(digest, encoding="ascii")
    return discarded


def cache_folders(module: ModuleType) -> set[Path]:
    """Find the folders in which numba caches the kernels of a module."""
    found = set()
    for value in vars(module).values():
        path = getattr(getattr(value, "stats", None), "cache_path", None)
        if path and getattr(value, "__module__", None) == module.__name__:
            found.add(Path(path))
    return found

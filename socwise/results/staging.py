"""Replace a folder of results as a whole, and never a folder that is not ours.

Everything is written to a temporary sibling, which takes the folder's name only once it is complete. What was
there before goes only after that.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

MANIFEST = "manifest.json"
FORMAT = "socwise comparison"
ESTIMATE_FORMAT = "socwise estimate"
INERTIA_FORMAT = "socwise inertia estimate"
_LITTER = frozenset({".DS_Store", "Thumbs.db", "desktop.ini"})


class StoreError(ValueError):
    """Results cannot be written to, or read from, the folder that was named; the message says what to do."""


def check_writable(out: Path, form: str = FORMAT) -> None:
    """Make sure that results can go to a folder, before anything is computed. Leaves nothing behind.

    Parameters
    ----------
    out : Path
        The folder. It may be absent, empty, or hold earlier results of this form and nothing else.
    form : str
        What the manifest calls the results.

    Raises
    ------
    StoreError
        If it is a file, holds anything that is not ours, or cannot be created.
    """
    target = _resolve(out)
    _check_replaceable(target, out, form)
    ancestor = _existing_ancestor(target.parent)
    if not ancestor.is_dir():
        raise StoreError(f"cannot write to {out}: {ancestor} is a file; choose another --out")
    try:
        Path(tempfile.mkdtemp(prefix=".socwise-", dir=ancestor)).rmdir()
    except OSError as error:
        raise StoreError(_refused(out, error)) from error


@contextmanager
def staged(out: Path, form: str = FORMAT) -> Iterator[Path]:
    """Give an empty folder to write to, and put it in the place of ``out`` if the block succeeds.

    Parameters
    ----------
    out : Path
        The folder that is to hold the results.
    form : str
        What the manifest calls the results; a folder with others is not touched.

    Yields
    ------
    Path
        The temporary sibling; removed if the block fails, and ``out`` is then as it was.

    Raises
    ------
    StoreError
        As `check_writable`, or if the disk refuses while writing.
    """
    check_writable(out, form)
    target = _resolve(out)
    created = _make_parents(target.parent)
    staging: Path | None = None
    try:
        staging = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
        # mkdtemp keeps others out; results get the permissions of any new folder.
        staging.chmod(0o777 & ~_umask())
        yield staging
        _swap(staging, target, out, form)
    except BaseException as error:
        if staging is not None:
            shutil.rmtree(staging, ignore_errors=True)
        for folder in created:
            with _ignoring_os_errors():
                folder.rmdir()
        if isinstance(error, OSError):
            raise StoreError(_refused(out, error)) from error
        raise


def held_format(folder: Path) -> str | None:
    """Return what the manifest of a folder calls its results, or None if it holds none of socwise."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    form = manifest.get("format") if isinstance(manifest, dict) else None
    return form if isinstance(form, str) and form.startswith("socwise ") else None


def load_manifest(folder: Path, form: str = FORMAT) -> dict[str, Any] | None:
    """Return the manifest of a folder of results, or None if the folder holds none of this form."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return manifest if isinstance(manifest, dict) and manifest.get("format") == form else None


def files_below(folder: Path) -> list[str]:
    """Return all files below a folder, relative, with forward slashes, sorted."""
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir())


def _swap(staging: Path, target: Path, out: Path, form: str) -> None:
    _check_replaceable(target, out, form)
    if not target.exists():
        staging.rename(target)
        return
    backup = Path(tempfile.mkdtemp(prefix=f".{target.name}-old-", dir=target.parent))
    earlier = backup / target.name
    try:
        target.rename(earlier)
        staging.rename(target)
    except BaseException:
        if earlier.exists():
            earlier.rename(target)
        backup.rmdir()
        raise
    shutil.rmtree(backup, ignore_errors=True)


def _check_replaceable(target: Path, out: Path, form: str) -> None:
    if not target.exists():
        return
    if not target.is_dir():
        raise StoreError(f"cannot write results to {out}: it is a file; choose a folder with --out")
    found = [name for name in files_below(target) if Path(name).name not in _LITTER]
    if not found:
        return
    manifest = load_manifest(target, form)
    if manifest is None:
        other = held_format(target)
        held = f"holds a {other}" if other else f"holds no results of socwise ({found[0]} is there)"
        raise StoreError(
            f"{out} is not empty and {held}; nothing was touched. "
            "Choose another --out, or empty the folder yourself"
        )
    ours = set(manifest.get("files", ()))
    foreign = [name for name in found if name not in ours]
    if foreign:
        raise StoreError(
            f"{out} holds earlier results, which would be replaced, and also {', '.join(foreign[:3])}"
            f"{f' and {len(foreign) - 3} more' if len(foreign) > 3 else ''}; nothing was touched. "
            "Move what you want to keep, or choose another --out"
        )


def _resolve(out: Path) -> Path:
    try:
        return out.expanduser().resolve()
    except (OSError, RuntimeError) as error:
        raise StoreError(f"cannot write to {out}: {error}; choose another --out") from error


def _existing_ancestor(folder: Path) -> Path:
    while not folder.exists():
        folder = folder.parent
    return folder


def _make_parents(folder: Path) -> list[Path]:
    """Create a folder with its parents; return what had to be created, deepest first."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    return missing


def _refused(out: Path, error: OSError) -> str:
    return f"cannot write results to {out}: {error.strerror or error}; choose another --out"


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


@contextmanager
def _ignoring_os_errors() -> Iterator[None]:
    try:
        yield
    except OSError:
        return

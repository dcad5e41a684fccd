"""One run at a time writes to a folder: a lock that a killed run does not leave behind for good.

The lock names its process, the host, and when the process started. On the same host a lock whose process is
gone, or whose number belongs to a younger process, is taken over. On another host nobody can tell, so that is
refused, and the message says what to do.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from socwise.results.staging import StoreError
from socwise.study.layout import LOCK

_ATTEMPTS = 3
_START_FIELD = 21


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder while the block runs.

    Raises
    ------
    StoreError
        If another run holds it.
    """
    path = folder / LOCK
    mine = _identity()
    _take(path, mine)
    try:
        yield
    finally:
        if _read(path) == mine:
            with suppress(OSError):
                path.unlink()


def holder(folder: Path) -> str | None:
    """Say who holds the lock of a folder; None where it is free or its holder is gone."""
    found = _read(folder / LOCK)
    return _named(found) if found and not _is_stale(found) else None


def _take(path: Path, mine: dict[str, Any]) -> None:
    for _ in range(_ATTEMPTS):
        # Written whole under a name of its own and then linked, so that nobody reads half a lock.
        draft = path.with_name(f".{path.name}.{mine['process']}.tmp")
        draft.write_text(json.dumps(mine), encoding="utf-8")
        try:
            _put(draft, path)
            return
        except FileExistsError:
            found = _read(path)
            if found is not None and not _is_stale(found):
                raise StoreError(
                    f"{path.parent} is being written by {_named(found)}; wait for it, or end it."
                    f" If you are sure that it is gone, remove {path}"
                ) from None
            _set_aside(path, found, mine)
        finally:
            draft.unlink(missing_ok=True)
    raise StoreError(f"cannot get hold of {path}: others take it at the same time; try again")


def _put(draft: Path, path: Path) -> None:
    try:
        os.link(draft, path)
    except FileExistsError:
        raise
    except OSError:
        # File systems without links; creating alone is atomic, too.
        with path.open("x", encoding="utf-8") as file:
            file.write(draft.read_text(encoding="utf-8"))


def _set_aside(path: Path, found: dict[str, Any] | None, mine: dict[str, Any]) -> None:
    """Remove a stale lock: of several that find it stale, one succeeds in renaming the one it has read."""
    aside = path.with_name(f".{path.name}.stale.{mine['process']}.tmp")
    with suppress(FileNotFoundError):
        path.rename(aside)
        if _read(aside) != found and found is not None:
            # Somebody was faster and this is a fresh lock: it goes back.
            with suppress(FileExistsError, OSError):
                os.link(aside, path)
        aside.unlink(missing_ok=True)


def _identity() -> dict[str, Any]:
    return {"host": socket.gethostname(), "process": os.getpid(), "started": started(os.getpid())}


def _read(path: Path) -> dict[str, Any] | None:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) and "process" in found else None


def _is_stale(found: dict[str, Any]) -> bool:
    if found.get("host") != socket.gethostname():
        return False
    number = int(found["process"])
    if not is_running(number):
        return True
    since = started(number)
    return since is not None and found.get("started") is not None and since != found["started"]


def _named(found: dict[str, Any]) -> str:
    return f"process {found['process']} on {found.get('host')}"


def is_running(process: int) -> bool:
    """Whether a process of this host is there; on Windows, where asking is not safe, always."""
    if os.name == "nt":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return _state(process) != "Z"


def started(process: int) -> str | None:
    """Say when a process started, in the system's own words; None where the system does not tell."""
    fields = _stat(process)
    if fields is not None:
        return fields[_START_FIELD - 2]
    if os.name == "nt":
        return None
    try:
        done = subprocess.run(
            ["ps", "-o", "lstart=", "-p", str(process)], capture_output=True, text=True, check=False
        )
    except OSError:
        return None
    return done.stdout.strip() or None


def _state(process: int) -> str | None:
    fields = _stat(process)
    return None if fields is None else fields[0]


def _stat(process: int) -> list[str] | None:
    """What stands behind the command in Linux's account of a process: state first."""
    try:
        text = Path(f"/proc/{process}/stat").read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None
    return text.rpartition(")")[2].split()

"""Unpack an FMU, which is a zip file from somebody else, into a folder that does not outlive its use.

The names in the archive decide where files land, and the sizes it declares may lie; so names that leave the
folder, links, devices and doubled names are refused before the first byte is written, and sizes are counted
while inflating. The folder is called ``socwise-fmu-<process id>-...`` in the system's place for temporary
files: should the process be killed, that is where to look for what it could not remove.
"""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO

from bms.plants.fmu.errors import FmuError

DESCRIPTION = "modelDescription.xml"
"""What every FMU has at its top."""

CHUNK = 1 << 20


@dataclass(frozen=True, slots=True)
class ArchiveLimits:
    """How much an FMU may hold.

    Parameters
    ----------
    entries : int
        Files and folders.
    total_bytes : int
        Sum of the unpacked sizes.
    ratio : float
        Unpacked over packed size; deflate itself ends at 1,032.
    ratio_from_bytes : int
        Smaller archives may be packed as tightly as they like.
    """

    entries: int = 50_000
    total_bytes: int = 2 << 30
    ratio: float = 200.0
    ratio_from_bytes: int = 64 << 20


@contextmanager
def unpack(path: str | Path, *, limits: ArchiveLimits | None = None) -> Iterator[Path]:
    """Unpack an FMU for as long as the context lasts.

    Parameters
    ----------
    path : str or Path
        The ``.fmu`` file.
    limits : ArchiveLimits or None
        What is still accepted; None for the defaults.

    Yields
    ------
    Path
        The folder, removed at the end whatever happens.

    Raises
    ------
    FmuError
        When the file cannot be read, is no FMU, wants to write elsewhere, or is too large.
    """
    path = Path(path)
    try:
        folder = Path(tempfile.mkdtemp(prefix=f"socwise-fmu-{os.getpid()}-")).resolve()
    except OSError as error:
        raise FmuError(f"cannot make a temporary folder for {path}: {error.strerror or error}") from error
    try:
        _extract(path, folder, limits or ArchiveLimits())
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _extract(path: Path, folder: Path, limits: ArchiveLimits) -> None:
    if path.is_dir():
        raise FmuError(f"{path} is a folder; give the .fmu file itself")
    try:
        with zipfile.ZipFile(path) as archive:
            members = _checked(archive, path, limits)
            budget = _Budget(path, limits, path.stat().st_size)
            for member, target in members:
                _write(archive, member, folder.joinpath(*target.parts), budget)
        (folder / "resources").mkdir(exist_ok=True)
    except FileExistsError as error:
        name = Path(error.filename or "").name
        raise FmuError(f"{path} holds {name!r} twice; ask its author for a clean archive") from error
    except (zipfile.BadZipFile, zlib.error, EOFError) as error:
        raise FmuError(
            f"{path} is not an FMU, or a damaged one: {_reason(error)}; an FMU is a zip file, get it again"
        ) from error
    except (RuntimeError, NotImplementedError) as error:
        raise FmuError(f"{path} cannot be unpacked: {error}; export it as an ordinary zip file") from error
    except OSError as error:
        raise FmuError(f"cannot unpack {path}: {error.strerror or error}") from error


def _reason(error: Exception) -> str:
    return str(error).rstrip(".") or "it ends too early"


def _checked(
    archive: zipfile.ZipFile, path: Path, limits: ArchiveLimits
) -> list[tuple[zipfile.ZipInfo, PurePosixPath]]:
    members = archive.infolist()
    if len(members) > limits.entries:
        raise FmuError(f"{path} holds {len(members)} files; at most {limits.entries} are unpacked")
    declared = sum(member.file_size for member in members)
    if declared > limits.total_bytes:
        raise FmuError(_too_large(path, declared, limits))
    targets: dict[PurePosixPath, zipfile.ZipInfo] = {}
    for member in members:
        target = _target(member, path)
        if not target.parts:
            continue
        if target in targets:
            raise FmuError(f"{path} holds {str(target)!r} twice; ask its author for a clean archive")
        targets[target] = member
    if PurePosixPath(DESCRIPTION) not in targets:
        raise FmuError(f"{path} is a zip file but no FMU: it has no {DESCRIPTION} at its top")
    return [(member, target) for target, member in targets.items()]


def _target(member: zipfile.ZipInfo, path: Path) -> PurePosixPath:
    """Where an entry goes below the folder."""
    name = member.orig_filename
    target = PurePosixPath(name)
    if name.startswith("/") or ".." in target.parts or any(sign in name for sign in "\\:\0"):
        raise FmuError(
            f"{path} holds {name!r}, a path that leaves its folder or that not every system understands; it"
            " is not unpacked. Ask its author for a clean archive"
        )
    kind = stat.S_IFMT(member.external_attr >> 16)
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        what = "a link" if kind == stat.S_IFLNK else "a special file"
        raise FmuError(f"{path} holds {what}, {name!r}; FMUs are unpacked without. Put the file itself in")
    if member.flag_bits & 0x1:
        raise FmuError(f"{path} is encrypted ({name!r}); unpack it with its password and zip it anew")
    return target


def _write(archive: zipfile.ZipFile, member: zipfile.ZipInfo, target: Path, budget: _Budget) -> None:
    if member.is_dir():
        target.mkdir(parents=True, exist_ok=True)
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    with archive.open(member) as source, target.open("xb") as sink:
        _copy(source, sink, budget)
    if (member.external_attr >> 16) & stat.S_IXUSR:
        target.chmod(0o755)


def _copy(source: IO[bytes], sink: IO[bytes], budget: _Budget) -> None:
    while chunk := source.read(CHUNK):
        budget.take(len(chunk))
        sink.write(chunk)


class _Budget:
    """Counts what is written, whatever the archive says of its sizes."""

    def __init__(self, path: Path, limits: ArchiveLimits, packed: int) -> None:
        self._path, self._limits = path, limits
        self._written = 0
        self._tight = max(limits.ratio * packed, limits.ratio_from_bytes)

    def take(self, size: int) -> None:
        self._written += size
        if self._written > self._limits.total_bytes:
            raise FmuError(_too_large(self._path, self._written, self._limits))
        if self._written > self._tight:
            raise FmuError(
                f"{self._path} unpacks to more than {self._limits.ratio:g} times its size"
                f" ({self._written / 1e6:.0f} MB so far); nothing honest is packed so tightly, unpacking was"
                " stopped"
            )


def _too_large(path: Path, size: int, limits: ArchiveLimits) -> str:
    return (
        f"{path} unpacks to {size / 1e9:.1f} GB; at most {limits.total_bytes / 1e9:.1f} GB are unpacked,"
        " unpacking was stopped"
    )

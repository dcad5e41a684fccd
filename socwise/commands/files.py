"""Write single files whole or not at all."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from socwise.commands.errors import CommandError


def check_file(path: Path, *suffixes: str) -> None:
    """Make sure that a file can be written, before anything is computed. Leaves nothing behind.

    Parameters
    ----------
    path : Path
        The file; it may exist.
    suffixes : str
        Endings that are allowed; every ending if none is given.

    Raises
    ------
    CommandError
        If the ending is another one, the path is a folder, or its folder cannot be written.
    """
    if suffixes and path.suffix.lower() not in suffixes:
        raise CommandError(f"cannot write {path}: the name must end in {' or '.join(suffixes)}")
    try:
        if path.is_dir():
            raise CommandError(f"cannot write {path}: it is a folder; name a file in it")
        folder = path.expanduser().resolve().parent
        while not folder.exists():
            folder = folder.parent
        if not folder.is_dir():
            raise CommandError(f"cannot write {path}: {folder} is a file; choose another --out")
        Path(tempfile.mkdtemp(prefix=".socwise-", dir=folder)).rmdir()
    except OSError as error:
        raise _refused(path, error) from error


@contextmanager
def staged_file(path: Path) -> Iterator[Path]:
    """Give a temporary name beside a file, and rename it to that file if the block succeeds.

    Parameters
    ----------
    path : Path
        The file to write; its folder is made if need be, and stays.

    Yields
    ------
    Path
        A name with the same ending, removed if the block fails.

    Raises
    ------
    CommandError
        As `check_file`, or if the disk refuses while writing.
    """
    check_file(path)
    target = path.expanduser().resolve()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        # In a folder of its own the file is created as any other, with the permissions of the user's choice.
        folder = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    except OSError as error:
        raise _refused(path, error) from error
    staging = folder / target.name
    try:
        yield staging
        staging.replace(target)
    except OSError as error:
        raise _refused(path, error) from error
    finally:
        with suppress(OSError):
            staging.unlink(missing_ok=True)
            folder.rmdir()


def _refused(path: Path, error: OSError) -> CommandError:
    return CommandError(f"cannot write {path}: {error.strerror or error}; choose another --out")

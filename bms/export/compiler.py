"""The system's C compiler, and the names that FMI gives to platforms."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

from bms.errors import BatteryError

COMPILERS = ("cc", "gcc", "clang")
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra")
"""Contracted products would give other bits on machines that have them."""

MOST_SECONDS = 300.0
_SHOWN = 2000


def find_compiler() -> str:
    """Find the C compiler: the one that the variable CC names, else cc, gcc or clang.

    Raises
    ------
    BatteryError
        When there is none.
    """
    wanted = (os.environ["CC"],) if os.environ.get("CC") else COMPILERS
    for name in wanted:
        found = shutil.which(name)
        if found is not None:
            return found
    raise BatteryError(
        f"an FMU needs a C compiler, and none was found (tried {', '.join(wanted)}); install one, such as"
        " gcc, or name it in the variable CC; the source alone (--form c) needs none"
    )


def compile_library(sources: list[Path], library: Path) -> None:
    """Compile a shared library that exports what the FMI headers mark, and nothing else.

    Parameters
    ----------
    sources : list of Path
        C files, all in one folder.
    library : Path
        What to write.

    Raises
    ------
    BatteryError
        When there is no compiler, or it complains.
    """
    command = [find_compiler(), *FLAGS, "-fvisibility=hidden", "-shared"]
    if sys.platform != "win32":
        command.append("-fPIC")
    # Names relative to the folder keep paths of this machine out of the library.
    folder = sources[0].parent
    command += ["-o", str(library), *(source.name for source in sources), "-lm"]
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, errors="replace", timeout=MOST_SECONDS
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise BatteryError(f"the C compiler {command[0]} could not be run: {error}") from error
    if done.returncode != 0:
        raise BatteryError(f"the C compiler {command[0]} does not take the source:\n{done.stderr[:_SHOWN]}")


def library_suffix() -> str:
    """Ending of a shared library on this platform."""
    return {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


def platform_folder(version: int) -> str:
    """Name of the folder of this platform's libraries in an FMU.

    Parameters
    ----------
    version : {2, 3}
        FMI 2.0 or 3.0.
    """
    machine = platform.machine().lower()
    wide = sys.maxsize > 2**32
    if version == 2:
        system = {"win32": "win", "darwin": "darwin"}.get(sys.platform, "linux")
        return f"{system}{64 if wide else 32}"
    system = {"win32": "windows", "darwin": "darwin"}.get(sys.platform, "linux")
    if machine in ("aarch64", "arm64"):
        return f"aarch64-{system}"
    return f"{'x86_64' if wide else 'x86'}-{system}"

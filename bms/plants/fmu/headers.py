"""The C headers of the FMI standard, which fmpy ships with their licence (2-Clause BSD) in each of them."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Literal

from bms.plants.fmu.errors import FmuError

Version = Literal[2, 3]

HEADERS: dict[Version, tuple[str, ...]] = {
    2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}


def fmi_headers(version: Version) -> dict[str, str]:
    """Read the headers of a version of FMI.

    Parameters
    ----------
    version : {2, 3}
        FMI 2.0 or 3.0.

    Returns
    -------
    dict of str
        The text of each header, by its name.

    Raises
    ------
    FmuError
        When fmpy, or a header in it, is missing.
    """
    # Found, not imported: an export needs nothing of fmpy but these files.
    spec = importlib.util.find_spec("fmpy")
    if spec is None or spec.origin is None:
        raise FmuError("the headers of FMI come with fmpy, which is not installed; pip install fmpy")
    folder = Path(spec.origin).parent / "c-code"
    try:
        return {name: (folder / name).read_text(encoding="utf-8") for name in HEADERS[version]}
    except OSError as error:
        raise FmuError(
            f"fmpy lacks a header of FMI {version}.0: {error.filename}; pip install --force-reinstall fmpy"
        ) from error

"""Load an FMU's library, once per process: it stays for the life of the process.

Libraries exported by one tool leak a file handle per load and crash after 1,021 cycles of loading and
unloading; so none is ever unloaded, and one of the same content is not loaded again from another folder.
"""

from __future__ import annotations

import copy
import hashlib
import os
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import Any

from bms.plants.fmu.channel import Kind
from bms.plants.fmu.description import Description
from bms.plants.fmu.errors import FmuError

_loaded: dict[tuple[int, str], dict[Kind, Any]] = {}
"""By version of FMI and content."""
_lock = Lock()


def load(description: Description, kind: Kind, folder: Path) -> Any:
    """Load the library and wrap it in fmpy's low-level class, without an instance yet.

    Parameters
    ----------
    description : Description
        Of the FMU.
    kind : {"co-simulation", "model-exchange"}
        Which interface.
    folder : Path
        Where the FMU was unpacked.

    Returns
    -------
    fmpy.fmi2.FMU2Slave, FMU2Model, fmpy.fmi3.FMU3Slave or FMU3Model
        Its ``dll`` is shared by all of the same content.

    Raises
    ------
    FmuError
        When there is none for this platform, or the system cannot load it.
    """
    from fmpy import sharedLibraryExtension

    description.check_platform()
    identifier = description.interface(kind).identifier
    path = folder / "binaries" / description.platform / f"{identifier}{sharedLibraryExtension}"
    if not path.is_file():
        there = ", ".join(sorted(each.name for each in path.parent.iterdir()))
        raise FmuError(
            f"the FMU {description.name} has no {path.name} for {description.platform}, but {there}; the"
            " file must be called after the modelIdentifier"
        )
    key = description.version, hashlib.sha256(path.read_bytes()).hexdigest()
    with _lock:
        kinds = _loaded.setdefault(key, {})
        if kind not in kinds:
            kinds[kind] = _wrap(description, kind, identifier, folder, next(iter(kinds.values()), None))
        fmu = copy.copy(kinds[kind])
    fmu.guid, fmu.modelIdentifier, fmu.instanceName = description.token, identifier, identifier
    fmu.unzipDirectory = str(folder)
    fmu.component = fmu.callbacks = None
    return fmu


def _wrap(description: Description, kind: Kind, identifier: str, folder: Path, loaded: Any) -> Any:
    """Make fmpy's object, from one of the other kind where the library is loaded already."""
    from fmpy import fmi2, fmi3

    slave = kind == "co-simulation"
    if description.version == 2:
        fmu_class = fmi2.FMU2Slave if slave else fmi2.FMU2Model
    else:
        fmu_class = fmi3.FMU3Slave if slave else fmi3.FMU3Model
    working_directory = Path.cwd()
    try:
        if loaded is None:
            return fmu_class(guid=description.token, modelIdentifier=identifier, unzipDirectory=str(folder))
        fmu = fmu_class.__new__(fmu_class)
        vars(fmu).update(vars(loaded) | {"_functions": {}})
        fmu._loadFunctions()
    except AttributeError as error:
        raise FmuError(
            f"the library of the FMU {description.name} lacks a function of FMI {description.version}.0"
            f" ({kind}): {error}; export it again"
        ) from error
    except Exception as error:
        raise FmuError(f"the library of the FMU {description.name} cannot be loaded: {error}") from error
    finally:
        with suppress(OSError):
            os.chdir(working_directory)
    return fmu

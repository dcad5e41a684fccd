"""A block as an FMU for co-simulation: FMI 2.0 or 3.0, compiled for this platform, its sources inside.

The FMU needs nothing at run time but the C library. Its doStep holds the inputs over the communication step
and takes one step of the block; its outputs are the block's at the end. The same block gives the same files,
and the same compiler the same bytes.
"""

from __future__ import annotations

import hashlib
import tempfile
import zipfile
from pathlib import Path
from typing import Literal

from bms.errors import BatteryError
from bms.export.block import CSource, checked_name
from bms.export.compiler import compile_library, library_suffix, platform_folder
from bms.export.fmu_description import Timing, build_description, model_description
from bms.export.fmu_glue import TEMPLATES, model_header, model_source

Version = Literal[2, 3]

RESERVED = ("model", "fmu")
_TIMELESS = (1980, 1, 1, 0, 0, 0)


def write_fmu(
    block: CSource,
    path: Path,
    version: Version = 3,
    *,
    timing: Timing | None = None,
    refusals: tuple[str, ...] = (),
) -> Path:
    """Write a block as an FMU.

    Parameters
    ----------
    block : CSource
        The block; its name becomes the model's.
    path : Path
        The file, ``.fmu``; its folder is made if it is not there.
    version : {2, 3}
        FMI 2.0 or 3.0.
    timing : Timing, optional
        How the FMU is to be stepped; at any step if left out.
    refusals : tuple of str
        What it means when the block's update gives 1, 2, and so on.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    BatteryError
        When there is no C compiler, the name is not one in C, or the file cannot be written.
    """
    if version not in (2, 3):
        raise BatteryError(f"FMI {version} is not known; give 2 or 3")
    if checked_name(block.name).lower() in RESERVED or block.name.lower().startswith("fmi"):
        raise BatteryError(f"an FMU cannot be called {block.name!r}, its own parts are; choose another name")
    sources = fmu_sources(block, version, refusals)
    timing = timing or Timing()
    compiled = [name for name in sources if name.endswith(".c")]
    token = sources["model.h"].partition('MODEL_TOKEN "')[2].partition('"')[0]
    files = {
        "modelDescription.xml": model_description(block, version, token, timing, compiled),
        f"binaries/{platform_folder(version)}/{block.name}{library_suffix()}": _compile(
            sources, compiled, block
        ),
        **{f"sources/{name}": text.encode() for name, text in sources.items()},
    }
    if version == 3:
        files["sources/buildDescription.xml"] = build_description(block, compiled)
    if block.data:
        files[f"resources/{block.name}.bin"] = block.data
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _pack(files, path)
    except OSError as error:
        raise BatteryError(f"cannot write {path}: {error.strerror or error}") from error
    return path


def fmu_sources(block: CSource, version: Version, refusals: tuple[str, ...] = ()) -> dict[str, str]:
    """Collect the C of an FMU: block, glue, wrapper and the headers of the standard.

    Parameters
    ----------
    block : CSource
        The block.
    version : {2, 3}
        FMI 2.0 or 3.0.
    refusals : tuple of str
        As in `write_fmu`.

    Returns
    -------
    dict of str
        Text of each file by its name, all for one folder.
    """
    # Here, so that the export of bare C needs no fmpy.
    from bms.plants.fmu.headers import fmi_headers

    sources = {
        f"{block.name}.h": block.header,
        f"{block.name}.c": block.source,
        "model.c": model_source(block, refusals),
        **{
            name: (TEMPLATES / name).read_text(encoding="ascii")
            for name in ("fmu.h", "fmu.c", f"fmi{version}.c")
        },
    }
    sources["model.h"] = model_header(block, _token(sources, block, version))
    return sources | fmi_headers(version)


def _token(sources: dict[str, str], block: CSource, version: Version) -> str:
    """Give a GUID that is another one whenever anything in the FMU is."""
    content = hashlib.sha256(f"FMI {version}.0 {block!r}".encode())
    for name in sorted(sources):
        content.update(f"\n{name}\n{sources[name]}".encode())
    text = content.hexdigest()
    return f"{{{text[:8]}-{text[8:12]}-{text[12:16]}-{text[16:20]}-{text[20:32]}}}"


def _compile(sources: dict[str, str], compiled: list[str], block: CSource) -> bytes:
    with tempfile.TemporaryDirectory(prefix="socwise-") as folder:
        for name, text in sources.items():
            (Path(folder) / name).write_text(text, encoding="utf-8", newline="\n")
        library = Path(folder) / f"{block.name}{library_suffix()}"
        compile_library([Path(folder) / name for name in compiled], library)
        return library.read_bytes()


def _pack(files: dict[str, bytes], path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, _TIMELESS)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(entry, content)

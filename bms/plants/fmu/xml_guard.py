"""A look at an XML file before a parser that builds a tree: small enough, well-formed, without entities.

FMI has no use for a document type, and everything harmful in XML begins with one (entities that multiply,
files and addresses that are fetched); so a file that has one is refused as a whole.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.parsers import expat

from bms.plants.fmu.errors import FmuError

MOST_BYTES = 64 << 20
MOST_ELEMENTS = 500_000
DEEPEST = 100
CHUNK = 1 << 16


def check_xml(path: Path) -> tuple[str, dict[str, str]]:
    """Read through an XML file without keeping it.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    tuple of str and dict
        Name and attributes of its root.

    Raises
    ------
    FmuError
        When it is too large, malformed, too deep, or declares a document type.
    """
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise FmuError(
            f"{path.name} has {size / 1e6:.0f} MB; at most {MOST_BYTES / 1e6:.0f} MB are read. Export the"
            " FMU with fewer variables (tools can leave out protected and auxiliary ones)"
        )
    guard = _Guard(path.name)
    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = guard.doctype
    parser.StartElementHandler = guard.start
    parser.EndElementHandler = guard.end
    try:
        with path.open("rb") as file:
            while chunk := file.read(CHUNK):
                parser.Parse(chunk, False)
        parser.Parse(b"", True)
    except FmuError:
        raise
    except (expat.ExpatError, LookupError, ValueError) as error:
        raise FmuError(f"{path.name} is not well-formed XML: {error}; export the FMU again") from error
    return guard.root, guard.attributes


class _Guard:
    def __init__(self, name: str) -> None:
        self._name = name
        self._depth = 0
        self._elements = 0
        self.root = ""
        self.attributes: dict[str, str] = {}

    def doctype(self, *_: Any) -> None:
        raise FmuError(
            f"{self._name} declares a document type (DTD); FMI knows none, and entities in it can fill the"
            " memory"
        )

    def start(self, name: str, attributes: dict[str, str]) -> None:
        if not self._elements:
            self.root, self.attributes = name, attributes
        self._elements += 1
        self._depth += 1
        if self._elements > MOST_ELEMENTS or self._depth > DEEPEST:
            raise FmuError(
                f"{self._name} has more than {MOST_ELEMENTS:,} elements or more than {DEEPEST} levels;"
                " no FMU needs that many"
            )

    def end(self, _: str) -> None:
        self._depth -= 1

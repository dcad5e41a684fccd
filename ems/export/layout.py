"""Constant tables as one C structure: its declaration, its bytes, and its initialiser.

All members are arrays of 8-byte or 4-byte numbers, each array a multiple of 8 bytes long, so that the
structure has no padding and is in memory what it is in a file. A check number made from the content stands
first; it also tells a machine of the other byte order.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_C_TYPES = {"f8": "double", "f4": "float", "i4": "int32_t"}
_ON_A_LINE = 8


@dataclass(frozen=True, eq=False)
class Member:
    """An array of the structure.

    Parameters
    ----------
    name : str
        Its name in C.
    values : ndarray of float64, float32 or int32
        Its values; the shape becomes that of the array in C.
    comment : str
        What it is.
    """

    name: str
    values: NDArray[Any]
    comment: str

    @property
    def c_type(self) -> str:
        """Type of an element in C."""
        return _C_TYPES[self.values.dtype.str[1:]]

    @property
    def declaration(self) -> str:
        """The member as the structure declares it."""
        shape = "".join(f"[{size}]" for size in _padded(self.values).shape)
        return f"    {self.c_type} {self.name}{shape}; /* {self.comment} */\n"

    @property
    def bytes(self) -> bytes:
        """The member in memory."""
        return _padded(self.values).tobytes()


@dataclass(frozen=True, eq=False)
class Layout:
    """The structure.

    Parameters
    ----------
    members : tuple of Member
        Its arrays, in their order.
    """

    members: tuple[Member, ...]

    @property
    def check(self) -> int:
        """A number of 64 bits made from names, shapes and values."""
        content = hashlib.sha256()
        for member in self.members:
            content.update(member.declaration.encode())
            content.update(member.bytes)
        return int.from_bytes(content.digest()[:8], "big") | 1

    def declaration(self, name: str) -> str:
        """Declare ``NAME_table``."""
        members = "".join(member.declaration for member in self.members)
        return (
            f"typedef struct {{\n    uint64_t check; /* {name.upper()}_CHECK */\n{members}}} {name}_table;\n"
        )

    def image(self) -> bytes:
        """Bytes of the structure on a machine like this one."""
        return b"".join([self.check.to_bytes(8, sys.byteorder), *(member.bytes for member in self.members)])

    def initialiser(self, name: str) -> Iterator[str]:
        """Write the structure as a C constant ``NAME_data``, in pieces: it may be long."""
        yield f'#include "{name}.h"\n\nconst {name}_table {name}_data = {{\n    {name.upper()}_CHECK,\n'
        for place, member in enumerate(self.members):
            yield f"    /* {member.name} */\n"
            yield from _initialise(_padded(member.values), member.c_type == "float")
            yield ",\n" if place + 1 < len(self.members) else "\n"
        yield "};\n"


def _padded(values: NDArray[Any]) -> NDArray[Any]:
    """Lengthen an array of one dimension to a multiple of eight bytes; others have to fit."""
    values = np.ascontiguousarray(values)
    if values.nbytes % 8 == 0:
        return values
    if values.ndim != 1:
        raise ValueError(f"an array of shape {values.shape} and {values.itemsize} bytes would need padding")
    return np.append(values, np.zeros(1, dtype=values.dtype))


def _initialise(values: NDArray[Any], single: bool) -> Iterator[str]:
    if values.ndim > 1:
        yield "{"
        for place, part in enumerate(values):
            yield from _initialise(part, single)
            yield "," if place + 1 < len(values) else ""
        yield "}"
        return
    # Digits that read back as the same number in its precision.
    form = {("f", True): "%.8ef", ("f", False): "%.16e"}.get((values.dtype.kind, single), "%d")
    yield "{"
    for start in range(0, values.size, _ON_A_LINE):
        line = values[start : start + _ON_A_LINE].tolist()
        yield (",\n" if start else "") + ",".join([form] * len(line)) % tuple(line)
    yield "}"

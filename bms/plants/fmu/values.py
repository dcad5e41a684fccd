"""Numbers into and out of an FMU, with arrays that are allocated once.

fmpy's own getters build their arrays anew at every call; here a port keeps its arrays, and a call of the C
function with them costs a third.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

from bms.plants.fmu.description import Variable

Call = tuple[str, Callable[..., int], tuple[Any, ...]]
"""Name of a C function, the function, its arguments."""

TYPES_2: dict[str, tuple[str, Any]] = {
    "Real": ("Real", ctypes.c_double),
    "Integer": ("Integer", ctypes.c_int),
    "Enumeration": ("Integer", ctypes.c_int),
    "Boolean": ("Boolean", ctypes.c_int),
}
WHOLE_3 = {
    "Int8": ctypes.c_int8,
    "UInt8": ctypes.c_uint8,
    "Int16": ctypes.c_int16,
    "UInt16": ctypes.c_uint16,
    "Int32": ctypes.c_int32,
    "UInt32": ctypes.c_uint32,
    "Int64": ctypes.c_int64,
    "UInt64": ctypes.c_uint64,
}
TYPES_3: dict[str, tuple[str, Any]] = {name: (name, number) for name, number in WHOLE_3.items()} | {
    "Float64": ("Float64", ctypes.c_double),
    "Float32": ("Float32", ctypes.c_float),
    "Enumeration": ("Int64", ctypes.c_int64),
    "Boolean": ("Boolean", ctypes.c_bool),
}


class Port:
    """Some variables of one type.

    Parameters
    ----------
    dll : ctypes.CDLL
        The FMU's library.
    version : {2, 3}
        Of FMI.
    component : ctypes.c_void_p
        The instance.
    variables : sequence of Variable
        Of one type.
    """

    def __init__(
        self, dll: Any, version: int, component: ctypes.c_void_p, variables: tuple[Variable, ...]
    ) -> None:
        name, number = (TYPES_2 if version == 2 else TYPES_3)[variables[0].type]
        count = len(variables)
        references = (ctypes.c_uint * count)(*(variable.reference for variable in variables))
        self.values: Any = (number * count)()
        self.whole = number not in (ctypes.c_double, ctypes.c_float)
        size = ctypes.c_size_t(count)
        arguments: tuple[Any, ...] = (component, references, size, self.values)
        if version == 3:
            arguments += (size,)
        self.set: Call = (f"fmi{version}Set{name}", dll[f"fmi{version}Set{name}"], arguments)
        self.get: Call = (f"fmi{version}Get{name}", dll[f"fmi{version}Get{name}"], arguments)


class Reader:
    """The outputs, of whatever types they are, in their order."""

    def __init__(
        self, dll: Any, version: int, component: ctypes.c_void_p, variables: tuple[Variable, ...]
    ) -> None:
        table = TYPES_2 if version == 2 else TYPES_3
        groups: dict[str, list[int]] = {}
        for at, variable in enumerate(variables):
            groups.setdefault(table[variable.type][0], []).append(at)
        self.ports = [
            Port(dll, version, component, tuple(variables[at] for at in places)) for places in groups.values()
        ]
        self._places = list(groups.values())
        self._count = len(variables)

    def numbers(self) -> tuple[float, ...]:
        """What the last calls of the ports' getters brought."""
        if len(self.ports) == 1:
            return tuple(map(float, self.ports[0].values))
        found = [0.0] * self._count
        for port, places in zip(self.ports, self._places, strict=True):
            for at, value in zip(places, port.values, strict=True):
                found[at] = float(value)
        return tuple(found)

"""What an exported block is: C99 source, and its inputs and outputs as data.

A block NAME is two files, NAME.h and NAME.c. The header declares ``NAME_state``, all that the block remembers
and of fixed size, and the functions on it. Whoever wraps a block (as an FMU, or in a replay) need not know
what it does: the calls are given as C expressions on a structure ``w`` of the wrapper, which holds

- ``state`` of type ``NAME_state`` and ``out`` of type ``NAME_output``,
- a ``double`` for each input and each parameter, under its own name,
- ``step_s``, and ``time_s`` at the end of the step,
- ``data``, a pointer to constant bytes, where the block has some.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from bms.errors import BatteryError
from bms.export.runtime import RESERVED

_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,30}")


@dataclass(frozen=True, slots=True)
class Port:
    """An input, an output or a parameter of a block.

    Parameters
    ----------
    name : str
        Its name, a C identifier.
    unit : str
        Its unit: ``A``, ``V``, ``s``, ``degC``, ``Ah``, ``ohm``, ``F`` or another; ``1`` for a pure number.
    description : str
        What it is, one line.
    c_expression : str
        Where its value stands: for an output a member of ``NAME_output``, else a member of the wrapper's
        structure.
    start : float
        Value before the first step.
    kind : {"real", "integer", "boolean"}
        What values it takes; an integer output is a C ``long``, a boolean one an ``int``.
    """

    name: str
    unit: str
    description: str
    c_expression: str
    start: float
    kind: Literal["real", "integer", "boolean"] = "real"


@dataclass(frozen=True, slots=True)
class CSource:
    """A block as C99 source.

    Parameters
    ----------
    name : str
        Prefix of all that it declares, and name of its files.
    header, source : str
        Content of NAME.h and NAME.c.
    state_bytes : int
        Size of ``NAME_state`` where a double takes eight bytes.
    description : str
        What the block is, one line.
    inputs, outputs, parameters : tuple of Port
        In the order of the calls. Parameters are given once, at the start.
    start_call : str
        C expression that brings the state to the start; 0 unless a parameter is refused.
    update_call : str
        C expression that takes the inputs of one step; 0 unless they are refused, and the state is as before.
    read_call : str
        C expression that fills ``w->out`` from the state, also before the first step.
    data : bytes
        Constant data behind ``w->data``; empty where the source holds all.
    """

    name: str
    header: str
    source: str
    state_bytes: int
    description: str
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    parameters: tuple[Port, ...]
    start_call: str
    update_call: str
    read_call: str
    data: bytes = b""

    def write(self, folder: Path) -> tuple[Path, Path]:
        """Write NAME.h and NAME.c.

        Parameters
        ----------
        folder : Path
            Where to; made if it is not there.

        Returns
        -------
        tuple of Path
            Header and source.
        """
        folder.mkdir(parents=True, exist_ok=True)
        header, source = folder / f"{self.name}.h", folder / f"{self.name}.c"
        header.write_text(self.header, encoding="ascii", newline="\n")
        source.write_text(self.source, encoding="ascii", newline="\n")
        return header, source


def checked_name(name: str) -> str:
    """Check that a block can have this name.

    Raises
    ------
    BatteryError
        When it is no C identifier of at most 31 characters that starts with a letter, or a keyword.
    """
    if not _IDENTIFIER.fullmatch(name) or name in RESERVED:
        raise BatteryError(
            f"a block cannot be called {name!r}; give a C name: a letter, then letters, digits or"
            " underscores, at most 31 characters, no keyword"
        )
    return name

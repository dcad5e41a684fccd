"""The C that joins a block to the wrapper: a table of its variables, and the calls with values in and out."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from bms.export.block import CSource, Port

Causality = Literal["parameter", "input", "output", "independent"]

TEMPLATES = Path(__file__).parent / "c"
TIME = Port("time", "s", "time", "time_s", 0.0)


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable of the FMU; its value reference is its place among them.

    Parameters
    ----------
    port : Port
        What it is.
    causality : {"parameter", "input", "output", "independent"}
        What it is for.
    """

    port: Port
    causality: Causality


def variables(block: CSource) -> tuple[Variable, ...]:
    """List a block's variables in the order of their value references, the time last."""
    return (
        *(Variable(port, "parameter") for port in block.parameters),
        *(Variable(port, "input") for port in block.inputs),
        *(Variable(port, "output") for port in block.outputs),
        Variable(TIME, "independent"),
    )


def model_header(block: CSource, token: str) -> str:
    """Write model.h, which tells the wrapper the sizes of the block."""
    members = "".join(f"    double {port.c_expression};\n" for port in (*block.parameters, *block.inputs))
    data = ""
    if block.data:
        data = f'#define MODEL_DATA_FILE "{block.name}.bin"\n'
        data += f"#define MODEL_DATA_BYTES ((size_t){len(block.data)})\n"
    return f"""/* Sizes of the block {block.name} for the wrapper, see fmu.h. */
#ifndef MODEL_H
#define MODEL_H

#include "{block.name}.h"

#define MODEL_TOKEN "{token}"
#define MODEL_VARIABLES {len(variables(block))}u
{data}
typedef struct {{
    {block.name}_state state;
    {block.name}_output out;
{members}    double step_s;
    double time_s; /* at the end of the step */
    const void *data;
}} model_state;

#endif
"""


def model_source(block: CSource, refusals: tuple[str, ...] = ()) -> str:
    """Write model.c.

    Parameters
    ----------
    block : CSource
        The block.
    refusals : tuple of str
        What it means when ``update_call`` gives 1, 2, and so on.
    """
    every = tuple(enumerate(variables(block)))
    cases = "".join(
        f'    case {code}:\n        complain(message, "{_quoted(text)}");\n        break;\n'
        for code, text in enumerate(refusals, start=1)
    )
    given = "".join(
        f"    w->{v.port.c_expression} = value[{place}];\n"
        for place, v in every
        if v.causality in ("parameter", "input")
    )
    taken = "".join(
        f"    value[{place}] = (double)w->out.{v.port.c_expression};\n"
        for place, v in every
        if v.causality == "output"
    )
    needs = [port.name for port in block.parameters] + [f"{block.name}.bin"] * bool(block.data)
    parts = {
        "NAME": block.name,
        "TABLE": ",\n".join(_row(v) for _, v in every),
        "GIVEN": given.rstrip("\n"),
        "TAKEN": taken.rstrip("\n"),
        "CASES": cases.rstrip("\n"),
        "PARAMETERS": _quoted(f"these: {', '.join(needs)}"),
        "START": block.start_call,
        "UPDATE": block.update_call,
        "READ": block.read_call,
    }
    template = (TEMPLATES / "model.c.in").read_text(encoding="ascii")
    # Marks are replaced in one pass: what stands for one may hold the text of another.
    return re.sub(r"@([A-Z]+)@", lambda mark: parts[mark.group(1)], template)


def _row(variable: Variable) -> str:
    port = variable.port
    kinds = f"FMU_{port.kind.upper()}, FMU_{variable.causality.upper()}"
    return f'    {{"{port.name}", {kinds}, {_number(port.start)}}}'


def _number(value: float) -> str:
    if math.isnan(value):
        return "NAN"
    return repr(float(value)) if math.isfinite(value) else ("-" if value < 0.0 else "") + "INFINITY"


def _quoted(text: str) -> str:
    return text[:200].replace("\\", "\\\\").replace('"', '\\"').replace("%", " per cent")

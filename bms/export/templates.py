"""The C around a translated kernel: header, state, and the functions that a user calls."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bms.estimators.base import LEADING
from bms.export.block import Port
from bms.export.values import literal
from bms.flags import MEANINGS

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Layout:
    """What the templates need to know.

    Parameters
    ----------
    name, title : str
        Prefix of all names, and what the block is.
    looks_back : bool
        Whether a current flowed since the sample before.
    arrays : dict of str to ndarray
        Members of the state, with their content at the start.
    outputs : tuple of Port
        Members of the output; parameters and their standard deviations in turn from the fifth on.
    soc, soc_sd : float
        Belief at the start.
    pending : int
        Place in the memory of flags that are kept for a next row of a log; there is none here.
    update, start : str
        Calls of the translated functions on ``s``.
    """

    name: str
    title: str
    looks_back: bool
    arrays: dict[str, Array]
    outputs: tuple[Port, ...]
    soc: float
    soc_sd: float
    pending: int
    update: str
    start: str


def comment(text: str) -> str:
    """Text that can stand in a C comment."""
    return re.sub(r"\*/|/\*", "* /", text.encode("ascii", "replace").decode("ascii"))


def header_of(layout: Layout) -> str:
    """Content of NAME.h."""
    name, guard = layout.name, f"{layout.name.upper()}_H"
    flags = ",\n".join(
        f"    {name.upper()}_{flag.name} = {flag.value} /* {meaning} */" for flag, meaning in MEANINGS.items()
    )
    # The comma goes before the comment.
    flags = re.sub(r"(= \d+) (/\*.*?\*/),", r"\1, \2", flags)
    members = "\n".join(
        f"    {'long' if port.kind == 'integer' else 'double'} {port.name};"
        f" /* {port.unit}: {port.description} */"
        for port in layout.outputs
    )
    state = "\n".join(f"    double {each}[{values.size}];" for each, values in layout.arrays.items())
    flows = "since the sample before" if layout.looks_back else "from this sample to the next one"
    return _HEADER.format(
        title=comment(layout.title),
        guard=guard,
        state=state,
        name=name,
        upper=name.upper(),
        flags=flags,
        members=members,
        flows=flows,
    )


def source_of(layout: Layout, kernels: str) -> str:
    """Content of NAME.c around the translated kernels."""
    name = layout.name
    return f"""/* {comment(layout.title)}; see {name}.h. Generated: do not edit, export anew. */
#include "{name}.h"

#include <math.h>
#include <stdbool.h>

#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#endif

{kernels}

{_init(layout)}

int {name}_start({name}_state *s, double soc, double soc_sd)
{{
    if (!((soc >= 0.0) && (soc <= 1.0) && (soc_sd >= 0.0) && (soc_sd <= 1.0))) {{
        return 1;
    }}
    {name}_init(s);
    if ((soc != {literal(layout.soc).text}) || (soc_sd != {literal(layout.soc_sd).text})) {{
        const double variance = soc_sd * soc_sd;
        {layout.start};
    }}
    return 0;
}}

int {name}_update({name}_state *s, double current_A, double voltage_V, double step_s,
    double temperature_C, {name}_output *out)
{{
    if ((!(step_s >= 0.0)) || (isinf(step_s) != 0)) {{
        return 1;
    }}
    if (temperature_C < -273.15) {{
        temperature_C = NAN;
    }}
    {layout.update};
    s->memory[{layout.pending}] = 0.0;
    {name}_read(s, out);
    return 0;
}}

{_read(layout)}
"""


def _init(layout: Layout) -> str:
    """Tables of the start, and the copy into the state."""
    parts, copies = [], []
    for each, values in layout.arrays.items():
        flat = values.reshape(-1)
        texts = [literal(float(value)).text for value in flat]
        rows = ",\n    ".join(", ".join(texts[i : i + 6]) for i in range(0, len(texts), 6))
        parts.append(f"static const double {each}_at_start[{flat.size}] = {{\n    {rows}\n}};")
        copies.append(
            f"    for (int i = 0; i < {flat.size}; i++) {{\n"
            f"        s->{each}[i] = {each}_at_start[i];\n    }}"
        )
    body = "\n".join(copies)
    return "\n\n".join([*parts, f"void {layout.name}_init({layout.name}_state *s)\n{{\n{body}\n}}"])


def _read(layout: Layout) -> str:
    """Copy the row of results to the members of the output."""
    lines = []
    count = (len(layout.outputs) - LEADING) // 2
    for i, port in enumerate(layout.outputs):
        if i < LEADING:
            place = i
        else:
            which, is_sd = divmod(i - LEADING, 2)
            place = LEADING + which + is_sd * count
        cast = "(long)" if port.kind == "integer" else ""
        lines.append(f"    out->{port.c_expression} = {cast}s->row[{place}];")
    body = "\n".join(lines)
    name = layout.name
    return f"void {name}_read(const {name}_state *s, {name}_output *out)\n{{\n{body}\n}}"


_HEADER = """/*
 * {title}.
 *
 * Generated from a Python estimator, and equal to it: same operations in the same order. C99, no heap, no
 * recursion, no variables but those of the caller. To get the same bits, compile without contraction of
 * multiplications and additions (-std=c99, or -ffp-contract=off).
 *
 * Do not edit: what the settings decide has been decided. Export anew.
 */
#ifndef {guard}
#define {guard}

#ifdef __cplusplus
extern "C" {{
#endif

/* All that the estimator remembers; no pointers: it can be copied and stored. */
typedef struct {{
{state}
}} {name}_state;

#define {upper}_SIZE (sizeof({name}_state))

/* What is to be said of a sample; several can hold at once. */
enum {{
{flags}
}};

typedef struct {{
{members}
}} {name}_output;

/* Bring the state to where the estimator stood when it was exported. */
void {name}_init({name}_state *s);

/*
 * The same with another belief about the SOC: the value and the standard deviation of its error.
 * Returns 0, or 1 and leaves the state alone when one of them is not within [0, 1].
 */
int {name}_start({name}_state *s, double soc, double soc_sd);

/*
 * Take one sample.
 *   current_A      > 0 charges; flows {flows}; NaN: missing
 *   voltage_V      terminal voltage with that current flowing; NaN: missing
 *   step_s         time since the sample before; without meaning at the first one
 *   temperature_C  temperature of the cell; NaN or below absolute zero: not measured
 * Returns 0, or 1 and leaves the state alone when the step is negative or not finite.
 */
int {name}_update({name}_state *s, double current_A, double voltage_V, double step_s,
    double temperature_C, {name}_output *out);

/* What is believed now. */
void {name}_read(const {name}_state *s, {name}_output *out);

#ifdef __cplusplus
}}
#endif

#endif
"""

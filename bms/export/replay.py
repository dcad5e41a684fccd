"""A replay of logged data through an exported estimator, compared with what the Python one made of them.

The replay is a C program of its own, so that it can be run where the estimator shall: it reads the samples
and the expected results from a CSV file, and says how far the block is from them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bms.estimators.base import KernelEstimator, Trace
from bms.export.block import CSource
from bms.export.c_source import export_c
from bms.logged_data import LoggedData

COMPILE = "cc -std=c99 -O2 -ffp-contract=off -o {name}_replay {name}_replay.c {name}.c -lm"
"""How the replay is compiled; -ffp-contract=off keeps a product and a sum apart, as they are in Python."""


@dataclass(frozen=True, slots=True)
class Replay:
    """Files of a replay, and the command that compiles it in their folder."""

    header: Path
    source: Path
    program: Path
    data: Path
    compile: str


def write_replay(
    folder: Path, estimator: KernelEstimator, log: LoggedData, name: str = "estimator"
) -> Replay:
    """Write an estimator as C, a program that replays a log through it, and the log with expected results.

    Parameters
    ----------
    folder : Path
        Where to; made if it is not there.
    estimator : KernelEstimator
        The estimator; it is left as it stands.
    log : LoggedData
        The samples.
    name : str
        Name of the block.

    Returns
    -------
    Replay
        NAME.h, NAME.c, NAME_replay.c and NAME_replay.csv, and how they are compiled. The program takes the
        CSV file and, if wanted, a tolerance (1e-9); it returns 0 where all results agree.

    Raises
    ------
    BatteryError
        When the name is no C identifier.
    """
    block = export_c(estimator, name)
    trace = estimator.copy().run(
        log.current_A, log.voltage_V, temperature_C=log.temperature_C, time_s=log.time_s
    )
    header, source = block.write(folder)
    program, data = folder / f"{name}_replay.c", folder / f"{name}_replay.csv"
    with data.open("w", encoding="ascii", newline="\n") as file:
        file.writelines(_rows(block, log, trace))
    program.write_text(_program(block), encoding="ascii", newline="\n")
    return Replay(header, source, program, data, COMPILE.format(name=name))


def _rows(block: CSource, log: LoggedData, trace: Trace) -> Iterator[str]:
    """The CSV file: inputs, then the results that are expected."""
    names = ["current_A", "voltage_V", "step_s", "temperature_C", *(port.name for port in block.outputs)]
    yield ",".join(names) + "\n"
    none = np.full(len(log), np.nan)
    columns = [
        log.current_A,
        log.voltage_V,
        np.diff(log.time_s, prepend=log.time_s[0]),
        none if log.temperature_C is None else log.temperature_C,
        trace.soc,
        trace.variance,
        trace.residual_V,
        trace.flags.astype(np.float64),
    ]
    for each, values in trace.parameters.items():
        columns += [values, trace.deviations[each]]
    for row in np.column_stack(columns).tolist():
        yield ",".join(map(repr, row)) + "\n"


def _program(block: CSource) -> str:
    name, count = block.name, len(block.outputs)
    names = ",\n    ".join(f'"{port.name}"' for port in block.outputs)
    reads = "\n".join(
        f"        got[{i}] = {'(double)' if port.kind == 'integer' else ''}out.{port.c_expression};"
        for i, port in enumerate(block.outputs)
    )
    return _PROGRAM.format(
        name=name, count=count, all=4 + count, names=names, reads=reads, compile=COMPILE.format(name=name)
    )


_PROGRAM = """/*
 * Replays logged data through {name} and compares with the results in the log.
 *
 *   {compile}
 *   ./{name}_replay {name}_replay.csv [tolerance]
 *
 * A result agrees when it differs by no more than the tolerance (1e-9) times one plus its size; missing
 * values (NaN) must be missing on both sides. Returns 0 when all agree, 1 when one does not, 2 without data.
 */
#include "{name}.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define OUTPUTS {count}
#define COLUMNS {all}
#define LONGEST_LINE 4096

static const char *const names[OUTPUTS] = {{
    {names}
}};

static int read_row(const char *line, double row[COLUMNS])
{{
    for (int i = 0; i < COLUMNS; i++) {{
        char *end = NULL;
        row[i] = strtod(line, &end);
        if (end == line) {{
            return 1;
        }}
        line = (*end == ',') ? end + 1 : end;
    }}
    return 0;
}}

static double difference(double got, double expected)
{{
    if ((isnan(got) != 0) || (isnan(expected) != 0)) {{
        return ((isnan(got) != 0) && (isnan(expected) != 0)) ? 0.0 : INFINITY;
    }}
    return fabs(got - expected) / (1.0 + fabs(expected));
}}

int main(int argc, char **argv)
{{
    static char line[LONGEST_LINE];
    double row[COLUMNS];
    double got[OUTPUTS];
    double worst[OUTPUTS] = {{0}};
    const double tolerance = (argc > 2) ? strtod(argv[2], NULL) : 1e-9;
    long samples = 0;
    int wrong = 0;
    {name}_state state;
    {name}_output out;
    FILE *file = (argc > 1) ? fopen(argv[1], "r") : NULL;

    if ((file == NULL) || (fgets(line, LONGEST_LINE, file) == NULL)) {{
        (void)fprintf(stderr, "usage: {name}_replay DATA.csv [tolerance]\\n");
        return 2;
    }}
    {name}_init(&state);
    while (fgets(line, LONGEST_LINE, file) != NULL) {{
        if ((read_row(line, row) != 0)
            || ({name}_update(&state, row[0], row[1], row[2], row[3], &out) != 0)) {{
            (void)fprintf(stderr, "row %ld cannot be used\\n", samples + 1);
            return 2;
        }}
{reads}
        for (int i = 0; i < OUTPUTS; i++) {{
            const double apart = difference(got[i], row[4 + i]);
            worst[i] = (apart > worst[i]) ? apart : worst[i];
        }}
        samples++;
    }}
    (void)fclose(file);
    for (int i = 0; i < OUTPUTS; i++) {{
        (void)printf("%-32s %.3g\\n", names[i], worst[i]);
        wrong += (worst[i] > tolerance) ? 1 : 0;
    }}
    (void)printf("%ld samples, %d of %d results differ by more than %g\\n", samples, wrong, OUTPUTS,
        tolerance);
    if (samples == 0) {{
        return 2;
    }}
    return (wrong == 0) ? 0 : 1;
}}
"""

"""``socwise cosim probe``: whether an FMU behaves as its mapping says."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from socwise.commands.cosim_inspect import FmuArgument
from socwise.commands.errors import CommandError
from socwise.commands.files import staged_file
from socwise.commands.options import JsonOption
from socwise.commands.screen import new_table, progress, show, show_json

if TYPE_CHECKING:
    from rich.table import Table

    from bms.cell import Cell
    from bms.plants.fmu.mapping import Mapping
    from bms.plants.fmu.probe import ProbeReport

CONTRADICTION = 1

MappingOption = Annotated[
    Path, typer.Option(metavar="MAPPING.toml", help="What the FMU's variables mean, see docs/fmu.md.")
]
IsolateOption = Annotated[
    Literal["yes", "no"], typer.Option(help="Run the FMU in a process of its own; without it is faster.")
]
DeadlineOption = Annotated[
    float, typer.Option(metavar="S", min=0.001, help="Longest time for one step of an isolated FMU.")
]
SeriesOption = Annotated[
    int | None,
    typer.Option(
        metavar="N", min=1, max=100_000, help="Cells in series.", show_default="as in [scale] of the mapping"
    ),
]
ParallelOption = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        min=1,
        max=100_000,
        help="Cells in parallel.",
        show_default="as in [scale] of the mapping",
    ),
]

_MARK = {"ok": "fits", "doubt": "doubtful", "contradiction": "CONTRADICTS"}


def probe(
    plant: FmuArgument,
    mapping: MappingOption,
    cell: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.toml",
            help="The cell it is taken for; its voltages are held against the FMU's.",
        ),
    ] = None,
    series: SeriesOption = None,
    parallel: ParallelOption = None,
    write: Annotated[
        bool,
        typer.Option(
            "--write", metavar="", help="Put the measured resistance and capacity into the mapping."
        ),
    ] = False,
    isolate: IsolateOption = "yes",
    deadline: DeadlineOption = 10.0,
    as_json: JsonOption = False,
) -> None:
    """Try an FMU out: rest, charge, rest, discharge.

    Checks signs, units and scale against the mapping, and measures resistance and capacity. Exit code 1 if
    something contradicts.
    """
    from bms.plants.fmu.limits import Limits
    from bms.plants.fmu.mapping import load_mapping
    from bms.plants.fmu.probe import probe as run
    from bms.plants.fmu.session import open_fmu

    known = load_mapping(mapping)
    pack = None if cell is None else cell_of(cell, known, series, parallel)
    with (
        progress("trying the FMU"),
        open_fmu(plant, known, isolate=isolate == "yes", limits=Limits(step_deadline_s=deadline)) as session,
    ):
        report = run(session, pack)
    result: dict[str, Any] = {"file": str(plant), "mapping": str(mapping), **report.to_json()}
    if write:
        from bms.plants.fmu.probe_write import with_measured

        text = with_measured(mapping.read_text(encoding="utf-8"), report)
        with staged_file(mapping) as path:
            path.write_text(text, encoding="utf-8")
    if as_json:
        show_json(result)
    else:
        show(finding_table(report), "")
        for line in _measured(report, mapping, write=write):
            show(line)
    if report.contradictions:
        raise typer.Exit(CONTRADICTION)


def cell_of(name: str, known: Mapping, series: int | None, parallel: int | None) -> Cell:
    """Load a cell, and see a pack of it as one: as many as asked for, or as the mapping takes the FMU for.

    Raises
    ------
    CommandError
        When the mapping has a scale that is no whole number of cells.
    BatteryError
        When there is no such cell.
    """
    from bms.cells import load_cell

    counts = []
    for option, given, own in (
        ("series", series, known.scale.series),
        ("parallel", parallel, known.scale.parallel),
    ):
        if given is None and own != round(own):
            raise CommandError(
                f"{option} in [scale] of the mapping is {own:g}; say how many cells that are with --{option}"
            )
        counts.append(round(own) if given is None else given)
    cell = load_cell(name)
    return cell if counts == [1, 1] else cell.scaled(*counts)


def finding_table(report: ProbeReport) -> Table:
    """Return a table with a row for each finding, contradictions first."""
    table = new_table("mapping", "verdict", "what was seen", left=3)
    order = ("contradiction", "doubt", "ok")
    for one in sorted(report.findings, key=lambda one: order.index(one.level)):
        table.add_row(f"[{one.about}]", _MARK[one.level], one.text)
    return table


def _measured(report: ProbeReport, mapping: Path, *, write: bool) -> list[str]:
    found = len(report.contradictions)
    if found:
        what = "A line of {} contradicts" if found == 1 else f"{found} lines of {{}} contradict"
        return [f"{what.format(mapping)} the FMU; mend and probe again"]
    values = [f"{report.voltage_V:.5g} V at rest"]
    if report.resistance_ohm is not None:
        values.append(f"{1e3 * report.resistance_ohm:.4g} mΩ")
    if report.capacity_Ah is not None:
        values.append(f"{report.capacity_Ah:.4g} Ah")
    lines = [f"Measured: {', '.join(values)}; brought back to its start by: {report.restoration}"]
    return [*lines, f"Resistance and capacity are in {mapping} now"] if write else lines

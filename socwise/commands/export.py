"""``socwise export``: a BMS or an EMS as C99 source, or as an FMU."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from socwise.commands.errors import CommandError
from socwise.commands.estimators import make_estimators, options_by_estimator, scaled_cell
from socwise.commands.files import check_file, staged_file
from socwise.commands.options import CycleOption, JsonOption, OnInfeasibleOption, one_concept, split
from socwise.commands.screen import complain, new_table, progress, show, show_json

if TYPE_CHECKING:
    from bms.cell import Cell
    from bms.estimators.base import KernelEstimator
    from bms.estimators.gate import Sensors
    from bms.export.block import CSource
    from bms.export.fmu_description import Timing
    from bms.logged_data import LoggedData
    from ems.export.tables import PolicyTables

export = typer.Typer(no_args_is_help=True, help="Write a BMS or an EMS as C source or as an FMU.")

FORMS = ("c", "fmu2", "fmu3")
RULES = "rule_based"
LARGE_BYTES = 1_000_000
"""Tables beyond this are mentioned: few embedded targets have room for them."""

FormOption = Annotated[
    str,
    typer.Option(
        "--form", metavar="FORM[,FORM...]", help="c: header and source; fmu2, fmu3: FMU of FMI 2.0, 3.0."
    ),
]
NameOption = Annotated[
    str | None, typer.Option(metavar="NAME", help="What C calls it.", show_default="bms or ems")
]
OutOption = Annotated[Path, typer.Option(metavar="DIR", help="Folder for the files.")]


@export.command("bms")
def export_bms(
    cell: Annotated[str, typer.Option(metavar="NAME|FILE.toml", help="A preset, or a file of your own.")],
    estimator: Annotated[
        str,
        typer.Option(metavar="NAME", help="coulomb, ekf, ukf, gpc-gradient, gpc-gauss-newton, gpc-ekf."),
    ] = "ekf",
    soc0: Annotated[float, typer.Option(metavar="F", help="SOC at the start, as far as known.")] = 0.5,
    soc0_sd: Annotated[float, typer.Option(metavar="F", help="Standard deviation of its error.")] = 0.3,
    holds: Annotated[
        Literal["from", "until"],
        typer.Option(help="A current flows from its sample to the next, or until it since the last."),
    ] = "until",
    step: Annotated[
        float,
        typer.Option(
            metavar="S",
            help="Usual time between two samples; a step beyond five such, 60 s at least, is a gap.",
        ),
    ] = 1.0,
    series: Annotated[int, typer.Option(metavar="N", min=1, max=100_000, help="Cells in series.")] = 1,
    parallel: Annotated[int, typer.Option(metavar="N", min=1, max=100_000, help="Cells in parallel.")] = 1,
    current_sd: Annotated[
        float | None, typer.Option(metavar="A", help="Noise of the current.", show_default="0.01")
    ] = None,
    voltage_sd: Annotated[
        float | None,
        typer.Option(metavar="V", help="Noise of the voltage.", show_default="0.002 a cell"),
    ] = None,
    option: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=VALUE", help="An option of the estimator; may be repeated."),
    ] = None,
    replay: Annotated[
        Path | None,
        typer.Option(
            metavar="LOG.csv", help="Write a C program too that checks the C against Python on this log."
        ),
    ] = None,
    form: FormOption = "fmu3",
    name: NameOption = None,
    out: OutOption = Path("results/export"),
    as_json: JsonOption = False,
) -> None:
    """Write an estimator: current, voltage and temperature in, SOC, its variance and parameters out."""
    forms = _forms(form)
    from bms.cells import load_cell
    from bms.export.c_source import export_c
    from bms.export.fmu_description import Timing

    chosen = estimator.strip().lower().replace("-", "_")
    sensors = _sensors(holds, step, series, current_sd, voltage_sd)
    pack = scaled_cell(load_cell(cell), series, parallel)
    options = options_by_estimator(option or [], [chosen])
    (made,) = make_estimators([chosen], options, pack, soc0, soc0_sd, sensors)
    log = None if replay is None else _log(replay, pack)
    block = export_c(made, name or "bms")
    files = _write(block, forms, out, Timing(step_s=step), ())
    if log is not None:
        files += [file for file in _write_replay(made, log, block.name, out) if file not in files]
    _finish("bms", block, files, as_json=as_json)


@export.command("ems")
def export_ems(
    policy: Annotated[
        str, typer.Argument(metavar="POLICY.nc", help="What 'socwise solve' wrote, or the word rule-based.")
    ],
    concept: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="For rule-based, and where the battery pack is a file of your own."
        ),
    ] = None,
    cycle: CycleOption = "larsson",
    soc: Annotated[
        str | None,
        typer.Option(metavar="LOW,HIGH", help="Keep this range of SOC only.", show_default="the whole grid"),
    ] = None,
    on_infeasible: OnInfeasibleOption = "error",
    form: FormOption = "fmu3",
    name: NameOption = None,
    out: OutOption = Path("results/export"),
    as_json: JsonOption = False,
) -> None:
    """Write a policy: SOC and its variance in, control, engine torque and battery power out."""
    forms = _forms(form)
    soc_range = None if soc is None else _range(soc)
    from ems.export.c_source import REFUSALS, export_policy
    from ems.export.tables import narrowed

    if policy.strip().lower().replace("-", "_") == RULES:
        tables = _rules(concept or "hev", cycle, on_infeasible)
    else:
        from socwise.commands.policy_tables import read_policy

        tables = read_policy(Path(policy), None if concept is None else one_concept(concept))
    if soc_range is not None:
        tables = narrowed(tables, *soc_range)
    with progress("writing the policy"):
        source = export_policy(tables, name or "ems")
        files = _write(source.block, forms, out, source.timing, REFUSALS, source.data_source())
    _finish("ems", source.block, files, as_json=as_json)


def _log(path: Path, cell: Cell) -> LoggedData:
    from bms.log_checks import check_cell
    from bms.logged_data import read_log

    log = read_log(path)
    check_cell(log, cell)
    return log


def _write_replay(estimator: KernelEstimator, log: LoggedData, name: str, out: Path) -> list[Path]:
    from bms.export.replay import write_replay

    try:
        written = write_replay(out, estimator, log, name)
    except OSError as error:
        raise CommandError(
            f"cannot write to {out}: {error.strerror or error}; choose another --out"
        ) from error
    complain(
        f"to check the C on this log: cd {out} && {written.compile} && ./{name}_replay {name}_replay.csv"
    )
    return [written.header, written.source, written.program, written.data]


def _rules(concept: str, cycle: str, on_infeasible: Literal["error", "limit"]) -> PolicyTables:
    from drivecycles import load_cycle
    from ems import build_policy, build_problem
    from ems.export.tables import tables_of

    problem = build_problem(one_concept(concept), load_cycle(cycle), on_infeasible=on_infeasible)
    return tables_of(build_policy(RULES, problem))


def _forms(text: str) -> list[str]:
    forms = [form.lower() for form in split(text, "--form")]
    for form in forms:
        if form not in FORMS:
            raise CommandError(f"--form names {form!r}; known are {', '.join(FORMS)}")
    return list(dict.fromkeys(forms))


def _range(text: str) -> tuple[float, float]:
    try:
        low, high = (float(item) for item in split(text, "--soc"))
    except ValueError as error:
        raise CommandError(f"--soc is {text!r}; give two fractions, such as 0.5,0.8") from error
    return low, high


def _sensors(
    holds: str, step_s: float, series: int, current_sd: float | None, voltage_sd: float | None
) -> Sensors:
    from pydantic import ValidationError

    from bms.estimators.gate import Sensors
    from bms.logged_data import GAP_RATIO
    from bms.toml_file import complaint

    if not 0.0 < step_s < float("inf"):
        raise CommandError(f"--step is {step_s:g}; give the seconds between two samples, more than zero")
    fields = Sensors.model_fields
    given: dict[str, Any] = {"holds": holds, "gap_s": max(fields["gap_s"].default, GAP_RATIO * step_s)}
    if current_sd is not None:
        given["current_sd_A"] = current_sd
    # A sensor for a hundred cells has a hundred times the range, and its noise goes with the range.
    given["voltage_sd_V"] = series * fields["voltage_sd_V"].default if voltage_sd is None else voltage_sd
    try:
        return Sensors(**given)
    except ValidationError as error:
        raise complaint(error, Sensors, "--current-sd and --voltage-sd do not fit") from error


def _write(
    block: CSource,
    forms: list[str],
    out: Path,
    timing: Timing,
    refusals: tuple[str, ...],
    data: Iterable[str] = (),
) -> list[Path]:
    """Write the forms; each file whole or not at all."""
    from bms.export.fmu import write_fmu

    files = []
    for form in forms:
        if form == "c":
            files += _write_c(block, out, data)
            continue
        version: Literal[2, 3] = 2 if form == "fmu2" else 3
        path = out / f"{block.name}-fmi{version}.fmu"
        check_file(path)
        with staged_file(path) as staging:
            write_fmu(block, staging, version, timing=timing, refusals=refusals)
        files.append(path)
    return files


def _write_c(block: CSource, out: Path, data: Iterable[str]) -> list[Path]:
    texts: list[tuple[str, Iterable[str]]] = [
        (f"{block.name}.h", [block.header]),
        (f"{block.name}.c", [block.source]),
    ]
    if block.data:
        texts.append((f"{block.name}_data.c", data))
    for file, parts in texts:
        with staged_file(out / file) as staging, staging.open("w", encoding="ascii", newline="\n") as stream:
            stream.writelines(parts)
    files = [out / file for file, _ in texts]
    if block.data:
        binary = out / f"{block.name}.bin"
        with staged_file(binary) as staging:
            staging.write_bytes(block.data)
        files.append(binary)
        if len(block.data) > LARGE_BYTES:
            complain(
                f"warning: the tables take {len(block.data) / 1e6:.1f} MB of constant memory, and a compiler"
                f" some forty times that for {block.name}_data.c; --soc LOW,HIGH leaves out what the car does"
                " not come to, or load the .bin file"
            )
    return files


def _finish(what: str, block: CSource, files: list[Path], *, as_json: bool) -> None:
    ports = {
        "parameters": [port.name for port in block.parameters],
        "inputs": [port.name for port in block.inputs],
        "outputs": [port.name for port in block.outputs],
    }
    if as_json:
        show_json(
            {
                "schema": 1,
                "what": what,
                "name": block.name,
                "description": block.description,
                **ports,
                "state_bytes": block.state_bytes,
                "table_bytes": len(block.data),
                "files": [str(file) for file in files],
            }
        )
        return
    table = new_table(what, block.name, left=2)
    table.add_row("what it is", block.description)
    for label, names in ports.items():
        table.add_row(label, ", ".join(names))
    table.add_row("state", f"{block.state_bytes} bytes")
    if block.data:
        table.add_row("tables", f"{len(block.data) / 1e6:.1f} MB")
    table.add_row("files", "\n".join(str(file) for file in files))
    show(table)

"""``socwise estimate``: SOC and SOH from logged current and voltage."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from socwise.commands.estimators import (
    estimator_names,
    make_estimators,
    options_by_estimator,
    run_estimators,
    scaled_cell,
    sensors_of,
)
from socwise.commands.options import JsonOption
from socwise.commands.screen import Advance, complain, progress, show, show_json

MEGABYTE = 1_000_000
_COLUMN = "NAME[:UNIT]"


def estimate(
    data: Annotated[Path, typer.Argument(metavar="DATA.csv", help="The log; it may be compressed, .gz.")],
    cell: Annotated[str, typer.Option(metavar="NAME|FILE.toml", help="A preset, or a file of your own.")],
    estimator: Annotated[
        str,
        typer.Option(
            metavar="NAME[,NAME...]", help="coulomb, ekf, ukf, gpc-gradient, gpc-gauss-newton, gpc-ekf."
        ),
    ] = "ekf",
    soc0: Annotated[float, typer.Option(metavar="F", help="SOC at the start, as far as known.")] = 0.5,
    soc0_sd: Annotated[float, typer.Option(metavar="F", help="Standard deviation of its error.")] = 0.3,
    time: Annotated[str | None, typer.Option(metavar=_COLUMN, help="Column of the time.")] = None,
    current: Annotated[str | None, typer.Option(metavar=_COLUMN, help="Column of the current.")] = None,
    voltage: Annotated[str | None, typer.Option(metavar=_COLUMN, help="Column of the voltage.")] = None,
    temperature: Annotated[
        str | None, typer.Option(metavar=_COLUMN, help="Column of the temperature; none leaves it out.")
    ] = None,
    soc: Annotated[
        str | None, typer.Option(metavar=_COLUMN, help="Column of the true SOC; none leaves it out.")
    ] = None,
    discharge_positive: Annotated[
        bool,
        typer.Option("--discharge-positive", metavar="", help="In the file a positive current discharges."),
    ] = False,
    holds: Annotated[
        Literal["from", "until"],
        typer.Option(help="A current flows from its sample to the next, or until it since the last."),
    ] = "from",
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
        typer.Option(
            metavar="[NAME.]KEY=VALUE", help="An option of all estimators or of one; may be repeated."
        ),
    ] = None,
    start_after: Annotated[
        float, typer.Option(metavar="S", help="Leave out the first seconds of the log.")
    ] = 0.0,
    every: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=1, help="Keep every so many-th sample.", show_default="at most 200,000 rows"
        ),
    ] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for results and figures.")] = Path(
        "results/estimate"
    ),
    as_json: JsonOption = False,
) -> None:
    """Estimate state of charge, capacity and resistance from a log of current and voltage.

    Finds the columns of the Battery Data Format and of many cyclers. Writes traces and figures to --out.
    """
    names = estimator_names(estimator)
    from bms.cells import load_cell
    from bms.log_checks import check_cell
    from bms.logged_data import read_log
    from socwise.estimate_store import write_estimates
    from socwise.estimation import to_json
    from socwise.results.staging import ESTIMATE_FORMAT, check_writable

    check_writable(out, ESTIMATE_FORMAT)
    chosen = scaled_cell(load_cell(cell), series, parallel)
    options = options_by_estimator(option or [], names)
    # Once without the log: a misspelt name should not wait for millions of rows.
    make_estimators(names, options, chosen, soc0, soc0_sd)
    columns = {"time": time, "current": current, "voltage": voltage, "temperature": temperature, "soc": soc}
    with progress("reading the log") as advance:
        tell = None if advance is None else _in_megabytes(advance)
        log = read_log(data, columns=columns, discharge_positive=discharge_positive, progress=tell)
    check_cell(log, chosen)
    if start_after:
        log = log.after(start_after)
    sensors = sensors_of(log, current_sd, voltage_sd, holds, chosen.series)
    estimators = make_estimators(names, options, chosen, soc0, soc0_sd, sensors)
    for doubt in log.doubts:
        complain(f"warning: {doubt}")
    runs = run_estimators(estimators, log, every)
    result = to_json(log, chosen.name, runs)
    settings = {
        "data": str(data),
        "columns": dict(log.headers),
        "discharge_positive": discharge_positive,
        "soc0": soc0,
        "soc0_sd": soc0_sd,
        "sensors": sensors.model_dump(),
        "options": options,
        "start_after_s": start_after,
        "every": every,
    }
    with progress("drawing figures and writing results"):
        write_estimates(runs, chosen, result, settings, out)
    _show(result, out, as_json=as_json)


def _in_megabytes(advance: Advance) -> Advance:
    return lambda done, size: advance(done // MEGABYTE, max(size // MEGABYTE, 1))


def _show(result: dict[str, Any], out: Path, *, as_json: bool) -> None:
    if as_json:
        show_json(result)
        return
    from socwise.commands.estimate_table import described, mistrust, parameter_table, soc_table

    estimators = result["estimators"]
    parameters = parameter_table(estimators)
    show(*described(result), "", soc_table(estimators), "")
    if parameters is not None:
        show(parameters, "")
    show(*mistrust(estimators))
    show("±: one standard deviation, as the estimator believes it")
    show(f"Results are in {out}, figures in {out / 'figures'}")

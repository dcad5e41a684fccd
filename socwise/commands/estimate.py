"""``socwise estimate``: SOC and SOH from logged current and voltage."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from socwise.commands.errors import CommandError
from socwise.commands.options import JsonOption, split
from socwise.commands.screen import Advance, complain, progress, show, show_json

if TYPE_CHECKING:
    from bms.cell import Cell
    from bms.estimators.base import KernelEstimator
    from bms.estimators.gate import Sensors
    from bms.logged_data import LoggedData
    from socwise.estimation import EstimateRun

MEGABYTE = 1_000_000
_COLUMN = "NAME[:UNIT]"
_OF_THEIR_OWN = {
    "soc": "--soc0",
    "soc_sd": "--soc0-sd",
    "sensors": "--current-sd and --voltage-sd",
    "name": "--estimator",
    "cell": "--cell",
}


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
    names = _estimator_names(estimator)
    from bms.cells import load_cell
    from bms.log_checks import check_cell
    from bms.logged_data import read_log
    from socwise.estimate_store import write_estimates
    from socwise.estimation import to_json
    from socwise.results.staging import ESTIMATE_FORMAT, check_writable

    check_writable(out, ESTIMATE_FORMAT)
    chosen = _scaled(load_cell(cell), series, parallel)
    options = _options(option or [], names)
    # Once without the log: a misspelt name should not wait for millions of rows.
    _make(names, options, chosen, soc0, soc0_sd)
    columns = {"time": time, "current": current, "voltage": voltage, "temperature": temperature, "soc": soc}
    with progress("reading the log") as advance:
        tell = None if advance is None else _in_megabytes(advance)
        log = read_log(data, columns=columns, discharge_positive=discharge_positive, progress=tell)
    check_cell(log, chosen)
    if start_after:
        log = log.after(start_after)
    sensors = _sensors(log, current_sd, voltage_sd, holds, chosen.series)
    estimators = _make(names, options, chosen, soc0, soc0_sd, sensors)
    for doubt in log.doubts:
        complain(f"warning: {doubt}")
    runs = _run(estimators, log, every)
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


def _estimator_names(text: str) -> list[str]:
    names = [name.lower().replace("-", "_") for name in split(text, "--estimator")]
    twice = next((name for place, name in enumerate(names) if name in names[:place]), None)
    if twice is not None:
        raise CommandError(f"--estimator names {twice!r} twice; name each once")
    return names


def _scaled(cell: Cell, series: int, parallel: int) -> Cell:
    return cell if series == parallel == 1 else cell.scaled(series, parallel)


def _sensors(
    log: LoggedData, current_sd: float | None, voltage_sd: float | None, holds: str, series: int = 1
) -> Sensors:
    from pydantic import ValidationError

    from bms.estimators.gate import Sensors
    from bms.logged_data import GAP_RATIO
    from bms.toml_file import complaint

    given: dict[str, Any] = {"holds": holds}
    given |= {
        key: value
        for key, value in (("current_sd_A", current_sd), ("voltage_sd_V", voltage_sd))
        if value is not None
    }
    # What is a gap in a log of one sample a second is the usual step in one of a sample in five minutes.
    usual = Sensors.model_fields["gap_s"].default
    given["gap_s"] = max(usual, GAP_RATIO * log.step_s)
    # A sensor for a hundred cells has a hundred times the range, and its noise goes with the range.
    given.setdefault("voltage_sd_V", series * Sensors.model_fields["voltage_sd_V"].default)
    try:
        return Sensors(**given)
    except ValidationError as error:
        raise complaint(error, Sensors, "--current-sd and --voltage-sd do not fit") from error


def _options(texts: list[str], names: list[str]) -> dict[str, dict[str, Any]]:
    """Options by estimator; those of all stand under the empty name."""
    found: dict[str, dict[str, Any]] = {"": {}}
    for text in texts:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not key or not equals or not value:
            raise CommandError(
                f"--option is {text!r}; give KEY=VALUE for all estimators, or NAME.KEY=VALUE for one"
            )
        owner, _, name = key.rpartition(".")
        if name in _OF_THEIR_OWN:
            raise CommandError(
                f"--option sets {name!r}, which has an option of its own: {_OF_THEIR_OWN[name]}"
            )
        owner = owner.lower().replace("-", "_")
        if owner and owner not in names:
            raise CommandError(f"--option {text!r} is for {owner!r}, which --estimator does not name")
        try:
            found.setdefault(owner, {})[name] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            found.setdefault(owner, {})[name] = value
    return found


def _make(
    names: list[str],
    options: dict[str, dict[str, Any]],
    cell: Cell,
    soc: float,
    soc_sd: float,
    sensors: Sensors | None = None,
) -> list[KernelEstimator]:
    from bms.errors import BatteryError
    from bms.estimators.catalogue import make_estimator

    if not 0.0 <= soc <= 1.0:
        raise CommandError(f"--soc0 is {soc:g}; give a fraction, not per cent, between 0 and 1")
    made = []
    for name in names:
        own = options[""] | options.get(name, {})
        try:
            made.append(make_estimator(name, cell, soc=soc, soc_sd=soc_sd, sensors=sensors, **own))
        except BatteryError as error:
            shared = [key for key in options[""] if f"unknown key {key}" in str(error)]
            if not shared or len(names) == 1:
                raise
            raise CommandError(
                f"{error}\n--option {shared[0]}=... is for every estimator; to set it for one alone, write"
                f" --option NAME.{shared[0]}=..."
            ) from error
    return made


def _run(estimators: list[KernelEstimator], log: LoggedData, every: int | None) -> list[EstimateRun]:
    from socwise.estimation import default_every, run_estimator

    rows = default_every(len(log)) if every is None else every
    total = len(estimators) * len(log)
    runs: list[EstimateRun] = []
    with progress("running the estimators (the first run also compiles)") as advance:
        for estimator in estimators:
            before = len(runs) * len(log)

            def tell(done: int, before: int = before) -> None:
                if advance is not None:
                    advance(before + done, total)

            runs.append(run_estimator(estimator, log, every=rows, progress=tell))
    return runs


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

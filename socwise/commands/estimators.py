"""Estimators on the command line: their names and options, the cell and the sensors that they are told of."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from socwise.commands.errors import CommandError
from socwise.commands.options import split, toml_value
from socwise.commands.screen import progress

if TYPE_CHECKING:
    from bms.cell import Cell
    from bms.estimators.base import KernelEstimator
    from bms.estimators.gate import Sensors
    from bms.logged_data import LoggedData
    from socwise.estimation import EstimateRun

_OF_THEIR_OWN = {
    "soc": "--soc0",
    "soc_sd": "--soc0-sd",
    "sensors": "--current-sd and --voltage-sd",
    "name": "--estimator",
    "cell": "--cell",
}


def estimator_names(text: str) -> list[str]:
    """Read ``--estimator``.

    Raises
    ------
    CommandError
        When one is named twice; unknown names are found by `make_estimators`.
    """
    names = [name.lower().replace("-", "_") for name in split(text, "--estimator")]
    twice = next((name for place, name in enumerate(names) if name in names[:place]), None)
    if twice is not None:
        raise CommandError(f"--estimator names {twice!r} twice; name each once")
    return names


def scaled_cell(cell: Cell, series: int, parallel: int) -> Cell:
    """Scale a cell to a pack, unless it is one cell."""
    return cell if series == parallel == 1 else cell.scaled(series, parallel)


def sensors_of(
    log: LoggedData, current_sd: float | None, voltage_sd: float | None, holds: str, series: int = 1
) -> Sensors:
    """Describe the sensors of a log.

    Parameters
    ----------
    log : LoggedData
        Its usual step says what a gap is.
    current_sd, voltage_sd : float or None
        Noise, A and V; None for the default.
    holds : str
        Whether a current holds from its sample on, or until it.
    series : int
        Cells in series that the voltage is measured over.

    Raises
    ------
    BatteryError
        When a noise is not one.
    """
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


def options_by_estimator(texts: list[str], names: list[str]) -> dict[str, dict[str, Any]]:
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
        found.setdefault(owner, {})[name] = toml_value(value)
    return found


def make_estimators(
    names: list[str],
    options: dict[str, dict[str, Any]],
    cell: Cell,
    soc: float,
    soc_sd: float,
    sensors: Sensors | None = None,
) -> list[KernelEstimator]:
    """Make estimators by name.

    Parameters
    ----------
    names : list of str
        From `estimator_names`.
    options : dict
        From `options_by_estimator`.
    cell : Cell
        The nominal cell.
    soc, soc_sd : float
        SOC at the start as far as known, and the standard deviation of its error.
    sensors : Sensors, optional
        Noise of the sensors.

    Raises
    ------
    BatteryError, CommandError
        When a name or an option is unknown, or a value out of range.
    """
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


def run_estimators(
    estimators: list[KernelEstimator], log: LoggedData, every: int | None
) -> list[EstimateRun]:
    """Run estimators over a log, with progress; ``every`` is None for as many rows as a plot can show."""
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

"""``socwise cosim run``: estimators over what an FMU answers to a load."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from socwise.commands.cosim_inspect import FmuArgument
from socwise.commands.cosim_probe import (
    DeadlineOption,
    IsolateOption,
    MappingOption,
    ParallelOption,
    SeriesOption,
    cell_of,
)
from socwise.commands.errors import CommandError
from socwise.commands.estimators import (
    estimator_names,
    make_estimators,
    options_by_estimator,
    run_estimators,
    sensors_of,
)
from socwise.commands.options import JsonOption, one_concept
from socwise.commands.screen import complain, progress, show, show_json

if TYPE_CHECKING:
    from bms.cell import Cell
    from bms.estimators.gate import Sensors
    from bms.load_profile import LoadProfile
    from bms.logged_data import LoggedData
    from bms.plants.fmu.mapping import Mapping
    from socwise.cosimulation import Drive, SensorFaults

_COLUMN = "NAME[:UNIT]"


def run(
    plant: FmuArgument,
    mapping: MappingOption,
    cell: Annotated[
        str, typer.Option(metavar="NAME|FILE.toml", help="The cell that the estimators take it for.")
    ],
    profile: Annotated[
        Path | None, typer.Option(metavar="DATA.csv", help="Load: a log with current or power.")
    ] = None,
    cycle: Annotated[
        str | None,
        typer.Option(metavar="NAME[+NAME...]", help="Load: battery power of --concept on a drive cycle."),
    ] = None,
    concept: Annotated[str, typer.Option(metavar="NAME", help="hev, phev, or a .toml file.")] = "phev",
    policy: Annotated[str, typer.Option(metavar="NAME", help="Who drives on --cycle.")] = "rule_based",
    estimator: Annotated[
        str,
        typer.Option(
            metavar="NAME[,NAME...]", help="coulomb, ekf, ukf, gpc-gradient, gpc-gauss-newton, gpc-ekf."
        ),
    ] = "ekf",
    series: SeriesOption = None,
    parallel: ParallelOption = None,
    isolate: IsolateOption = "yes",
    deadline: DeadlineOption = 10.0,
    start_soc: Annotated[
        float | None, typer.Option(metavar="F", help="SOC the FMU starts at.", show_default="its own")
    ] = None,
    soc0: Annotated[float, typer.Option(metavar="F", help="SOC the estimators start at.")] = 0.5,
    soc0_sd: Annotated[float, typer.Option(metavar="F", help="Standard deviation of its error.")] = 0.3,
    step: Annotated[
        float | None,
        typer.Option(metavar="S", help="Time between samples.", show_default="that of the load"),
    ] = None,
    current_sd: Annotated[
        float | None, typer.Option(metavar="A", help="Noise of the current.", show_default="0.01")
    ] = None,
    voltage_sd: Annotated[
        float | None,
        typer.Option(metavar="V", help="Noise of the voltage.", show_default="0.002 a cell"),
    ] = None,
    current_offset: Annotated[
        float, typer.Option(metavar="A", help="Offset of the current sensor, unknown to the estimators.")
    ] = 0.0,
    noise: Annotated[
        Literal["yes", "no"], typer.Option(help="Add the sensors' noise to what the FMU answers.")
    ] = "yes",
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Of the noise.")] = 0,
    time: Annotated[str | None, typer.Option(metavar=_COLUMN, help="Column of the time.")] = None,
    current: Annotated[str | None, typer.Option(metavar=_COLUMN, help="Column of the current.")] = None,
    power: Annotated[str | None, typer.Option(metavar=_COLUMN, help="Column of the power.")] = None,
    discharge_positive: Annotated[
        bool,
        typer.Option("--discharge-positive", metavar="", help="In the file a positive load discharges."),
    ] = False,
    option: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[NAME.]KEY=VALUE", help="An option of all estimators or of one; may be repeated."
        ),
    ] = None,
    every: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=1, help="Keep every so many-th sample.", show_default="at most 200,000 rows"
        ),
    ] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for results and figures.")] = Path(
        "results/cosim"
    ),
    as_json: JsonOption = False,
) -> None:
    """Drive an FMU along a load, run estimators on what its sensors see, and compare with the true SOC.

    The FMU is probed first; where it contradicts its mapping nothing is run.
    """
    names = estimator_names(estimator)
    from bms.plants.fmu.mapping import load_mapping
    from socwise.estimate_store import write_estimates
    from socwise.estimation import to_json
    from socwise.results.staging import ESTIMATE_FORMAT, check_writable

    check_writable(out, ESTIMATE_FORMAT)
    known = load_mapping(mapping)
    pack = cell_of(cell, known, series, parallel)
    options = options_by_estimator(option or [], names)
    # Once without the log: a misspelt name should not wait for the FMU.
    make_estimators(names, options, pack, soc0, soc0_sd)
    if start_soc is not None and not 0.0 <= start_soc <= 1.0:
        raise CommandError(f"--start-soc is {start_soc:g}; give a fraction, not per cent, between 0 and 1")
    if cycle is None:
        columns = {"time": time, "current": current, "power": power}
        load = _logged_load(profile, columns, step, known.step_s, discharge_positive=discharge_positive)
    else:
        load = _cycle_load(cycle, concept, policy, profile, step)
    driven = _drive(plant, known, load, pack, start_soc, isolated=isolate == "yes", deadline_s=deadline)
    log, sensors, faults = _look(driven, pack, current_sd, voltage_sd, current_offset, noise, seed)
    runs = run_estimators(make_estimators(names, options, pack, soc0, soc0_sd, sensors), log, every)
    result = {"schema": 1, "plant": driven.facts} | to_json(log, pack.name, runs)
    settings = {
        "plant": driven.facts,
        "mapping": known.model_dump(exclude_none=True),
        "load": {"source": load.source, "step_s": load.step_s},
        "start_soc": start_soc,
        "soc0": soc0,
        "soc0_sd": soc0_sd,
        "sensors": sensors.model_dump(),
        "faults": asdict(faults),
        "seed": seed,
        "options": options,
        "every": every,
    }
    with progress("drawing figures and writing results"):
        write_estimates(runs, pack, result, settings, out, also=partial(_also, driven, log), truth="FMU")
    _show(result, out, as_json=as_json)


@dataclass(frozen=True)
class _Driven:
    """What the FMU answered, what it is, and what was done to the load."""

    drive: Drive
    facts: dict[str, Any]
    source: str
    notes: tuple[str, ...]


def _logged_load(
    profile: Path | None,
    columns: dict[str, str | None],
    step_s: float | None,
    unit_s: float,
    *,
    discharge_positive: bool,
) -> LoadProfile:
    if profile is None:
        raise CommandError(
            "there is no load; give --profile DATA.csv, a log with current or power, or --cycle NAME"
        )
    from bms.load_profile import read_profile

    return read_profile(
        profile, step_s=step_s, unit_s=unit_s, columns=columns, discharge_positive=discharge_positive
    )


def _cycle_load(
    cycle: str, concept: str, policy: str, profile: Path | None, step_s: float | None
) -> LoadProfile:
    if profile is not None:
        raise CommandError("--profile and --cycle are both a load; give one of the two")
    from drivecycles import load_cycle
    from socwise.cycle_load import cycle_load

    car, trip = one_concept(concept), load_cycle(cycle)
    with progress(f"driving {car.name} on {trip.name}"):
        load = cycle_load(car, trip, policy)
    if step_s is not None and step_s != load.step_s:
        raise CommandError(
            f"--step is {step_s:g}; a drive cycle has steps of {load.step_s:g} s, leave it out"
        )
    return load


def _drive(
    plant: Path,
    known: Mapping,
    load: LoadProfile,
    pack: Cell,
    start_soc: float | None,
    *,
    isolated: bool,
    deadline_s: float,
) -> _Driven:
    """Probe the FMU, and drive it along the load."""
    from bms.plants.fmu.limits import Limits
    from bms.plants.fmu.probe import probe
    from bms.plants.fmu.session import open_fmu
    from socwise.cosimulation import drive_plant

    limits = Limits(step_deadline_s=deadline_s)
    with open_fmu(plant, known, isolate=isolated, limits=limits) as session:
        report = probe(session, pack)
        report.check()
        with progress("driving the FMU") as advance:
            drive = drive_plant(session.start(start_soc), load, advance)
        description = session.description
        facts = {
            "file": str(plant),
            "model": description.name,
            "tool": description.tool,
            "fmi": description.version,
            "kind": session.roles.wiring.kind,
            "drive": known.drive.role,
            "isolated": isolated,
            "restored_by": session.restoration,
            "probe": report.to_json(),
            "range": drive.ranges(),
        }
    for finding in report.findings:
        if finding.level == "doubt":
            complain(f"warning: [{finding.about}] {finding.text}")
    return _Driven(drive, facts, f"{plant.name}, {load.source}", load.notes)


def _look(
    driven: _Driven,
    pack: Cell,
    current_sd: float | None,
    voltage_sd: float | None,
    current_offset_A: float,
    noise: str,
    seed: int,
) -> tuple[LoggedData, Sensors, SensorFaults]:
    """Look at the drive through the sensors; their noise is what the estimators are told."""
    import numpy as np

    from socwise.cosimulation import SensorFaults, measured

    exact = measured(driven.drive, SensorFaults(), np.random.default_rng(seed), driven.source, driven.notes)
    sensors = sensors_of(exact, current_sd, voltage_sd, "until", pack.series)
    if noise == "yes":
        faults = SensorFaults(sensors.current_sd_A, sensors.voltage_sd_V, current_offset_A)
    else:
        faults = SensorFaults(current_offset_A=current_offset_A)
    log = measured(driven.drive, faults, np.random.default_rng(seed), driven.source, driven.notes)
    return log, sensors, faults


def _also(driven: _Driven, log: LoggedData, folder: Path) -> None:
    """Write what the sensors saw as a log that ``socwise estimate`` reads, and draw what the FMU did."""
    from socwise.cosimulation import write_log
    from socwise.figures.plant_drive import write_plant_drive

    write_log(log, folder / "log.csv")
    write_plant_drive(driven.drive, folder / "figures" / "plant.png", driven.source)


def _show(result: dict[str, Any], out: Path, *, as_json: bool) -> None:
    if as_json:
        show_json(result)
        return
    from socwise.commands.estimate_table import described, mistrust, parameter_table, soc_table

    plant, estimators = result["plant"], result["estimators"]
    where = "in a process of its own" if plant["isolated"] else "in this process"
    tool = f", exported by {plant['tool']}" if plant["tool"] else ""
    show(f"{plant['model']}: FMI {plant['fmi']}.0, {plant['kind']}, {where}{tool}")
    parameters = parameter_table(estimators)
    show(*described(result), _ranges(plant["range"]), "", soc_table(estimators), "")
    if parameters is not None:
        show(parameters, "")
    show(*mistrust(estimators))
    show("±: one standard deviation, as the estimator believes it; SOC error: against the FMU's")
    show(f"Results are in {out}, figures in {out / 'figures'}")


def _ranges(found: dict[str, list[float]]) -> str:
    """What the FMU went through, in a line."""
    first, last = (100.0 * soc for soc in found["soc"])
    words = [f"SOC from {first:.4g} to {last:.4g} %"]
    for name, unit in (("current_A", "A"), ("voltage_V", "V"), ("temperature_C", "°C")):
        if name in found:
            low, high = found[name]
            words.append(f"{low:.4g} to {high:.4g} {unit}")
    return f"the FMU: {', '.join(words)}"

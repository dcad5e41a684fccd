"""An FMU in this process and in a child's, against fmpy's own calls on the same library."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType

import numpy as np

from benchmarks.rivals import DisagreementError
from benchmarks.timing import Task
from bms.plants.fmu.archive import unpack
from bms.plants.fmu.channel import Channel, Kind, Wiring
from bms.plants.fmu.in_process import open_channel
from bms.plants.fmu.isolated import IsolatedChannel
from bms.plants.fmu.mapping import load_mapping
from bms.plants.fmu.session import FmuSession, open_fmu

INPUT, OUTPUTS, STEP_S = "current", ("voltage", "soc"), 1.0
STARTS = (0.6,)
Outputs = tuple[float, ...]


def battery_files() -> ModuleType:
    """Load the builder of the test suite's FMU."""
    place = Path(__file__).parents[1] / "tests" / "fmu_files.py"
    spec = spec_from_file_location("fmu_files", place)
    if spec is None or spec.loader is None:
        raise ImportError("tests/fmu_files.py is missing; benchmarks run from a checkout")
    files = module_from_spec(spec)
    # Its records look for their module by name.
    sys.modules["fmu_files"] = files
    spec.loader.exec_module(files)
    return files


@contextmanager
def fmu_tasks(steps: int, realizations: int) -> Iterator[tuple[list[Task], ...]]:
    """Prepare co-simulation by FMI 2.0 and by 3.0, each against fmpy's calls; isolated and others; a restart.

    Parameters
    ----------
    steps : int
        Steps of a realization.
    realizations : int
        Realizations of the row of many.

    Raises
    ------
    DisagreementError
        The outputs differ.
    """
    files = battery_files()
    currents = (2.0 * np.sin(np.arange(steps) * 0.05)).tolist()
    with TemporaryDirectory() as place:
        paths = [files.build_fmu(place, fmi=fmi, file=f"battery-{fmi}.fmu") for fmi in ("2.0", "3.0")]
        with unpack(paths[0]) as two, unpack(paths[1]) as three:
            mapping = Path(place) / "mapping.toml"
            mapping.write_text(files.mapping_text(), encoding="utf-8")
            here, there = (
                open_fmu(paths[0], load_mapping(mapping), isolate=choice) for choice in (False, True)
            )
            channel = IsolatedChannel(two, _wiring())
            with here, there, closing(channel):
                plants = [
                    Task("FmuPlant, in process", _plant(here, currents), steps),
                    Task("FmuPlant, isolated", _plant(there, currents), steps),
                ]
                yield (
                    _against_fmpy(two, currents),
                    _against_fmpy(three, currents),
                    [*_further(two, channel, currents, realizations), *plants],
                    [_restart(channel)],
                )


def _against_fmpy(folder: Path, currents: list[float]) -> list[Task]:
    ours, theirs = _channel(open_channel(folder, _wiring()), currents), _fmpy_loop(folder, currents)
    require_same(ours(), theirs(), "those of fmpy's own loop")
    return [
        Task("socwise, in process", ours, len(currents)),
        Task("fmpy's set, doStep and get", theirs, len(currents)),
    ]


def _further(folder: Path, channel: Channel, currents: list[float], realizations: int) -> list[Task]:
    isolated = _channel(channel, currents)
    exchange = _channel(open_channel(folder, _wiring("model-exchange")), currents)
    here = _channel(open_channel(folder, _wiring()), currents)
    require_same(here(), isolated(), "those of the child")

    def many() -> Outputs:
        return [isolated() for _ in range(realizations)][-1]

    steps = len(currents)
    return [
        Task("isolated", isolated, steps),
        Task(f"isolated, {realizations} realizations", many, steps * realizations),
        Task("model exchange, in process", exchange, steps),
    ]


def _plant(session: FmuSession, currents: list[float]) -> Callable[[], float]:
    """A realization as the closed loop drives it, by powers."""
    powers_W = [3.6 * current for current in currents]

    def run() -> float:
        step = session.start(STARTS[0]).step
        for power_W in powers_W:
            seen = step(power_W, 0.0, STEP_S)
        return seen.current_A

    return run


def _restart(channel: IsolatedChannel) -> Task:
    def restart() -> Outputs:
        channel.renew()
        return channel.start(STARTS)

    return Task("end of the old one, start, load, initialise", restart, 1)


def _wiring(kind: Kind = "co-simulation") -> Wiring:
    return Wiring(kind=kind, input=INPUT, outputs=OUTPUTS, starts=("initial_soc",), step_s=STEP_S)


def _channel(channel: Channel, currents: list[float]) -> Callable[[], Outputs]:
    def run() -> Outputs:
        channel.start(STARTS)
        step = channel.step
        for current in currents:
            outputs = step(current, 1)
        return outputs

    return run


def _fmpy_loop(folder: Path, currents: list[float]) -> Callable[[], Outputs]:
    """A realization by fmpy's own low-level class."""
    from fmpy import fmi2, fmi3, read_model_description

    description = read_model_description(str(folder))
    reference = {variable.name: variable.valueReference for variable in description.modelVariables}
    two = description.fmiVersion == "2.0"
    fmu = (fmi2.FMU2Slave if two else fmi3.FMU3Slave)(
        guid=description.guid if two else description.instantiationToken,
        modelIdentifier=description.coSimulation.modelIdentifier,
        unzipDirectory=str(folder),
    )
    fmu.instantiate()
    set_values, get_values = (fmu.setReal, fmu.getReal) if two else (fmu.setFloat64, fmu.getFloat64)
    driven, read = [reference[INPUT]], [reference[name] for name in OUTPUTS]

    def run() -> Outputs:
        fmu.reset()
        if two:
            fmu.setupExperiment(startTime=0.0)
        set_values([reference["initial_soc"]], [*STARTS])
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()
        time_s = 0.0
        for current in currents:
            set_values(driven, [current])
            fmu.doStep(time_s, STEP_S)
            outputs = get_values(read)
            time_s += STEP_S
        fmu.terminate()
        return tuple(outputs)

    return run


def require_same(ours: Outputs, theirs: Outputs, whose: str) -> None:
    """Hold that two ways of running an FMU end at the same outputs, to the last bit."""
    if ours != theirs:
        raise DisagreementError(
            f"the FMU's last outputs {ours} are not {whose} {theirs}; one of the two is wrong, so no time is"
            " taken"
        )

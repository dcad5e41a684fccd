"""Plants for realizations: an equivalent circuit made anew each time, or one FMU that starts over."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from bms.cell import Cell
from bms.errors import BatteryError
from bms.plants import Plant
from bms.plants.ecm import EcmPlant
from bms.plants.sensed import SensedPlant
from ems.closed.battery import ClosedLoop, FmuSource
from ems.closed.scatter import Draws
from ems.concept import Concept

Start = Callable[[Draws], tuple[SensedPlant, float]]
"""Starts the plant of a realization; also gives the SOC that the management system is told."""

FAR_V = 0.1
"""An FMU whose voltage at the start is farther than this share from the cell's OCV is another battery."""


@contextmanager
def open_plant(loop: ClosedLoop, concept: Concept, cell: Cell) -> Iterator[Start]:
    """Open the plant of a closed loop for as many realizations as are wanted.

    Parameters
    ----------
    loop : ClosedLoop
        Which plant, and its sensors.
    concept : Concept
        Gives the SOC at the start and how well it is known.
    cell : Cell
        The nominal pack as a cell.

    Yields
    ------
    callable
        Starts a realization.

    Raises
    ------
    BatteryError
        When an FMU cannot be used as mapped, or is another battery than the cell.
    """
    mean, sd = concept.initial_soc, concept.initial_soc_sd

    def sensed(plant: Plant, draws: Draws) -> SensedPlant:
        return SensedPlant(plant, draws.sensor_errors(loop.sensors, cell.series))

    if not isinstance(loop.plant, FmuSource):

        def start_circuit(draws: Draws) -> tuple[SensedPlant, float]:
            soc = _inside(mean + sd * draws.initial)
            plant = EcmPlant(cell, soc, ambient_C=loop.ambient_C, factors=draws.factors(loop.scatter))
            return sensed(plant, draws), mean

        yield start_circuit
        return

    from bms.plants.fmu.session import open_fmu

    source = loop.plant
    mapping = source.load_mapping()
    with open_fmu(source.path, mapping, isolate=source.isolate) as session:

        def start_fmu(draws: Draws) -> tuple[SensedPlant, float]:
            settable = mapping.initial_soc is not None
            plant = session.start(_inside(mean + sd * draws.initial) if settable else None)
            _check_voltage(plant.voltage_V, plant.soc, cell, source)
            # An FMU that starts where it wants is told apart from the belief by shifting the belief.
            told = mean if settable else _inside(plant.soc - sd * draws.initial)
            return sensed(plant, draws), told

        yield start_fmu


def check_plant(loop: ClosedLoop, cell: Cell) -> None:
    """Commission a plant that is somebody else's: a short drive shows whether it is what its mapping says.

    Raises
    ------
    BatteryError
        With everything that contradicts the mapping.
    """
    if isinstance(loop.plant, FmuSource):
        from bms.plants.fmu.probe import probe
        from bms.plants.fmu.session import open_fmu

        with open_fmu(loop.plant.path, loop.plant.load_mapping(), isolate=loop.plant.isolate) as session:
            probe(session, cell).check()


def _check_voltage(voltage_V: float, soc: float, cell: Cell, source: FmuSource) -> None:
    ocv_V = float(cell.ocv(soc))
    if voltage_V > 0.0 and abs(voltage_V - ocv_V) > FAR_V * ocv_V:
        raise BatteryError(
            f"{source.path.name} stands at {voltage_V:.4g} V at {soc:.0%} SOC, the management system's cell"
            f" {cell.name!r} at {ocv_V:.4g} V; give the FMU's cell by --cell, and series and parallel under"
            f" [scale] in {source.mapping.name}"
        )


def _inside(soc: float) -> float:
    return min(max(soc, 0.0), 1.0)

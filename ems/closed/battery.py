"""What a closed loop consists of besides the car: plant, cell, sensors, estimator, and how they differ.

The management system is told the nominal cell, the noise of its sensors, and how much specimens differ; the
rest of its options are the estimator's defaults, or the user's.
"""

from __future__ import annotations

import collections.abc
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from bms import Pack
from bms.belief import SocBelief
from bms.cell import Cell
from bms.errors import BatteryError
from bms.estimators import Estimator, EstimatorKind
from bms.estimators.catalogue import make_estimator
from bms.estimators.gate import Sensors
from bms.pack_cell import cell_from_pack, fill_pack, pack_from_cell
from bms.plants.sensed import SensorNoise
from ems.closed.scatter import Scatter
from ems.concept import Concept

if TYPE_CHECKING:
    from bms.plants.fmu.mapping import Mapping

OTHER_CAPACITY = 0.2
"""An FMU's pack whose capacity differs by more than this share is another one than the cell says."""
LEAST_SD = 1e-3
"""The least doubt about a parameter that a filter is told; none at all would leave it nothing to learn."""


@dataclass(frozen=True)
class FmuSource:
    """A plant that comes as an FMU.

    Parameters
    ----------
    path, mapping : Path
        The FMU, and the TOML file that says what its variables are.
    isolate : bool
        Run it in a process of its own.
    """

    path: Path
    mapping: Path
    isolate: bool = True

    def load_mapping(self) -> Mapping:
        """Read the mapping file.

        Raises
        ------
        BatteryError
            When it cannot be read, or does not fit.
        """
        from bms.plants.fmu.mapping import load_mapping

        return load_mapping(self.mapping)


@dataclass(frozen=True)
class ClosedLoop:
    """A closed loop, for any concept.

    Parameters
    ----------
    plant : "ecm" or FmuSource
        What the battery really does.
    estimator : str or EstimatorKind
        Name of the estimator, see `bms.estimators.catalogue.estimator_names`; or one of your own.
    options : mapping
        Its options, before those that follow from the study.
    cell : Cell, optional
        The cell; as many as fill the concept's pack are taken. Without one it is the concept's pack, seen as
        a cell (`bms.pack_cell`).
    scatter : Scatter
        How specimens differ; an FMU is the same in every realization.
    sensors : SensorNoise
        Errors of the sensors.
    ambient_C : float
        Temperature of the surroundings.
    """

    plant: Literal["ecm"] | FmuSource = "ecm"
    estimator: str | EstimatorKind = "ekf"
    options: collections.abc.Mapping[str, Any] = field(default_factory=dict)
    cell: Cell | None = None
    scatter: Scatter = field(default_factory=Scatter)
    sensors: SensorNoise = field(default_factory=SensorNoise)
    ambient_C: float = 25.0

    @property
    def plant_name(self) -> str:
        """Name of the plant, for results."""
        return self.plant if isinstance(self.plant, str) else self.plant.path.name

    @property
    def estimator_name(self) -> str:
        """Name of the estimator, for results."""
        return self.estimator if isinstance(self.estimator, str) else self.estimator.name

    def make_estimator(self, cell: Cell, soc: float, soc_sd: float) -> Estimator:
        """Make the estimator for one realization.

        Parameters
        ----------
        cell : Cell
            The pack as a cell.
        soc, soc_sd : float
            Belief at the start.

        Raises
        ------
        BatteryError
            Unknown name or option, or a value out of range.
        """
        noise = self.sensors
        sensors = Sensors(
            current_sd_A=noise.current_sd_A,
            voltage_sd_V=max(cell.series * noise.voltage_sd_V, 1e-6),
            ambient_C=self.ambient_C,
            holds="until",
        )
        if isinstance(self.estimator, EstimatorKind):
            if self.options:
                raise BatteryError(
                    f"options ({', '.join(self.options)}) are for socwise's own estimators; give those of"
                    f" {self.estimator.name!r} to its constructor"
                )
            return self.estimator.make(cell, SocBelief(soc, soc_sd**2), sensors)
        chosen = self._told() | dict(self.options)
        return make_estimator(self.estimator, cell, soc=soc, soc_sd=soc_sd, sensors=sensors, **chosen)

    def _told(self) -> dict[str, Any]:
        """What the estimator is told of sensors and specimens, as far as it has an option for it."""
        scatter, name = self.scatter, self.estimator_name.strip().lower().replace("-", "_")
        if name == "coulomb":
            return {"capacity_share": scatter.capacity_sd, "bias_sd_A": self.sensors.current_bias_sd_A}
        if name in {"ekf", "ukf", "gpc_ekf"}:
            return {
                "capacity_sd": max(scatter.capacity_sd, LEAST_SD),
                "resistance_sd": max(scatter.resistance_sd, LEAST_SD),
                "relaxation_sd": max(scatter.relaxation_sd, LEAST_SD),
            }
        return {}


@dataclass(frozen=True)
class Battery:
    """The battery of one concept in a closed loop.

    Parameters
    ----------
    cell : Cell
        The nominal pack as a cell: what the management system knows, and what specimens scatter around.
    pack : Pack
        The same as the optimisation knows it.
    """

    cell: Cell
    pack: Pack


def battery_for(concept: Concept, loop: ClosedLoop) -> Battery:
    """Find the battery of a concept: its own pack, or as many of the loop's cells as fill it.

    Raises
    ------
    BatteryError
        When pack or mapping cannot be loaded, or the mapping's pack is another one than the cell's.
    """
    pack = concept.load_pack()
    if loop.cell is None:
        battery = Battery(cell_from_pack(pack), pack)
    else:
        cell = _fill(loop, loop.cell, pack)
        battery = Battery(cell, pack_from_cell(cell))
    if isinstance(loop.plant, FmuSource):
        _check_capacity(loop.plant, battery.cell)
    return battery


def _fill(loop: ClosedLoop, cell: Cell, pack: Pack) -> Cell:
    """Take as many cells as the mapping says, or as fill the pack."""
    if isinstance(loop.plant, FmuSource):
        scale = loop.plant.load_mapping().scale
        series, parallel = round(scale.series), round(scale.parallel)
        if series * parallel > 1 and (series, parallel) == (scale.series, scale.parallel):
            return cell.scaled(series, parallel)
    return fill_pack(cell, pack)


def _check_capacity(source: FmuSource, cell: Cell) -> None:
    known_Ah = source.load_mapping().pack.capacity_Ah
    if known_Ah is not None and abs(known_Ah / cell.capacity_Ah - 1.0) > OTHER_CAPACITY:
        raise BatteryError(
            f"{source.mapping} gives the pack {known_Ah:g} Ah, the management system knows {cell.name!r} of"
            f" {cell.capacity_Ah:g} Ah; give the FMU's cell by --cell, and series and parallel under [scale]"
            f" in {source.mapping}"
        )

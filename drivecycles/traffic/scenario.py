"""A traffic scenario: road, diagram, demand, what is uncertain, detectors, probe, ensemble; in SI units.

`drivecycles.traffic.scenario_file` reads it from a TOML file.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PrivateAttr

from drivecycles.traffic.detectors import Detectors
from drivecycles.traffic.diagrams import Diagram
from drivecycles.traffic.errors import TrafficError
from drivecycles.traffic.field import TrafficField
from drivecycles.traffic.naming import suggest
from drivecycles.traffic.probe import Probe
from drivecycles.traffic.road import Bottleneck, Demand, Road
from drivecycles.traffic.scenario_parts import (
    KM,
    KMH,
    PER_KM,
    UNITS,
    VEHPH,
    BottleneckPart,
    CorrelationPart,
    DemandPart,
    DetectorsPart,
    DiagramPart,
    EnsemblePart,
    Part,
    RoadPart,
    RunPart,
    UncertainPart,
)
from drivecycles.traffic.uncertain import UncertainDiagram

if TYPE_CHECKING:
    from drivecycles.traffic.second_order import SecondOrder

Array = NDArray[np.float64]


class Scenario(Part):
    """A traffic scenario; see docs/traffic.md for the file."""

    name: str = Field(min_length=1, description="short name")
    road: RoadPart
    diagram: DiagramPart
    demand: DemandPart
    run: RunPart
    bottleneck: tuple[BottleneckPart, ...] = ()
    uncertain: dict[str, UncertainPart] = Field(default_factory=dict)
    correlation: tuple[CorrelationPart, ...] = ()
    detectors: DetectorsPart | None = None
    probe: Probe = Field(default=Probe())
    ensemble: EnsemblePart = Field(default=EnsemblePart())
    _origin: str = PrivateAttr(default="the scenario")

    def build_road(self) -> Road:
        """Lay the road with its bottlenecks."""
        barred = [
            Bottleneck(
                KM * one.position_km,
                VEHPH * one.capacity_vehph,
                one.start_s,
                float("inf") if one.end_s is None else one.end_s,
            )
            for one in self.bottleneck
        ]
        return Road(KM * self.road.length_km, self.road.cells, tuple(barred))

    def build_demand(self) -> Demand:
        """Give the demand in vehicles per second."""
        flows = VEHPH * np.atleast_1d(np.asarray(self.demand.flow_vehph, dtype=np.float64))
        return Demand(np.asarray(self.demand.time_s or (0.0,), dtype=np.float64), flows)

    @property
    def initial_per_m(self) -> Array:
        """Density at the start."""
        return PER_KM * np.asarray(self.run.initial_per_km, dtype=np.float64)

    @property
    def locations_m(self) -> tuple[float, ...]:
        """Where speed is reported; four places along the road if the file names none."""
        length = KM * self.road.length_km
        given = tuple(KM * place for place in self.run.locations_km)
        return given or tuple(share * length for share in (0.1, 0.2, 0.5, 1.0))

    def simulate(self, diagram: Diagram | None = None) -> TrafficField:
        """Run the traffic, with the scenario's diagram or another one."""
        from drivecycles.traffic.lwr import simulate
        from drivecycles.traffic.second_order import simulate_second_order

        road, chosen = self.build_road(), diagram or self.diagram.build()
        common: dict[str, Any] = {
            "demand": self.build_demand(),
            "duration_s": self.run.duration_s,
            "initial": self.initial_per_m,
            "step_s": self.run.step_s,
        }
        model = self.build_model()
        if model is not None:
            field = simulate_second_order(road, chosen, model, **common)
        else:
            field = simulate(road, chosen, scheme=self.run.scheme, **common)
        least = -chosen.parameters()["free_flow_mps"]
        if not np.all(np.isfinite(field.speed_mps)) or field.speed_mps.min() < least:
            raise TrafficError(
                f"{self._origin}: the run blew up, with densities far beyond the jam: the scheme"
                f" {field.scheme!r} does not follow a demand near or above the capacity; take 'godunov', or"
                " ease the traffic"
            )
        return field

    def build_model(self) -> SecondOrder | None:
        """Make the second-order model; None of kinematic waves.

        Raises
        ------
        TrafficError
            When there is no such model, or a constant or scheme is not its.
        """
        from drivecycles.traffic.second_order import MODELS, make_model

        name, constants = self.run.model.strip().lower(), self.run.constants
        if name != "lwr":
            if name not in MODELS:
                known = ("lwr", *MODELS)
                raise TrafficError(
                    f"there is no traffic model {name!r}; known are {', '.join(known)}{suggest(name, known)}"
                )
            return make_model(name, **constants)
        if constants:
            raise TrafficError(f"lwr has no constants, but run.constants names {', '.join(constants)}")
        return None

    def require_lwr(self, what: str) -> None:
        """Refuse what is done with kinematic waves alone.

        Raises
        ------
        TrafficError
            When the scenario's model is another one.
        """
        if self.build_model() is not None:
            raise TrafficError(
                f"{self._origin}: {what} takes the model lwr, not {self.run.model}; leave run.model out"
            )

    def build_uncertain(self) -> UncertainDiagram:
        """Make the diagram with its distributions.

        Raises
        ------
        TrafficError
            When nothing is uncertain, a parameter is unknown, or a distribution cannot be.
        """
        if not self.uncertain:
            raise TrafficError(
                f"{self._origin}: nothing is uncertain; add a table such as [uncertain.free_flow_kmh] with"
                ' distribution = "lognormal" and sd'
            )
        means = {key: value for key, value in self.diagram if key in UNITS and value is not None}
        for name in (*self.uncertain, *(n for one in self.correlation for n in one.parameters)):
            if name not in means:
                raise TrafficError(f"{self._origin}: {_unknown(name, means)}")
        found = {}
        for name, part in self.uncertain.items():
            try:
                found[UNITS[name][0]] = part.build(means[name], UNITS[name][1])
            except TrafficError as error:
                raise TrafficError(f"{self._origin}, uncertain.{name}: {error}") from None
        return UncertainDiagram(self.diagram.build(), found, self._correlations())

    def _correlations(self) -> Array | None:
        if not self.correlation:
            return None
        names, matrix = list(self.uncertain), np.eye(len(self.uncertain))
        for one in self.correlation:
            if one.parameters[0] == one.parameters[1] or not set(one.parameters) <= set(names):
                raise TrafficError(
                    f"{self._origin}: correlation names {' and '.join(one.parameters)}; name two different"
                    f" uncertain parameters: {', '.join(names)}"
                )
            i, j = (names.index(name) for name in one.parameters)
            matrix[i, j] = matrix[j, i] = one.value
        return matrix

    def build_detectors(self) -> Detectors:
        """Give the detectors, checked to stand on the road.

        Raises
        ------
        TrafficError
            When there is none, or one stands outside the road.
        """
        part = self.detectors
        if part is None:
            raise TrafficError(f"{self._origin} has no detectors; add [detectors] with position_km = [...]")
        detectors = Detectors(
            position_m=tuple(KM * place for place in part.position_km),
            period_s=part.period_s,
            noise_mps=KMH * part.noise_kmh,
        )
        detectors.cells(self.build_road())
        return detectors

    def check(self) -> Self:
        """Build everything once, so that whatever is wrong is said before anything runs."""
        self.build_road()
        self.build_demand()
        self.diagram.build()
        self.build_model()
        road = self.build_road()
        for place in self.locations_m:
            road.require_inside(place, "a location")
        if self.detectors is not None:
            self.build_detectors()
        if self.uncertain:
            self.build_uncertain()
        return self


def _unknown(name: str, known: dict[str, float]) -> str:
    return f"the diagram has no parameter {name!r}; it has {', '.join(known)}{suggest(name, known)}"

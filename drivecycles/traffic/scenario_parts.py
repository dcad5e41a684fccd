"""The tables of a scenario file, in its own units: km, km/h, veh/km and veh/h."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from drivecycles.traffic.detectors import MPS_PER
from drivecycles.traffic.diagrams import Diagram, make_diagram
from drivecycles.traffic.distributions import Beta, Distribution, LogNormal, TruncatedNormal
from drivecycles.traffic.errors import TrafficError

KMH, PER_KM, VEHPH, KM = MPS_PER["kmh"], 1e-3, 1.0 / 3600.0, 1e3
UNITS: dict[str, tuple[str, float]] = {
    "free_flow_kmh": ("free_flow_mps", KMH),
    "optimum_kmh": ("optimum_mps", KMH),
    "jam_per_km": ("jam_per_m", PER_KM),
    "critical_density_per_km": ("critical_density_per_m", PER_KM),
}
"""Parameters of a diagram by their name in the file: the field's name and what one unit is in SI."""
OF_FILE = {field: name for name, (field, _) in UNITS.items()}


class Part(BaseModel):
    """A table of the file: frozen, with no keys but its own."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class RoadPart(Part):
    """Table ``[road]``."""

    length_km: float = Field(gt=0.0, le=1000.0, description="length, km")
    cells: int = Field(ge=2, le=10_000, description="number of cells")


class BottleneckPart(Part):
    """Table ``[[bottleneck]]``."""

    position_km: float = Field(ge=0.0, description="where, km")
    capacity_vehph: float = Field(ge=0.0, description="flow that it lets through, veh/h")
    start_s: float = Field(default=0.0, ge=0.0, description="from when, s")
    end_s: float | None = Field(default=None, gt=0.0, description="until when, s; for ever if left out")


class DiagramPart(Part):
    """Table ``[diagram]``."""

    kind: str = Field(description="greenshields, underwood, greenberg or triangular")
    free_flow_kmh: float = Field(description="speed on the empty road, km/h")
    jam_per_km: float | None = Field(default=None, description="density at which traffic stands, veh/km")
    critical_density_per_km: float | None = Field(
        default=None, description="density at which the flow is largest, veh/km"
    )
    optimum_kmh: float | None = Field(default=None, description="Greenberg's speed at capacity, km/h")

    def build(self) -> Diagram:
        """Make the diagram."""
        given = {
            UNITS[key][0]: UNITS[key][1] * value for key, value in self if key in UNITS and value is not None
        }
        return make_diagram(self.kind, **given)


class DemandPart(Part):
    """Table ``[demand]``."""

    flow_vehph: float | tuple[float, ...] = Field(description="flow that wants to enter, veh/h; or a list")
    time_s: tuple[float, ...] | None = Field(default=None, description="from when each flow holds, s")

    @model_validator(mode="after")
    def _matched(self) -> Self:
        flows = self.flow_vehph if isinstance(self.flow_vehph, tuple) else (self.flow_vehph,)
        if len(flows) != (1 if self.time_s is None else len(self.time_s)):
            raise ValueError("give a time for each flow of the list, as many of one as of the other")
        return self


class RunPart(Part):
    """Table ``[run]``."""

    duration_s: float = Field(gt=0.0, le=1e6, description="how long traffic is simulated, s")
    step_s: float | None = Field(default=None, gt=0.0, description="time step, s; chosen if left out")
    model: str = Field(default="lwr", description="lwr, or a second-order model")
    constants: dict[str, float] = Field(
        default_factory=dict, description="constants of a second-order model, in SI units"
    )
    scheme: str = Field(default="godunov", description="numerical scheme of lwr: godunov or report")
    initial_per_km: float | tuple[float, ...] = Field(
        default=0.0, description="density at the start, veh/km; one, or one for each cell"
    )
    locations_km: tuple[float, ...] = Field(default=(), description="where speed is reported, km")


class UncertainPart(Part):
    """Table ``[uncertain.PARAMETER]``; in the unit of the parameter."""

    distribution: Literal["normal", "lognormal", "beta"] = Field(description="normal is truncated")
    sd: float = Field(description="standard deviation")
    lower: float | None = Field(default=None, description="lower bound")
    upper: float | None = Field(default=None, description="upper bound")

    def build(self, mean: float, unit: float) -> Distribution:
        """Make the distribution about a mean, given in the file's unit."""
        low, high = (None if bound is None else unit * bound for bound in (self.lower, self.upper))
        if self.distribution == "normal":
            return TruncatedNormal(unit * mean, unit * self.sd, low, high)
        if self.distribution == "lognormal":
            if low is not None or high is not None:
                raise TrafficError("a lognormal distribution has no bounds; leave lower and upper out")
            return LogNormal(unit * mean, unit * self.sd)
        if low is None or high is None:
            raise TrafficError("a beta distribution needs lower and upper")
        return Beta(unit * mean, unit * self.sd, low, high)


class CorrelationPart(Part):
    """Table ``[[correlation]]``."""

    parameters: tuple[str, str] = Field(description="two uncertain parameters")
    value: float = Field(gt=-1.0, lt=1.0, description="correlation of their normal scores")


class DetectorsPart(Part):
    """Table ``[detectors]``."""

    position_km: tuple[float, ...] = Field(min_length=1, description="where, km")
    period_s: float = Field(default=10.0, gt=0.0, description="time between readings, s")
    noise_kmh: float = Field(default=1.609344, gt=0.0, description="standard deviation of a reading, km/h")
    walk_per_km: float = Field(
        default=0.05, ge=0.0, description="doubt of the model: sd that a density gathers in 1 s, veh/km"
    )
    guess: dict[str, float] = Field(
        default_factory=dict, description="parameters that the estimate starts from; 20 % off if left out"
    )


class EnsemblePart(Part):
    """Table ``[ensemble]``."""

    cycles: int = Field(default=20, ge=2, le=10_000, description="number of cycles")
    plan: Literal["mean", "nominal"] = Field(
        default="mean", description="what policies are optimised for: mean arrival times, or mean parameters"
    )

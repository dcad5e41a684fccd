"""A study as data: what is varied, what stays, and how cases are laid out (see docs/studies.md).

The models here check what can be said of each entry alone. What only shows between entries is checked in
`socwise.study.checks`, and what only shows in a case in `socwise.study.plan`.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from bms.plants.sensed import SensorNoise
from ems.closed.identify import REALIZATIONS
from ems.closed.scatter import Scatter
from ems.compare import DEFAULT_POLICIES
from ems.grid import GridSettings
from socwise.study.names import (
    CellName,
    ConceptName,
    CycleName,
    EstimatorName,
    FileName,
    PlantName,
    PolicyName,
    SingleCycleName,
)
from socwise.study.values import Choices, Numbers

NotNegative = Annotated[float, Field(ge=0.0)]
Positive = Annotated[float, Field(gt=0.0)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
Inside = Annotated[float, Field(gt=0.0, lt=1.0)]
Share = Annotated[float, Field(gt=0.0, le=1.0)]
Spread = Annotated[float, Field(ge=0.0, lt=0.3)]
SeedNumber = Annotated[int, Field(ge=0)]
Number = Annotated[float, Field()]

_CONFIG = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)


class Factors(BaseModel):
    """What is varied, and what all cases share but a concept gives otherwise."""

    model_config = _CONFIG

    concept: Choices[ConceptName] | None = Field(
        default=None, description="name of a concept, or the path of its TOML file"
    )
    cycle: Choices[CycleName] | None = Field(
        default=None, description="name of a cycle, a CSV file, several joined by '+', or traffic:SCENARIO"
    )
    mu: Numbers[NotNegative] | None = Field(
        default=None, description="variance of the measured SOC where alpha is 1"
    )
    gamma: Numbers[NotNegative] | None = Field(default=None, description="drift variance of the SOC, 1/s")
    beta: Numbers[NotNegative] | None = Field(
        default=None, description="drift variance of the SOC per ampere, 1/(A s)"
    )
    window_low: Numbers[Fraction] | None = Field(default=None, description="lowest allowed SOC")
    window_high: Numbers[Fraction] | None = Field(default=None, description="highest allowed SOC")
    window_width: Numbers[Share] | None = Field(
        default=None, description="width of the SOC window about the centre of the concept's own"
    )
    window_scale: Numbers[Positive] | None = Field(
        default=None, description="factor on the width of the SOC window, about its centre"
    )
    penalty_steepness: Numbers[NotNegative] | None = Field(
        default=None, description="factor on the running penalty outside the window, jumps and slopes alike"
    )
    penalty_slope: Numbers[NotNegative] | None = Field(
        default=None, description="factor on the slopes of the running penalty alone"
    )
    terminal_penalty: Numbers[NotNegative] | None = Field(
        default=None, description="factor on the terminal penalty, jump and slopes alike"
    )
    capacity_factor: Numbers[Positive] | None = Field(
        default=None, description="parallel strings per string of the concept's pack"
    )
    capacity_Ah: Numbers[Positive] | None = Field(
        default=None, description="capacity of the pack, reached by parallel strings, Ah"
    )
    mass_kg: Numbers[Positive] | None = Field(default=None, description="mass of the vehicle, kg")
    initial_soc: Numbers[Inside] | None = Field(default=None, description="SOC estimate at the start")
    initial_soc_sd: Numbers[Spread] | None = Field(
        default=None, description="standard deviation of the error of that estimate"
    )
    target_soc: Numbers[Inside] | None = Field(default=None, description="preferred SOC at the end")
    plant: Choices[PlantName] | None = Field(
        default=None, description="what the battery really does: model, ecm, or an FMU file"
    )
    estimator: Choices[EstimatorName] | None = Field(default=None, description="what believes the SOC")
    seed: Choices[SeedNumber] | None = Field(
        default=None, description="seeds of the noise in place of the study's"
    )
    grid: dict[str, Numbers[Positive]] = Field(
        default={}, description="grid settings by name, such as soc_step"
    )
    set: dict[str, Numbers[Number]] = Field(
        default={}, description="other numbers of the concept by path, such as 'terminal.slope_below_kg'"
    )


class Design(BaseModel):
    """How cases are laid out.

    ``factorial`` combines every value with every other. The others draw ``samples`` points from the ranges,
    all at once, with `scipy.stats.qmc`, and combine each with every value of the lists.
    """

    model_config = _CONFIG

    kind: Literal["factorial", "sobol", "halton", "latin-hypercube"] = Field(
        default="factorial", description="every combination, or a low-discrepancy sample of the ranges"
    )
    samples: int | None = Field(
        default=None, ge=1, le=100_000, description="points drawn from the ranges; not for factorial"
    )
    seed: int = Field(default=0, ge=0, description="seed of the points")


class Loop(BaseModel):
    """The closed loop of cases whose plant is not the model."""

    model_config = _CONFIG

    mapping: FileName | None = Field(default=None, description="TOML file: what the variables of an FMU mean")
    isolate: bool = Field(default=True, description="run an FMU in a process of its own")
    cell: CellName | None = Field(default=None, description="cell that fills the pack")
    options: dict[str, dict[str, Any]] = Field(
        default={}, description="options of estimators, by name of the estimator"
    )
    sensors: SensorNoise = Field(default=SensorNoise(), description="errors of the sensors")
    scatter: Scatter = Field(default=Scatter(), description="how batteries differ")
    training: SingleCycleName | None = Field(
        default=None, description="trip on which the uncertainty model is identified"
    )
    training_realizations: int = Field(default=REALIZATIONS, ge=2, description="how often it is driven")


class Study(BaseModel):
    """A study: factors, design, and what every case shares."""

    model_config = _CONFIG | {"title": "socwise study"}

    name: str = Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$",
        max_length=80,
        description="short name: letters, digits, '-', '_', '.'",
    )
    description: str = Field(default="", description="what the study asks")
    seed: int = Field(default=0, ge=0, description="seed of the noise, the same in every case")
    realizations: int = Field(default=50, ge=1, le=1_000_000, description="realizations of the noise")
    policies: Annotated[list[PolicyName], Field(min_length=1)] = Field(
        default=list(DEFAULT_POLICIES),
        description="policies that every case compares, the first with the others",
    )
    on_infeasible: Literal["error", "limit"] = Field(
        default="error",
        description="a step that the vehicle cannot follow: fail, or drive what it can",
    )
    keep_trajectories: bool = Field(default=False, description="store every trajectory as NetCDF")
    design: Design = Field(default=Design(), description="how cases are laid out")
    factors: Factors = Field(description="what is varied")
    together: list[Factors] = Field(
        default=[], description="factors that vary together: lists of the same length, taken item by item"
    )
    grid: GridSettings = Field(default=GridSettings(), description="spacings of the grids")
    closed_loop: Loop = Field(default=Loop(), description="the closed loop, where the plant is not the model")


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of a study file, for editors that complete and check TOML."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **Study.model_json_schema()}

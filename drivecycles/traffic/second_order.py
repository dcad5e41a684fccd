r"""Second-order models: speed has a dynamics of its own beside the conservation of vehicles.

With the equilibrium speed :math:`v^*(k)` of a diagram, [M] eqs 96 to 101, terms and units put right:

- Payne (96): :math:`v_t + v v_x = (v^* - v)/T + \frac{1}{2Tk} \frac{dv^*}{dk}\,k_x`,
- Ross (97): :math:`v_t + v v_x = (v_f - v)/T`, with flows that the road ahead has room for,
- Kuehne (98): :math:`v_t + v v_x = (v^* - v)/T - \frac{C_0^2}{k}\,k_x + \nu v_{xx}`,
- Zhang (100): :math:`v_t + v v_x = (v^* - v)/T - k\,(dv^*/dk)^2\,k_x`,
- Aw and Rascle (101): :math:`(v + p)_t + v\,(v + p)_x = 0` with :math:`p = p_0 (k/k_0)^\gamma`; a relaxation
  :math:`(v^* - v)/T` may be added.

The first four have the form of gas dynamics, :math:`(kv)_t + (k v^2 + P(k))_x = k\,(v_e - v)/T` with
:math:`P' = c^2(k)` and :math:`c^2 = -\frac{1}{2T} \frac{dv^*}{dk},\; 0,\; C_0^2,\; (k\,dv^*/dk)^2`; the last
one conserves :math:`k(v + p)`. Vehicles and momentum move by the local Lax-Friedrichs flux

.. math:: f = \tfrac12 (F_L + F_R) - \tfrac12 a\,(U_R - U_L), \qquad a = \max_{L,R} |\lambda|,

for Ross, who has no pressure, the flux of the cell behind,
and after each step speeds relax towards :math:`v_e`, exactly in time (source splitting). Vehicles are
conserved to rounding and densities stay positive while :math:`a\,\Delta t/\Delta x \le 1`. Waves at
:math:`v + c` overtake the vehicles, and the first four can back them up and crowd them beyond the jam
(Daganzo, Transp. Res. B 29, 1995); a warning says when. The flux smears contacts: refine the cells before
trusting a front.

What enters is min(demand, supply of the first cell) at the equilibrium speed of the demand; the exit takes
all it is sent. A vehicle that Ross lets into a queue drives as fast as the queue lets vehicles out. [M] eq 99
needs a road geometry that the report does not give.
"""

from __future__ import annotations

import math
import warnings
from abc import ABC
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivecycles.traffic import _kernels as _kernels
from drivecycles.traffic._second_order import (
    AW_RASCLE,
    KUEHNE,
    PAYNE,
    ROSS,
    ZHANG,
    Law,
    fastest,
    push,
    run,
)
from drivecycles.traffic.diagram import Diagram
from drivecycles.traffic.errors import TrafficError, TrafficWarning
from drivecycles.traffic.field import TrafficField
from drivecycles.traffic.lwr import COURANT, gates, initial_density, split_duration, warn_of_demand
from drivecycles.traffic.naming import suggest
from drivecycles.traffic.road import Demand, Road

Array = NDArray[np.float64]

MARGIN = 1e-6
SCAN = 201
ATTEMPTS = 4


class SecondOrder(ABC):
    """A second-order model; its fields are its constants."""

    name: ClassVar[str]
    code: ClassVar[int]
    relaxation_s: float
    elasticity_mps: float = 0.0
    viscosity_m2ps: float = 0.0
    exponent: float = 1.0
    pressure_mps: float | None = None
    reference_per_m: float | None = None

    def _require(self, **values: float | None) -> None:
        for name, value in values.items():
            if value is not None and not 0.0 < value < math.inf:
                raise TrafficError(f"{name} of {self.name} must be positive and finite, got {value!r}")

    def law(self, diagram: Diagram) -> Law:
        """Lay the model out for the kernel.

        Raises
        ------
        TrafficError
            When the model needs a jam density and the diagram has none.
        """
        reference = self.reference_per_m or diagram.full_per_m
        if self.code == AW_RASCLE and reference == math.inf:
            raise TrafficError(
                f"the {diagram.kind} diagram has no jam density, to which {self.name} refers its"
                " pressure; give reference_per_m"
            )
        free = diagram.constants[0]
        return Law(
            self.code,
            diagram.code,
            (*diagram.constants, diagram.critical_per_m, diagram.capacity_per_s),
            float(self.relaxation_s),
            float(self.elasticity_mps),
            float(self.viscosity_m2ps),
            float(self.pressure_mps or free),
            float(reference),
            float(self.exponent),
        )


@final
@dataclass(frozen=True)
class Payne(SecondOrder):
    """Drivers see a change of density ahead, [M] eq 96.

    Parameters
    ----------
    relaxation_s : float
        Time T in which they adapt.
    """

    name: ClassVar[str] = "payne"
    code: ClassVar[int] = PAYNE
    relaxation_s: float = 10.0

    def __post_init__(self) -> None:
        self._require(relaxation_s=self.relaxation_s)


@final
@dataclass(frozen=True)
class Ross(SecondOrder):
    """Drivers want the free-flow speed and get what the road has room for, [M] eq 97.

    Parameters
    ----------
    relaxation_s : float
        Time T in which they adapt.
    """

    name: ClassVar[str] = "ross"
    code: ClassVar[int] = ROSS
    relaxation_s: float = 10.0

    def __post_init__(self) -> None:
        self._require(relaxation_s=self.relaxation_s)


@final
@dataclass(frozen=True)
class Kuehne(SecondOrder):
    """An elastic, viscous stream, [M] eq 98.

    Parameters
    ----------
    relaxation_s : float
        Time T in which drivers adapt.
    elasticity_mps : float
        Speed C0 of a disturbance in it.
    viscosity_m2ps : float
        Viscosity nu, in m^2/s; 0 for none.
    """

    name: ClassVar[str] = "kuehne"
    code: ClassVar[int] = KUEHNE
    relaxation_s: float = 10.0
    elasticity_mps: float = 10.0
    viscosity_m2ps: float = 100.0

    def __post_init__(self) -> None:
        self._require(relaxation_s=self.relaxation_s, elasticity_mps=self.elasticity_mps)
        if not 0.0 <= self.viscosity_m2ps < math.inf:
            raise TrafficError(
                f"viscosity_m2ps of kuehne must be 0 or more and finite, got {self.viscosity_m2ps!r}"
            )


@final
@dataclass(frozen=True)
class Zhang(SecondOrder):
    """Drivers see the waves of the equilibrium, [M] eq 100.

    Parameters
    ----------
    relaxation_s : float
        Time T in which they adapt.
    """

    name: ClassVar[str] = "zhang"
    code: ClassVar[int] = ZHANG
    relaxation_s: float = 10.0

    def __post_init__(self) -> None:
        self._require(relaxation_s=self.relaxation_s)


@final
@dataclass(frozen=True)
class AwRascle(SecondOrder):
    """Drivers carry a wanted speed along and give up part of it to density, [M] eq 101.

    Parameters
    ----------
    exponent : float
        The pressure's gamma.
    pressure_mps : float, optional
        Pressure at the reference density; the free-flow speed if absent.
    reference_per_m : float, optional
        Reference density; the jam density if absent.
    relaxation_s : float
        Time in which they adapt to the equilibrium; infinite, as in the report, for never.
    """

    name: ClassVar[str] = "aw-rascle"
    code: ClassVar[int] = AW_RASCLE
    exponent: float = 1.0
    pressure_mps: float | None = None
    reference_per_m: float | None = None
    relaxation_s: float = math.inf

    def __post_init__(self) -> None:
        self._require(
            exponent=self.exponent, pressure_mps=self.pressure_mps, reference_per_m=self.reference_per_m
        )
        if not self.relaxation_s > 0.0:
            raise TrafficError(f"relaxation_s of aw-rascle must be positive, got {self.relaxation_s!r}")


MODELS: dict[str, type[SecondOrder]] = {each.name: each for each in (Payne, Ross, Kuehne, Zhang, AwRascle)}


def make_model(name: str, **constants: float) -> SecondOrder:
    """Make a second-order model by its name.

    Raises
    ------
    TrafficError
        When there is no such model, or a constant is unknown or out of range.
    """
    found = MODELS.get(name.strip().lower())
    if found is None:
        raise TrafficError(
            f"there is no second-order model {name!r}; known are {', '.join(MODELS)}{suggest(name, MODELS)}"
        )
    known = list(found.__dataclass_fields__)  # type: ignore[attr-defined]
    for each in constants:
        if each not in known:
            raise TrafficError(
                f"{found.name} has no constant {each!r}; it has {', '.join(known)}{suggest(each, known)}"
            )
    return found(**constants)


def simulate_second_order(
    road: Road,
    diagram: Diagram,
    model: SecondOrder,
    *,
    demand: float | Demand,
    duration_s: float,
    initial: ArrayLike = 0.0,
    initial_mps: ArrayLike | None = None,
    step_s: float | None = None,
) -> TrafficField:
    """Run one road under a second-order model.

    Parameters
    ----------
    road, diagram, demand, duration_s, initial
        As in `drivecycles.traffic.lwr.simulate`.
    model : SecondOrder
        How speeds change.
    initial_mps : array_like, scalar or shape (cells,), optional
        Speed at the start; that of the equilibrium if absent.
    step_s : float, optional
        Time step; chosen for a Courant number of at most 0.9 at equilibrium speeds if absent.

    Returns
    -------
    TrafficField
        Its ``scheme`` is the model's name; its speeds are the model's own.

    Raises
    ------
    TrafficError
        When something is out of range or the step too long.

    Warns
    -----
    TrafficWarning
        When the demand exceeds the capacity, a density the jam, or a speed falls below zero.
    """
    law = model.law(diagram)
    start = initial_density(road, initial, diagram.full_per_m)
    speed = diagram.speed_mps(start) if initial_mps is None else np.asarray(initial_mps, dtype=np.float64)
    if speed.shape not in ((), start.shape) or not np.all(np.isfinite(speed)) or np.any(speed < 0.0):
        raise TrafficError(
            f"give one initial speed of 0 m/s or more, or one for each of the {road.cells} cells, got shape"
            f" {speed.shape}"
        )
    speed = np.array(np.broadcast_to(speed, start.shape))
    bound = _fastest_expected(law, diagram, start, speed)
    if step_s is not None:
        found = _attempt(road, diagram, model, law, start, speed, demand, duration_s, step_s, bound)
        _check_courant(found.courant, found.step_s, road.cell_m)
    else:
        bound = max(bound, COURANT * law.viscosity_m2ps / road.cell_m * 2.0)
        for _ in range(ATTEMPTS):
            found = _attempt(road, diagram, model, law, start, speed, demand, duration_s, None, bound)
            if found.courant <= 1.0:
                break
            bound *= 2.0
        _check_courant(found.courant, found.step_s, road.cell_m)
    warn_of_demand(found, diagram.capacity_per_s)
    _warn_of_excess(found, diagram)
    return found


def _attempt(
    road: Road, diagram: Diagram, model: SecondOrder, law: Law, start: Array, speed: Array,
    demand: float | Demand, duration_s: float, step_s: float | None, bound_mps: float,
) -> TrafficField:  # fmt: skip
    """Run with a step for waves of at most ``bound_mps``; faster ones show in the Courant number."""
    steps, step_s = split_duration(duration_s, step_s, road.cell_m, bound_mps)
    _check_viscosity(law.viscosity_m2ps, step_s, road.cell_m)
    offered = Demand.of(demand).at((np.arange(steps) + 0.5) * step_s)
    densities, speeds = np.empty((2, steps + 1, road.cells))
    flows = np.empty((steps, road.cells + 1))
    largest = run(
        law, start.copy(), speed.copy(), offered, _carried(law, diagram, offered), step_s, road.cell_m,
        gates(road, step_s, steps), densities, speeds, flows,
    )  # fmt: skip
    courant = float(largest) * step_s / road.cell_m
    return TrafficField(
        road, model.name, step_s * np.arange(steps + 1.0), densities, speeds, flows, offered, courant
    )


def _fastest_expected(law: Law, diagram: Diagram, start: Array, speed: Array) -> float:
    """Bound the waves of equilibrium traffic and of the start."""
    full = diagram.full_per_m if diagram.full_per_m < math.inf else 4.0 * diagram.critical_per_m
    scan = np.linspace(0.0, full, SCAN)
    pairs = [*zip(scan, diagram.speed_mps(scan), strict=True), *zip(start, speed, strict=True)]
    return max(float(fastest(law, float(k), float(v))) for k, v in pairs)


def _carried(law: Law, diagram: Diagram, offered: Array) -> Array:
    """Find what vehicles carry in, for each step: speed and pressure of free traffic of that flow."""
    density = {
        flow: diagram.free_density_per_m(min(float(flow), diagram.capacity_per_s))
        for flow in np.unique(offered)
    }
    known = {flow: float(diagram.speed_mps(k)) + float(push(law, k)) for flow, k in density.items()}
    return np.array([known[flow] for flow in offered])


def _check_viscosity(viscosity_m2ps: float, step_s: float, cell_m: float) -> None:
    number = viscosity_m2ps * step_s / cell_m**2
    if number > 0.5 * (1.0 + 1e-9):
        raise TrafficError(
            f"the step is too long for the viscosity: {viscosity_m2ps:g} m^2/s times {step_s:g} s over the"
            f" square of {cell_m:g} m is {number:.3g}, and 0.5 is the most; take a step of at most"
            f" {0.5 * cell_m**2 / viscosity_m2ps:.4g} s"
        )


def _check_courant(courant: float, step_s: float, cell_m: float) -> None:
    if not courant <= 1.0 + 1e-9:
        largest_mps = courant * cell_m / step_s
        raise TrafficError(
            f"the step was too long: a wave of {largest_mps:.4g} m/s crossed {courant:.3g} cells in a"
            f" step (the Courant number), and 1 is the most; take a step of at most"
            f" {cell_m / largest_mps:.4g} s, or another model if waves keep growing"
        )


def _warn_of_excess(field: TrafficField, diagram: Diagram) -> None:
    crowded, slowest = float(field.density_per_m.max()), float(field.speed_mps.min())
    if crowded > diagram.full_per_m * (1.0 + MARGIN):
        warnings.warn(
            f"{field.scheme} crowds traffic to {1000.0 * crowded:.4g} veh/km, beyond the jam density,"
            f" {1000.0 * diagram.full_per_m:.4g} veh/km: second-order models have no bound on density",
            TrafficWarning,
            stacklevel=3,
        )
    if slowest < -MARGIN * diagram.constants[0]:
        warnings.warn(
            f"{field.scheme} drives vehicles backwards, at up to {-slowest:.4g} m/s: they react to traffic"
            " behind them (Daganzo 1995); take 'aw-rascle' or the kinematic-wave model",
            TrafficWarning,
            stacklevel=3,
        )

r"""Fundamental diagrams: the speed at which traffic of a density drives in equilibrium.

With density :math:`k` in vehicles per metre, speed :math:`v` and flow :math:`Q(k) = k\,v(k)`:

=============  =============================================  ==================  ====================
diagram        speed                                          critical density    capacity
=============  =============================================  ==================  ====================
Greenshields   :math:`v_f (1 - k/k_j)`                        :math:`k_j/2`       :math:`v_f k_j/4`
Underwood      :math:`v_f\,e^{-k/k_c}`                        :math:`k_c`         :math:`v_f k_c/e`
Greenberg      :math:`\min(v_f,\; v_m \ln(k_j/k))`            :math:`k_j/e`       :math:`v_m k_j/e`
triangular     :math:`\min(v_f,\; w\,(k_j/k - 1))`            :math:`k_c`         :math:`v_f k_c`
=============  =============================================  ==================  ====================

with :math:`w = v_f k_c / (k_j - k_c)`. All have one maximum of the flow, so the flow that a cell can send
(demand) and the flow that it can take (supply) are :math:`D(k) = Q(\min(k, k_c))` and
:math:`S(k) = Q(\max(k, k_c))`. Greenberg's logarithm has no free-flow speed, its speed is capped. Underwood's
traffic never stands still: it has no jam density, and its flow is not concave beyond :math:`2 k_c`.
May, *Traffic Flow Fundamentals*, 1990; Newell, Transp. Res. B 27, 1993 (triangular).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivecycles.traffic.diagram import Diagram
from drivecycles.traffic.errors import TrafficError
from drivecycles.traffic.naming import suggest

__all__ = ["DIAGRAMS", "Diagram", "Greenberg", "Greenshields", "Triangular", "Underwood", "make_diagram"]

Array = NDArray[np.float64]


@final
@dataclass(frozen=True)
class Greenshields(Diagram):
    """Speed falls linearly with density.

    Parameters
    ----------
    free_flow_mps : float
        Speed on the empty road.
    jam_per_m : float
        Density at which traffic stands.

    Raises
    ------
    TrafficError
        When a parameter is not positive and finite.
    """

    kind: ClassVar[str] = "greenshields"
    code: ClassVar[int] = 0
    free_flow_mps: float
    jam_per_m: float

    def __post_init__(self) -> None:
        self._check_positive()

    @property
    def critical_per_m(self) -> float:
        """Density at which the flow is largest, in 1/m."""
        return 0.5 * self.jam_per_m

    @property
    def full_per_m(self) -> float:
        """Density at which traffic stands, in 1/m."""
        return self.jam_per_m

    @property
    def fastest_wave_mps(self) -> float:
        """Largest magnitude of the slope of the flow: at both ends."""
        return self.free_flow_mps

    @property
    def constants(self) -> tuple[float, float, float]:
        """Free-flow speed and its share of the jam density."""
        return self.free_flow_mps, self.free_flow_mps / self.jam_per_m, 0.0

    def speed_mps(self, density_per_m: ArrayLike) -> Array:
        """Evaluate the equilibrium speed, in m/s."""
        return self.free_flow_mps * (1.0 - np.asarray(density_per_m, dtype=np.float64) / self.jam_per_m)

    def wave_mps(self, density_per_m: ArrayLike) -> Array:
        """Evaluate the slope of the flow over density, in m/s."""
        return self.free_flow_mps * (1.0 - 2.0 * np.asarray(density_per_m, dtype=np.float64) / self.jam_per_m)


@final
@dataclass(frozen=True)
class Underwood(Diagram):
    """Speed falls exponentially with density and never reaches zero.

    Parameters
    ----------
    free_flow_mps : float
        Speed on the empty road.
    critical_density_per_m : float
        Density at which the flow is largest.

    Raises
    ------
    TrafficError
        When a parameter is not positive and finite.
    """

    kind: ClassVar[str] = "underwood"
    code: ClassVar[int] = 1
    free_flow_mps: float
    critical_density_per_m: float

    def __post_init__(self) -> None:
        self._check_positive()

    @property
    def critical_per_m(self) -> float:
        """Density at which the flow is largest, in 1/m."""
        return self.critical_density_per_m

    @property
    def full_per_m(self) -> float:
        """Infinite: traffic never stands."""
        return math.inf

    @property
    def fastest_wave_mps(self) -> float:
        """Largest magnitude of the slope of the flow: on the empty road."""
        return self.free_flow_mps

    @property
    def constants(self) -> tuple[float, float, float]:
        """Free-flow speed and the inverse of the critical density."""
        return self.free_flow_mps, 1.0 / self.critical_density_per_m, 0.0

    def speed_mps(self, density_per_m: ArrayLike) -> Array:
        """Evaluate the equilibrium speed, in m/s."""
        share = np.asarray(density_per_m, dtype=np.float64) / self.critical_density_per_m
        return self.free_flow_mps * np.asarray(np.exp(-share), dtype=np.float64)

    def wave_mps(self, density_per_m: ArrayLike) -> Array:
        """Evaluate the slope of the flow over density, in m/s."""
        share = np.asarray(density_per_m, dtype=np.float64) / self.critical_density_per_m
        return self.free_flow_mps * (1.0 - share) * np.asarray(np.exp(-share), dtype=np.float64)


@final
@dataclass(frozen=True)
class Greenberg(Diagram):
    """Speed falls with the logarithm of density, from a free-flow speed on.

    Parameters
    ----------
    free_flow_mps : float
        Speed below the density at which the logarithm reaches it.
    jam_per_m : float
        Density at which traffic stands.
    optimum_mps : float
        Speed at capacity; below the free-flow speed.

    Raises
    ------
    TrafficError
        When a parameter is not positive and finite, or the speed at capacity is not the lower one.
    """

    kind: ClassVar[str] = "greenberg"
    code: ClassVar[int] = 2
    ordered: ClassVar[tuple[str, str] | None] = ("optimum_mps", "free_flow_mps")
    free_flow_mps: float
    jam_per_m: float
    optimum_mps: float

    def __post_init__(self) -> None:
        self._check_positive()
        if not self.optimum_mps < self.free_flow_mps:
            raise TrafficError(
                f"Greenberg's speed at capacity must lie below the free-flow speed, {self.free_flow_mps:g}"
                f" m/s, got {self.optimum_mps:g} m/s; one half of it is common"
            )

    @property
    def critical_per_m(self) -> float:
        """Density at which the flow is largest, in 1/m."""
        return self.jam_per_m / math.e

    @property
    def full_per_m(self) -> float:
        """Density at which traffic stands, in 1/m."""
        return self.jam_per_m

    @property
    def fastest_wave_mps(self) -> float:
        """Largest magnitude of the slope of the flow: the free-flow speed, above that at the jam."""
        return self.free_flow_mps

    @property
    def capped_per_m(self) -> float:
        """Density up to which the speed is the free-flow speed, in 1/m."""
        return self.jam_per_m * math.exp(-self.free_flow_mps / self.optimum_mps)

    @property
    def constants(self) -> tuple[float, float, float]:
        """Free-flow speed, jam density, speed at capacity."""
        return self.free_flow_mps, self.jam_per_m, self.optimum_mps

    def speed_mps(self, density_per_m: ArrayLike) -> Array:
        """Evaluate the equilibrium speed, in m/s."""
        density = np.maximum(np.asarray(density_per_m, dtype=np.float64), self.capped_per_m)
        return np.minimum(self.free_flow_mps, self.optimum_mps * np.log(self.jam_per_m / density))

    def wave_mps(self, density_per_m: ArrayLike) -> Array:
        """Evaluate the slope of the flow over density, in m/s."""
        density = np.asarray(density_per_m, dtype=np.float64)
        slowed = self.optimum_mps * (np.log(self.jam_per_m / np.maximum(density, self.capped_per_m)) - 1.0)
        return np.where(density <= self.capped_per_m, self.free_flow_mps, slowed)


@final
@dataclass(frozen=True)
class Triangular(Diagram):
    """Flow rises linearly to capacity and falls linearly to the jam.

    Parameters
    ----------
    free_flow_mps : float
        Speed up to the critical density.
    critical_density_per_m : float
        Density at which the flow is largest.
    jam_per_m : float
        Density at which traffic stands; above the critical one.

    Raises
    ------
    TrafficError
        When a parameter is not positive and finite, or the jam density is not the higher one.
    """

    kind: ClassVar[str] = "triangular"
    code: ClassVar[int] = 3
    ordered: ClassVar[tuple[str, str] | None] = ("critical_density_per_m", "jam_per_m")
    free_flow_mps: float
    critical_density_per_m: float
    jam_per_m: float

    def __post_init__(self) -> None:
        self._check_positive()
        if not self.critical_density_per_m < self.jam_per_m:
            raise TrafficError(
                f"the critical density, {1000.0 * self.critical_density_per_m:g} veh/km, must lie below the"
                f" jam density, {1000.0 * self.jam_per_m:g} veh/km"
            )

    @property
    def critical_per_m(self) -> float:
        """Density at which the flow is largest, in 1/m."""
        return self.critical_density_per_m

    @property
    def full_per_m(self) -> float:
        """Density at which traffic stands, in 1/m."""
        return self.jam_per_m

    @property
    def backward_mps(self) -> float:
        """Speed at which a disturbance of congested traffic travels upstream, positive."""
        critical = self.critical_density_per_m
        return self.free_flow_mps * critical / (self.jam_per_m - critical)

    @property
    def fastest_wave_mps(self) -> float:
        """Largest magnitude of the slope of the flow: the free-flow or the backward speed."""
        return max(self.free_flow_mps, self.backward_mps)

    @property
    def constants(self) -> tuple[float, float, float]:
        """Free-flow speed, jam density, backward speed."""
        return self.free_flow_mps, self.jam_per_m, self.backward_mps

    def speed_mps(self, density_per_m: ArrayLike) -> Array:
        """Evaluate the equilibrium speed, in m/s."""
        density = np.asarray(density_per_m, dtype=np.float64)
        slowed = self.backward_mps * (self.jam_per_m / np.maximum(density, self.critical_density_per_m) - 1.0)
        return np.where(density <= self.critical_density_per_m, self.free_flow_mps, slowed)

    def wave_mps(self, density_per_m: ArrayLike) -> Array:
        """Evaluate the slope of the flow over density, in m/s."""
        density = np.asarray(density_per_m, dtype=np.float64)
        return np.where(density <= self.critical_density_per_m, self.free_flow_mps, -self.backward_mps)


DIAGRAMS: dict[str, type[Diagram]] = {
    each.kind: each for each in (Greenshields, Underwood, Greenberg, Triangular)
}


def make_diagram(kind: str, **parameters: float) -> Diagram:
    """Make a diagram by its name.

    Parameters
    ----------
    kind : str
        ``greenshields``, ``underwood``, ``greenberg`` or ``triangular``.
    **parameters : float
        Its fields, see the classes.

    Raises
    ------
    TrafficError
        When there is no such diagram, or a parameter is missing, unknown or out of range.
    """
    found = DIAGRAMS.get(kind.strip().lower())
    if found is None:
        raise TrafficError(
            f"there is no diagram {kind!r}; known are {', '.join(DIAGRAMS)}{suggest(kind, DIAGRAMS)}"
        )
    known = found.parameter_names()
    for name in parameters:
        if name not in known:
            raise TrafficError(
                f"the {found.kind} diagram has no parameter {name!r}; it has {', '.join(known)}"
                f"{suggest(name, known)}"
            )
    missing = [name for name in known if name not in parameters]
    if missing:
        raise TrafficError(f"the {found.kind} diagram needs {', '.join(missing)} as well")
    return found(**parameters)

"""What every fundamental diagram offers; the maths and the diagrams themselves stand in `diagrams`."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import fields
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivecycles.traffic.errors import TrafficError

Array = NDArray[np.float64]


class Diagram(ABC):
    """A fundamental diagram; its fields are its parameters, all positive."""

    kind: ClassVar[str]
    code: ClassVar[int]
    ordered: ClassVar[tuple[str, str] | None] = None
    """Two parameters the first of which must lie below the second, if there are such."""

    def _check_positive(self) -> None:
        for name, value in self.parameters().items():
            if not 0.0 < value < math.inf:
                raise TrafficError(
                    f"{name} of the {self.kind} diagram must be positive and finite, got {value!r}"
                )

    @classmethod
    def parameter_names(cls) -> tuple[str, ...]:
        """Names of the parameters, in the order of the fields."""
        return tuple(field.name for field in fields(cls))  # type: ignore[arg-type]

    def parameters(self) -> dict[str, float]:
        """Give the parameters by name."""
        return {name: float(getattr(self, name)) for name in self.parameter_names()}

    @property
    @abstractmethod
    def critical_per_m(self) -> float:
        """Density at which the flow is largest, in 1/m."""

    @property
    @abstractmethod
    def full_per_m(self) -> float:
        """Density at which traffic stands, in 1/m; infinite where it never does."""

    @property
    @abstractmethod
    def fastest_wave_mps(self) -> float:
        """Largest magnitude of the slope of the flow, which bounds the time step of a scheme."""

    @property
    @abstractmethod
    def constants(self) -> tuple[float, float, float]:
        """Give the three numbers that the kernels compute the flow with."""

    @abstractmethod
    def speed_mps(self, density_per_m: ArrayLike) -> Array:
        """Evaluate the equilibrium speed, in m/s."""

    @abstractmethod
    def wave_mps(self, density_per_m: ArrayLike) -> Array:
        """Evaluate the slope of the flow over density: the speed of a small disturbance, in m/s."""

    @property
    def capacity_per_s(self) -> float:
        """Largest flow, in vehicles per second."""
        return float(self.flow_per_s(self.critical_per_m))

    def flow_per_s(self, density_per_m: ArrayLike) -> Array:
        """Evaluate the equilibrium flow, in vehicles per second."""
        density = np.asarray(density_per_m, dtype=np.float64)
        return density * self.speed_mps(density)

    def demand_per_s(self, density_per_m: ArrayLike) -> Array:
        """Evaluate the flow that traffic of a density would send downstream."""
        return self.flow_per_s(np.minimum(density_per_m, self.critical_per_m))

    def supply_per_s(self, density_per_m: ArrayLike) -> Array:
        """Evaluate the flow that traffic of a density can take from upstream."""
        return self.flow_per_s(np.maximum(density_per_m, self.critical_per_m))

    def free_density_per_m(self, flow_per_s: float) -> float:
        """Find the density below the critical one that carries a flow.

        Raises
        ------
        TrafficError
            When the flow is negative or exceeds the capacity.
        """
        from scipy.optimize import brentq

        if not 0.0 <= flow_per_s <= self.capacity_per_s * (1.0 + 1e-12):
            raise TrafficError(
                f"a flow of {3600.0 * flow_per_s:g} veh/h is not within 0 and the capacity,"
                f" {3600.0 * self.capacity_per_s:g} veh/h"
            )
        if flow_per_s >= self.capacity_per_s:
            return self.critical_per_m
        return float(
            brentq(lambda k: float(self.flow_per_s(k)) - flow_per_s, 0.0, self.critical_per_m, xtol=1e-15)
        )

r"""A solved policy as one NetCDF file (classic format with 64-bit offsets), enough to act with it elsewhere.

Dimensions: ``stage`` (N + 1), ``step`` (N), ``engine`` (off, on), ``variance`` (r; 1 where the policy knows
no variance), ``soc`` (n), ``control`` (C; the first is "engine off"). Variables carry ``units`` and
``long_name``, see `VARIABLES`. Attributes of the file: ``concept``, ``policy``, ``cycle``; ``acts_on``
("estimate and variance", "estimate" or "truth"); ``mu``, ``gamma``, ``beta``; ``step_s``, ``capacity_C``,
``start_fuel_kg``, ``shortfall_kg_per_MJ``; ``initial_soc``, ``initial_soc_sd``, ``value_kg``; ``look_up``
("linear" or "cubic", along SOC); ``settings`` (the concept and the grid in full, JSON).

To act at step k on an estimate s with variance p, engine state e ([L] eq 19):

1. ``w = measurement_variance(p, s)``; the next measurement leaves the variance ``p w / (p + w)`` and moves
   the estimate by ``sigma nu`` with ``sigma = p / sqrt(p + w)`` and ``nu`` standard normal. A policy that
   acts on the estimate alone has neither; one that acts on the truth has
   ``sigma^2 = step_s (gamma + beta |i|)`` instead.
2. For each control that e allows (0 if off, the others if on): the current solves
   ``battery_power_W = i (ocv_V + R i)`` at s, with R for its sign, and is clipped to its limits; discharge
   power that clipping withholds costs ``shortfall_kg_per_MJ``.
3. ``s' = s + step_s i / capacity_C`` and ``p' = p w / (p + w) + step_s (gamma + beta |i|)``.
4. Take the control and the next engine state e' with the least ``stage_cost_kg[k]`` + withheld power + start
   fuel (e off, e' on) + ``E cost_to_go_kg[k + 1, e', p', s' + sigma nu]``.

Look up along SOC as ``look_up`` says, along the variance quadratically through three rows. The cost-to-go
itself is ``cost_to_go_kg[k] + offset_kg[k]``: without the offset single precision holds it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import netcdf_file

from ems import Problem
from ems._choose import CERTAIN, ESTIMATE, TRUTH
from ems.grid import measurement_variance
from ems.policies import CostToGoPolicy
from socwise.commands.errors import CommandError

TITLE = "socwise policy"

_ACTS_ON = {ESTIMATE: "estimate and variance", CERTAIN: "estimate", TRUTH: "truth"}
_WIDE_OFFSETS = 2
_TABLE = ("step", "control")
_MOST_BYTES = 2**32 - 4
"""Largest variable that the format can hold, unless it is the last."""


@dataclass(frozen=True)
class PolicyVariable:
    """How one array of a policy is stored: dimensions, type on disk, unit, meaning."""

    dimensions: tuple[str, ...]
    on_disk: str
    units: str
    long_name: str


VARIABLES: dict[str, PolicyVariable] = {
    "time_s": PolicyVariable(("stage",), "f8", "s", "time of the stages; step k begins at stage k"),
    "speed_mps": PolicyVariable(("stage",), "f8", "m/s", "vehicle speed"),
    "altitude_m": PolicyVariable(("stage",), "f8", "m", "altitude of the road"),
    "soc": PolicyVariable(("soc",), "f8", "1", "nodes of the state of charge"),
    "variance": PolicyVariable(("variance",), "f8", "1", "rows of the variance of the estimate's error"),
    "measurement_variance": PolicyVariable(
        ("variance", "soc"), "f8", "1", "expected variance of the measured state of charge"
    ),
    "ocv_V": PolicyVariable(("soc",), "f8", "V", "open-circuit voltage"),
    "discharge_resistance_ohm": PolicyVariable(("soc",), "f8", "ohm", "internal resistance, discharge"),
    "charge_resistance_ohm": PolicyVariable(("soc",), "f8", "ohm", "internal resistance, charge"),
    "least_current_A": PolicyVariable(("soc",), "f8", "A", "strongest discharge, negative"),
    "greatest_current_A": PolicyVariable(("soc",), "f8", "A", "strongest charge, positive"),
    "stage_cost_kg": PolicyVariable(_TABLE, "f8", "kg", "fuel and price of missing power, of a step"),
    "battery_power_W": PolicyVariable(_TABLE, "f8", "W", "battery power, positive charges"),
    "engine_torque_Nm": PolicyVariable(_TABLE, "f8", "N m", "engine torque at the crank"),
    "fuel_kgps": PolicyVariable(_TABLE, "f8", "kg/s", "fuel rate"),
    "offset_kg": PolicyVariable(("stage",), "f8", "kg", "to be added to cost_to_go_kg"),
    "cost_to_go_kg": PolicyVariable(
        ("stage", "engine", "variance", "soc"),
        "f4",
        "kg",
        "expected cost from a stage to the end, less offset_kg",
    ),
}


def write_policy(policy: CostToGoPolicy, path: Path) -> None:
    """Write a policy; the same policy gives the same bytes.

    Parameters
    ----------
    policy : CostToGoPolicy
        What to write.
    path : Path
        File to create.

    Raises
    ------
    CommandError
        If the cost-to-go is larger than the format allows (4 GiB).
    """
    arrays = _arrays(policy)
    largest = arrays["cost_to_go_kg"].nbytes
    if largest > _MOST_BYTES:
        raise CommandError(
            f"the cost-to-go takes {largest / 2**30:.1f} GiB, a policy file can hold 4; take a shorter cycle"
        )
    sizes: dict[str, int] = {}
    for name, form in VARIABLES.items():
        sizes |= zip(form.dimensions, arrays[name].shape, strict=True)
    with netcdf_file(path, "w", version=_WIDE_OFFSETS) as opened:
        # Attributes of the file and its variables are set at run time, which no type can say.
        file: Any = opened
        for name, value in _attributes(policy).items():
            setattr(file, name, value.encode() if isinstance(value, str) else np.float64(value))
        for dimension, size in sizes.items():
            file.createDimension(dimension, size)
        for name, form in VARIABLES.items():
            stored = file.createVariable(name, form.on_disk, form.dimensions)
            stored.units, stored.long_name = form.units, form.long_name
            stored[:] = arrays[name]


def is_policy(path: Path) -> bool:
    """Tell whether a file is one that `write_policy` wrote."""
    try:
        with path.open("rb") as raw, netcdf_file(raw, "r", mmap=False) as file:
            return getattr(file, "title", b"") == TITLE.encode()
    except (OSError, TypeError, ValueError, LookupError, AttributeError):
        return False


def _arrays(policy: CostToGoPolicy) -> dict[str, NDArray[Any]]:
    problem, solution = policy.problem, policy.solution
    grid, nodes = solution.grid, solution.soc
    rows = grid.level if solution.cost_to_go_kg.shape[2] > 1 else np.zeros(1)
    return {
        "time_s": problem.cycle.time_s,
        "speed_mps": problem.cycle.speed_mps,
        "altitude_m": problem.cycle.altitude_m,
        "soc": nodes,
        "variance": rows,
        "measurement_variance": measurement_variance(nodes, rows, problem.pack, problem.uncertainty),
        "ocv_V": grid.ocv_V,
        "discharge_resistance_ohm": grid.discharge_ohm,
        "charge_resistance_ohm": grid.charge_ohm,
        "least_current_A": grid.current_low_A,
        "greatest_current_A": grid.current_high_A,
        "stage_cost_kg": problem.stages.cost_kg,
        "battery_power_W": problem.stages.power_W,
        "engine_torque_Nm": problem.engine_torque_Nm,
        "fuel_kgps": problem.fuel_kgps,
        "offset_kg": solution.offset_kg,
        "cost_to_go_kg": solution.cost_to_go_kg,
    }


def _attributes(policy: CostToGoPolicy) -> dict[str, str | float]:
    problem: Problem = policy.problem
    concept, uncertainty = problem.concept, problem.uncertainty
    settings = {"concept": concept.model_dump(mode="json"), "grid": problem.settings.model_dump(mode="json")}
    return {
        "title": TITLE,
        "concept": concept.name,
        "policy": policy.name,
        "cycle": problem.cycle.name,
        "acts_on": _ACTS_ON[policy.acts_on],
        "mu": uncertainty.mu,
        "gamma": uncertainty.gamma,
        "beta": uncertainty.beta,
        "step_s": problem.step_s,
        "capacity_C": problem.pack.capacity_C,
        "start_fuel_kg": concept.start_fuel_kg,
        "shortfall_kg_per_MJ": concept.shortfall_kg_per_MJ,
        "initial_soc": concept.initial_soc,
        "initial_soc_sd": concept.initial_soc_sd,
        "value_kg": policy.value_kg,
        "look_up": "cubic" if policy.solution.grid.cubic else "linear",
        "settings": json.dumps(settings, sort_keys=True),
    }

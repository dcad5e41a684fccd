"""A policy file read back, as far as acting needs it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import netcdf_file

from bms._filter import Filter
from bms.errors import BatteryError
from bms.filtering import tabulate_filter
from bms.uncertainty import UncertaintyModel
from ems import Concept, EmsError
from ems._choose import CERTAIN, ESTIMATE, TRUTH
from ems._sdp import Scalars
from ems.concept import parse_concept
from ems.export.tables import LookAhead, PolicyTables, StageTables
from socwise.commands.errors import CommandError
from socwise.commands.policy_file import is_policy

Array = NDArray[np.float64]

_ACTS_ON = {"estimate and variance": ESTIMATE, "estimate": CERTAIN, "truth": TRUTH}
_SAME_V = 1e-9


def read_policy(path: Path, concept: Concept | None = None) -> PolicyTables:
    """Read a file that ``socwise solve`` wrote.

    Parameters
    ----------
    path : Path
        The file.
    concept : Concept, optional
        The concept it was solved for, where its battery pack is a file of the user's own; the policy file
        names the pack but does not hold its curve of trust in a measurement (alpha).

    Raises
    ------
    CommandError
        If there is no such file, it is no policy, or the pack is not the one it was solved for.
    """
    if not path.is_file():
        raise CommandError(f"there is no policy file {path}; write one with: socwise solve --out {path}")
    if not is_policy(path):
        raise CommandError(f"{path} is no policy file of socwise; write one with: socwise solve")
    try:
        with netcdf_file(path, "r", mmap=False) as opened:
            file: Any = opened
            attributes = {key: _plain(value) for key, value in file._attributes.items()}
            arrays = {name: _native(variable[:]) for name, variable in file.variables.items()}
        return _tables(path, attributes, arrays, concept)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        if isinstance(error, CommandError | BatteryError | EmsError):
            raise
        raise CommandError(
            f"{path} is not a whole policy file ({error}); write it again with: socwise solve"
        ) from error


def _tables(
    path: Path, attributes: dict[str, Any], arrays: dict[str, NDArray[Any]], concept: Concept | None
) -> PolicyTables:
    step_s = float(attributes["step_s"])
    acts_on = _ACTS_ON[attributes["acts_on"]]
    soc = arrays["soc"]
    return PolicyTables(
        policy=attributes["policy"],
        concept=attributes["concept"],
        cycle=attributes["cycle"],
        step_s=step_s,
        stages=StageTables(
            power_W=arrays["battery_power_W"],
            cost_kg=arrays["stage_cost_kg"],
            engine_torque_Nm=arrays["engine_torque_Nm"],
            fuel_kgps=arrays["fuel_kgps"],
        ),
        basis=LookAhead(
            acts_on=acts_on,
            soc=soc,
            soc_step=float(soc[-1] - soc[0]) / (soc.size - 1),
            cubic=attributes["look_up"] == "cubic",
            ocv_V=arrays["ocv_V"],
            discharge_ohm=arrays["discharge_resistance_ohm"],
            charge_ohm=arrays["charge_resistance_ohm"],
            current_low_A=arrays["least_current_A"],
            current_high_A=arrays["greatest_current_A"],
            level=arrays["variance"],
            cost_to_go_kg=arrays["cost_to_go_kg"][1:],
            scalars=Scalars(
                step_s=step_s,
                charge_to_soc=step_s / attributes["capacity_C"],
                drift=step_s * attributes["gamma"],
                drift_per_A=step_s * attributes["beta"],
                start_cost_kg=attributes["start_fuel_kg"],
                shortfall_kg_per_J=1e-6 * attributes["shortfall_kg_per_MJ"],
            ),
            known=_filter(path, attributes, arrays, concept) if acts_on == ESTIMATE else None,
        ),
    )


def _filter(
    path: Path, attributes: dict[str, Any], arrays: dict[str, NDArray[Any]], concept: Concept | None
) -> Filter:
    """Tabulate the filter anew, from the pack that the file names."""
    if concept is None:
        concept = parse_concept(json.loads(attributes["settings"])["concept"], str(path))
        if concept.pack.endswith(".toml"):
            raise CommandError(
                f"{path} was solved for a battery pack of your own, {concept.pack}; name the concept's file"
                " too: --concept FILE.toml"
            )
    pack = concept.load_pack()
    same_curve = np.allclose(pack.ocv(arrays["soc"]), arrays["ocv_V"], rtol=0.0, atol=_SAME_V)
    if not (same_curve and pack.capacity_C == attributes["capacity_C"]):
        raise CommandError(
            f"the battery pack {concept.pack!r} is not the one that {path} was solved for; solve it again"
            " with: socwise solve"
        )
    uncertainty = UncertaintyModel(gamma=attributes["gamma"], beta=attributes["beta"], mu=attributes["mu"])
    return tabulate_filter(pack, uncertainty)


def _plain(value: Any) -> Any:
    return value.decode() if isinstance(value, bytes) else float(value)


def _native(values: NDArray[Any]) -> NDArray[Any]:
    """Numbers in the byte order of this machine; the file has the other one, mostly."""
    values = np.asarray(values)
    return np.ascontiguousarray(values.astype(values.dtype.newbyteorder("=")))

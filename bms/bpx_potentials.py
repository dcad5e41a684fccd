r"""Open-circuit voltage between the stoichiometry limits of the two electrodes of a BPX file.

.. math::

    V_{oc}(s) = U_p(y) - U_n(x), \qquad y = y_{max} - s\,(y_{max} - y_{min}), \quad
    x = x_{min} + s\,(x_{max} - x_{min})

Where the file has branches, a charge delithiates the positive electrode and lithiates the negative one, a
discharge the other way round, and the hysteresis voltage is half the distance of the two.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from bms.bpx_expression import evaluate
from bms.errors import BatteryError

Array = NDArray[np.float64]

ELECTRODES = ("Negative electrode", "Positive electrode")
POTENTIALS = ("OCP [V]", "OCP (lithiation) [V]", "OCP (delithiation) [V]")

NODES = np.concatenate((np.arange(20) / 400, np.arange(5, 95) / 100, 1.0 - np.arange(21)[::-1] / 400))
"""SOC nodes of the open-circuit voltage: 1 % apart, 0.25 % within 5 % of the ends."""

LARGEST_FALL_V = 1e-3
"""Potentials of real electrodes are fits; a fall of the difference by less than this is smoothed away."""

FARADAY_C_PER_MOL = 96485.33212


def held_Ah(cell: Any, electrode: Any) -> float:
    """Charge in Ah between the stoichiometry limits of an electrode of spherical particles.

    Parameters
    ----------
    cell, electrode : object
        Sections of the file as the `bpx` package read them.
    """
    share = electrode.surface_area_per_unit_volume * electrode.particle_radius / 3.0
    volume_m3 = electrode.thickness * cell.electrode_area * cell.number_of_electrodes * share
    window = electrode.maximum_stoichiometry - electrode.minimum_stoichiometry
    return float(FARADAY_C_PER_MOL * electrode.maximum_concentration * volume_m3 * window / 3600.0)


def open_circuit(
    electrodes: list[dict[str, Any]], windows: list[Any], file: Path
) -> tuple[Array, Array | None]:
    """Tabulate the open-circuit voltage.

    Parameters
    ----------
    electrodes : list of dict
        The negative and the positive electrode as they stand in the file.
    windows : list
        The same two as the `bpx` package read them, for their stoichiometry limits.
    file : Path
        Named in errors.

    Returns
    -------
    tuple of ndarray and (ndarray or None)
        Voltage at `NODES`, and half the distance of its branches where the file has them.

    Raises
    ------
    BatteryError
        A potential missing or not finite, a table that does not reach the limits, or no rising voltage.
    """
    at = [
        low + share * (high - low)
        for share, low, high in (
            (NODES, windows[0].minimum_stoichiometry, windows[0].maximum_stoichiometry),
            (1.0 - NODES, windows[1].minimum_stoichiometry, windows[1].maximum_stoichiometry),
        )
    ]
    plain, lithiation, delithiation = (
        [
            _potential(electrode.get(key), x, f"{file}, {name}, {key}")
            for name, electrode, x in zip(ELECTRODES, electrodes, at, strict=True)
        ]
        for key in POTENTIALS
    )
    if plain[0] is None or plain[1] is None:
        raise BatteryError(f"{file}: both electrodes need {POTENTIALS[0]}")
    ocv_V = _rising(plain[1] - plain[0], file)
    if all(branch is None for branch in lithiation + delithiation):
        return ocv_V, None
    charge_V = _either(delithiation[1], plain[1]) - _either(lithiation[0], plain[0])
    discharge_V = _either(lithiation[1], plain[1]) - _either(delithiation[0], plain[0])
    return ocv_V, np.maximum(0.5 * (charge_V - discharge_V), 0.0)


def _either(branch: Array | None, plain: Array) -> Array:
    return plain if branch is None else branch


def _potential(given: Any, x: Array, where: str) -> Array | None:
    """Tabulate a potential: an expression, a table with linear interpolation, or a number."""
    if given is None:
        return None
    if isinstance(given, str):
        found = evaluate(given, x)
    elif isinstance(given, dict):
        nodes, values = np.asarray(given["x"], dtype=np.float64), np.asarray(given["y"], dtype=np.float64)
        if nodes.size < 2 or np.any(np.diff(nodes) <= 0.0):
            raise BatteryError(f"{where}: x of the table must increase strictly")
        if nodes[0] > x.min() + 1e-9 or nodes[-1] < x.max() - 1e-9:
            raise BatteryError(
                f"{where}: the table runs from {nodes[0]:g} to {nodes[-1]:g}, the stoichiometry from"
                f" {x.min():g} to {x.max():g}"
            )
        found = np.interp(x, nodes, values)
    else:
        found = np.full(x.size, float(given))
    if not np.isfinite(found).all():
        raise BatteryError(f"{where} is not finite between the stoichiometry limits")
    return found


def _rising(voltage_V: Array, file: Path) -> Array:
    """Smooth small falls away, refuse others."""
    smooth = np.asarray(isotonic_regression(voltage_V).x, dtype=np.float64)
    worst = int(np.argmax(np.abs(smooth - voltage_V)))
    if abs(smooth[worst] - voltage_V[worst]) > LARGEST_FALL_V or smooth[-1] <= smooth[0]:
        raise BatteryError(
            f"{file}: the difference of the potentials does not rise with SOC (near {NODES[worst]:.2f});"
            " check the potentials and the stoichiometry limits"
        )
    return smooth

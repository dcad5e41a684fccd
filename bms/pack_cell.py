r"""A pack seen as a cell, and a cell seen as a pack, so that policies and plant speak of the same battery.

The optimisation knows a pack as OCV and one resistance over SOC ([L] section 3.1); a plant with a circuit
and the estimators know a cell (`bms.cell`). [L] and its Table 1 say nothing of relaxation. Here a pack's
resistance is what data sheets call it, that of a pulse of 10 s:

.. math:: R_{pack} = R + \sum_j R_j\,\bigl(1 - e^{-10\,\mathrm{s}/\tau_j}\bigr) .

**Pack to cell.** One relaxation pair is added with :math:`R_1 = R` and :math:`\tau_1 = 30` s, close to [M]
Table 7 (8 and 11 mOhm, 29.7 s) and to the A123 of `bms/presets/cells` (10.2 and 12.4 mOhm, 30.7 s); with the
formula :math:`R = R_{pack} / 1.283`. Where charge and discharge resistance differ, their mean is taken.

**Cell to pack.** The same formula at the cell's reference temperature. Hysteresis and the slower part of the
relaxation are lost on the way: the policies do not know of them.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from bms._ecm import parameters_at
from bms.cell import Cell, RelaxationPair
from bms.circuit import tabulate
from bms.pack import Pack

PULSE_S = 10.0
RELAXATION_RATIO = 1.0
RELAXATION_S = 30.0
"""The pair that a pack gets: its resistance over the series resistance, and its time constant."""
CELL_V = 3.7
"""Voltage of a cell, from which the number in series is guessed where a pack does not say it."""


def cell_from_pack(pack: Pack) -> Cell:
    """See a pack as a cell with one relaxation pair.

    Parameters
    ----------
    pack : Pack
        The pack. Where it has no voltage window, the cell's is as wide as its currents can make it.

    Returns
    -------
    Cell
        With the pack's capacity, OCV and current limits.
    """
    share = 1.0 + RELAXATION_RATIO * -math.expm1(-PULSE_S / RELAXATION_S)
    discharge = np.array(pack.resistance_ohm)
    charge = np.array(pack.charge_resistance_ohm or pack.resistance_ohm)
    series = 0.5 * (discharge + charge) / share
    most = (1.0 + RELAXATION_RATIO) * float(series.max())
    lowest_V = max(pack.ocv_V[0] - most * pack.discharge_limit_A, 0.25 * pack.ocv_V[0])
    highest_V = pack.ocv_V[-1] + most * pack.charge_limit_A
    same = bool(np.all(series == series[0]))
    return Cell(
        name=pack.name,
        source=f"{pack.source}; relaxation: R1 = R, {RELAXATION_S:g} s",
        capacity_Ah=pack.capacity_Ah,
        series=max(1, round(nominal_V(pack) / CELL_V)),
        soc=pack.soc,
        ocv_V=pack.ocv_V,
        resistance_ohm=float(series[0]) if same else tuple(series.tolist()),
        relaxation=(
            RelaxationPair(
                resistance_ohm=RELAXATION_RATIO * float(series[0])
                if same
                else tuple((RELAXATION_RATIO * series).tolist()),
                time_constant_s=RELAXATION_S,
            ),
        ),
        voltage_min_V=lowest_V if pack.voltage_min_V is None else pack.voltage_min_V,
        voltage_max_V=highest_V if pack.voltage_max_V is None else pack.voltage_max_V,
        discharge_limit_A=pack.discharge_limit_A,
        charge_limit_A=pack.charge_limit_A,
        slope_floor=pack.slope_floor,
    )


def pack_from_cell(cell: Cell) -> Pack:
    """See a cell (or a pack of cells, `Cell.scaled`) as a pack.

    Parameters
    ----------
    cell : Cell
        The cell.

    Returns
    -------
    Pack
        With the cell's capacity, OCV and limits, and its resistance to a pulse of 10 s.
    """
    circuit = tabulate(cell)
    ohms = []
    for soc in cell.soc:
        r, r1, tau1, r2, tau2, _ = parameters_at(
            circuit.table,
            circuit.temperature_C,
            circuit.activation_K,
            circuit.reference_K,
            soc,
            cell.reference_temperature_C,
        )
        ohms.append(r - r1 * math.expm1(-PULSE_S / tau1) - r2 * math.expm1(-PULSE_S / tau2))
    return Pack(
        name=cell.name,
        source=f"{cell.source}; resistance to a pulse of {PULSE_S:g} s",
        capacity_Ah=cell.capacity_Ah,
        soc=cell.soc,
        ocv_V=cell.ocv_V,
        resistance_ohm=tuple(ohms),
        discharge_limit_A=cell.discharge_limit_A,
        charge_limit_A=cell.charge_limit_A,
        voltage_min_V=cell.voltage_min_V,
        voltage_max_V=cell.voltage_max_V,
        slope_floor=cell.slope_floor,
    )


def fill_pack(cell: Cell, pack: Pack) -> Cell:
    """Take as many cells in series and in parallel as come closest to a pack's voltage and capacity.

    Parameters
    ----------
    cell : Cell
        The cell.
    pack : Pack
        What is to be replaced.
    """
    series = max(1, round(nominal_V(pack) / nominal_V(cell)))
    parallel = max(1, round(pack.capacity_Ah / cell.capacity_Ah))
    return cell.scaled(series, parallel)


def nominal_V(battery: Pack | Cell) -> float:
    """Mean of the OCV over SOC."""
    pairs = zip(pairwise(battery.soc), pairwise(battery.ocv_V), strict=True)
    return float(sum(0.5 * (b - a) * (low + high) for (a, b), (low, high) in pairs))

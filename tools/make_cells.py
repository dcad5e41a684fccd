"""Write the preset cells: `python tools/make_cells.py [FOLDER]`.

Open-circuit voltages are differences of published electrode potentials over stoichiometry windows:

* LFP against graphite: Safari and Delacourt, J. Electrochem. Soc. 158 (2011) A562, a 2.3 Ah 26650 cell.
* NMC 811 against graphite-SiOx: Chen et al., J. Electrochem. Soc. 167 (2020) 080534, the LG M50.

The circuits: [M] Table 7; Perez et al., ASME DSCC 2012 (A123 26650); and, for the LG M50, the
porous-electrode parameters of Chen et al. linearised at 50 % SOC, see `linearised`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, least_squares

Array = NDArray[np.float64]
Curve = Callable[[Array], Array]

FARADAY_C_PER_MOL = 96485.33212
GAS_J_PER_MOL_K = 8.314462618
KELVIN_25_C = 298.15

NODES = np.concatenate(
    [
        [0.0, 0.0025, 0.005, 0.01, 0.015],
        np.arange(2, 10) / 100,
        np.arange(10, 90, 2) / 100,
        np.arange(90, 98) / 100,
        [0.98, 0.985, 0.99, 0.995, 1.0],
    ]
)
"""SOC nodes: close together where the ends bend."""


def graphite(x: Array) -> Array:
    """Potential of graphite in V over its stoichiometry (Safari and Delacourt 2011)."""
    return (
        0.6379
        + 0.5416 * np.exp(-305.5309 * x)
        + 0.044 * np.tanh(-(x - 0.1958) / 0.1088)
        - 0.1978 * np.tanh((x - 1.0571) / 0.0854)
        - 0.6875 * np.tanh((x + 0.0117) / 0.0529)
        - 0.0175 * np.tanh((x - 0.5692) / 0.0875)
    )


def lfp(y: Array) -> Array:
    """Potential of LiFePO4 in V over its stoichiometry (Safari and Delacourt 2011)."""
    z = 1.0 - y
    return (
        3.4323
        - 0.8428 * np.exp(-80.2493 * z**1.3198)
        - 3.2474e-6 * np.exp(20.2645 * z**3.8003)
        + 3.2482e-6 * np.exp(20.2646 * z**3.7995)
    )


def graphite_silicon(x: Array) -> Array:
    """Potential of the LG M50's graphite-SiOx in V over its stoichiometry (Chen et al. 2020)."""
    return (
        1.9793 * np.exp(-39.3631 * x)
        + 0.2482
        - 0.0909 * np.tanh(29.8538 * (x - 0.1234))
        - 0.04478 * np.tanh(14.9159 * (x - 0.2769))
        - 0.0205 * np.tanh(30.4444 * (x - 0.6103))
    )


def nmc(y: Array) -> Array:
    """Potential of the LG M50's NMC 811 in V over its stoichiometry (Chen et al. 2020)."""
    return (
        -0.8090 * y
        + 4.4875
        - 0.0428 * np.tanh(18.5138 * (y - 0.5542))
        - 17.7326 * np.tanh(15.7890 * (y - 0.3117))
        + 17.5842 * np.tanh(15.9308 * (y - 0.3120))
    )


def lfp_cell(x_empty: float, x_full: float, empty_V: float = 2.5, full_V: float = 3.6) -> Array:
    """OCV of an LFP cell at `NODES`; the window of the LFP follows from the voltages at the two ends."""
    y_empty = brentq(lambda y: lfp(y) - graphite(x_empty) - empty_V, 0.6, 0.9999)
    y_full = brentq(lambda y: lfp(y) - graphite(x_full) - full_V, 0.005, 0.1)
    return lfp(y_empty + NODES * (y_full - y_empty)) - graphite(x_empty + NODES * (x_full - x_empty))


M50_X = (0.0279, 0.9014)
M50_Y = (0.9084, 0.2661)
"""Stoichiometry windows of the LG M50, empty and full (Chen et al. 2020)."""


def linearised() -> tuple[float, list[tuple[float, float]], float]:
    """Linearise the LG M50's porous-electrode parameters at 50 % SOC.

    Series resistance: electrolyte (a third of each electrode, the whole separator) and charge transfer
    ``R T / (F i0 a L A)``. Relaxation: diffusion in the particles, whose surface leads its mean by
    ``(r j / 5 D) (1 - sum 10 / l_n^2 exp(-l_n^2 D t / r^2))`` with ``tan l_n = l_n``; two exponentials are
    fitted to the sum of both electrodes. Electrolyte diffusion is left out.

    Returns
    -------
    tuple of float, list of (float, float) and float
        Series resistance in ohm, pairs (ohm, s), activation energy of all of them together in J/mol.
    """
    area_m2, salt = 0.065 * 1.58, 1000.0
    conductivity = 0.1297 - 2.51 + 3.329  # S/m at 1 mol/l, Nyman et al. 2008
    electrodes = (  # L, porosity, active share, r, D, c_max, m (A m^2.5 mol^-1.5), E_act, U, window
        (85.2e-6, 0.25, 0.75, 5.86e-6, 3.3e-14, 33133.0, 6.48e-7, 35000.0, graphite_silicon, M50_X),
        (75.6e-6, 0.335, 0.665, 5.22e-6, 4e-15, 63104.0, 3.42e-6, 17800.0, nmc, M50_Y),
    )
    ohmic = 12e-6 / (conductivity * 0.47**1.5) / area_m2
    transfer, energy = 0.0, 0.0
    times = np.geomspace(1.0, 3000.0, 200)
    response = np.zeros_like(times)
    roots = np.array(
        [brentq(lambda v: np.sin(v) - v * np.cos(v), n * np.pi, (n + 0.5) * np.pi) for n in range(1, 200)]
    )
    for length, porosity, share, radius, diffusivity, most, rate, activation, potential, window in electrodes:
        ohmic += length / (3.0 * conductivity * porosity**1.5) / area_m2
        surface_m2 = 3.0 * share / radius * length * area_m2
        at = 0.5 * (window[0] + window[1])
        exchange = rate * np.sqrt(salt * most * at * most * (1.0 - at))
        one = GAS_J_PER_MOL_K * KELVIN_25_C / (FARADAY_C_PER_MOL * exchange * surface_m2)
        transfer += one
        energy += one * activation
        slope = abs(potential(np.array(at + 1e-4)) - potential(np.array(at - 1e-4))) / 2e-4
        whole = float(slope) * radius / (5.0 * diffusivity * FARADAY_C_PER_MOL * surface_m2 * most)
        decay = np.exp(-np.outer(times * diffusivity / radius**2, roots**2))
        response += whole * (1.0 - decay @ (10.0 / roots**2))

    def error(guess: Array) -> Array:
        a, s, b, t = np.exp(guess)
        return (a * (1.0 - np.exp(-times / s)) + b * (1.0 - np.exp(-times / t)) - response) * 1e3

    a, s, b, t = np.exp(least_squares(error, np.log([5e-3, 30.0, 7e-3, 300.0])).x)
    return ohmic + transfer, [(a, s), (b, t)], energy / (ohmic + transfer + a + b)


def array(values: Array, digits: int) -> str:
    """Format a TOML array, ten numbers a line."""
    cells = [f"{value:.{digits}f}" for value in values]
    lines = [", ".join(cells[i : i + 10]) for i in range(0, len(cells), 10)]
    return "[\n  " + ",\n  ".join(lines) + ",\n]"


def lfp_2ah() -> str:
    """Compose the cell of [M] Table 7."""
    return f"""# The cell of [M] Table 7; written by tools/make_cells.py.
# The report gives no open-circuit voltage: here LFP against graphite (Safari and Delacourt 2011), graphite
# between 0.0085 and 0.78 (Schimpe et al., J. Electrochem. Soc. 165 (2018) A181), 2.5 V empty and 3.6 V full.
# Current limits: own choice.
name = "lfp-2ah"
source = "[M] Table 7; OCV: electrode potentials of Safari and Delacourt 2011"
capacity_Ah = 2.0
soc = {array(NODES, 4)}
ocv_V = {array(lfp_cell(0.0085, 0.78), 5)}
resistance_ohm = 0.008
voltage_min_V = 2.0
voltage_max_V = 3.65
discharge_limit_A = 60.0
charge_limit_A = 20.0
full_charge_voltage_V = 3.6
full_charge_current_A = 0.1

[[relaxation]]
resistance_ohm = 0.011
capacitance_F = 2700.0
"""


def a123_26650() -> str:
    """Compose the A123 26650 cell."""
    hysteresis_V = np.interp(NODES, [0.2, 0.5, 0.8], [0.0245, 0.017, 0.014])
    return f"""# A123 ANR26650M1; written by tools/make_cells.py.
# OCV: Safari and Delacourt 2011 (this very cell), graphite between 0.0085 and 0.86, 2.5 V empty, 3.6 V full.
#   Slopes 0.37, 0.046 and 0.041 V per unit of SOC at 20, 50 and 80 %; measured 0.48, 0.08 and 0.05.
# Circuit: Perez et al., ASME DSCC 2012 (15 to 45 C), at 25 C and 50 %: series resistance, mean of charge and
#   discharge; first pair, charge branch; their second pair (1000 s) is left out. Energy: slope of ln(R + R_r)
#   over 1/T between 15 and 45 C.
# Hysteresis: half the measured distance of the branches (49, 34 and 28 mV at 20, 50 and 80 %); rate: own.
# Thermal: Lin et al., J. Power Sources 257 (2014) 1; core and surface as one node, 62.7 + 4.5 J/K and
#   1.94 + 3.08 K/W. Limits: data sheet.
name = "a123-26650"
source = "Safari and Delacourt 2011 (OCV), Perez et al. 2012 (circuit), Lin et al. 2014 (thermal)"
capacity_Ah = 2.3
soc = {array(NODES, 4)}
ocv_V = {array(lfp_cell(0.0085, 0.86), 5)}
resistance_ohm = 0.0102
activation_energy_J_per_mol = 18300.0
reference_temperature_C = 25.0
voltage_min_V = 2.0
voltage_max_V = 3.65
discharge_limit_A = 70.0
charge_limit_A = 10.0
full_charge_voltage_V = 3.6
full_charge_current_A = 0.115

[[relaxation]]
resistance_ohm = 0.0124
time_constant_s = 30.7

[hysteresis]
voltage_V = {array(hysteresis_V, 5)}
rate = 20.0

[thermal]
heat_capacity_J_per_K = 67.2
resistance_K_per_W = 5.02
"""


def nmc_lgm50() -> str:
    """Compose the LG M50 cell."""
    x = M50_X[0] + NODES * (M50_X[1] - M50_X[0])
    y = M50_Y[0] + NODES * (M50_Y[1] - M50_Y[0])
    series, pairs, energy = linearised()
    relaxation = "\n".join(
        f"[[relaxation]]\nresistance_ohm = {ohm:.5f}\ntime_constant_s = {time:.1f}\n" for ohm, time in pairs
    )
    return f"""# LG M50, NMC 811 against graphite-SiOx, 21700; written by tools/make_cells.py.
# OCV and stoichiometry windows: Chen et al. 2020. Circuit: no measured one; the porous-electrode parameters
#   of the same paper linearised at 50 % SOC and 25 C (formulas in the tool). Energy: its charge transfer
#   (35 and 17.8 kJ/mol) by its share of the whole resistance.
# Thermal: the layers of the same paper over 24.2 cm3; 10 W/(m2 K) on 53.1 cm2. Limits: data sheet.
name = "nmc-lgm50"
source = "Chen et al., J. Electrochem. Soc. 167 (2020) 080534; circuit linearised from its parameters"
capacity_Ah = 5.0
soc = {array(NODES, 4)}
ocv_V = {array(nmc(y) - graphite_silicon(x), 5)}
resistance_ohm = {series:.5f}
activation_energy_J_per_mol = {energy:.0f}.0
reference_temperature_C = 25.0
voltage_min_V = 2.5
voltage_max_V = 4.2
discharge_limit_A = 7.275
charge_limit_A = 3.395
full_charge_voltage_V = 4.19
full_charge_current_A = 0.05

{relaxation}
[thermal]
heat_capacity_J_per_K = 42.8
resistance_K_per_W = 18.8
"""


CELLS = {"lfp-2ah": lfp_2ah, "a123-26650": a123_26650, "nmc-lgm50": nmc_lgm50}

if __name__ == "__main__":
    here = Path(__file__).parents[1] / "bms" / "presets" / "cells"
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else here
    folder.mkdir(parents=True, exist_ok=True)
    for name, compose in CELLS.items():
        (folder / f"{name}.toml").write_text(compose(), encoding="utf-8")

"""Write the preset packs of [L] Table 1: `python tools/make_packs.py [FOLDER]`.

The paper gives voltage, resistance and energy and only draws the voltage curve (its Fig 1). The curve here is
our own choice: flat between 20 and 75 % SOC, steep below 10 % and above 95 %.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

PACKS = {"hev": (192.0, 0.30, 1400.0), "phev": (305.0, 0.13, 8000.0)}


def shape(soc: NDArray[np.float64]) -> NDArray[np.float64]:
    """Open-circuit voltage as a share of the nominal voltage; 1 at 50 % SOC."""
    return 0.95 + 0.10 * soc - 0.18 * np.exp(-soc / 0.04) + 0.05 * np.exp(-(1.0 - soc) / 0.08)


def table(values: NDArray[np.float64], digits: int) -> str:
    """Format a TOML array, ten numbers a line."""
    cells = [f"{value:.{digits}f}" for value in values]
    lines = [", ".join(cells[i : i + 10]) for i in range(0, len(cells), 10)]
    return "[\n  " + ",\n  ".join(lines) + ",\n]"


def preset(name: str) -> str:
    """Compose the TOML text of one pack."""
    voltage_V, resistance_ohm, energy_Wh = PACKS[name]
    soc = np.linspace(0.0, 1.0, 51)
    figures = f"{voltage_V:g} V, {resistance_ohm:g} ohm, {energy_Wh / 1000:g} kWh"
    return f"""# {name.upper()} battery of [L] Table 1; written by tools/make_packs.py.
# The OCV curve is our own choice, as a share of the nominal voltage:
#   0.95 + 0.10 s - 0.18 exp(-s / 0.04) + 0.05 exp(-(1 - s) / 0.08)
# The current limits are our own choice as well.
name = "{name}"
source = "[L] Table 1 ({figures}); curve and current limits: own"
capacity_Ah = {energy_Wh / voltage_V:.4f}
soc = {table(soc, 2)}
ocv_V = {table(voltage_V * shape(soc), 4)}
resistance_ohm = {resistance_ohm}
discharge_limit_A = 200.0
charge_limit_A = 200.0
"""


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "bms" / "presets"
    for pack_name in PACKS:
        (folder / f"{pack_name}.toml").write_text(preset(pack_name), encoding="utf-8")

"""The degradation map of [M] Figs 32 and 33: published fade laws of an A123 cell as a table.

The report's map is drawn without values. Here cycling (Wang et al. 2011) and calendar fade (Swierczynski et
al. 2015) are added and linearised at a cell that has lost 4 % to the one and 1 % to the other, so that the
rate depends on current and SOC alone, as that of the report does. As in the report it is the capacity that
fades; the other parameters stay.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from bms.degradation import DegradationMap
from bms.fade_laws import FadeLaws, Wear
from socwise.reproduce.battery_case import battery_cell

WEAR = Wear(cycle=0.04, calendar=0.01)
TEMPERATURE_C = 25.0
CURRENTS_A = np.linspace(0.0, 6.0, 25)
SOCS = np.linspace(0.1, 0.9, 17)


@lru_cache(maxsize=1)
def fade_map() -> DegradationMap:
    """Tabulate the laws over current and SOC at 25 degC."""
    return DegradationMap.from_laws(
        FadeLaws(),
        current_A=CURRENTS_A,
        soc=SOCS,
        temperature_C=TEMPERATURE_C,
        capacity_Ah=battery_cell().capacity_Ah,
        wear=WEAR,
    )

"""Cells and currents that the tests of the battery share."""

import numpy as np

from bms.cell import Cell


def linear_cell(**changes):
    """A cell with OCV = 3 + SOC / 2 and one relaxation pair: a linear circuit."""
    soc = np.linspace(0.0, 1.0, 5)
    values = {
        "name": "linear",
        "source": "test",
        "capacity_Ah": 2.0,
        "soc": tuple(soc),
        "ocv_V": tuple(3.0 + 0.5 * soc),
        "resistance_ohm": 0.008,
        "relaxation": ({"resistance_ohm": 0.011, "capacitance_F": 2700.0},),
        "voltage_min_V": 2.0,
        "voltage_max_V": 4.0,
        "discharge_limit_A": 60.0,
        "charge_limit_A": 20.0,
    }
    return Cell(**(values | changes))


def drive_current_A(n, seed=0, rms_A=2.0, noise_A=0.0):
    """Pulses of some ten seconds around zero mean, as in a drive."""
    rng = np.random.default_rng(seed)
    pulses = np.repeat(rng.normal(0.0, rms_A, n // 10 + 1), 10)[:n]
    return pulses - pulses.mean() + rng.normal(0.0, noise_A, n)

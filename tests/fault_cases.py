"""Logs, random faults, and what must be said of them; shared by the fault tests."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from hypothesis import strategies as st

from bms.cell import Cell
from bms.cells import load_cell
from bms.estimators.gate import Sensors, gate_for
from bms.faults import (
    CHANNELS,
    Dropout,
    Gap,
    Infinite,
    NotANumber,
    SensorGain,
    SensorOffset,
    Spikes,
    Stuck,
)
from bms.flags import Flag
from bms.simulation import simulate

CELLS = ("lfp-2ah", "a123-26650", "nmc-lgm50")
SAMPLES = 6000
FIRST_S, LAST_S = 600.0, 3900.0
"""Faults keep within these, so that the last half hour and more is clean."""
CLEAN_S = 1800.0


@dataclass(frozen=True, eq=False)
class Log:
    """A log as measured, with the truth beside it."""

    cell: Cell
    time_s: np.ndarray
    current_A: np.ndarray
    voltage_V: np.ndarray
    soc: np.ndarray
    temperature_C: np.ndarray


@lru_cache
def measured(name, soc=0.7, samples=SAMPLES):
    """A drive of 40 min, 20 min of charge at C/2, and a drive of 40 min, with the sensors' noise."""
    cell = load_cell(name)
    rng = np.random.default_rng(4)
    rate = np.repeat(rng.normal(-0.35, 0.55, samples // 10), 10)
    rate[2400:3600] = 0.5
    current = np.clip(rate * cell.capacity_Ah, -0.9 * cell.discharge_limit_A, 0.9 * cell.charge_limit_A)
    run = simulate(cell, current, soc=soc)
    return Log(
        cell,
        run.time_s,
        current + 0.01 * rng.normal(size=samples),
        run.voltage_V + 0.002 * rng.normal(size=samples),
        run.soc,
        run.temperature_C,
    )


def decades(low, high, unit):
    """A size between two bounds, each decade as likely as the other."""
    return float(low * (high / low) ** unit)


def fault(units, capacity_Ah):
    """Any fault, from hardly to be seen to absurd, from seven numbers in [0, 1]."""
    kinds = (SensorOffset, SensorGain, Stuck, Dropout, NotANumber, Infinite, Spikes, Gap)
    kind = kinds[min(int(8 * units[0]), 7)]
    duration = decades(1.0, 1200.0, units[1])
    values = {"duration_s": duration, "start_s": FIRST_S + units[2] * (LAST_S - duration - FIRST_S)}
    if kind is Gap:
        return Gap(**values)
    channels = CHANNELS if kind in (SensorOffset, Spikes) else (*CHANNELS, "both")
    channel = channels[min(int(len(channels) * units[3]), len(channels) - 1)]
    full = capacity_Ah if channel == "current" else 1.0
    if kind is SensorOffset:
        values["size"] = full * decades(1e-3, 1.0, units[4]) * (1.0 if units[5] < 0.5 else -1.0)
    elif kind is SensorGain:
        values["size"] = 0.9 + 0.2 * units[4]
    elif kind is Spikes:
        values["size"] = full * decades(1e-2, 1e3, units[4])
    if kind in (Spikes, NotANumber, Infinite):
        values["share"] = decades(1e-3, 0.2 if kind is Spikes else 1.0, units[6])
    return kind(channel=channel, **values)


def drawn(seed):
    """A cell, one to four faults, and the seed of what is drawn within them."""
    rng = np.random.default_rng(seed)
    name = CELLS[rng.integers(len(CELLS))]
    faults = [fault(rng.random(7), load_cell(name).capacity_Ah) for _ in range(rng.integers(1, 5))]
    return name, faults, seed


@st.composite
def chosen(draw):
    """The same, with hypothesis at the wheel: bounds, repetitions, faults within faults."""
    name = draw(st.sampled_from(CELLS))
    units = draw(st.lists(st.tuples(*[st.floats(0.0, 1.0)] * 7), min_size=1, max_size=4))
    return name, [fault(each, load_cell(name).capacity_Ah) for each in units], draw(st.integers(0, 999))


CASES = st.one_of(st.integers(0, 2**32 - 1).map(drawn), chosen())
"""Half of them spread evenly over all that there is, half where hypothesis looks for trouble."""


def plainly_bad(log, cell):
    """Flags that follow from each reading alone, shape (m,)."""
    gate = gate_for(cell, Sensors())
    with np.errstate(invalid="ignore"):
        said = {
            Flag.CURRENT_MISSING: ~np.isfinite(log.current_A),
            Flag.VOLTAGE_MISSING: ~np.isfinite(log.voltage_V),
            Flag.CURRENT_RANGE: np.isfinite(log.current_A) & (np.abs(log.current_A) > gate.current_limit_A),
            Flag.VOLTAGE_RANGE: np.isfinite(log.voltage_V)
            & ((log.voltage_V < gate.voltage_low_V) | (log.voltage_V > gate.voltage_high_V)),
            Flag.GAP: np.diff(log.time_s, prepend=log.time_s[0]) > gate.gap_s,
        }
    return sum(np.where(bad, int(flag), 0) for flag, bad in said.items())


def has_lying_current(fault):
    """Whether a fault makes currents that are wrong and look right."""
    lies = isinstance(fault, SensorOffset | SensorGain | Stuck | Spikes)
    return lies and "current" in fault.channels

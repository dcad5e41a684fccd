"""Exported estimators, compiled and called from Python, and logs that lead them through every branch."""

import ctypes
import subprocess
from dataclasses import dataclass

import numpy as np
from fmu_files import COMPILER

from bms.estimators.base import LEADING
from bms.export.block import CSource
from bms.export.c_source import export_c
from bms.simulation import simulate

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wshadow", "-O1", "-ffp-contract=off")


@dataclass(frozen=True, eq=False)
class Samples:
    """What a battery-management system is given, sample by sample."""

    current_A: np.ndarray
    voltage_V: np.ndarray
    step_s: np.ndarray
    temperature_C: np.ndarray

    def part(self, start, stop=None):
        """Some of the samples."""
        chosen = slice(start, stop)
        return Samples(
            self.current_A[chosen], self.voltage_V[chosen], self.step_s[chosen], self.temperature_C[chosen]
        )


def drive(cell, samples=2000, seed=0, sags=True):
    """A drive with noise; ``sags`` adds faults, gaps, a rest, a full charge and a jump of the voltage."""
    rng = np.random.default_rng(seed)
    current = np.repeat(rng.normal(0.0, 1.2 * cell.capacity_Ah, samples // 10), 10)
    step = np.ones(samples)
    temperature = np.full(samples, np.nan)
    if sags:
        current[499:502], current[1200:1260], step[1205:1260] = 0.0, 0.0, 120.0
        step[500], step[600:620], step[640], step[660] = 7200.0, 0.1, 0.0, 300.0
        temperature[300:310] = 31.0
    clean = simulate(cell, current, np.maximum(step, 1e-3), soc=0.7)
    voltage = clean.voltage_V + 0.002 * rng.normal(size=samples)
    current = current + 0.01 * rng.normal(size=samples)
    if sags:
        voltage[670:720], voltage[730], voltage[740], voltage[750] = voltage[670], 99.0, np.nan, np.inf
        current[800:830], current[840], current[850:880] = np.nan, 1e6, current[850]
        voltage[1400:1460] += 0.3
        voltage[1700:1800] = cell.full_charge_voltage_V + 0.001 * rng.normal(size=100)
        current[1700:1800] = 0.5 * cell.full_charge_current_A + 0.001 * rng.normal(size=100)
    return Samples(current, voltage, step, temperature)


class Compiled:
    """A block in a shared library."""

    def __init__(self, block: CSource, folder):
        self.block = block
        block.write(folder)
        library = folder / f"{block.name}.so"
        command = [COMPILER, *STRICT, "-shared", "-fPIC", "-o", library.name, f"{block.name}.c", "-lm"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        self.object = library
        self.library = ctypes.CDLL(str(library))
        fields = [
            (port.c_expression, ctypes.c_long if port.kind == "integer" else ctypes.c_double)
            for port in block.outputs
        ]
        self.output = type("Output", (ctypes.Structure,), {"_fields_": fields})()
        self.state = (ctypes.c_double * (block.state_bytes // 8))()
        self.init()

    def function(self, name, *given):
        """Call NAME_name on the state."""
        found = getattr(self.library, f"{self.block.name}_{name}")
        return found(self.state, *given)

    def init(self):
        self.function("init")

    def start(self, soc, soc_sd):
        return self.function("start", ctypes.c_double(soc), ctypes.c_double(soc_sd))

    def update(self, *sample):
        return self.function("update", *map(ctypes.c_double, sample), ctypes.byref(self.output))

    def read(self):
        self.function("read", ctypes.byref(self.output))
        return [getattr(self.output, port.c_expression) for port in self.block.outputs]

    def run(self, samples):
        """Outputs after each sample, shape (n, outputs)."""
        rows = np.empty((samples.current_A.size, len(self.block.outputs)))
        columns = (samples.current_A, samples.voltage_V, samples.step_s, samples.temperature_C)
        for k, sample in enumerate(zip(*(column.tolist() for column in columns), strict=True)):
            assert self.update(*sample) == 0
            rows[k] = [getattr(self.output, port.c_expression) for port in self.block.outputs]
        return rows


def compiled(estimator, name, folder):
    """Export and compile an estimator."""
    return Compiled(export_c(estimator, name), folder)


def in_python(estimator, samples):
    """The same rows from the estimator itself; it is left as it stands."""
    twin = estimator.copy()
    trace = twin.run(samples.current_A, samples.voltage_V, samples.step_s, samples.temperature_C)
    columns = [trace.soc, trace.variance, trace.residual_V, trace.flags.astype(float)]
    for each, values in trace.parameters.items():
        columns += [values, trace.deviations[each]]
    assert len(columns) == LEADING + 2 * len(trace.parameters)
    return np.column_stack(columns)

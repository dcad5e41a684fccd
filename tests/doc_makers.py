"""Files that the documentation's commands take as given: made here, where a page does not show them."""

import gzip
import sys
from pathlib import Path

import numpy as np
from command_line import preset_text, write_cycle

from bms.cell_file import write_cell
from bms.cells import load_cell
from bms.simulation import simulate
from vehicle.inertia.sensors import ROAD_SENSORS_GAIN
from vehicle.inertia.synthetic import synthetic

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))


def _samples():
    """Ten minutes of a cell of 2 Ah: time, current, voltage."""
    rng = np.random.default_rng(1)
    run = simulate(load_cell("lfp-2ah"), np.repeat(rng.normal(-0.5, 2.0, 60), 10), soc=0.7)
    return run.time_s, run.current_A, run.voltage_V + rng.normal(0.0, 0.002, 600)


def _log(path):
    np.savetxt(
        path, np.column_stack(_samples()), "%.5f", ",", header="time_s,current_A,voltage_V", comments=""
    )


def _compressed(path):
    _log(path.with_suffix(""))
    path.write_bytes(gzip.compress(path.with_suffix("").read_bytes()))


def _bench(path):
    """The same in the words, units and signs of two benches."""
    time_s, current_A, voltage_V = _samples()
    columns = np.column_stack([time_s, time_s / 60.0, 1e3 * current_A, -1e3 * current_A, 1e3 * voltage_V])
    np.savetxt(path, columns, "%.5f", ";", header="Zeit;t [min];Strom [mA];I(mA);U", comments="")


def _road(path):
    """Two minutes of a Defender on a rural road, 100 samples a second."""
    log, _ = synthetic("rural", seed=1, duration_s=120.0, sensors=ROAD_SENSORS_GAIN)
    corners = ("fl", "fr", "rl", "rr")
    names = ["time_s", *(f"force_{c}_N" for c in corners), "ax_mps2", "ay_mps2"]
    names += [*(f"az_{c}_mps2" for c in corners), "speed_mps"]
    columns = (log.time_s, log.forces_N, log.ax_mps2, log.ay_mps2, log.corner_az_mps2, log.speed_mps)
    np.savetxt(path, np.column_stack(columns), "%.6g", ",", header=",".join(names), comments="")


def _my_cell(path):
    write_cell(load_cell("lfp-2ah"), path)


def _my_concept(path):
    path.write_text(preset_text().replace('name = "hev"', 'name = "mine"'), encoding="utf-8")


def _supplier_fmu(path):
    from supplier_fmu import build

    build(path)


MAKERS = {
    "log.csv.gz": _compressed,
    "log.csv": _log,
    "bench.csv": _bench,
    "my-cell.toml": _my_cell,
    "my-concept.toml": _my_concept,
    "road.csv": _road,
    "trip.csv": write_cycle,
    "commute.csv": write_cycle,
    "logs/commute.csv": write_cycle,
    "supplier.fmu": _supplier_fmu,
}

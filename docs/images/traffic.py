"""Draw traffic.png: `python docs/images/traffic.py`."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from drivecycles.traffic.ensemble import draw_cycles
from drivecycles.traffic.errors import TrafficWarning
from drivecycles.traffic.plot import plot_cycles, plot_errors, plot_field, plot_state
from drivecycles.traffic.scenario_file import load_scenario
from socwise.traffic import error_curves, estimate_scenario

PICTURE = Path(__file__).with_suffix(".png")


def main() -> None:
    """Draw the commute in four panels."""
    warnings.simplefilter("ignore", TrafficWarning)
    scenario, road = load_scenario("commute"), load_scenario("report")
    field, ensemble = scenario.simulate(), draw_cycles(scenario)
    found = estimate_scenario(scenario, field=field)
    figure = Figure(figsize=(11.0, 6.6), layout="constrained")
    panels = figure.subplots(2, 2)
    departs = scenario.probe.depart_s
    plot_field(field, panels[0, 0], [(departs, cycle) for cycle in ensemble.members[:8]])
    panels[0, 0].set_title("the commute, and probes through other days' traffic")
    plot_cycles(ensemble.planned, ensemble.members, panels[0, 1])
    panels[0, 1].set_title("an ensemble of 20 cycles")
    at = int(np.argmin(np.abs(found.estimate.time_s - 900.0)))
    read = (found.readings.detectors.position_m, found.readings.speed_mps[at])
    plot_state(found.estimate, at, read, field, panels[1, 0])
    panels[1, 0].set_title("the road at 900 s, from six detectors")
    plot_errors(error_curves(road, ["mc", "antithetic", "sobol", "gpc"], 0), panels[1, 1])
    panels[1, 1].set_title("the report's road: error of the mean speed")
    figure.savefig(PICTURE, dpi=110)


if __name__ == "__main__":
    main()

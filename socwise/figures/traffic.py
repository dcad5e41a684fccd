"""The figures that go with each command of ``socwise traffic``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from numpy.typing import NDArray

from drivecycles.traffic import plot
from drivecycles.traffic.ensemble import CycleEnsemble
from drivecycles.traffic.field import TrafficField
from drivecycles.traffic.scenario import Scenario
from drivecycles.traffic.uncertainty import Spread
from socwise.traffic import TrafficEstimateRun

if TYPE_CHECKING:
    from typing import Any

    from matplotlib.figure import Figure


def run_figures(scenario: Scenario, field: TrafficField) -> Iterator[tuple[str, Figure]]:
    """Draw speed at the locations, and the time-space diagram."""
    figure = _new(7.0, 3.4)
    plot.plot_locations(field, scenario.locations_m, figure.add_subplot())
    yield "speed", figure
    figure = _new(7.5, 3.6)
    plot.plot_field(field, figure.add_subplot())
    yield "time_space", figure


def spread_figures(
    spreads: Sequence[Spread], curves: Mapping[str, tuple[NDArray[Any], NDArray[Any]]]
) -> Iterator[tuple[str, Figure]]:
    """Draw a fan chart of each location by each method, and errors against runs where there are any."""
    for one in spreads:
        figure = _new(7.0, 0.6 + 2.0 * one.position_m.size)
        panels = figure.subplots(one.position_m.size, 1, sharex=True, squeeze=False)[:, 0]
        for place, ax in enumerate(panels):
            plot.plot_fan(one, place, ax)
            ax.label_outer()
            if place:
                ax.get_legend().remove()
        yield f"fan_{one.method}", figure
    if curves:
        figure = _new(5.5, 4.0)
        plot.plot_errors(curves, figure.add_subplot())
        yield "errors", figure


def estimate_figures(run: TrafficEstimateRun) -> Iterator[tuple[str, Figure]]:
    """Draw the parameters over time, and the road at three times."""
    one = run.estimate
    truth = {} if run.truth is None else run.truth.parameters()
    figure = _new(7.0, 0.6 + 2.2 * len(one.names))
    for name, ax in zip(one.names, figure.subplots(len(one.names), 1, squeeze=False)[:, 0], strict=True):
        plot.plot_parameter(one, name, truth.get(name), ax)
    yield "parameters", figure
    shown = sorted({0, one.time_s.size // 2, one.time_s.size - 1})
    figure = _new(7.0, 0.6 + 2.2 * len(shown))
    for at, ax in zip(shown, figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0], strict=True):
        readings = (run.readings.detectors.position_m, run.readings.speed_mps[at])
        plot.plot_state(one, at, readings, run.field, ax)
        ax.label_outer()
    yield "road", figure


def cycle_figures(
    scenario: Scenario, field: TrafficField, ensemble: CycleEnsemble
) -> Iterator[tuple[str, Figure]]:
    """Draw the cycles over the road, and the planned one in the traffic of the mean parameters."""
    figure = _new(8.0, 3.4)
    plot.plot_cycles(ensemble.planned, ensemble.members, figure.add_subplot())
    yield "cycles", figure
    figure = _new(7.5, 3.6)
    trips = [(scenario.probe.depart_s, cycle) for cycle in (ensemble.planned, *ensemble.members[:10])]
    plot.plot_field(field, figure.add_subplot(), trips)
    yield "time_space", figure


def _new(width_in: float, height_in: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), layout="constrained")

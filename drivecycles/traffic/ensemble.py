r"""An ensemble of drive cycles: a probe vehicle through traffic whose diagram is uncertain, and a plan.

Each member draws parameters of the diagram, independently and from a stream of its own, so that member m is
the same however many there are. Its traffic is simulated, and a probe drives through it. The *plan*, the
cycle that policies are optimised for, is one of two:

- ``mean``: at every place the vehicle arrives at the mean of the members' arrival times,
  :math:`\bar t(\sigma) = \frac1M \sum_m t_m(\sigma)` over the share :math:`\sigma` of the road. A mean of
  speeds over time would mix places, and end when the last one arrives; this one has the mean duration, and
  drives everywhere at the harmonic mean of the speeds;
- ``nominal``: the probe through the traffic of the mean parameters, with none of the spread smoothed away.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivecycles.cycle import DriveCycle
from drivecycles.errors import CycleError
from drivecycles.traffic.errors import TrafficError, TrafficWarning
from drivecycles.traffic.probe import drive_through
from drivecycles.traffic.scenario import Scenario

Array = NDArray[np.float64]

GRID = 4000
"""Places at which arrival times are averaged."""


@dataclass(frozen=True, eq=False)
class CycleEnsemble:
    """Cycles over one road, and the one that is planned with.

    Attributes
    ----------
    planned : DriveCycle
        What policies are optimised for.
    members : tuple of DriveCycle
        What happens, M of them.
    names : tuple of str
        Uncertain parameters, d of them, as the diagram calls them.
    values : ndarray, shape (M, d)
        What the members drew.
    """

    planned: DriveCycle
    members: tuple[DriveCycle, ...]
    names: tuple[str, ...]
    values: Array


def draw_cycles(
    scenario: Scenario,
    *,
    cycles: int | None = None,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> CycleEnsemble:
    """Draw the ensemble of a scenario.

    Parameters
    ----------
    scenario : Scenario
        With uncertain parameters.
    cycles : int, optional
        Number of members; that of the scenario if left out.
    seed : int
        Of the parameters, >= 0.
    progress : callable, optional
        Called with the number of members that are done and of all.

    Raises
    ------
    TrafficError
        When nothing is uncertain, there are fewer than two members, or a member's traffic cannot be run.
    CycleError
        When a probe does not arrive within the simulated time.
    """
    count = scenario.ensemble.cycles if cycles is None else cycles
    if count < 2:
        raise TrafficError(f"an ensemble has two cycles or more, got {count}")
    if seed < 0:
        raise TrafficError(f"the seed is {seed}; give a whole number that is not negative")
    uncertain = scenario.build_uncertain()
    streams = np.random.SeedSequence(seed).spawn(count)
    shares = np.stack([np.random.default_rng(one).random(len(uncertain.names)) for one in streams])
    values = uncertain.values(uncertain.germs(np.clip(shares, 1e-12, 1.0 - 1e-12)))
    members, refused = [], []
    for number, diagram in enumerate(uncertain.diagrams(values)):
        try:
            # The same warning for every other member would be read by nobody: one says it for all.
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always", TrafficWarning)
                field = scenario.simulate(diagram)
            members.append(drive_through(field, scenario.probe, f"{scenario.name}-{number + 1}"))
        except CycleError as error:
            drawn = ", ".join(f"{name} = {value:.5g}" for name, value in diagram.parameters().items())
            raise TrafficError(f"cycle {number + 1} of {count} ({drawn}): {error}") from error
        refused += [str(one.message) for one in caught if issubclass(one.category, TrafficWarning)][:1]
        if progress is not None:
            progress(number + 1, count)
    if refused:
        warnings.warn(
            f"in {len(refused)} of {count} cycles; the first: {refused[0]}", TrafficWarning, stacklevel=2
        )
    if scenario.ensemble.plan == "nominal":
        planned = drive_through(scenario.simulate(), scenario.probe, scenario.name)
    else:
        planned = mean_cycle(members, scenario.name)
    return CycleEnsemble(planned, tuple(members), uncertain.names, values)


def mean_cycle(cycles: list[DriveCycle] | tuple[DriveCycle, ...], name: str) -> DriveCycle:
    """Build the cycle that arrives everywhere at the mean time.

    Parameters
    ----------
    cycles : sequence of DriveCycle
        Over the same road, with the same time step; distances are compared as shares of their own whole.
    name : str
        Of the result.

    Returns
    -------
    DriveCycle
        Of the mean duration, up to one step longer, and the mean distance; on the level.
    """
    step_s = cycles[0].step_s
    fine = np.linspace(0.0, 1.0, GRID + 1)
    share = np.unique(np.concatenate([fine, *(one.position_m / one.distance_m for one in cycles)]))
    share = share[(share >= 0.0) & (share <= 1.0)]
    arrival = np.mean([_arrival(one, share) for one in cycles], axis=0)
    count = int(np.ceil(arrival[-1] / step_s - 1e-9))
    time_s = step_s * np.arange(count + 1)
    first, last = (_harmonic_mean(np.array([one.speed_mps[at] for one in cycles])) for at in (0, -1))
    position = np.interp(time_s, arrival, share) * float(np.mean([one.distance_m for one in cycles]))
    position += last * np.maximum(time_s - arrival[-1], 0.0)
    speed = np.gradient(position, step_s)
    speed[0], speed[-1] = first, last
    return DriveCycle(name, time_s, np.maximum(speed, 0.0))


def _harmonic_mean(speed_mps: Array) -> float:
    return float(1.0 / np.mean(1.0 / speed_mps)) if speed_mps.min() > 0.0 else 0.0


def _arrival(cycle: DriveCycle, share: Array) -> Array:
    """Give the time at which a cycle has each share of its road behind it; of a stop, the time it leaves."""
    behind = cycle.position_m / cycle.distance_m
    leaves = np.append(np.diff(behind) > 0.0, True)
    time_s = cycle.time_s - cycle.time_s[0]
    return np.asarray(np.interp(share, behind[leaves], time_s[leaves]), dtype=np.float64)

r"""Kinematic waves: the equation of Lighthill, Whitham and Richards, [M] eq 90, in conservative form.

Vehicles are conserved and drive at the equilibrium speed of their density,
:math:`k_t + Q(k)_x = 0`. In cells of length :math:`\Delta x` and steps of :math:`\Delta t`

.. math:: k_i^{n+1} = k_i^n + \frac{\Delta t}{\Delta x}\,(f_{i-1/2} - f_{i+1/2}),

so what leaves a cell enters the next. Two schemes differ in the flow :math:`f` through a face:

- ``godunov`` (the default), the exact flow of a jump: :math:`f = \min(D(k_i), S(k_{i+1}), C)` with the demand
  of the cell before, the supply of the cell after and the capacity of a bottleneck. What enters is
  :math:`\min(\text{demand}, S(k_1))`; the exit takes all it is sent. Densities stay within 0 and the jam.
- ``report``, the upwind scheme of [M]: :math:`f = Q(k_i)`, and the whole demand enters whatever there is room
  for. That is right while all traffic is below the critical density; congestion, whose waves travel
  upstream, it moves the wrong way.

Both need the Courant number :math:`\max|Q'|\,\Delta t / \Delta x \le 1`. Lebacque, Proc. 13th ISTTT, 1996.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivecycles.traffic import _kernels as _kernels
from drivecycles.traffic._lwr import Gates, Members, Recorded, run, speeds
from drivecycles.traffic.diagram import Diagram
from drivecycles.traffic.errors import TrafficError, TrafficWarning
from drivecycles.traffic.field import TrafficField
from drivecycles.traffic.naming import suggest
from drivecycles.traffic.road import Demand, Road

Array = NDArray[np.float64]
Whole = NDArray[np.int64]

SCHEMES = ("godunov", "report")
COURANT = 0.9
"""Courant number of the step that is chosen where none is given."""
MOST_STEPS = 10_000_000
LEAST_TOLD_VEH = 1e-6


@dataclass(frozen=True, eq=False)
class MemberFields:
    """Runs of M members, kept at r times in c cells.

    Attributes
    ----------
    time_s : ndarray, shape (r,)
        Times.
    position_m : ndarray, shape (c,)
        Middles of the cells.
    density_per_m, speed_mps : ndarray, shape (r, c, M)
        Vehicles per metre, and their equilibrium speed.
    """

    time_s: Array
    position_m: Array
    density_per_m: Array
    speed_mps: Array


def simulate(
    road: Road,
    diagram: Diagram,
    *,
    demand: float | Demand,
    duration_s: float,
    initial: ArrayLike = 0.0,
    scheme: str = "godunov",
    step_s: float | None = None,
) -> TrafficField:
    """Run one road.

    Parameters
    ----------
    road : Road
        Where.
    diagram : Diagram
        How traffic drives.
    demand : float or Demand
        Flow that wants to enter, in vehicles per second.
    duration_s : float
        How long.
    initial : array_like, scalar or shape (cells,)
        Density at the start, in vehicles per metre.
    scheme : str
        ``godunov`` or ``report``.
    step_s : float, optional
        Time step, a whole part of the duration; chosen for a Courant number of at most 0.9 if absent:
        1 s, or a whole part of it.

    Returns
    -------
    TrafficField

    Raises
    ------
    TrafficError
        When the scheme is unknown or cannot do what is asked, the step is too long, or a density is out of
        range.

    Warns
    -----
    TrafficWarning
        When the demand exceeds the capacity, or a queue keeps vehicles from entering.
    """
    upwind = is_upwind(scheme, road)
    steps, step_s = split_duration(duration_s, step_s, road.cell_m, diagram.fastest_wave_mps)
    offered = Demand.of(demand).at((np.arange(steps) + 0.5) * step_s)
    start = initial_density(road, initial, diagram.full_per_m)
    density, flow = np.empty((steps + 1, road.cells, 1)), np.empty((steps, road.cells + 1, 1))
    every = np.arange(steps + 1)
    kept = Recorded(every, np.arange(road.cells), density, flow)
    run(lay_out([diagram]), upwind, start, offered, step_s / road.cell_m, gates(road, step_s, steps), kept)
    found = TrafficField(
        road,
        scheme,
        step_s * every.astype(np.float64),
        density[:, :, 0],
        diagram.speed_mps(density[:, :, 0]),
        flow[:, :, 0],
        offered,
        float(diagram.fastest_wave_mps * step_s / road.cell_m),
    )
    warn_of_demand(found, diagram.capacity_per_s)
    return found


def simulate_members(
    road: Road,
    diagrams: Sequence[Diagram],
    *,
    demand: float | Demand,
    duration_s: float,
    initial: ArrayLike = 0.0,
    scheme: str = "godunov",
    step_s: float | None = None,
    time_s: ArrayLike | None = None,
    position_m: ArrayLike | None = None,
    cells: ArrayLike | None = None,
) -> MemberFields:
    """Run the same road with many diagrams of one kind, in one call.

    Parameters
    ----------
    road, demand, duration_s, initial, scheme, step_s
        As in `simulate`; the step is chosen for the fastest of all.
    diagrams : sequence of Diagram
        One per member, all of the same kind.
    time_s : array_like, shape (r,), optional
        Times to keep, multiples of the step; every step if absent.
    position_m : array_like, shape (c,), optional
        Positions whose cells to keep; every cell if absent.
    cells : array_like of int, shape (c,), optional
        Cells to keep, from 0, instead of positions.

    Returns
    -------
    MemberFields

    Raises
    ------
    TrafficError
        As `simulate`; or when there is no member, kinds differ, or a time is not a step of the run.
    """
    upwind, members = is_upwind(scheme, road), lay_out(diagrams)
    fastest = max(diagram.fastest_wave_mps for diagram in diagrams)
    steps, step_s = split_duration(duration_s, step_s, road.cell_m, fastest)
    offered = Demand.of(demand).at((np.arange(steps) + 0.5) * step_s)
    start = initial_density(road, initial, min(diagram.full_per_m for diagram in diagrams))
    order, when = steps_at(time_s, steps, step_s)
    where = cells_at(road, position_m, cells)
    density = np.empty((when.size, where.size, len(diagrams)))
    kept = Recorded(when, where, density, np.empty((0, road.cells + 1, len(diagrams))))
    run(members, upwind, start, offered, step_s / road.cell_m, gates(road, step_s, steps), kept)
    if not np.array_equal(order, np.arange(order.size)):
        density = density[order]
        when = when[order]
    return MemberFields(
        step_s * when.astype(np.float64), road.position_m[where], density, speeds(members, density)
    )


def is_upwind(scheme: str, road: Road) -> bool:
    """Read the name of a scheme: whether it is the report's.

    Raises
    ------
    TrafficError
        When it is unknown, or the report's and the road has a bottleneck.
    """
    if scheme not in SCHEMES:
        raise TrafficError(
            f"there is no scheme {scheme!r}; known are {', '.join(SCHEMES)}{suggest(scheme, SCHEMES)}"
        )
    if scheme == "report" and road.bottlenecks:
        raise TrafficError("the report's scheme knows no bottleneck; take scheme 'godunov'")
    return scheme == "report"


def split_duration(
    duration_s: float, step_s: float | None, cell_m: float, fastest_mps: float
) -> tuple[int, float]:
    """Split a duration into steps that the fastest wave allows.

    Returns
    -------
    tuple of int and float
        Number of steps and their length.

    Raises
    ------
    TrafficError
        When the duration is not positive, the step no whole part of it, or the Courant number exceeds 1.
    """
    if not 0.0 < duration_s < math.inf:
        raise TrafficError(f"the duration must be positive and finite, got {duration_s!r} s")
    most_s = cell_m / fastest_mps
    if step_s is None:
        number = _default_steps(duration_s, COURANT * most_s)
    else:
        if not 0.0 < step_s <= duration_s * (1.0 + 1e-9):
            raise TrafficError(
                f"the step must be above 0 and at most the duration, {duration_s:g} s, got {step_s!r} s"
            )
        number = round(duration_s / step_s)
        if abs(number * step_s - duration_s) > 1e-6 * step_s:
            raise TrafficError(
                f"a step of {step_s:g} s does not divide the duration, {duration_s:g} s; take"
                f" {duration_s / math.ceil(duration_s / step_s):g} s"
            )
    if number > MOST_STEPS:
        raise TrafficError(f"{number} steps are more than {MOST_STEPS}; take longer cells or steps")
    length_s = duration_s / number
    courant = fastest_mps * length_s / cell_m
    if courant > 1.0 + 1e-9:
        raise TrafficError(
            f"the step is too long: in {length_s:g} s the fastest wave, {fastest_mps:.4g} m/s, crosses"
            f" {courant:.3g} cells of {cell_m:g} m (the Courant number), and 1 is the most; take a step of at"
            f" most {most_s:.4g} s or cells of at least {fastest_mps * length_s:.4g} m"
        )
    return number, length_s


def _default_steps(duration_s: float, most_s: float) -> int:
    """Count steps of at most a second, a whole part of one where the duration is whole seconds."""
    if abs(duration_s - round(duration_s)) < 1e-9:
        return round(duration_s) * math.ceil(1.0 / most_s * (1.0 - 1e-12))
    return math.ceil(duration_s / min(most_s, 1.0) * (1.0 - 1e-12))


def initial_density(road: Road, given: ArrayLike, full_per_m: float) -> Array:
    """Check the density to start from, and give it for every cell.

    Raises
    ------
    TrafficError
        When the shape does not fit, or a density is negative or beyond the jam.
    """
    density = np.asarray(given, dtype=np.float64)
    if density.shape not in ((), (road.cells,)):
        raise TrafficError(
            f"give one initial density, or one for each of the {road.cells} cells, got shape {density.shape}"
        )
    start = np.array(np.broadcast_to(density, (road.cells,)))
    if not np.all((start >= 0.0) & (start <= full_per_m)):
        raise TrafficError(
            f"an initial density must lie within 0 and the jam density, {1000.0 * full_per_m:g} veh/km, got"
            f" {1000.0 * start.min():g} to {1000.0 * start.max():g} veh/km"
        )
    return start


def lay_out(diagrams: Sequence[Diagram]) -> Members:
    """Lay diagrams of one kind out for the kernels.

    Raises
    ------
    TrafficError
        When there is none, or kinds differ.
    """
    if not diagrams:
        raise TrafficError("there is no member to run; give one diagram or more")
    kinds = {diagram.kind for diagram in diagrams}
    if len(kinds) > 1:
        raise TrafficError(f"members must be of one kind, got {' and '.join(sorted(kinds))}; run each alone")
    rows = [(*each.constants, each.critical_per_m, each.capacity_per_s) for each in diagrams]
    return Members(diagrams[0].code, np.ascontiguousarray(np.array(rows).T))


def gates(road: Road, step_s: float, steps: int) -> Gates:
    """Lay the road's bottlenecks out for the kernels; each acts in the steps whose middle it covers."""
    rows = road.bottlenecks
    first = [np.clip(math.ceil(row.start_s / step_s - 0.5), 0, steps) for row in rows]
    end = [steps if row.end_s == math.inf else math.ceil(row.end_s / step_s - 0.5) for row in rows]
    return Gates(
        np.array([road.face_at(row.position_m) for row in rows], dtype=np.int64),
        np.array([row.capacity_per_s for row in rows], dtype=np.float64),
        np.array(first, dtype=np.int64),
        np.array(end, dtype=np.int64),
    )


def steps_at(time_s: ArrayLike | None, steps: int, step_s: float) -> tuple[Whole, Whole]:
    """Find the steps of times: the distinct ones in order, and which of them each time is.

    Raises
    ------
    TrafficError
        When a time is not a step of the run.
    """
    if time_s is None:
        return np.arange(steps + 1), np.arange(steps + 1)
    given = np.atleast_1d(np.asarray(time_s, dtype=np.float64))
    found = np.rint(given / step_s)
    wrong = (np.abs(found * step_s - given) > 1e-6 * step_s) | (found < 0) | (found > steps)
    if given.ndim != 1 or given.size == 0 or wrong.any():
        raise TrafficError(
            f"times to keep must be multiples of the step, {step_s:g} s, from 0 to {steps * step_s:g} s, got"
            f" {given[wrong][:3] if given.ndim == 1 else given.shape}"
        )
    distinct, order = np.unique(found.astype(np.int64), return_inverse=True)
    return order, distinct


def cells_at(road: Road, position_m: ArrayLike | None, cells: ArrayLike | None) -> Whole:
    """Find the cells to keep.

    Raises
    ------
    TrafficError
        When positions and cells are both given, or one is outside the road.
    """
    if position_m is not None and cells is not None:
        raise TrafficError("give positions or cells to keep, not both")
    if position_m is not None:
        given = np.atleast_1d(np.asarray(position_m, dtype=np.float64))
        return np.array([road.cell_at(float(position)) for position in given], dtype=np.int64)
    if cells is None:
        return np.arange(road.cells)
    found = np.atleast_1d(np.asarray(cells, dtype=np.int64))
    if found.size == 0 or found.min() < 0 or found.max() >= road.cells:
        raise TrafficError(f"cells to keep must be numbers from 0 to {road.cells - 1}, got {found.tolist()}")
    return found


def warn_of_demand(field: TrafficField, capacity_per_s: float) -> None:
    """Warn when more wants to enter than finds room."""
    peak = float(field.demand_per_s.max())
    if peak <= capacity_per_s * (1.0 + 1e-12):
        if field.refused_veh > LEAST_TOLD_VEH:
            warnings.warn(
                f"the queue reaches the entrance: {field.refused_veh:.4g} vehicles found no room and did not"
                " enter; let the road begin further upstream to hold them",
                TrafficWarning,
                stacklevel=3,
            )
        return
    said = (
        f"{field.refused_veh:.4g} vehicles found no room and did not enter"
        if field.scheme != "report"
        else "the report's scheme lets all of it enter and piles it up in the first cell; take 'godunov'"
    )
    warnings.warn(
        f"the demand reaches {3600.0 * peak:.4g} veh/h, but the road's capacity is"
        f" {3600.0 * capacity_per_s:.4g} veh/h: {said}",
        TrafficWarning,
        stacklevel=3,
    )

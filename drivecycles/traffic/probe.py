r"""A probe vehicle: from a speed field to a drive cycle.

The vehicle takes the traffic's speed :math:`v_f(x, t)` for its own as far as a car can. It sees the traffic
ahead and brakes in time: the speed it wants is the highest from which a comfortable deceleration :math:`b`
still meets every speed ahead,

.. math:: v^* = \min_{0 \le s \le s_b} \sqrt{v_f(x + s, t)^2 + 2\,b\,\max(s - s_0, 0)},
          \qquad s_0 = v\,b / J,

with :math:`s_0` for the time in which the deceleration builds up at the jerk :math:`J`, and
:math:`s_b = v^2 / 2b + s_0`. With :math:`e = v^* - v` it asks for the acceleration

.. math:: a^* = \operatorname{clip}\Bigl(\operatorname{sgn}(e)\,\min\bigl(|e|/\tau, \sqrt{2 J |e|}\bigr),\;
          -b_{max},\; \min(a_{max}, P/v)\Bigr),

which its own follows with a jerk of at most J. No deceleration exceeds :math:`\sqrt{2 J v}`, from which full
jerk just reaches rest, so the vehicle stops smoothly and never moves backwards. The field is linear between
its cells and time steps; the integration takes 0.05 s.

At a face that a bottleneck of no capacity closes the vehicle waits, one metre before it: while the face is
closed, :math:`v^*` is also at most the speed from which the stop is met, as at the end of the road, it brakes
with what the rest of the way takes where that is more than :math:`b`, and the field is not interpolated
across the face, whose sides have nothing to do with each other. A face that closes when the vehicle can no
longer stop is passed; whether it can is tried by driving up to it. A bottleneck that lets something through
sets no rule of its own: its queue does, once it has formed.

LWR has no vehicle that accelerates: its speeds jump at a shock and the first car of a queue leaves it at free
speed. The limits are what makes a cycle out of it that a powertrain can be asked to follow.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from drivecycles.cycle import DriveCycle
from drivecycles.errors import CycleError

if TYPE_CHECKING:
    from drivecycles.traffic._probe import Closures
    from drivecycles.traffic.field import TrafficField

SUBSTEP_S = 0.05
MOST_SAMPLES = 200_000


class Probe(BaseModel):
    """What the vehicle and its driver do at most."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    acceleration_mps2: float = Field(default=1.5, gt=0.0, le=10.0, description="greatest acceleration, m/s²")
    deceleration_mps2: float = Field(default=3.0, gt=0.0, le=10.0, description="greatest deceleration, m/s²")
    comfort_mps2: float = Field(
        default=1.5, gt=0.0, le=10.0, description="deceleration that is planned with, m/s²"
    )
    jerk_mps3: float = Field(default=1.0, ge=0.1, le=20.0, description="greatest jerk, m/s³")
    specific_power_Wpkg: float = Field(
        default=12.0, gt=0.0, le=100.0, description="greatest product of speed and acceleration, W/kg"
    )
    reaction_s: float = Field(default=2.0, ge=0.5, le=20.0, description="time constant to the speed ahead, s")
    depart_s: float = Field(default=0.0, ge=0.0, description="departure, in the traffic's time, s")
    from_rest: bool = Field(default=True, description="start at rest; else at the traffic's speed")
    to_rest: bool = Field(default=True, description="stop at the end of the road")
    sample_s: float = Field(default=1.0, ge=0.1, le=10.0, description="time step of the cycle, s")


def drive_through(field: TrafficField, probe: Probe | None = None, name: str = "probe") -> DriveCycle:
    """Drive the whole road once.

    Parameters
    ----------
    field : TrafficField
        Speed over time and road; its times and cells are uniform.
    probe : Probe, optional
        Limits and departure.
    name : str
        Of the cycle.

    Returns
    -------
    DriveCycle
        From 0 to the end of the road on the level, time from 0, a sample every ``probe.sample_s``.

    Raises
    ------
    CycleError
        When the simulated time ends before the vehicle arrives, or it stands still for good.
    """
    from drivecycles.traffic import _kernels as _kernels
    from drivecycles.traffic._probe import ARRIVED, BEYOND, Limits, drive

    probe = probe or Probe()
    cell_m = float(field.position_m[1] - field.position_m[0])
    length_m = float(field.position_m[-1]) + 0.5 * cell_m
    time_s = field.time_s
    substeps = max(round(probe.sample_s / SUBSTEP_S), 1)
    left_s = float(time_s[-1] - time_s[0]) - probe.depart_s
    rows = min(int(left_s / probe.sample_s) + 3, MOST_SAMPLES)
    if rows < 4:
        raise CycleError(
            f"the vehicle departs at {probe.depart_s:g} s, but traffic is simulated for"
            f" {float(time_s[-1] - time_s[0]):g} s; depart earlier or simulate longer"
        )
    track = np.zeros((rows, 2))
    start = 0.0 if probe.from_rest else _entry_speed(field, probe.depart_s)
    count, outcome = drive(
        np.ascontiguousarray(field.speed_mps, dtype=np.float64),
        float(time_s[1] - time_s[0]),
        float(field.position_m[0]),
        cell_m,
        length_m,
        probe.depart_s,
        start,
        probe.to_rest,
        Limits(
            probe.acceleration_mps2,
            probe.deceleration_mps2,
            min(probe.comfort_mps2, probe.deceleration_mps2),
            probe.jerk_mps3,
            probe.specific_power_Wpkg,
            probe.reaction_s,
        ),
        _closures(field, probe.to_rest),
        probe.sample_s / substeps,
        substeps,
        track,
    )
    if outcome != ARRIVED:
        ended = (
            "traffic is simulated no further" if outcome == BEYOND else "there is room for no more samples"
        )
        raise CycleError(
            f"the probe vehicle is at {track[count - 1, 0]:.0f} m of {length_m:.0f} m when {ended};"
            " simulate longer (duration_s), let it depart earlier, or ease the traffic"
        )
    return DriveCycle(name, probe.sample_s * np.arange(count), track[:count, 1])


def _closures(field: TrafficField, to_rest: bool) -> Closures:
    """Find the faces that the road's bottlenecks close, on the field's clock."""
    from drivecycles.traffic._probe import Closures

    road = field.road
    # The vehicle starts behind the entrance, and at the end it stops anyway if it comes to rest there.
    faces = range(1, road.cells if to_rest else road.cells + 1)
    rows = [
        (road.face_at(one.position_m), one.start_s - field.time_s[0], one.end_s - field.time_s[0])
        for one in road.bottlenecks
        if one.capacity_per_s == 0.0
    ]
    rows = [row for row in rows if row[0] in faces]
    cell = np.array([row[0] for row in rows], dtype=np.int64)
    start, end = (np.array([row[at] for row in rows], dtype=np.float64) for at in (1, 2))
    place_m = np.asarray(road.cell_m * cell, dtype=np.float64)
    return Closures(cell, place_m, start, end)


def _entry_speed(field: TrafficField, depart_s: float) -> float:
    return float(np.interp(depart_s, field.time_s - field.time_s[0], field.speed_mps[:, 0]))

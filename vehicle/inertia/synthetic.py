r"""A synthetic log: the Defender on a rough road, driven in town or in the country.

Body with heave z, pitch :math:`\theta` (nose down) and roll :math:`\phi` (right side down) on four struts
over four wheels on tyres, small angles. With dynamic strut forces SF, M the moments of [M] eqs 32-33 without
A, and specific forces :math:`A_x, A_y` in the axes of the body at the centre of gravity,

.. math:: m \ddot z = \sum SF, \qquad J_\phi \ddot\phi = M_\phi + m h_r A_y, \qquad
          J_\theta \ddot\theta = M_\theta - h_p m A_x - (h_p + h_d) C V^2,
.. math:: A_y = a_y + g \phi - h_r \ddot\phi, \qquad A_x = a_x - g \theta + h_p \ddot\theta,

:math:`a_x, a_y` those in the axes of the road at roll and pitch centre, and drag acting :math:`h_d` above the
centre of gravity. So tilt, and the sway of the centre of gravity about them, are in the log as an
accelerometer on the body feels them. Wheels are sprung one by one, which a rigid axle is not; the tyres do
not feel the part of a bend's load that passes through the axle; wind blows from nowhere. Nothing of the
load-transfer models goes in: what they leave out is in the log.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vehicle.errors import VehicleError
from vehicle.inertia import _body
from vehicle.inertia import _kernels as _kernels
from vehicle.inertia.defender import DEFENDER, GRAVITY_MPS2, SprungVehicle
from vehicle.inertia.log import Log
from vehicle.inertia.manoeuvre import STYLES, drive
from vehicle.inertia.road import make_road
from vehicle.inertia.sensors import SensorErrors, sense

Array = NDArray[np.float64]

DURATION_S = 300.0
SAMPLE_S = 0.01
STEPS = 5
"""Steps of the simulation per sample: 2 ms, where a wheel hops in 100 ms."""
WILDEST = 1e3
"""Acceleration beyond which a simulation is none, m/s^2 or rad/s^2."""
CONTACT_M = 0.2
"""A tyre averages the road over its contact."""


def synthetic(
    scenario: str,
    *,
    vehicle: SprungVehicle = DEFENDER,
    seed: int = 0,
    sensors: SensorErrors | None = None,
    duration_s: float = DURATION_S,
    road: str | None = None,
) -> tuple[Log, dict[str, float]]:
    """Drive a vehicle with a known truth.

    Parameters
    ----------
    scenario : {"urban", "rural"}
    vehicle : SprungVehicle
    seed : int
        Of drive, road and sensors; the same seed with other sensors is the same drive.
    sensors : SensorErrors, optional
        Default: noise of variance 0.1 on the outputs of the ride model, nothing else.
    duration_s : float
    road : {"A", "B", "C", "D", "E"}, optional
        Class of ISO 8608; default: the scenario's.

    Returns
    -------
    tuple of Log and dict
        The log, sampled at 100 Hz, and the true value of every quantity that a model estimates.

    Raises
    ------
    VehicleError
        When a name is unknown, or the vehicle does not stay on its wheels.
    """
    streams = np.random.SeedSequence(seed).spawn(3)
    choose, shake, disturb = (np.random.default_rng(stream) for stream in streams)
    motion = drive(scenario, duration_s, SAMPLE_S / STEPS, choose)
    length = float(motion.distance_m[-1]) + 10.0
    surface = make_road(road or STYLES[scenario].road, length, vehicle.track_m, shake)
    touched = surface.smooth(CONTACT_M).under(motion.distance_m, vehicle.wheelbase_m)
    samples = (motion.time_s.size - 1) // STEPS + 1
    forces, moved = np.empty((samples, 4)), np.empty((samples, 5))
    body, strut = vehicle_arrays(vehicle)
    _body.ride_over(
        touched,
        motion.ax_mps2,
        motion.ay_mps2,
        vehicle.drag_kgpm * motion.speed_mps**2,
        SAMPLE_S / STEPS,
        STEPS,
        body,
        vehicle.static_N,
        strut,
        forces,
        moved,
    )
    if not np.all(np.abs(moved) < WILDEST):
        raise VehicleError(
            "the simulated vehicle left its road: steps of 2 ms are too long for so stiff tyres, hard"
            " dampers or light wheels"
        )
    linear, angular = accelerations(vehicle, moved)
    forces, linear, angular, gain = sense(sensors or SensorErrors(), forces, linear, angular, disturb)
    log = Log(
        time_s=motion.time_s[::STEPS],
        forces_N=forces,
        ax_mps2=linear[:, 0],
        ay_mps2=linear[:, 1],
        az_mps2=linear[:, 2],
        corner_az_mps2=linear[:, 3:],
        heave_mps2=linear[:, 2] - GRAVITY_MPS2,
        pitch_radps2=angular[:, 0],
        roll_radps2=angular[:, 1],
        speed_mps=motion.speed_mps[::STEPS],
        static_N=vehicle.static_N * gain,
    )
    return log, vehicle.truth


def accelerations(vehicle: SprungVehicle, moved: Array) -> tuple[Array, Array]:
    """Turn motion (heave, pitch, roll, A_x, A_y), shape (n, 5), into what sensors would feel.

    Returns
    -------
    tuple of ndarray, shapes (n, 7) and (n, 2)
        A_x, A_y, A_z at the centre of gravity and the vertical ones at the struts; pitch and roll.
    """
    a, b, left, right = vehicle.geometry.lengths_m
    vertical = moved[:, 0] + GRAVITY_MPS2
    corners = [vertical + x * moved[:, 1] + y * moved[:, 2] for x in (-a, b) for y in (left, -right)]
    return np.column_stack([moved[:, 3], moved[:, 4], vertical, *corners]), moved[:, 1:3]


def vehicle_arrays(vehicle: SprungVehicle) -> tuple[Array, Array]:
    """Lay a vehicle's body and struts out for the kernel, shapes (10,) and (6,)."""
    v = vehicle
    inertia = (v.mass_kg, v.pitch_inertia_kgm2, v.roll_inertia_kgm2)
    over_pitch = v.cg_over_pitch_centre_m
    heights = (v.cg_over_roll_centre_m, over_pitch, over_pitch + v.drag_over_cg_m)
    body = np.array([*inertia, *v.geometry.lengths_m, *heights])
    damping = (v.bump_Nspm, v.rebound_Nspm)
    return body, np.array([v.spring_Npm, v.gas_exponent, *damping, v.unsprung_kg, v.tyre_Npm])

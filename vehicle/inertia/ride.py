r"""Mass, inertias and height of the centre of gravity from the body's ride, [M] eqs 29-33.

With dynamic strut forces SF (what a strut carries beyond its static load), heave z, pitch :math:`\theta`
(nose down) and roll :math:`\phi` (right side down):

.. math:: \ddot z = \tfrac{1}{m} \sum SF_i, \qquad
          \ddot\theta = \tfrac{1}{J_\theta} [-a (SF_{fl} + SF_{fr}) + b (SF_{rl} + SF_{rr}) + m h A_x], \qquad
          \ddot\phi = \tfrac{1}{J_\phi} [l (SF_{fl} + SF_{rl}) - r (SF_{fr} + SF_{rr}) + m h A_y].

Here :math:`A_x > 0` brakes and :math:`A_y > 0` is a left-hand bend. The position a, b, l, r of the centre of
gravity is taken as known, and so is the pitching moment of drag, which [M] leaves out, where the geometry
gives it: ignored, it lifts the Defender's pitch inertia by 4 % on a country road, and by 0.5 % if means are
taken off. That is done where no static forces are known: the mean of every column, for the model is linear in
them.

Noise on A_x and A_y is noise on what the model takes as known, and biases every method. Of variance 0.1 it
lifts the roll inertia by 33 % and the pitch inertia by 6 % and lowers the height by 11 %, in all filters and
in least squares in the form of accelerations; the mass does not depend on it (50 drives on a country road).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vehicle.inertia.blocks import average, told_of
from vehicle.inertia.defender import Geometry
from vehicle.inertia.log import NEEDS, Log
from vehicle.inertia.regression import Regression

Array = NDArray[np.float64]

KIND = 0
NAMES = ("mass_kg", "pitch_inertia_kgm2", "roll_inertia_kgm2", "cg_height_m")
PRIOR = {
    "mass_kg": (1500.0, 900.0),
    "pitch_inertia_kgm2": (2500.0, 1800.0),
    "roll_inertia_kgm2": (1000.0, 700.0),
    "cg_height_m": (0.7, 0.5),
}
"""Centre and half-range of what is believed of a vehicle of this size before it moves."""
NOISE_GUESS = 0.1**0.5


def prepare(log: Log, geometry: Geometry, average_s: float = 0.0) -> Regression:
    """Turn a log into the regression's inputs (total force, pitch and roll moment, A_x, A_y) and outputs.

    Raises
    ------
    VehicleError
        When a column is missing, or too little is left.
    """
    forces, ax, ay, heave, pitch, roll = (log.column(name, "ride") for name in NEEDS["ride"])
    if log.static_N is not None:
        forces = forces - log.static_N
    a, b, left, right = geometry.lengths_m
    nose = b * (forces[:, 2] + forces[:, 3]) - a * (forces[:, 0] + forces[:, 1])
    if geometry.drag_moment_kg > 0.0 and log.speed_mps is not None:
        nose = nose - geometry.drag_moment_kg * log.speed_mps**2
    side = left * (forces[:, 0] + forces[:, 2]) - right * (forces[:, 1] + forces[:, 3])
    table = np.column_stack([forces.sum(axis=1), nose, side, -ax, ay, heave, pitch, roll])
    if log.static_N is None:
        table = table - np.nanmean(table[np.isfinite(table).all(axis=1)], axis=0)
    blocks = average(log.time_s, table, average_s)
    lengths = np.array([geometry.wheelbase_m, geometry.track_m])
    inputs, outputs = blocks.means[:, :5], blocks.means[:, 5:]
    return Regression(KIND, "ride", blocks.time_s, inputs, outputs, lengths, notes=told_of(blocks, average_s))


def as_rows(regression: Regression, form: str) -> tuple[Array, Array]:
    """Write the model as rows that are linear in coefficients, for recursive least squares.

    In the form ``force`` the forces and moments are the targets, and (m, J_theta, J_phi, m h) the
    coefficients; in the form ``acceleration`` the accelerations are, and (1/m, 1/J_theta, m h/J_theta,
    1/J_phi, m h/J_phi).

    Returns
    -------
    tuple of ndarray, shapes (n, 3, p) and (n, 3)
    """
    total, nose, side, braking, ay = regression.inputs.T
    heave, pitch, roll = regression.outputs.T
    n = total.size
    if form == "force":
        rows = np.zeros((n, 3, 4))
        rows[:, 0, 0], rows[:, 1, 1], rows[:, 2, 2] = heave, pitch, roll
        rows[:, 1, 3], rows[:, 2, 3] = -braking, -ay
        return rows, regression.inputs[:, :3]
    rows = np.zeros((n, 3, 5))
    rows[:, 0, 0], rows[:, 1, 1], rows[:, 1, 2], rows[:, 2, 3], rows[:, 2, 4] = total, nose, braking, side, ay
    return rows, regression.outputs


def coefficients_of(centre: Array, form: str) -> Array:
    """Turn parameters, in the order of `NAMES`, into the coefficients of `as_rows`."""
    m, pitch, roll, height = centre
    if form == "force":
        return np.array([m, pitch, roll, m * height])
    return np.array([1.0 / m, 1.0 / pitch, m * height / pitch, 1.0 / roll, m * height / roll])


def from_coefficients(coefficients: Array, form: str) -> Array:
    """Turn coefficients of `as_rows`, shape (n, p), into `NAMES`, shape (n, 4).

    In the form ``acceleration`` there are two heights, one from pitch, one from roll; their mean is given,
    weighted with the squares of the coefficients they come from: bends and brakes shake alike.
    """
    c = coefficients.T
    if form == "force":
        return np.column_stack([c[0], c[1], c[2], c[3] / c[0]])
    from_pitch, from_roll = c[0] * c[2] / c[1], c[0] * c[4] / c[3]
    height = (c[1] ** 2 * from_pitch + c[3] ** 2 * from_roll) / (c[1] ** 2 + c[3] ** 2)
    return np.column_stack([1.0 / c[0], 1.0 / c[1], 1.0 / c[3], height])

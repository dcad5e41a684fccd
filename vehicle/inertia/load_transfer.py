r"""Mass and centre of gravity from the load on the four struts, [M] eqs 34-53.

The load-transfer model (LTM, eqs 35-38) with one accelerometer at the centre of gravity, A_x and A_y in g,
:math:`A_z` with gravity in m/s^2:

.. math:: F_{fl} = \tfrac{m A_z}{B L} [b r - A_y b h_r - A_x r h_p] - \tfrac{r h_p V^2 C}{B L},

and so on for the other corners, estimates m, a, l, h_r, h_p and C. The modified one (MLTM, eqs 48-51) has an
accelerometer at each strut and a mass at each corner,

.. math:: F_{fl} = m_{fl} A_{z,fl} - \tfrac{(m_{fl} + m_{fr}) \ddot Z}{B} A_y h_r
          - \tfrac{(m_{fl} + m_{rl}) \ddot Z}{L} A_x h_p
          - \tfrac{h_p V^2 C}{L} \tfrac{m_{fl} + m_{rl}}{m}, \qquad
          \ddot Z = \tfrac14 \sum A_z + \tfrac{a - b}{2} \ddot\theta + \tfrac{r - l}{2} \ddot\phi,

where pitch is nose down and both angular accelerations come from the corners; then :math:`a = L (m_{rl} +
m_{rr}) / m` and :math:`l = B (m_{fr} + m_{rr}) / m` (eqs 46-47 with the lengths that they lack). :math:`A_y >
0` loads the right, :math:`A_x > 0` the rear. The bounce force (eqs 44, 52) is the sum of the four and tells
nothing new: it is not a fifth output.

Both are models of slow motion: they know no inertia in pitch and roll. Forces and accelerations are therefore
averaged over blocks of a second, in which a body that sways at 1.3 Hz hardly gets ahead; taken sample by
sample, a rough road biases the corner masses (a corner moves more than the mass it carries would).

How a bend's load is shared between front and rear is b : a in the models, and in a vehicle a matter of its
springs. That shows in the warp of the four forces (fl - fr - rl + rr) only, which tells nothing of the
balance of forces and moments; it is given noise of its own, lest the shares pull the centre of gravity
towards where they would be right.

C is not identifiable. What the struts feel is C times the height at which drag acts over the pitch centre,
together with every other moment of the air; the model calls this height h_p. The filters estimate the product
h_p C, in which the model is linear (with C itself their first steps, on heights not yet known, leave a
lasting error in a and C), and divide in the end. The standard deviation of C holds that the height at which
drag acts is known to within 0.3 m.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vehicle.inertia.blocks import Blocks, average, told_of
from vehicle.inertia.defender import Geometry
from vehicle.inertia.log import NEEDS, Log
from vehicle.inertia.regression import DRAG_HEIGHT_SD_M, Regression

Array = NDArray[np.float64]

KIND = {"ltm": 1, "mltm": 2}
NAMES = (
    "mass_kg",
    "cg_from_front_m",
    "cg_from_left_m",
    "cg_over_roll_centre_m",
    "cg_over_pitch_centre_m",
    "drag_kgpm",
)
OWN_NAMES = (*NAMES[:5], "drag_moment_kg")
CORNER_NAMES = ("mass_fl_kg", "mass_fr_kg", "mass_rl_kg", "mass_rr_kg", *OWN_NAMES[3:])
"""What the filters estimate: the product h_p C in place of C."""
PRIOR = {
    "ltm": {
        "mass_kg": (1500.0, 900.0),
        "cg_from_front_m": (1.4, 0.7),
        "cg_from_left_m": (0.9, 0.45),
        "cg_over_roll_centre_m": (0.7, 0.5),
        "cg_over_pitch_centre_m": (0.7, 0.5),
        "drag_moment_kg": (1.0, 1.0),
    },
    "mltm": {
        **dict.fromkeys(CORNER_NAMES[:4], (400.0, 250.0)),
        "cg_over_roll_centre_m": (0.7, 0.5),
        "cg_over_pitch_centre_m": (0.7, 0.5),
        "drag_moment_kg": (1.0, 1.0),
    },
}
"""Centre and half-range of what is believed of a vehicle of this size before it moves."""
NOISE_GUESS = 40.0
WARP = np.array([0.5, -0.5, -0.5, 0.5])
WARP_SD_N = 500.0
"""Noise that is allowed in the warp of the forces, along `WARP`."""
AVERAGE_S = 1.0
HEIGHT_DOUBT = 0.02
"""Relative error of h_r and h_p that comes from what the models leave out, seen on synthetic drives."""
FEW_SAMPLES = 20
"""Samples in a block below which heights are warned of, and `WARNED` the error from which on they are."""
WARNED = 0.05
LEAST_SIGNAL = 0.1
LEAST_HEIGHT_M = 0.1
"""Bounds of what a shrunk height may have been: of the share that is not noise, and of the height itself."""
DRAG_NOTE = (
    "drag_kgpm is not identifiable: a log tells only C times the height at which drag acts, with every other"
    " moment of the air; take its standard deviation, not its value"
)


def prepare(log: Log, geometry: Geometry, model: str, average_s: float = AVERAGE_S) -> Regression:
    """Turn a log into the inputs of the kernel and the four forces.

    Raises
    ------
    VehicleError
        When a column is missing, or too little is left.
    """
    forces, ax, ay, vertical, speed = (log.column(name, model) for name in NEEDS[model])
    table = np.column_stack([forces, ax, ay, vertical, speed**2])
    blocks = average(log.time_s, table, average_s)
    table = blocks.means
    inputs = table[:, 4:]
    if model == "mltm":
        fl, fr, rl, rr = table[:, 6:10].T
        pitch = (rl + rr - fl - fr) / (2.0 * geometry.wheelbase_m)
        roll = (fl + rl - fr - rr) / (2.0 * geometry.track_m)
        inputs = np.column_stack([inputs, pitch, roll])
    lengths = np.array([geometry.wheelbase_m, geometry.track_m])
    share = blocks.noise_share[[5, 4]]
    notes = (*told_of(blocks, average_s), *_shrunk(blocks, share, average_s))
    return Regression(KIND[model], model, blocks.time_s, inputs, table[:, :4], lengths, share, notes)


def from_own(parameters: Array) -> Array:
    """Turn `OWN_NAMES`, shape (n, 6), into `NAMES`: C is the moment of drag over the height h_p."""
    height = parameters[:, 4]
    drag = parameters[:, 5] / np.where(height == 0.0, np.nan, height)
    return np.column_stack([parameters[:, :5], drag])


def from_corners(parameters: Array, lengths_m: Array) -> Array:
    """Turn `CORNER_NAMES`, shape (n, 7), into `NAMES`, shape (n, 6), by [M] eqs 46-47."""
    fl, fr, rl, rr = parameters.T[:4]
    mass = fl + fr + rl + rr
    a, left = lengths_m[0] * (rl + rr) / mass, lengths_m[1] * (fr + rr) / mass
    return from_own(np.column_stack([mass, a, left, parameters[:, 4:]]))


def add_doubt(values: Array, covariance: Array, noise_share: Array | None = None) -> Array:
    r"""Add what no residual shows to the covariance of `NAMES`, shape (n, 6, 6).

    That is the models' own error in the heights, `HEIGHT_DOUBT`; that the height at which drag acts is not
    known; and that chance in A_y and A_x, a share :math:`\lambda` of their variances, shrinks h_r and h_p by
    the factor :math:`1 - \lambda`: an error of :math:`\lambda / (1 - \lambda)` times what is found.
    """
    doubted = covariance.copy()
    shrunk = _shrinkage(np.zeros(2) if noise_share is None else noise_share)
    for at, share in zip((3, 4), shrunk, strict=True):
        height = np.abs(values[:, at])
        doubted[:, at, at] += (HEIGHT_DOUBT * height) ** 2
        doubted[:, at, at] += (share * np.maximum(height, LEAST_HEIGHT_M)) ** 2
    relative = DRAG_HEIGHT_SD_M / np.maximum(np.abs(values[:, 4]), 0.1)
    doubted[:, 5, 5] += (values[:, 5] * relative) ** 2
    return doubted


def _shrinkage(noise_share: Array) -> Array:
    shrunk: Array = noise_share / np.maximum(1.0 - noise_share, LEAST_SIGNAL)
    return shrunk


def _shrunk(blocks: Blocks, noise_share: Array, average_s: float) -> tuple[str, ...]:
    """Say how far off the heights are, where noise in A_y and A_x makes them so."""
    side, nose = 100.0 * noise_share
    if average_s == 0.0 or not (blocks.samples < FEW_SAMPLES or max(noise_share) > WARNED):
        return ()
    return (
        f"samples per block of {average_s:g} s: {blocks.samples:.0f}; noise and sway that are left in ay and"
        f" ax are an error of some {side:.1f} % in cg_over_roll_centre_m and {nose:.1f} % in"
        " cg_over_pitch_centre_m; their standard deviations hold that, those of rls do not"
        " hold what it makes of the mass; log at 100 Hz, or filter before you thin a log out",
    )


def as_rows(regression: Regression, form: str) -> tuple[Array, Array]:
    """Write the model as rows that are linear in 16 coefficients, for recursive least squares.

    A corner's force is ``w A_z + s Z A_y + n Z A_x + d V^2`` with A_x and A_y in g and coefficients of its
    own. In the form ``force`` forces are the targets; in the form ``acceleration`` it is divided by w, and
    the corner's A_z is the target.

    Returns
    -------
    tuple of ndarray, shapes (n, 4, 16) and (n, 4)
    """
    u = regression.inputs
    per_gravity = 1.0 / 9.81
    corners = regression.kind == KIND["mltm"]
    vertical = u[:, 2:6] if corners else np.repeat(u[:, 2:3], 4, axis=1)
    middle, square = vertical.mean(axis=1), u[:, 6] if corners else u[:, 3]
    rows = np.zeros((u.shape[0], 4, 16))
    first, target = vertical, regression.outputs
    if form == "acceleration":
        first, target = target, first
    for i in range(4):
        rows[:, i, 4 * i] = first[:, i]
        rows[:, i, 4 * i + 1] = middle * u[:, 1] * per_gravity
        rows[:, i, 4 * i + 2] = middle * u[:, 0] * per_gravity
        rows[:, i, 4 * i + 3] = square
    return rows, target


def coefficients_of(centre: Array, form: str) -> Array:
    """Give coefficients of `as_rows` to start from: the masses of the prior, and no transfer of load."""
    masses = centre[:4] if centre.size == len(CORNER_NAMES) else np.full(4, 0.25 * centre[0])
    start = np.zeros((4, 4))
    start[:, 0] = masses if form == "force" else 1.0 / masses
    return start.ravel()


def from_coefficients(coefficients: Array, form: str, lengths_m: Array) -> Array:
    """Turn coefficients of `as_rows`, shape (n, 16), into `NAMES`, shape (n, 6)."""
    w, side, nose, drag = coefficients.reshape(-1, 4, 4).transpose(2, 0, 1)
    if form == "acceleration":
        side, nose, drag, w = -side / w, -nose / w, -drag / w, 1.0 / w
    wheelbase, track = lengths_m
    mass = w.sum(axis=1)
    to_right, to_rear = np.array([-1.0, 1.0, -1.0, 1.0]), np.array([-1.0, -1.0, 1.0, 1.0])
    over_pitch = 0.5 * wheelbase * (nose @ to_rear) / mass
    # As long as nothing braked there is no height, and no drag that goes with it.
    lever = np.where(over_pitch == 0.0, np.nan, over_pitch)
    return np.column_stack(
        [
            mass,
            wheelbase * (w[:, 2] + w[:, 3]) / mass,
            track * (w[:, 1] + w[:, 3]) / mass,
            0.5 * track * (side @ to_right) / mass,
            over_pitch,
            0.5 * wheelbase * (drag @ to_rear) / lever,
        ]
    )

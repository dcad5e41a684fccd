r"""[M] Table 8: whether the gains of the gradient are stable, and how fast they are.

At the true parameters the gradient of the cost (eq 79) is :math:`H(\theta - \theta^*)` with

.. math:: H(t) = \sum_\tau \lambda^{t - \tau} s_\tau s_\tau^T, \qquad
    s = \frac{\partial V}{\partial (\alpha, R, \beta, \xi, x_{10})}
    = \Bigl(C_0 (x_{10} + x_1),\; I,\; x_2,\; \beta \sigma_1 \frac{\partial x_2}{\partial \sigma},\;
    \alpha C_0\Bigr),

so a step :math:`\theta' = \theta - \Gamma H (\theta - \theta^*)` is stable while the eigenvalues of
:math:`\Gamma H` stay below 2, and the inverse of an eigenvalue is the number of steps in which its mode falls
e-fold. The sensitivities are exact: no expansion in xi is needed at a known xi.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from bms.cell import Cell
from bms.cycling import CyclingProfile
from bms.estimators.gpc_gradient import Gains
from socwise.reproduce.battery_case import FORGETTING, SIGMA_PER_S

Array = NDArray[np.float64]

SYMBOLS = ("α", "R", "β", "ξ", "x10")
BLOCK = 1800


@dataclass(frozen=True, eq=False)
class Modes:
    """Eigenvalues of a gradient step at the ends of half hours.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Time.
    eigenvalue : ndarray, shape (n, 5)
        In falling order.
    leading : ndarray of int, shape (n, 5)
        The parameter of `SYMBOLS` with the largest part in each mode, on the scale on which Gamma is one.
    """

    time_s: Array
    eigenvalue: Array
    leading: NDArray[np.int64]


def modes_over_time(cell: Cell, profile: CyclingProfile, gains: Gains) -> Modes:
    """Follow the eigenvalues of a gradient step along a profile of 1 s.

    Parameters
    ----------
    cell : Cell
        With constant parameters and one relaxation pair.
    profile : CyclingProfile
        Current and SOC.
    gains : Gains
        Diagonal of Gamma.
    """
    root = np.sqrt([gains.alpha, gains.resistance, gains.beta, gains.xi, gains.x10])
    s = sensitivities(cell, profile) * root
    blocks = s.shape[0] // BLOCK
    fading = np.sqrt(FORGETTING ** np.arange(BLOCK - 1, -1, -1, dtype=np.float64))
    total, values = np.zeros((s.shape[1], s.shape[1])), np.empty((blocks, s.shape[1]))
    leading = np.empty((blocks, s.shape[1]), dtype=np.int64)
    for block in range(blocks):
        part = s[block * BLOCK : (block + 1) * BLOCK] * fading[:, None]
        total = FORGETTING**BLOCK * total + part.T @ part
        value, vector = np.linalg.eigh(total)
        values[block] = value[::-1]
        leading[block] = np.abs(vector[:, ::-1]).argmax(axis=0)
    return Modes(BLOCK * np.arange(1.0, blocks + 1.0), values, leading)


def sensitivities(cell: Cell, profile: CyclingProfile) -> Array:
    """Change of the voltage with alpha, R, beta, xi and x10 at every sample, shape (n, 5)."""
    pair = cell.relaxation[0]
    beta = 1.0 / cast(float, pair.capacitance_F)
    sigma = beta / cast(float, pair.resistance_ohm)
    slope_V, current_A = cell.ocv.slope_V(profile.soc), profile.current_A
    keep = np.exp(-sigma)
    feed = (1.0 - keep) / sigma
    # d keep / d sigma = -keep and d feed / d sigma = (keep - feed) / sigma, at steps of one second
    x2 = lfilter([0.0, feed], [1.0, -keep], current_A)
    x2_by_sigma = lfilter([0.0, 1.0], [1.0, -keep], (keep - feed) / sigma * current_A - keep * x2)
    half = 0.5 * (SIGMA_PER_S[1] - SIGMA_PER_S[0])
    columns = (
        slope_V * profile.soc * cell.capacity_C,
        current_A,
        x2,
        beta * half * x2_by_sigma,
        slope_V / cell.capacity_C,
    )
    return np.stack(columns, axis=1)

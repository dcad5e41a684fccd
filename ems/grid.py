r"""How finely the optimisation problem is discretised, and the operators that follow from it.

Three dynamic programs share one kernel (`ems._sdp`); they differ in their rows and smoothing:

* *stochastic*: one row per variance ``p_r``; a control leads to the level
  ``p' = p sw2 / (p + sw2) + h (gamma + beta |i|)``; the cost-to-go is smoothed with the innovation of
  the row;
* *perfect information*: one row; a control leads to the level ``h (gamma + beta |i|)``, and the
  cost-to-go is smoothed with that process noise;
* *certainty equivalent*: one row, no level, no smoothing.

The variance rows are uniform in sqrt(p) from 0 to a little above the largest variance within reach: the fixed
point of [L] eq 9 at the largest current of the pack, or the initial variance if that is more.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from bms import Pack, UncertaintyModel
from bms.uncertainty import innovation_spread, posterior_variance, steady_variance
from ems._blocks import NODES
from ems._lanes import CURRENTS, SHARES
from ems._sdp import Grid
from ems.concept import Concept
from ems.monotone import hat_weights, linear_shares
from ems.smoothing import smoothing_weights

Array = NDArray[np.float64]

NEGLIGIBLE_WEIGHT = 1e-9
HEADROOM = 1.1
LEAST_DAMPED = 5
"""Fewer rows have no fourth difference."""


class GridSettings(BaseModel):
    """Spacings of the grids; the defaults pass the convergence test (docs/method.md)."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    soc_step: float = Field(
        default=0.0025,
        gt=0.0,
        le=0.05,
        description="SOC spacing under noise; finer where little noise asks it",
    )
    deterministic_soc_step: float = Field(
        default=0.00025, gt=0.0, le=0.05, description="SOC spacing of the certainty-equivalent program"
    )
    variance_rows: int = Field(default=16, ge=4, le=400, description="rows of the variance grid")
    process_levels: int = Field(default=6, ge=3, le=100, description="levels of perfect information")
    torque_levels: int = Field(default=31, ge=1, le=400, description="clutched engine torques per step")
    soc_margin: float = Field(
        default=0.15,
        gt=0.0,
        le=1.0,
        description="how far the grid passes the window; more where a descent forces more",
    )

    def halved(self) -> GridSettings:
        """Return the settings with every spacing halved."""
        return self.model_copy(
            update={
                "soc_step": self.soc_step / 2.0,
                "deterministic_soc_step": self.deterministic_soc_step / 2.0,
                "variance_rows": 2 * self.variance_rows - 1,
                "process_levels": 2 * self.process_levels - 1,
                "torque_levels": 2 * self.torque_levels,
            }
        )


def soc_nodes(concept: Concept, settings: GridSettings, step: float) -> Array:
    """Lay the SOC grid: the window and a margin, within [0, 1], nodes on multiples of the step."""
    low = max(0.0, concept.window.low - settings.soc_margin)
    high = min(1.0, concept.window.high + settings.soc_margin)
    first, full = math.floor(low / step + 1e-9), math.floor(1.0 / step + 1e-9)
    last = min(max(math.ceil(high / step - 1e-9), first + 8), full)
    first = min(first, last - 8)
    return np.minimum(np.arange(first, last + 1, dtype=np.float64) * step, 1.0)


def variance_rows(
    concept: Concept,
    pack: Pack,
    uncertainty: UncertaintyModel,
    step_s: float,
    settings: GridSettings,
    *,
    steps: int | None = None,
    least_reach: float = 0.0,
) -> Array:
    """Variances of the rows, uniform in sqrt(p).

    Parameters
    ----------
    concept, pack, uncertainty, step_s, settings
        The problem.
    steps : int, optional
        Steps of the trip: where next to nothing is learnt, p does not come to its level before the end.
    least_reach : float
        The rows reach this variance at least.
    """
    largest_A = max(pack.discharge_limit_A, pack.charge_limit_A)
    drift, start = float(uncertainty.process_variance(largest_A, step_s)), concept.initial_soc_sd**2
    reach = float(steady_variance(uncertainty.mu, drift))
    if steps is not None:
        reach = min(reach, start + steps * drift)
    top = HEADROOM * math.sqrt(max(reach, start, least_reach, 1e-8))
    return np.square(np.linspace(0.0, top, settings.variance_rows))


def measurement_variance(nodes: Array, variances: Array, pack: Pack, uncertainty: UncertaintyModel) -> Array:
    """Expected measurement variance [L] eq 10 at every (row, node), shape (r, n)."""
    mean, variance = np.broadcast_arrays(nodes[None, :], variances[:, None])
    return uncertainty.measurement_variance(mean, variance, pack.ocv.alpha)


def stochastic_grid(
    nodes: Array,
    variances: Array,
    pack: Pack,
    uncertainty: UncertaintyModel,
    step_s: float,
    cubic: bool = True,
    parabolas: bool | None = None,
    damping: float = 0.0,
) -> Grid:
    """Build the grid of the program over (estimate, variance).

    Parameters
    ----------
    nodes, variances : ndarray
        SOC nodes, and variances of the rows.
    pack, uncertainty, step_s
        The problem.
    cubic : bool
        Cubic look-ups in SOC, or the operators of `ems.monotone`.
    parabolas : bool, optional
        Parabolas through the rows, or linear between them; as in SOC unless told.
    damping : float
        Share by which a stage damps what alternates from row to row, see `ems._sdp.damp_rows`.
    """
    measured = measurement_variance(nodes, variances, pack, uncertainty)
    prior = np.broadcast_to(variances[:, None], measured.shape)
    rows = variances.size
    return _grid(
        nodes,
        pack,
        step_s * uncertainty.beta,
        level=variances,
        posterior=posterior_variance(prior, measured) + step_s * uncertainty.gamma,
        source_row=np.tile(np.arange(rows), (rows, 1)),
        operator=np.tile(np.arange(rows)[:, None], (1, rows)),
        spread=innovation_spread(prior, measured),
        cubic=cubic,
        parabolas=parabolas,
        damping=damping,
    )


def perfect_information_grid(
    nodes: Array, levels: int, pack: Pack, uncertainty: UncertaintyModel, step_s: float, cubic: bool = True
) -> Grid:
    """Build the grid of the program over the true SOC, with process noise."""
    largest_A = max(pack.discharge_limit_A, pack.charge_limit_A)
    top = math.sqrt(max(float(uncertainty.process_variance(largest_A, step_s)), 1e-12))
    spread = np.linspace(0.0, top, levels)
    return _grid(
        nodes,
        pack,
        step_s * uncertainty.beta,
        level=np.square(spread),
        posterior=np.full((1, nodes.size), step_s * uncertainty.gamma),
        source_row=np.zeros((1, levels), dtype=np.int64),
        operator=np.arange(levels)[None, :],
        spread=np.tile(spread[:, None], (1, nodes.size)),
        cubic=cubic,
    )


def deterministic_grid(nodes: Array, pack: Pack, cubic: bool = False) -> Grid:
    """Build the grid of the program without noise; see `ems._interpolate` for why it is linear by default."""
    one = np.zeros((1, nodes.size))
    return _grid(
        nodes,
        pack,
        0.0,
        level=np.zeros(1),
        posterior=one,
        source_row=np.zeros((1, 1), dtype=np.int64),
        operator=np.zeros((1, 1), dtype=np.int64),
        spread=one,
        cubic=cubic,
    )


def _grid(
    nodes: Array,
    pack: Pack,
    drift_per_A: float,
    *,
    level: Array,
    posterior: Array,
    source_row: NDArray[np.int64],
    operator: NDArray[np.int64],
    spread: Array,
    cubic: bool,
    parabolas: bool | None = None,
    damping: float = 0.0,
) -> Grid:
    soc_step = float(nodes[-1] - nodes[0]) / (nodes.size - 1)
    discharge_ohm, charge_ohm = pack.resistances_ohm(nodes)
    low_A, high_A = pack.current_limits_A(nodes)
    weights = smoothing_weights(spread, soc_step) if cubic else hat_weights(spread, soc_step)
    weights = weights[:, weights.shape[1] // 2 :]  # the other side is the same
    used = np.abs(weights).max(axis=2) > NEGLIGIBLE_WEIGHT
    weights[~used] = 0.0
    weights /= 2.0 * weights.sum(axis=1, keepdims=True) - weights[:, :1]
    side = np.array([int(np.flatnonzero(row).max()) for row in used])
    largest_A = max(pack.discharge_limit_A, pack.charge_limit_A)
    joined = cubic if parabolas is None else parabolas
    shares = _level_shares(level, posterior, drift_per_A * largest_A, joined)
    first, most = _reached(shares)
    plan = np.zeros((first.size, most, 3), dtype=np.int64)
    share = np.zeros((first.size, most, CURRENTS, _whole_blocks(nodes.size)))
    for row, lowest in enumerate(first):
        reached = slice(lowest, lowest + most)
        plan[row, :, 0], plan[row, :, 1] = source_row[row, reached], operator[row, reached]
        share[row, ..., : nodes.size] = shares[row, reached]
    plan[..., 2] = side[plan[..., 1]]
    return Grid(
        soc_first=float(nodes[0]),
        soc_step=soc_step,
        ocv_V=pack.ocv(nodes),
        discharge_ohm=discharge_ohm,
        charge_ohm=charge_ohm,
        current_low_A=low_A,
        current_high_A=high_A,
        largest_A=largest_A,
        level_step=float(np.sqrt(level[-1])) / (level.size - 1) if level.size > 1 else 1.0,
        level=np.ascontiguousarray(level, dtype=np.float64),
        posterior=np.ascontiguousarray(posterior, dtype=np.float64),
        weights=np.pad(weights, ((0, 0), (0, 0), (0, share.shape[-1] - nodes.size))),
        plan=plan,
        levels=_levels_of_blocks(share),
        share=share,
        cubic=cubic,
        damping=damping if level.size >= LEAST_DAMPED else 0.0,
    )


def _whole_blocks(nodes: int) -> int:
    return -(-nodes // NODES) * NODES


def _level_shares(level: Array, posterior: Array, widest: float, parabolas: bool) -> Array:
    """Weights of the levels at each of the currents, for every row and node.

    Parameters
    ----------
    level : ndarray, shape (q,)
        Variances of the levels.
    posterior : ndarray, shape (r, n)
        Next variance without current.
    widest : float
        What the largest current adds to it.
    parabolas : bool
        Whether levels are joined by parabolas or linearly.

    Returns
    -------
    ndarray, shape (r, q, CURRENTS, n)
        Weights of the three levels around each variance, or of the two.
    """
    rows, nodes = posterior.shape
    share = np.zeros((rows, level.size, CURRENTS, nodes))
    if level.size == 1:
        share[:] = 1.0
        return share
    root = np.sqrt(level)
    middle = 0.5 * (root[1:-2] + root[2:-1])
    row, node = np.ogrid[:rows, :nodes]
    for m, part in enumerate(SHARES):
        variance = posterior + part * widest
        if not parabolas:
            lower, both = linear_shares(level, variance)
            for i, weight in enumerate(both):
                share[row, lower + i, m, node] = weight
            continue
        q = np.searchsorted(middle, np.sqrt(variance), side="right")
        x = [variance - level[q + i] for i in range(3)]
        for i in range(3):
            a, b = (i + 1) % 3, (i + 2) % 3
            norm = (level[q + i] - level[q + a]) * (level[q + i] - level[q + b])
            share[row, q + i, m, node] = x[a] * x[b] / norm
    return share


def _reached(shares: Array) -> tuple[NDArray[np.int64], int]:
    """First of the levels that each row keeps, and how many: as many for each as the widest needs."""
    used = np.any(shares != 0.0, axis=(2, 3))
    first = used.argmax(axis=1)
    most = int((used.shape[1] - used[:, ::-1].argmax(axis=1) - first).max())
    return np.minimum(first, used.shape[1] - most), most


def _levels_of_blocks(share: Array) -> NDArray[np.int64]:
    """First kept level that each block of nodes uses, and the one after the last, shape (r, blocks, 2)."""
    rows, most, _, wide = share.shape
    used = np.any(share.reshape(rows, most, CURRENTS, wide // NODES, NODES) != 0.0, axis=(2, 4))
    first = used.argmax(axis=1)
    last = most - used[:, ::-1].argmax(axis=1)
    return np.ascontiguousarray(np.stack((first, last), axis=-1), dtype=np.int64)

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
from ems._sdp import Grid
from ems.concept import Concept
from ems.smoothing import smoothing_weights

Array = NDArray[np.float64]

NEGLIGIBLE_WEIGHT = 1e-9
HEADROOM = 1.1


class GridSettings(BaseModel):
    """Spacings of the grids; the defaults pass the convergence test (docs/method.md)."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    soc_step: float = Field(default=0.0025, gt=0.0, le=0.05, description="SOC spacing under noise")
    deterministic_soc_step: float = Field(
        default=0.00025, gt=0.0, le=0.05, description="SOC spacing of the certainty-equivalent program"
    )
    variance_rows: int = Field(default=10, ge=4, le=400, description="rows of the variance grid")
    process_levels: int = Field(default=6, ge=3, le=100, description="levels of perfect information")
    torque_levels: int = Field(default=21, ge=1, le=400, description="clutched engine torques per step")
    soc_margin: float = Field(default=0.15, gt=0.0, le=1.0, description="how far the grid passes the window")

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
    first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
    return np.asarray(np.minimum(np.arange(first, max(last, first + 8) + 1) * step, 1.0), dtype=np.float64)


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
) -> Grid:
    """Build the grid of the program over (estimate, variance)."""
    measured = measurement_variance(nodes, variances, pack, uncertainty)
    prior = np.broadcast_to(variances[:, None], measured.shape)
    rows = variances.size
    return _grid(
        nodes,
        pack,
        step_s,
        level=variances,
        posterior=posterior_variance(prior, measured) + step_s * uncertainty.gamma,
        source_row=np.tile(np.arange(rows), (rows, 1)),
        operator=np.tile(np.arange(rows)[:, None], (1, rows)),
        spread=innovation_spread(prior, measured),
        cubic=cubic,
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
        step_s,
        level=np.square(spread),
        posterior=np.full((1, nodes.size), step_s * uncertainty.gamma),
        source_row=np.zeros((1, levels)),
        operator=np.arange(levels)[None, :],
        spread=np.tile(spread[:, None], (1, nodes.size)),
        cubic=cubic,
    )


def deterministic_grid(nodes: Array, pack: Pack, step_s: float, cubic: bool = False) -> Grid:
    """Build the grid of the program without noise; see `ems._interpolate` for why it is linear by default."""
    one = np.zeros((1, nodes.size))
    return _grid(
        nodes,
        pack,
        step_s,
        level=np.zeros(1),
        posterior=one,
        source_row=one[:, :1],
        operator=one[:, :1],
        spread=one,
        cubic=cubic,
    )


def _grid(
    nodes: Array,
    pack: Pack,
    step_s: float,
    *,
    level: Array,
    posterior: Array,
    source_row: NDArray[np.generic],
    operator: NDArray[np.generic],
    spread: Array,
    cubic: bool,
) -> Grid:
    soc_step = float(nodes[-1] - nodes[0]) / (nodes.size - 1)
    discharge_ohm, charge_ohm = pack.resistances_ohm(nodes)
    low_A, high_A = pack.current_limits_A(nodes)
    weights = smoothing_weights(spread, soc_step)
    used = np.abs(weights).max(axis=2) > NEGLIGIBLE_WEIGHT
    weights[~used] = 0.0
    weights /= weights.sum(axis=1, keepdims=True)
    distance = np.abs(np.arange(weights.shape[1]) - weights.shape[1] // 2)
    fastest = max(pack.discharge_limit_A, pack.charge_limit_A) * step_s / pack.capacity_C
    return Grid(
        soc_first=float(nodes[0]),
        soc_step=soc_step,
        ocv_V=pack.ocv(nodes),
        discharge_ohm=discharge_ohm,
        charge_ohm=charge_ohm,
        current_low_A=low_A,
        current_high_A=high_A,
        level_step=float(np.sqrt(level[-1])) / (level.size - 1) if level.size > 1 else 1.0,
        level=np.ascontiguousarray(level, dtype=np.float64),
        posterior=np.ascontiguousarray(posterior, dtype=np.float64),
        source_row=np.ascontiguousarray(source_row, dtype=np.int64),
        operator=np.ascontiguousarray(operator, dtype=np.int64),
        weights=weights,
        taps=np.array([int(distance[row].max()) for row in used], dtype=np.int64),
        pad=math.ceil(fastest / soc_step) + 2,
        cubic=cubic,
    )

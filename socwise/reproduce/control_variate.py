r"""Fuel without the luck of the draw: the charge that the noise created, as a control variate.

In [L]'s model the true SOC walks with the process noise ``d``, so a trip is given or loses battery energy
that nobody pays for, and its fuel scatters with it. The charge given to a trip over its N steps,

.. math:: D = SOC_N - SOC_0 - \sum_k h\,i_k / Q = \sum_k d_k,

has expectation exactly zero under every policy: ``d_k`` has mean zero whatever happened before step k, so its
sums are a martingale (as long as the true SOC stays inside [0, 1]). Regress the fuel ``f`` on ``D`` over the
realizations of a case, slope ``b``; then ``f - b D`` has the expectation of ``f`` and much less variance. As
``b`` is estimated from the same realizations there is a bias, of the order of one over their number.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ems.records import Case
from ems.statistics import mean_and_error

Array = NDArray[np.float64]


def created_charge(case: Case, capacity_C: float) -> Array:
    """Charge that the process noise gave to each realization, as a share of the capacity, shape (n,)."""
    rollout = case.rollout
    step_s = np.diff(rollout.time_s)
    passed = (rollout.current_A.astype(np.float64) * step_s).sum(axis=1) / capacity_C
    change = rollout.soc[:, -1].astype(np.float64) - rollout.soc[:, 0].astype(np.float64)
    return np.asarray(change - passed)


def adjust(values: Array, control: Array) -> Array:
    """Take out of the values what a control variate of expectation zero explains, shape (n,).

    Parameters
    ----------
    values, control : ndarray, shape (n,)
        One of each per realization. Where the control does not vary, the values come back as they are.
    """
    deviation = control - control.mean()
    spread = float(deviation @ deviation)
    slope = float(deviation @ (values - values.mean())) / spread if spread > 0.0 else 0.0
    return np.asarray(values - slope * control)


def rise_percent(before: Array, after: Array) -> tuple[float, float | None]:
    """Rise of a mean in per cent and its standard error, over paired realizations.

    Parameters
    ----------
    before, after : ndarray, shape (n,)
        Values of the same realizations in two cases.

    Returns
    -------
    tuple
        ``100 (mean(after) / mean(before) - 1)``, and its standard error to first order; None for a single
        pair of realizations.
    """
    base = float(before.mean())
    ratio = float(after.mean()) / base
    _, error = mean_and_error((after - ratio * before) / base)
    return 100.0 * (ratio - 1.0), None if error is None or math.isnan(error) else 100.0 * error

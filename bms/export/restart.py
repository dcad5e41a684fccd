"""Another belief about the SOC before the first sample, in the kernels' own language, to be translated.

What each estimator's constructor does with a belief, on the memory of one that was made with another.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bms.estimators import _coulomb, _gate, _gpc_belief, _gpc_form, _watch
from bms.estimators._chaos import collapse, regerm
from bms.estimators._gpc_ekf import ChaosSettings
from bms.estimators._joint import SHARED, STATE, Settings, covariance_row, rows_of
from bms.estimators._report import report

Array = NDArray[np.float64]

LEAST_SD = 1e-4
"""Prior standard deviation of the SOC below which the recursive estimators do not go."""


def start_coulomb(memory: Array, row: Array, soc: float, variance: float) -> None:
    """Start to count from a SOC."""
    x = memory[_gate.SIZE :]
    x[_coulomb.SOC], x[_coulomb.START_SOC], x[_coulomb.START_VARIANCE] = soc, soc, variance
    row[0], row[1] = soc, variance


def start_joint(settings: Settings, memory: Array, row: Array, soc: float, variance: float) -> None:
    """Start a Kalman-type filter from a SOC; what it believes of everything else stays."""
    places = settings.places
    n, top = places.size, covariance_row(places)
    m = memory[_watch.END :].reshape(-1, n)
    for i in range(n):
        m[top, i] = m[top + i, 0] = 0.0
        m[top + n, i] = m[top + n + i, 0] = 0.0
    m[SHARED, 0], m[STATE, 0], m[top, 0] = 0.0, soc, variance
    report(places, m, m[:0], settings.nominal, memory[_watch.ERROR_V2], row)


def start_chaos(settings: ChaosSettings, memory: Array, row: Array, soc: float, variance: float) -> None:
    """Start the filter on chaos coefficients from a SOC, as `start_joint`."""
    joint = settings.joint
    places, terms = joint.places, settings.inverse.shape[0]
    n, top = places.size, covariance_row(places)
    end = _watch.END + rows_of(n) * n
    m = memory[_watch.END : end].reshape(-1, n)
    chaos = memory[end:].reshape(terms, n)
    collapse(places, m, chaos)
    for i in range(n):
        m[top, i] = m[top + i, 0] = 0.0
        m[top + n, i] = m[top + n + i, 0] = 0.0
    m[SHARED, 0], m[STATE, 0], m[top, 0] = 0.0, soc, variance
    regerm(places, m, chaos, settings.germs)
    report(places, m, chaos, joint.nominal, memory[_watch.ERROR_V2], row)


def start_recursive(
    start: Array,
    prior_sd: Array,
    described: Array,
    temperature_C: float,
    memory: Array,
    row: Array,
    soc: float,
    variance: float,
) -> None:
    """Start a recursive gPC estimator anew from a SOC: it keeps nothing that it learnt.

    ``described`` is the row that it reports before any sample.
    """
    capacity_C = 1.0 / start[_gpc_form.ALPHA]
    start[_gpc_form.X10] = soc * capacity_C
    prior_sd[_gpc_form.X10] = max(math.sqrt(variance), LEAST_SD) * capacity_C
    memory[:] = 0.0
    memory[_gate.TEMPERATURE_C] = temperature_C
    theta = memory[_gate.SIZE + _gpc_belief.SCALARS : _gate.SIZE + _gpc_belief.SCALARS + _gpc_form.THETA]
    theta[:] = start
    row[:] = described
    row[0], row[1] = soc, variance

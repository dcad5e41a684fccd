r"""Recursive least squares on a model that is linear in coefficients, in either of two forms.

.. math:: K = P h / (\lambda + h^T P h), \qquad c \leftarrow c + K (y - h^T c), \qquad
          P \leftarrow (P - K h^T P) / \lambda,

(Ljung, System Identification, 1999, section 11.2; [M] reference 10), here with :math:`\lambda = 1`. A
regressor with noise of variance s^2 on a signal of variance S^2 shrinks its coefficient by 1 / (1 + s^2 /
S^2). So force = parameter x *noisy* acceleration underestimates masses and inertias, whatever the length of
the log, and acceleration = coefficient x force does not, as long as forces are clean ([M] Figs 7-14 do not
say which form they show: ERRATA). The variance of the residuals sets the scale of the covariance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vehicle.inertia import _kernels as _kernels
from vehicle.inertia import _regression

Array = NDArray[np.float64]

START_VARIANCE = 1e8
"""Of a coefficient, in units of what one sample tells: as good as unknown."""


def least_squares(rows: Array, targets: Array, start: Array, forget: float = 1.0) -> tuple[Array, Array]:
    """Fit ``targets = rows @ coefficients`` recursively.

    Parameters
    ----------
    rows, targets : ndarray, shapes (n, m, p) and (n, m)
        A sample with NaN is left out.
    start : ndarray, shape (p,)
        Coefficients to start from, hardly believed.
    forget : float
        Forgetting factor per sample, in (0, 1].

    Returns
    -------
    tuple of ndarray, shapes (n, p) and (n, p, p)
        Coefficients and their covariance after each sample; every sample's with the residual variance of the
        whole log.
    """
    n, _, p = rows.shape
    power = np.nanmean(np.sum(rows**2, axis=1), axis=0)
    doubt = np.diag(START_VARIANCE / np.where(power > 0.0, power, 1.0))
    mean, covariance, squares = np.empty((n, p)), np.empty((n, p, p)), np.empty(n)
    _regression.run_least_squares(
        start.copy(),
        doubt,
        forget,
        np.ascontiguousarray(rows),
        np.ascontiguousarray(targets),
        mean,
        covariance,
        squares,
    )
    return mean, covariance * (np.nanmean(squares) / targets.shape[1])

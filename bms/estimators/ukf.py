r"""The unscented Kalman filter on states and parameters.

The same state, model error and watch as in `bms.estimators.joint`; instead of slopes at the estimate, 2 n +
1 sigma points (Julier and Uhlmann, Proc. IEEE 92, 2004; scaled, van der Merwe, thesis, OGI 2004)

.. math:: \mathcal X_0 = \hat x, \quad \mathcal X_{\pm i} = \hat x \pm \sqrt{n + \lambda}\,L_i, \quad
          L L^T = P, \quad \lambda = \alpha^2 (n + \kappa) - n

go through the model, and means and covariances are weighted sums over them, with :math:`W_i = 1 / (2 (n +
\lambda))`, :math:`W_0 = \lambda / (n + \lambda)` for means and :math:`W_0 + 1 - \alpha^2 + \beta` for
covariances. Noise is additive. The update is written with the slopes :math:`h^T = P_{xz}^T P^{-1}` of the
statistical linearisation and the variance that they leave out, :math:`\Omega = P_{zz} - h^T P h`, so that
Joseph's form holds for any gain, also one held back:

.. math:: P \leftarrow (1 - k h^T) P (1 - k h^T)^T + k (r + \Omega) k^T .

With the defaults (:math:`\alpha = 1/2`, :math:`\beta = 2`, :math:`\kappa = 3 - n`) the points stand 0.87
standard deviations away, which keeps a wide belief between empty and full (:math:`\alpha = 1` sends a third
of the points beyond). On a linear curve the filter is the Kalman filter.

When to use: where the OCV bends within the uncertainty of the SOC (knees of an LFP cell, a poor start); it
costs several times an EKF.
"""

from __future__ import annotations

import math
from typing import ClassVar, final

from pydantic import Field

from bms.belief import SocBelief
from bms.cell import Cell
from bms.errors import BatteryError
from bms.estimators import _ukf
from bms.estimators.base import Kernel
from bms.estimators.gate import Sensors
from bms.estimators.joint import JointEstimator, JointOptions, places_of, settings_of, start_of


class UkfOptions(JointOptions):
    """Options of the unscented Kalman filter."""

    alpha: float = Field(default=0.5, gt=0.0, le=2.0, description="scale of the sigma points' distance")
    beta: float = Field(default=2.0, ge=0.0, description="extra weight of the centre in covariances")
    kappa: float | None = Field(default=None, description="secondary scale; 3 minus the size of the state")


@final
class Ukf(JointEstimator):
    """Unscented Kalman filter.

    Parameters
    ----------
    cell : Cell
        Nominal cell.
    belief : SocBelief
        Belief at the start.
    options : UkfOptions
        What to estimate, and with which noise.
    sensors : Sensors
        The sensors.

    Raises
    ------
    BatteryError
        When ``alpha`` and ``kappa`` leave the points no distance.
    """

    name: ClassVar[str] = "ukf"
    kernel: ClassVar[Kernel] = staticmethod(_ukf.run)

    def __init__(
        self,
        cell: Cell,
        belief: SocBelief,
        options: UkfOptions | None = None,
        sensors: Sensors | None = None,
    ) -> None:
        chosen, sensed = options or UkfOptions(), sensors or Sensors()
        places = places_of(cell, chosen)
        joint = settings_of(cell, chosen, sensed, places)
        sigma = sigma_weights(places.size, chosen.alpha, chosen.beta, chosen.kappa)
        memory = start_of(cell, belief, chosen, places)
        super().__init__(cell, belief, sensed, joint, _ukf.UkfSettings(joint, sigma), memory)


def sigma_weights(size: int, alpha: float, beta: float, kappa: float | None) -> _ukf.Sigma:
    """Weights of the scaled sigma points.

    Parameters
    ----------
    size : int
        Size of the state.
    alpha, beta, kappa : float
        Scales; a ``kappa`` of None is 3 minus the size.

    Raises
    ------
    BatteryError
        When the points have no distance from the mean.
    """
    spread = alpha**2 * (size + (3.0 - size if kappa is None else kappa))
    if not spread > 0.0:
        raise BatteryError(f"kappa must be more than minus the size of the state, {-size}, got {kappa}")
    centre = 1.0 - size / spread
    return _ukf.Sigma(math.sqrt(spread), centre, centre + 1.0 - alpha**2 + beta, 0.5 / spread)

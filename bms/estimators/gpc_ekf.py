r"""The Kalman filter on polynomial-chaos coefficients of the cell's states and parameters ([M] part 1).

Initial SOC, hysteresis, current bias and the estimated parameters are germs, uniform with the mean and the
variance of their priors. State and parameters are expansions :math:`x = \sum_i x^i \Psi_i(\xi)` in Legendre
polynomials of total order ``order``. Each step runs the cell's model at the collocation nodes and projects
the result (eqs 9-15); the voltage at the nodes gives its coefficients :math:`z^i` in the same way.
Covariances are sums over coefficients (eq 20), and a measured voltage moves every coefficient (eqs 22, 23):

.. math:: k = \frac{\sum_{i \ge 1} x^i z^i + N h}{s}, \quad
          s = \sum_{i \ge 1} (z^i)^2 + h^T N h + r, \quad x^i \leftarrow x^i + k\,(z\,\delta_{i0} - z^i) .

The report's filter falls asleep, because its measurement carries no noise into the coefficients. Here the
covariance N that no germ represents is carried beside the chaos (as in `gpc.ekf`): noise of sensors,
relaxation voltages at the start, and :math:`k r k^T`,

.. math:: N \leftarrow \Phi N \Phi^T + Q, \qquad N \leftarrow (1 - k h^T) N (1 - k h^T)^T + k\,r\,k^T ,

with the slopes :math:`\Phi`, h at the mean. The total, chaos and N, is the covariance; model error and
watch are those of `bms.estimators.joint`. When most of the variance of a wide belief stands in N (after a
gap, a reset or a belief given up), mean and covariance become germs again: Cholesky's factor of the germs'
states, the regression of the others on them, and the rest in N.

On a linear curve the filter is the Kalman filter, whatever the order. Of order 0 it has no chaos: it moves
the mean along the deterministic model.

When to use: for a wide start on a bent curve, and to see how far chaos helps; it costs some ten times an
EKF.
"""

from __future__ import annotations

from typing import ClassVar, Literal, final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from bms.belief import SocBelief
from bms.cell import Cell
from bms.estimators import _chaos, _gpc_ekf, _joint, _watch
from bms.estimators.base import Kernel
from bms.estimators.gate import Sensors
from bms.estimators.joint import JointEstimator, JointOptions, places_of, settings_of, start_of
from gpc.basis import Legendre
from gpc.collocation import Collocation, collocate, quadrature
from gpc.index_set import total_order

Array = NDArray[np.float64]

CHECKS = 5
"""Gauss points beyond the order with which the part of the OCV is found that an expansion leaves out."""


class GpcEkfOptions(JointOptions):
    """Options of the filter on chaos coefficients."""

    order: int = Field(default=2, ge=0, le=4, description="total order of the expansions")
    nodes: Literal["selected", "tensor"] = Field(
        default="selected",
        description="as many well-conditioned nodes as terms, or the full tensor Gauss grid",
    )


@final
class GpcEkf(JointEstimator):
    """Kalman filter on chaos coefficients.

    Parameters
    ----------
    cell : Cell
        Nominal cell.
    belief : SocBelief
        Belief at the start.
    options : GpcEkfOptions
        What to estimate, with which noise, and the expansions' order and nodes.
    sensors : Sensors
        The sensors.
    """

    name: ClassVar[str] = "gpc_ekf"
    kernel: ClassVar[Kernel] = staticmethod(_gpc_ekf.run)

    def __init__(
        self,
        cell: Cell,
        belief: SocBelief,
        options: GpcEkfOptions | None = None,
        sensors: Sensors | None = None,
    ) -> None:
        chosen, sensed = options or GpcEkfOptions(), sensors or Sensors()
        places = places_of(cell, chosen)
        germs = germs_of(places)
        self.collocation = collocation_of(germs.size, chosen)
        joint = settings_of(cell, chosen, sensed, places)
        settings = _gpc_ekf.ChaosSettings(
            joint, germs, self.collocation.matrix, self.collocation.inverse, rule_of(chosen.order)
        )
        beside = start_of(cell, belief, chosen, places)
        chaos = np.zeros((self.collocation.indices.shape[0], places.size))
        _chaos.regerm(places, beside[_watch.END :].reshape(-1, places.size), chaos, germs)
        memory = np.concatenate([beside, chaos.ravel()])
        super().__init__(cell, belief, sensed, joint, settings, memory, chaos.shape[0])

    @property
    def coefficients(self) -> Array:
        """Chaos coefficients, shape (terms, states): SOC, relaxation, hysteresis, bias, log factors."""
        return self._beliefs()[1].copy()


def germs_of(places: _joint.Places) -> NDArray[np.int64]:
    """Places of the states with germs: all but the relaxation voltages, whose start is soon forgotten."""
    return np.array([at for at in range(places.size) if at not in (1, places.v2)], dtype=np.int64)


def collocation_of(germs: int, options: GpcEkfOptions) -> Collocation:
    """Nodes and maps of the expansions."""
    families = [Legendre()] * germs
    indices = total_order(germs, options.order)
    return quadrature(families, indices) if options.nodes == "tensor" else collocate(families, indices)


def rule_of(order: int) -> Array:
    """Gauss rule that sees what an expansion of this order leaves out, and the polynomials at its nodes."""
    nodes, weights = Legendre().gauss(order + CHECKS)
    return np.vstack([nodes, weights, Legendre().evaluate(nodes, order)])

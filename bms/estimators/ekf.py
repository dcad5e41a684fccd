r"""The extended Kalman filter on states and parameters.

State, options, model error and watch are those of `bms.estimators.joint`. A step moves the state with the
model and the covariance with its slopes, :math:`P \leftarrow \Phi P \Phi^T + Q`; a voltage moves the state
by :math:`k\,(V - \hat V)` with the slope of the OCV at the estimate (over one standard deviation where the
belief is wide), and the covariance by Joseph's form. Plett, J. Power Sources 134 (2004) 252, 262 and 277.

SOC and one relaxation voltage with constant parameters run in a kernel of their own, with the same result.

When to use: the first choice; fast, and on a linear curve the Kalman filter itself.
"""

from __future__ import annotations

from typing import ClassVar, final

from bms.belief import SocBelief
from bms.cell import Cell
from bms.estimators import _ekf
from bms.estimators.base import Kernel
from bms.estimators.gate import Sensors
from bms.estimators.joint import JointEstimator, JointOptions, places_of, settings_of, start_of


class EkfOptions(JointOptions):
    """Options of the extended Kalman filter."""


@final
class Ekf(JointEstimator):
    """Extended Kalman filter.

    Parameters
    ----------
    cell : Cell
        Nominal cell.
    belief : SocBelief
        Belief at the start.
    options : EkfOptions
        What to estimate, and with which noise.
    sensors : Sensors
        The sensors.
    """

    name: ClassVar[str] = "ekf"
    kernel: ClassVar[Kernel] = staticmethod(_ekf.run)

    def __init__(
        self,
        cell: Cell,
        belief: SocBelief,
        options: EkfOptions | None = None,
        sensors: Sensors | None = None,
    ) -> None:
        chosen, sensed = options or EkfOptions(), sensors or Sensors()
        places = places_of(cell, chosen)
        joint = settings_of(cell, chosen, sensed, places)
        super().__init__(cell, belief, sensed, joint, joint, start_of(cell, belief, chosen, places))

"""Policies in a loop that is closed: a plant with sensors answers, a real estimator believes.

Kept apart from `ems.compare`, whose plant and estimator are those that the policies are computed with.
"""

from ems.closed.battery import ClosedLoop, FmuSource, battery_for
from ems.closed.compare import Training, compare_closed
from ems.closed.identify import Identified, identify
from ems.closed.scatter import Scatter

__all__ = [
    "ClosedLoop",
    "FmuSource",
    "Identified",
    "Scatter",
    "Training",
    "battery_for",
    "compare_closed",
    "identify",
]

"""Traffic: fundamental diagrams, kinematic waves and second-order models, and what is uncertain in them.

What computes is imported from its module: `drivecycles.traffic.lwr`, `second_order`, `uncertainty`.
"""

from drivecycles.traffic.diagram import Diagram
from drivecycles.traffic.diagrams import (
    DIAGRAMS,
    Greenberg,
    Greenshields,
    Triangular,
    Underwood,
    make_diagram,
)
from drivecycles.traffic.errors import TrafficError, TrafficWarning
from drivecycles.traffic.field import TrafficField
from drivecycles.traffic.road import Bottleneck, Demand, Road
from gpc.kernel_cache import provide_folder

__all__ = [
    "DIAGRAMS",
    "Bottleneck",
    "Demand",
    "Diagram",
    "Greenberg",
    "Greenshields",
    "Road",
    "TrafficError",
    "TrafficField",
    "TrafficWarning",
    "Triangular",
    "Underwood",
    "make_diagram",
]

provide_folder()

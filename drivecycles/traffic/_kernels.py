"""Every kernel of the traffic models, checked against its cache when one of them is first used."""

from __future__ import annotations

from drivecycles.traffic import _lwr, _probe, _second_order
from gpc.kernel_cache import discard_stale

MODULES = (_lwr, _second_order, _probe)

discard_stale(MODULES, "traffic")

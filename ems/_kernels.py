"""Every module with a kernel of the energy management, checked against its cache when `ems` is imported."""

from __future__ import annotations

from bms import _filter, _levels
from ems import (
    _blocks,
    _choose,
    _expect,
    _interpolate,
    _ir,
    _lanes,
    _look_up,
    _map,
    _moves,
    _rollout,
    _rules,
    _sdp,
)
from gpc.kernel_cache import discard_stale

MODULES = (
    _levels,
    _filter,
    _interpolate,
    _ir,
    _lanes,
    _blocks,
    _moves,
    _expect,
    _sdp,
    _look_up,
    _choose,
    _map,
    _rules,
    _rollout,
)

discard_stale(MODULES)

"""Every kernel of the inertia estimation, checked against its cache when one of them is first used."""

from __future__ import annotations

from gpc import _ekf, _small, _ukf
from gpc.kernel_cache import discard_stale
from vehicle.inertia import _body, _mass_spring, _regression

MODULES = (_small, _ekf, _ukf, _mass_spring, _body, _regression)

discard_stale(MODULES, "inertia")

"""Every kernel of cells and estimators, checked against its cache when one of them is first used."""

from __future__ import annotations

from bms import _ageing, _cycling, _ecm, _filter, _levels, _uncertainty_fit
from bms.estimators import (
    _absorb,
    _chaos,
    _coulomb,
    _ekf,
    _ekf_plain,
    _gate,
    _gpc_belief,
    _gpc_ekf,
    _gpc_form,
    _gpc_gradient,
    _joint,
    _report,
    _reset,
    _ukf,
    _watch,
)
from bms.plants import _ecm_plant
from gpc import _small
from gpc.kernel_cache import discard_stale

MODULES = (
    _ageing,
    _cycling,
    _levels,
    _filter,
    _uncertainty_fit,
    _ecm,
    _ecm_plant,
    _small,
    _reset,
    _gate,
    _coulomb,
    _gpc_form,
    _gpc_belief,
    _gpc_gradient,
    _joint,
    _watch,
    _absorb,
    _report,
    _ekf,
    _ekf_plain,
    _ukf,
    _chaos,
    _gpc_ekf,
)

discard_stale(MODULES, "battery")

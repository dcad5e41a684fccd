"""The BMS that [L] postulates, tabulated for the kernels."""

from __future__ import annotations

import numpy as np

from bms._filter import Filter
from bms.pack import Pack
from bms.uncertainty import UncertaintyModel

SOC_NODES = 401
LEVELS = 24
LARGEST_SD = 0.12
"""Standard deviation of the last level; a larger variance is looked up as if it were this one."""


def tabulate_filter(pack: Pack, uncertainty: UncertaintyModel) -> Filter:
    """Tabulate the expected measurement variance of [L] eq 10 over SOC and variance.

    Parameters
    ----------
    pack : Pack
        Gives alpha.
    uncertainty : UncertaintyModel
        Gives mu.
    """
    deviations = np.linspace(0.0, LARGEST_SD, LEVELS)
    nodes = np.linspace(0.0, 1.0, SOC_NODES)
    soc, variance = np.broadcast_arrays(nodes[None, :], np.square(deviations)[:, None])
    return Filter(
        alpha=np.ascontiguousarray(pack.ocv.alpha(nodes)),
        mu=uncertainty.mu,
        level_step=LARGEST_SD / (LEVELS - 1),
        level=np.square(deviations),
        measured=np.ascontiguousarray(uncertainty.measurement_variance(soc, variance, pack.ocv.alpha)),
    )

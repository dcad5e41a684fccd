"""The BMS that [L] postulates, tabulated for the kernels."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from bms._filter import Filter
from bms.pack import Pack
from bms.piecewise import PiecewiseLinear
from bms.uncertainty import UncertaintyModel

Array = NDArray[np.float64]

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
    alpha, expected = _tabulate_alpha(pack.ocv.alpha)
    return Filter(
        alpha=alpha,
        mu=uncertainty.mu,
        level_step=LARGEST_SD / (LEVELS - 1),
        level=np.square(np.linspace(0.0, LARGEST_SD, LEVELS)),
        measured=uncertainty.mu * expected,
    )


@lru_cache(maxsize=32)
def _tabulate_alpha(alpha: PiecewiseLinear) -> tuple[Array, Array]:
    """Tabulate alpha over SOC, and its expectation over variance and SOC; the same for every mu."""
    nodes = np.linspace(0.0, 1.0, SOC_NODES)
    variances = np.square(np.linspace(0.0, LARGEST_SD, LEVELS))
    soc, variance = np.broadcast_arrays(nodes[None, :], variances[:, None])
    return np.ascontiguousarray(alpha(nodes)), np.ascontiguousarray(alpha.expectation(soc, variance))

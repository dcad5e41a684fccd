r"""Where to run a model whose parameters are uncertain: four ways to scatter points over the unit cube.

- ``mc``: independent uniform points; the error of the mean of n is :math:`s/\sqrt n`;
- ``antithetic``: n/2 pairs :math:`u, 1-u`; the error is :math:`s/\sqrt{n/2}` with s that of the pairs' means.
  What is odd about the middle of the distribution cancels within a pair, what is even does not;
- ``lhs``: Latin hypercubes, which scatter every parameter alone evenly (McKay et al., Technometrics 21,
  1979);
- ``sobol``: scrambled Sobol' sequences, which scatter all of them together (Owen, J. Complexity 14, 1998).

The points of the last two depend on each other, so a design is made of independent replicates of it, and the
error is that of the mean of the replicates' means.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivecycles.traffic.errors import TrafficError
from drivecycles.traffic.naming import suggest

Array = NDArray[np.float64]

SAMPLERS = ("mc", "antithetic", "lhs", "sobol")
REPLICATES = 8
LEAST = {"mc": 2, "antithetic": 4, "lhs": 2 * REPLICATES, "sobol": 2 * REPLICATES}
MOST_RUNS = 10_000_000
_EDGE = 2.0**-40


@dataclass(frozen=True, eq=False)
class Design:
    """Points, and which of them belong together.

    Attributes
    ----------
    share : ndarray, shape (n, d)
        Points in the open unit cube, group after group.
    groups : int
        Number of groups of equal size that are independent of each other.
    """

    share: Array
    groups: int

    def error(self, values: Array) -> Array:
        """Estimate the standard error of the mean of values of shape ``(..., n)``."""
        means = values.reshape(*values.shape[:-1], self.groups, -1).mean(axis=-1)
        return np.asarray(means.std(axis=-1, ddof=1) / math.sqrt(self.groups), dtype=np.float64)


def design(method: str, runs: int, dimension: int, generator: np.random.Generator) -> Design:
    """Scatter points.

    Parameters
    ----------
    method : str
        One of `SAMPLERS`.
    runs : int
        Most points; rounded down to what the method can do: even for pairs, multiples of 8 for Latin
        hypercubes, 8 times a power of two for Sobol'.
    dimension : int
        Number of uncertain parameters.
    generator : numpy.random.Generator
        Source of the points.

    Raises
    ------
    TrafficError
        When the method is unknown or there are too few runs for it, or too many to hold.
    """
    if method not in SAMPLERS:
        raise TrafficError(
            f"there is no method {method!r}; known are {', '.join((*SAMPLERS, 'gpc'))}"
            f"{suggest(method, (*SAMPLERS, 'gpc'))}"
        )
    if not LEAST[method] <= runs <= MOST_RUNS:
        raise TrafficError(f"the method {method!r} takes {LEAST[method]} to {MOST_RUNS} runs, got {runs}")
    if method == "mc":
        points, groups = generator.random((runs, dimension)), runs
    elif method == "antithetic":
        first = generator.random((runs // 2, dimension))
        points, groups = np.stack([first, 1.0 - first], axis=1).reshape(-1, dimension), runs // 2
    else:
        points, groups = _replicates(method, runs // REPLICATES, dimension, generator), REPLICATES
    return Design(np.clip(points, _EDGE, 1.0 - _EDGE), groups)


def even_points(dimension: int, generator: np.random.Generator) -> Array:
    """Scatter 4096 points evenly, one scrambled Sobol' sequence, shape (4096, d)."""
    from scipy.stats import qmc

    points = qmc.Sobol(dimension, seed=generator).random_base2(12)
    return np.clip(points, _EDGE, 1.0 - _EDGE)


def _replicates(method: str, size: int, dimension: int, generator: np.random.Generator) -> Array:
    from scipy.stats import qmc

    parts = []
    for child in generator.spawn(REPLICATES):
        if method == "lhs":
            parts.append(qmc.LatinHypercube(dimension, seed=child).random(size))
        else:
            parts.append(qmc.Sobol(dimension, seed=child).random_base2(int(math.log2(size))))
    return np.concatenate(parts)

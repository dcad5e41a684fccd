"""The noise of a comparison: standard normal draws that every policy and every mu shares.

Drawn from one ``SeedSequence`` per study, spawned per pair of realizations, so that a realization does not
depend on how many there are, on who computes it, or on the number of workers.

Realizations come in antithetic pairs: number ``2 m + 1`` is the mirror image of number ``2 m``. On [L]'s
plant noise creates and destroys battery energy, so the fuel of one PHEV trip scatters by half of its mean; in
a pair the energies cancel. Means keep their expectation, standard errors are those of the pairs
(`ems.statistics`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ems.errors import EmsError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Noise:
    """Standard normal draws of ``n`` realizations over ``N`` steps.

    Parameters
    ----------
    initial : ndarray, shape (n,)
        Error of the initial estimate, in its standard deviations.
    process, measurement : ndarray, shape (n, N)
        ``d`` and ``w`` of [L] eqs 3 and 4, in their standard deviations.
    """

    initial: Array
    process: Array
    measurement: Array


def draw_noise(seed: int, realizations: int, steps: int) -> Noise:
    """Draw the noise of a comparison.

    Parameters
    ----------
    seed : int
        Seed of the study, >= 0.
    realizations, steps : int
        Numbers of realizations (>= 1) and of steps.

    Raises
    ------
    EmsError
        When there is no realization to draw, or the seed is negative.
    """
    if realizations < 1:
        raise EmsError(f"{realizations} realizations were asked for; give at least 1 (50 is the default)")
    if seed < 0:
        raise EmsError(f"the seed is {seed}; give a whole number that is not negative")
    initial = np.empty(realizations)
    process, measurement = np.empty((realizations, steps)), np.empty((realizations, steps))
    for pair, child in enumerate(np.random.SeedSequence(seed).spawn((realizations + 1) // 2)):
        generator = np.random.default_rng(child)
        first, both = 2 * pair, slice(2 * pair, 2 * pair + 2)
        for array, size in ((initial, None), (process, steps), (measurement, steps)):
            array[both] = generator.standard_normal(size)
            array[first + 1 : first + 2] *= -1.0
    return Noise(initial, process, measurement)

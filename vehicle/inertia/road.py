r"""Rough roads after ISO 8608: two tracks of the class's roughness, coherent as on an isotropic surface.

The displacement of a track has the one-sided power spectral density

.. math:: G(n) = G(n_0)\,(n / n_0)^{-w}, \qquad n_0 = 0.1\ \text{cycles/m}, \quad w = 2,

and the class names :math:`G(n_0)`: 16e-6 m^3 for A, four times as much for each next one (geometric means of
the standard). If the surface looks the same in all directions, two tracks a distance B apart have the
coherence (Kamash and Robson, J. Sound Vib. 57, 1978, for an arbitrary exponent)

.. math:: \gamma(n) = \frac{2^{1 - \nu}}{\Gamma(\nu)} x^\nu K_\nu(x), \qquad x = 2 \pi n B, \quad \nu = w/2,

one for long waves, nothing for short ones. Half sum and half difference of the tracks are independent, of
density :math:`G (1 \pm \gamma) / 2`; each is drawn in the frequency domain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gamma, kv

from vehicle.errors import VehicleError
from vehicle.inertia.log import check_name

Array = NDArray[np.float64]

ROUGHNESS_M3 = {"A": 16e-6, "B": 64e-6, "C": 256e-6, "D": 1024e-6, "E": 4096e-6}
"""G(n_0) of a class."""

REFERENCE_PER_M = 0.1
WAVINESS = 2.0
LONGEST_M, SHORTEST_M = 100.0, 0.35
"""Waves that a road has: about those of the standard, 0.011 to 2.83 cycles/m."""


@dataclass(frozen=True, eq=False)
class Road:
    """Heights of a left and a right track.

    Parameters
    ----------
    distance_m : ndarray, shape (n,)
        Uniform, from 0.
    left_m, right_m : ndarray, shape (n,)
    """

    distance_m: Array
    left_m: Array
    right_m: Array

    def smooth(self, over_m: float) -> Road:
        """Average both tracks over a length, as the contact of a tyre does."""
        count = max(round(over_m / (self.distance_m[1] - self.distance_m[0])), 1)
        window = np.full(count, 1.0 / count)
        left, right = (np.convolve(track, window, "same") for track in (self.left_m, self.right_m))
        return Road(self.distance_m, left, right)

    def under(self, distance_m: Array, wheelbase_m: float) -> Array:
        """Heights under the four wheels with the front axle at ``distance_m``, shape (n, 4).

        The rear axle follows in the tracks of the front; the road is level before its start and after its
        end.
        """
        behind = distance_m - wheelbase_m
        columns = [
            np.interp(at, self.distance_m, track, left=0.0, right=0.0)
            for at in (distance_m, behind)
            for track in (self.left_m, self.right_m)
        ]
        return np.column_stack(columns)


def psd_m3(roughness: str, wave_number_per_m: ArrayLike) -> Array:
    """Give the one-sided power spectral density of a class, m^3, at wave numbers in cycles per metre.

    Raises
    ------
    VehicleError
        When the class is unknown.
    """
    check_name("road class", roughness, tuple(ROUGHNESS_M3))
    ratio = np.asarray(wave_number_per_m, dtype=np.float64) / REFERENCE_PER_M
    return np.asarray(ROUGHNESS_M3[roughness] * ratio**-WAVINESS, dtype=np.float64)


def coherence(wave_number_per_m: ArrayLike, apart_m: float) -> Array:
    """Give the coherence of two tracks a distance apart, in [0, 1]."""
    x = 2.0 * np.pi * apart_m * np.asarray(wave_number_per_m, dtype=np.float64)
    order = 0.5 * WAVINESS
    # The limit at 0 is one; beyond 700 the Bessel function underflows to the right value, zero.
    safe = np.maximum(x, 1e-12)
    value = 2.0 ** (1.0 - order) / gamma(order) * safe**order * kv(order, safe)
    return np.asarray(np.clip(value, 0.0, 1.0), dtype=np.float64)


def make_road(
    roughness: str,
    length_m: float,
    track_m: float,
    generator: np.random.Generator,
    *,
    spacing_m: float = 0.05,
) -> Road:
    """Draw a road.

    Parameters
    ----------
    roughness : {"A", "B", "C", "D", "E"}
        Class of ISO 8608.
    length_m, track_m : float
        Length, and distance between the tracks.
    generator : numpy.random.Generator
    spacing_m : float
        Between points.

    Returns
    -------
    Road

    Raises
    ------
    VehicleError
        When the class is unknown or a length not positive.
    """
    if not (0.0 < spacing_m <= 0.5 * SHORTEST_M and spacing_m < length_m < np.inf and 0.0 < track_m < np.inf):
        raise VehicleError(
            f"a road needs positive lengths and a spacing of at most {0.5 * SHORTEST_M:g} m, got"
            f" {length_m:g} m, {track_m:g} m and {spacing_m:g} m"
        )
    # Longer than asked for, since a Fourier series repeats itself.
    count = 2 * int(np.ceil(0.5 * (length_m + LONGEST_M) / spacing_m))
    wave = np.fft.rfftfreq(count, spacing_m)
    inside = (wave >= 1.0 / LONGEST_M) & (wave <= 1.0 / SHORTEST_M)
    density = np.zeros_like(wave)
    density[inside] = psd_m3(roughness, wave[inside])
    together = coherence(wave, track_m)
    half_sum = _draw(0.5 * density * (1.0 + together), count, spacing_m, generator)
    half_difference = _draw(0.5 * density * (1.0 - together), count, spacing_m, generator)
    keep = int(length_m / spacing_m) + 1
    # Eased in over the longest wave: no vehicle drops onto a road.
    distance = spacing_m * np.arange(keep, dtype=np.float64)
    ease = 0.5 - 0.5 * np.cos(np.pi * np.minimum(distance / LONGEST_M, 1.0))
    return Road(
        distance,
        ease * (half_sum + half_difference)[:keep],
        ease * (half_sum - half_difference)[:keep],
    )


def _draw(density: Array, count: int, spacing_m: float, generator: np.random.Generator) -> Array:
    """Draw a Gaussian signal of a one-sided density, shape (count,)."""
    step = 1.0 / (count * spacing_m)
    sd = np.sqrt(density * step)
    normal = generator.standard_normal((2, density.size))
    return np.fft.irfft(sd * (normal[0] + 1j * normal[1]) * (0.5 * count), count)

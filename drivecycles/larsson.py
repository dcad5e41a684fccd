"""The altitude profile of the preset cycle `larsson`.

[L] Figure 5 draws HWFET and FTP-72 over a "plausible altitude profile" without giving its values. Ours is a
sum of sines over the distance of one lap of length L,

    z(x) = sum over k of A_k sin(2 pi n_k x / L),

with (n_k, A_k) in `HARMONICS_M`: hills 2.6 to 28.5 km long, altitudes within 21 m of the start, slopes up to
1.8 %. It is smooth, zero at the start, and equal on every lap, so the trip ends where it began.
"""

import numpy as np
import numpy.typing as npt

HARMONICS_M: tuple[tuple[int, float], ...] = ((1, 14.0), (2, -6.0), (5, 5.0), (11, 2.5))
"""Waves per lap and their amplitudes in metres."""


def larsson_altitude_m(position_m: npt.NDArray[np.float64], lap_m: float) -> npt.NDArray[np.float64]:
    """Evaluate the profile.

    Parameters
    ----------
    position_m : ndarray
        Distance from the start.
    lap_m : float
        Length of one lap.

    Returns
    -------
    ndarray
        Altitude above the start in metres, of the shape of `position_m`.
    """
    phase = 2.0 * np.pi * np.asarray(position_m) / lap_m
    altitude = np.zeros_like(phase)
    for waves, amplitude_m in HARMONICS_M:
        altitude += amplitude_m * np.sin(waves * phase)
    return altitude

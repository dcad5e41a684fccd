"""Pictures of a cell's model: open-circuit voltage and polynomial ([M] Fig 25), a pulse test (Fig 26)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from bms.identify import Identification
from bms.ocv import OcvCurve
from bms.ocv_fit import OcvFit
from bms.ocv_polynomial import OcvPolynomial
from bms.plot import new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_POINTS = 801


def plot_polynomial(curve: OcvCurve, polynomial: OcvPolynomial, ax: Axes | None = None) -> Axes:
    """Draw an open-circuit voltage and its polynomial, the ranges where that falls shaded ([M] Fig 25b).

    Parameters
    ----------
    curve : OcvCurve
        The table; its voltage is drawn over the range of the fit.
    polynomial : OcvPolynomial
        The fit.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        SOC in per cent, voltage in V.
    """
    ax = ax or new_axes()
    soc = np.linspace(polynomial.low, polynomial.high, _POINTS)
    ax.plot(100.0 * soc, curve(soc), label="table")
    ax.plot(
        100.0 * soc, polynomial(soc), "--", label=f"polynomial of degree {polynomial.polynomial.degree()}"
    )
    for k, (low, high) in enumerate(polynomial.falls):
        label = "polynomial falls" if k == 0 else None
        ax.axvspan(100.0 * low, 100.0 * high, color="0.5", alpha=0.25, linewidth=0.0, label=label)
    ax.set(xlabel="SOC [%]", ylabel="open-circuit voltage [V]")
    ax.legend(loc="upper left")
    return ax


def plot_branches(fit: OcvFit, ax: Axes | None = None) -> Axes:
    """Draw the charge branch, the discharge branch and the voltage between them ([M] Fig 25a).

    Parameters
    ----------
    fit : OcvFit
        Found from slow branches.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        SOC in per cent, voltage in V.
    """
    ax = ax or new_axes()
    for sign, label in ((1.0, "charge"), (-1.0, "discharge")):
        ax.plot(100.0 * fit.soc, fit.ocv_V + sign * fit.hysteresis_V, linewidth=1.0, label=label)
    ax.plot(100.0 * fit.soc, fit.ocv_V, color="black", label="open-circuit voltage")
    ax.set(xlabel="SOC [%]", ylabel="voltage [V]", xlim=(0.0, 100.0))
    ax.legend(loc="lower right")
    return ax


def plot_pulse(
    time_s: ArrayLike, voltage_V: ArrayLike, found: Identification, ax: Axes | None = None
) -> Axes:
    """Draw the measured response to a pulse test and that of the fitted model ([M] Fig 26b).

    Parameters
    ----------
    time_s, voltage_V : array_like, shape (n,)
        The test that was given to `identify_pulse`.
    found : Identification
        What it found.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        Time in s, voltage in V; the title says how far the two are apart.
    """
    ax = ax or new_axes()
    ax.plot(time_s, voltage_V, ".", markersize=3, label="measured")
    ax.plot(time_s, found.voltage_V, label="model")
    ax.set(
        xlabel="time [s]",
        ylabel="terminal voltage [V]",
        title=f"residual {1e3 * found.residual_rms_V:.2g} mV rms",
    )
    ax.legend(loc="best")
    return ax

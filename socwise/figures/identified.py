"""[L]'s model of uncertainty beside what an estimator claims and how wrong it is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ems.records import Case
from socwise.figures.style import DRAWN_STRETCHES, ESTIMATE, INK, LIMIT, PERCENT, draw, finish, new_axes
from socwise.thinning import stride_for

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bms import Pack
    from bms.uncertainty import UncertaintyModel
    from bms.uncertainty_fit import Behaviour

Array = NDArray[np.float64]
MODEL = "#b3532b"
_SHOWN = 12


def plot_identified(
    behaviour: Behaviour, pack: Pack, model: UncertaintyModel, ax: Axes | None = None
) -> Axes:
    """Plot real error, claimed standard deviation and the model's, as root mean squares over realizations.

    Parameters
    ----------
    behaviour : Behaviour
        What the estimator did.
    pack : Pack
        Gives alpha.
    model : UncertaintyModel
        gamma, beta and mu.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        SOC in per cent over time in s.
    """
    from bms.uncertainty_fit import model_variance

    ax = ax or new_axes()
    time_s = behaviour.step_s * np.arange(behaviour.soc.shape[1], dtype=np.float64)
    said = model_variance(behaviour, pack, model)[0]
    keep = slice(None, None, stride_for(time_s.size, DRAWN_STRETCHES))
    for place, error in enumerate(behaviour.error[:_SHOWN]):
        size, label = PERCENT * np.abs(error[keep]), None if place else "|error| of single realizations"
        ax.plot(time_s[keep], size, color=LIMIT, linewidth=0.5, alpha=0.6, label=label)
    real = _root(np.square(behaviour.error))
    draw(ax, time_s, real, color=INK, linewidth=1.2, label="real error, rms")
    draw(ax, time_s, _root(behaviour.variance), color=ESTIMATE, linewidth=1.4, label="claimed, √p")
    draw(ax, time_s, _root(said), color=MODEL, linewidth=1.4, linestyle="--", label="[L]'s model, √m")
    ax.set(xlabel="time [s]", ylabel="SOC error [%]")
    ax.set_xlim(time_s[0], time_s[-1])
    ax.set_ylim(bottom=0.0)
    return finish(ax)


def new_figure() -> Figure:
    """An empty figure of the size of one panel, without a window."""
    from matplotlib.figure import Figure

    return Figure(figsize=(7.0, 3.6), layout="constrained")


def behaviour_of_case(case: Case) -> Behaviour:
    """What the estimator did in a case, a single realization twice."""
    from bms.uncertainty_fit import Behaviour

    rollout = case.rollout
    rows = [0, 0] if rollout.soc.shape[0] == 1 else slice(None)
    soc, estimate, variance, current_A = (
        np.asarray(array[rows], dtype=np.float64)
        for array in (rollout.soc, rollout.soc_estimate, rollout.variance, rollout.current_A)
    )
    return Behaviour(
        step_s=float(rollout.time_s[1] - rollout.time_s[0]),
        soc=estimate,
        error=soc - estimate,
        variance=variance,
        current_A=current_A,
    )


def _root(square: Array) -> Array:
    return np.asarray(PERCENT * np.sqrt(square.mean(axis=0)), dtype=np.float64)

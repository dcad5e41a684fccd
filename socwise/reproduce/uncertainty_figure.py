"""[L] Fig 2: the measurement variance over SOC, and the estimation uncertainty over time (eq 9)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bms import PiecewiseLinear
from ems.concept import load_concept
from socwise.figures.style import LIMIT, finish
from socwise.reproduce.forward import Settings, settled_variance, simulate_variance
from socwise.reproduce.panels import COLORS, new_figure
from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import Progress
from socwise.reproduce.sources import MUS, SQRT_P, larsson

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NOTE = (
    "HEV pack, h = 1 s; unless varied, SOC 65 %, 23 A, gamma = 1e-6, beta = 3.9e-7, mu = 0.002. alpha is the"
    " inverse slope of the open-circuit voltage, scaled to a maximum of one (ERRATA.md). The picture shows"
    " sqrt(p) in per cent of SOC; the paper draws p."
)

DURATION_S, REST_FROM_S, TRANSIENT_S = 240, 200, 500
_BASE = Settings()
_GAMMAS, _BETAS = (0.3e-6, 1e-6, 10e-6), (1.3e-7, 3.9e-7, 11.7e-7)
_SOCS, _CURRENTS_A = (0.10, 0.60, 0.95), (0.0, 10.0, 23.0, 50.0)
_MIDDLE_SOC = 0.6
Array = NDArray[np.float64]


def reproduce(*, jobs: int = 2, progress: Progress | None = None) -> Reproduction:
    """Simulate eq 9 forwards; ``jobs`` and ``progress`` are not used."""
    alpha = load_concept("hev").load_pack().ocv.alpha
    rows = (*_levels(alpha), *_trends(alpha))
    return Reproduction("larsson-fig2", larsson("Fig 2"), rows, NOTE, lambda: _draw(alpha))


def _percent(variance: Array) -> list[float]:
    return [100.0 * float(value) for value in np.sqrt(variance)]


def _levels(alpha: PiecewiseLinear) -> list[Row]:
    rows = []
    for mu, own in zip(MUS, _percent(settled_variance(replace(_BASE, mu=MUS), alpha)), strict=True):
        name = f"sqrt(p) settled at 65 % SOC, 23 A, mu = {mu:g}, ERRATA.md: about {SQRT_P[mu]:g}"
        rows.append(Row(name, None, own, 0.1, abs(own - SQRT_P[mu]) <= 0.1, "% SOC"))
    return rows


def _trends(alpha: PiecewiseLinear) -> list[Row]:
    def ordered(name: str, **varied: Sequence[float]) -> Row:
        own = _percent(settled_variance(replace(_BASE, **varied), alpha))
        return Row.holds(name, bool(np.all(np.diff(own) > 0.0)), " < ".join(f"{x:.3f}" for x in own), "% SOC")

    def at(name: str, end: float) -> Row:
        own = _percent(settled_variance(replace(_BASE, soc=(end, _MIDDLE_SOC)), alpha))
        return Row.holds(name, own[0] < own[1], f"{own[0]:.3f} < {own[1]:.3f}", "% SOC")

    transient = _percent(
        simulate_variance(_BASE, alpha, TRANSIENT_S, rest_from_s=REST_FROM_S)[[REST_FROM_S, TRANSIENT_S], 0]
    )
    return [
        ordered("settled sqrt(p) rises with gamma (0.3, 1, 10 e-6)", gamma=_GAMMAS),
        ordered("settled sqrt(p) rises with beta (1.3, 3.9, 11.7 e-7)", beta=_BETAS),
        ordered("settled sqrt(p) rises with mu (0.7, 2, 6 e-3)", mu=MUS),
        ordered("settled sqrt(p) rises with |i| (0, 10, 23, 50 A)", current_A=_CURRENTS_A),
        at("settled sqrt(p) is lower at 10 % SOC than at 60 %", 0.10),
        at("settled sqrt(p) is lower at 95 % SOC than at 60 %", 0.95),
        Row.holds(
            "sqrt(p) falls while there is no current, 300 s later",
            transient[1] < transient[0],
            f"{transient[1]:.3f} < {transient[0]:.3f}",
            "% SOC",
        ),
    ]


def _draw(alpha: PiecewiseLinear) -> Figure:
    figure = new_figure(10.0, 6.0)
    panels = figure.subplots(2, 3)
    _draw_measurement(panels[0, 0], alpha)
    _draw_family(panels[0, 1], alpha, "drift γ", [f"γ = {1e6 * x:g}·10⁻⁶" for x in _GAMMAS], gamma=_GAMMAS)
    _draw_family(
        panels[0, 2], alpha, "drift per ampere β", [f"β = {1e7 * x:g}·10⁻⁷" for x in _BETAS], beta=_BETAS
    )
    currents = _CURRENTS_A[1:]
    _draw_family(
        panels[1, 0],
        alpha,
        f"current, zero after {REST_FROM_S} s",
        [f"{x:g} A" for x in currents],
        current_A=currents,
        rest=True,
    )
    _draw_family(panels[1, 1], alpha, "measurement μ", [f"μ = {x:g}" for x in MUS], mu=MUS)
    _draw_family(panels[1, 2], alpha, "state of charge", [f"SOC {x:.0%}" for x in _SOCS], soc=_SOCS)
    for ax in panels.flat[1:]:
        ax.set_ylim(0.0, 2.0)
    return figure


def _draw_measurement(ax: Axes, alpha: PiecewiseLinear) -> None:
    soc = np.linspace(0.0, 1.0, 501)
    for mu, color in zip(MUS, COLORS, strict=True):
        ax.plot(100.0 * soc, 1e3 * mu * alpha(soc), color=color, label=f"μ = {mu:g}")
    ax.set(title="measurement variance", xlabel="SOC [%]", ylabel="μ α [10⁻³ SOC²]", xlim=(0.0, 100.0))
    ax.set_ylim(0.0, 9.0)
    ax.legend(loc="upper right", frameon=False)
    finish(ax)


def _draw_family(
    ax: Axes, alpha: PiecewiseLinear, title: str, labels: Sequence[str], *, rest: bool = False, **varied: Any
) -> None:
    duration = TRANSIENT_S if rest else DURATION_S
    variance = simulate_variance(
        replace(_BASE, **varied), alpha, duration, rest_from_s=REST_FROM_S if rest else None
    )
    for curve, color, label in zip(variance.T, COLORS, labels, strict=True):
        ax.plot(np.arange(duration + 1), 100.0 * np.sqrt(curve), color=color, label=label)
    if rest:
        ax.axvline(REST_FROM_S, color=LIMIT, linewidth=0.8, linestyle=(0, (5, 3)))
    ax.set(title=title, xlabel="time [s]", ylabel="√p [% SOC]", xlim=(0.0, duration))
    ax.legend(loc="upper right" if rest else "lower right", frameon=False)
    finish(ax)

"""What is published: citation, and the values that several items share."""

from __future__ import annotations

LARSSON = (
    "Larsson, Johannesson, Egardt: Influence of state of charge estimation uncertainty on energy management"
    " strategies for hybrid electric vehicles"
)

MAUTC = (
    "Fathy, Sandu, Unnikrishnan: A stochastic approach to online vehicle state and parameter estimation,"
    " report MAUTC-2010-02"
)

CONCEPTS = ("hev", "phev")
CYCLE = "larsson"
MUS = (0.7e-3, 2.0e-3, 6.0e-3)
LOW, MEDIUM, HIGH = MUS
MU_NAMES = dict(zip(MUS, ("low", "medium", "high"), strict=True))

SQRT_P = {LOW: 0.9, MEDIUM: 1.2, HIGH: 1.5}
"""Where sqrt(p) of the HEV settles, in per cent of SOC, with alpha scaled to a maximum of one (ERRATA.md)."""


def larsson(place: str) -> str:
    """Cite a table or figure of [L]."""
    return f"{LARSSON}, {place}"


def mautc(place: str) -> str:
    """Cite a table or figure of [M]."""
    return f"{MAUTC}, {place}"

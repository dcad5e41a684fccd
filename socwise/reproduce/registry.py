"""The tables and figures that can be reproduced, by id.

Importing the registry is cheap: an item's module is imported when it is run.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module

from socwise.reproduce.record import Reproduction

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Item:
    """Where an item is made.

    Parameters
    ----------
    title : str
        What it shows, in a few words.
    module, function : str
        Module under ``socwise.reproduce`` and its function ``f(*, jobs, progress) -> Reproduction``.
    """

    title: str
    module: str
    function: str = "reproduce"


_ITEMS: dict[str, Item] = {
    "larsson-table1": Item("vehicle data", "table1"),
    "larsson-table2": Item("fuel and final SOC estimate over mu, 200 realizations", "table2"),
    "larsson-fig1": Item("voltage over SOC", "ocv_figure"),
    "larsson-fig2": Item("measurement variance and estimation uncertainty", "uncertainty_figure"),
    "larsson-fig4": Item("penalties Gamma and Upsilon over SOC", "penalty_figure"),
    "larsson-fig5": Item("drive cycle", "cycle_figure"),
    "larsson-fig6": Item("HEV, medium mu: realizations", "realizations", "figure6"),
    "larsson-fig7": Item("HEV, low and high mu: realizations", "realizations", "figure7"),
    "larsson-fig8": Item("PHEV, medium mu: realizations", "realizations", "figure8"),
    "larsson-fig9": Item("PHEV, low and high mu: realizations", "realizations", "figure9"),
    "mautc-table7": Item("battery model, first guesses and estimates", "battery_tables", "table7"),
    "mautc-table8": Item("gains of the gradient and their stability", "battery_tables", "table8"),
    "mautc-fig25": Item("open-circuit voltage and its polynomial", "ocv_fit_figure"),
    "mautc-fig26": Item("pulse test and the model found in it", "pulse_figure"),
    "mautc-fig27": Item("FTP-72 and the PHEV's cell current", "current_figures", "figure27"),
    "mautc-fig28": Item("battery cycling between 20 and 80 % SOC", "current_figures", "figure28"),
    "mautc-fig30": Item("battery parameters over 10 days, N = 2, 3, 4", "estimates_figure"),
    "mautc-fig31": Item("SOC and voltage errors over 10 days", "errors_figure"),
    "mautc-fig32": Item("battery degradation map", "lifetime_figures", "figure32"),
    "mautc-fig33": Item("battery health over 100 days", "lifetime_figures", "figure33"),
}


def ids() -> tuple[str, ...]:
    """Ids of all items, in the order of the sources."""
    return tuple(_ITEMS)


def title(item: str) -> str:
    """Say in a few words what an item shows; an unknown id is an `EmsError`, as in `run`."""
    return _find(item).title


def run(item: str, *, jobs: int = 2, progress: Progress | None = None) -> Reproduction:
    """Reproduce an item.

    Parameters
    ----------
    item : str
        One of `ids`, in upper or lower case.
    jobs : int
        Threads that solve and simulate, where the item does; the result does not depend on it.
    progress : callable, optional
        Called with the number of finished tasks and of all tasks; not at all where nothing takes time.

    Returns
    -------
    Reproduction

    Raises
    ------
    EmsError
        If there is no such item; suggests the nearest.
    """
    found = _find(item)
    function: Callable[..., Reproduction] = getattr(
        import_module(f"socwise.reproduce.{found.module}"), found.function
    )
    return function(jobs=jobs, progress=progress)


def _find(item: str) -> Item:
    known = item.strip().lower()
    if known not in _ITEMS:
        from ems.errors import EmsError

        near = difflib.get_close_matches(known, _ITEMS, n=1, cutoff=0.5)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise EmsError(f"there is nothing to reproduce called {item!r}; known are {', '.join(_ITEMS)}{hint}")
    return _ITEMS[known]

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
    "mautc-table1": Item(
        "mass-spring, unmodified filter: settings and failure", "mass_spring_items", "table1"
    ),
    "mautc-table2": Item("mass-spring, modified filter and those to use", "mass_spring_items", "table2"),
    "mautc-table3": Item("ride model without sensor noise", "ride_items", "table3"),
    "mautc-table4": Item("ride model with sensor noise, six methods", "ride_items", "table4"),
    "mautc-table5": Item("mass and centre of gravity, urban drives", "load_transfer_items", "table5"),
    "mautc-table6": Item("mass and centre of gravity, rural drives", "load_transfer_items", "table6"),
    "mautc-fig1": Item("mass-spring, unmodified filter: position", "mass_spring_items", "figure1"),
    "mautc-fig2": Item("mass-spring, unmodified filter: velocity", "mass_spring_items", "figure2"),
    "mautc-fig3": Item("mass-spring, unmodified filter: mass", "mass_spring_items", "figure3"),
    "mautc-fig4": Item("mass-spring, modified filter: position", "mass_spring_items", "figure4"),
    "mautc-fig5": Item("mass-spring, modified filter: velocity", "mass_spring_items", "figure5"),
    "mautc-fig6": Item("mass-spring, modified filter: mass", "mass_spring_items", "figure6"),
    "mautc-fig7": Item("ride model, CG height, without sensor noise", "ride_items", "figure7"),
    "mautc-fig8": Item("ride model, mass, without sensor noise", "ride_items", "figure8"),
    "mautc-fig9": Item("ride model, pitch inertia, without sensor noise", "ride_items", "figure9"),
    "mautc-fig10": Item("ride model, roll inertia, without sensor noise", "ride_items", "figure10"),
    "mautc-fig11": Item("ride model, CG height, with sensor noise", "ride_items", "figure11"),
    "mautc-fig12": Item("ride model, mass, with sensor noise", "ride_items", "figure12"),
    "mautc-fig13": Item("ride model, pitch inertia, with sensor noise", "ride_items", "figure13"),
    "mautc-fig14": Item("ride model, roll inertia, with sensor noise", "ride_items", "figure14"),
    "mautc-fig17": Item("mass, urban drives", "load_transfer_items", "figure17"),
    "mautc-fig18": Item("lateral position of the CG, urban drives", "load_transfer_items", "figure18"),
    "mautc-fig19": Item("longitudinal position of the CG, urban drives", "load_transfer_items", "figure19"),
    "mautc-fig20": Item("mass, rural drives", "load_transfer_items", "figure20"),
    "mautc-fig21": Item("lateral position of the CG, rural drives", "load_transfer_items", "figure21"),
    "mautc-fig22": Item("longitudinal position of the CG, rural drives", "load_transfer_items", "figure22"),
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
    "mautc-table9": Item("Greenshields, sd 3, t = 1 s: errors and means", "traffic_tables", "table9"),
    "mautc-table10": Item("Greenshields, sd 3, t = 300 s: errors and means", "traffic_tables", "table10"),
    "mautc-table11": Item("Underwood, sd 3, t = 1 s: errors and means", "traffic_tables", "table11"),
    "mautc-table12": Item("Underwood, sd 3, t = 300 s: errors and means", "traffic_tables", "table12"),
    "mautc-table13": Item(
        "Greenshields, sd 6, t = 150 s: antithetic and plain errors", "traffic_tables", "table13"
    ),
    "mautc-table14": Item(
        "Greenshields, sd 6, t = 300 s: antithetic and plain errors", "traffic_tables", "table14"
    ),
    "mautc-table15": Item(
        "Greenshields, sd 10, t = 150 s: antithetic and plain errors", "traffic_tables", "table15"
    ),
    "mautc-table16": Item(
        "Greenshields, sd 10, t = 300 s: antithetic and plain errors", "traffic_tables", "table16"
    ),
    "mautc-table17": Item(
        "Underwood, sd 6, t = 150 s: antithetic and plain errors", "traffic_tables", "table17"
    ),
    "mautc-table18": Item(
        "Underwood, sd 6, t = 300 s: antithetic and plain errors", "traffic_tables", "table18"
    ),
    "mautc-table19": Item(
        "Underwood, sd 10, t = 150 s: antithetic and plain errors", "traffic_tables", "table19"
    ),
    "mautc-table20": Item(
        "Underwood, sd 10, t = 300 s: antithetic and plain errors", "traffic_tables", "table20"
    ),
    "mautc-fig34": Item("Greenshields, mean: speed at location 1", "traffic_figures", "figure34"),
    "mautc-fig35": Item("Greenshields, mean: speed at location 2", "traffic_figures", "figure35"),
    "mautc-fig36": Item("Greenshields, mean: speed at location 3", "traffic_figures", "figure36"),
    "mautc-fig37": Item("Greenshields, mean: speed at location 4", "traffic_figures", "figure37"),
    "mautc-fig38": Item("Greenshields, five draws: speed at location 1", "traffic_figures", "figure38"),
    "mautc-fig39": Item("Greenshields, five draws: speed at location 2", "traffic_figures", "figure39"),
    "mautc-fig40": Item("Greenshields, five draws: speed at location 3", "traffic_figures", "figure40"),
    "mautc-fig41": Item("Greenshields, five draws: speed at location 4", "traffic_figures", "figure41"),
    "mautc-fig42": Item("Underwood, mean: speed at location 1", "traffic_figures", "figure42"),
    "mautc-fig43": Item("Underwood, mean: speed at location 2", "traffic_figures", "figure43"),
    "mautc-fig44": Item("Underwood, mean: speed at location 3", "traffic_figures", "figure44"),
    "mautc-fig45": Item("Underwood, mean: speed at location 4", "traffic_figures", "figure45"),
    "mautc-fig46": Item("Underwood, five draws: speed at location 1", "traffic_figures", "figure46"),
    "mautc-fig47": Item("Underwood, five draws: speed at location 2", "traffic_figures", "figure47"),
    "mautc-fig48": Item("Underwood, five draws: speed at location 3", "traffic_figures", "figure48"),
    "mautc-fig49": Item("Underwood, five draws: speed at location 4", "traffic_figures", "figure49"),
    "mautc-fig50": Item("5 antithetic against 100 plain runs, and a chaos", "traffic_sampling_figure"),
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

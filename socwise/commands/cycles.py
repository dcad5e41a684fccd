"""``socwise cycles``: what there is to drive."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from socwise.commands.files import check_file, staged_file
from socwise.commands.screen import new_table, show

if TYPE_CHECKING:
    from drivecycles import DriveCycle

cycles = typer.Typer(no_args_is_help=True, help="List, describe and draw drive cycles.")

PICTURES = (".png", ".svg", ".pdf")
_KMH_PER_MPS = 3.6
_DPI = 150

NameArgument = Annotated[
    str, typer.Argument(metavar="NAME", help="Cycle of the library, a CSV file, or several joined by '+'.")
]


@cycles.command("list")
def list_cycles() -> None:
    """List the cycles that come with socwise."""
    from drivecycles import cycle_info, cycle_names, load_cycle

    table = new_table("cycle", "what it is", "s", "km", left=2)
    for name in cycle_names():
        cycle = load_cycle(name)
        table.add_row(
            name, cycle_info(name).title, f"{cycle.duration_s:.0f}", f"{cycle.distance_m / 1e3:.2f}"
        )
    show(table)


@cycles.command("show")
def show_cycle(name: NameArgument) -> None:
    """Describe a cycle: source, duration, distance, speeds, accelerations, road."""
    from drivecycles import CycleError, cycle_info, load_cycle

    cycle = load_cycle(name)
    table = new_table("cycle", cycle.name, left=2)
    try:
        info = cycle_info(name)
    except CycleError:
        pass  # the user's own, or several joined
    else:
        table.add_row("title", info.title)
        table.add_row("what it is", info.description)
        table.add_row("source", info.source)
    for label, value in _facts(cycle):
        table.add_row(label, value)
    show(table)


@cycles.command("plot")
def plot_cycle(
    name: NameArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Picture to write: .png, .svg or .pdf.", show_default="results/NAME.png"
        ),
    ] = None,
) -> None:
    """Draw speed and altitude of a cycle."""
    from drivecycles import load_cycle

    cycle = load_cycle(name)
    path = out or Path("results") / f"{_safe(cycle.name)}.png"
    check_file(path, *PICTURES)
    from matplotlib.figure import Figure

    from drivecycles.plot import plot_cycle as draw

    figure = Figure(figsize=(9.0, 3.2), layout="constrained")
    draw(cycle, figure.add_subplot())
    with staged_file(path) as staging:
        figure.savefig(staging, dpi=_DPI)
    show(f"The picture is {path}")


def _facts(cycle: DriveCycle) -> list[tuple[str, str]]:
    numbers = cycle.statistics()
    return [
        ("samples", str(len(cycle))),
        ("duration", f"{numbers.duration_s:.0f} s"),
        ("distance", f"{numbers.distance_m / 1e3:.3f} km"),
        ("mean speed", f"{_KMH_PER_MPS * numbers.mean_speed_mps:.1f} km/h"),
        ("mean speed, moving", f"{_KMH_PER_MPS * numbers.mean_moving_speed_mps:.1f} km/h"),
        ("greatest speed", f"{_KMH_PER_MPS * numbers.max_speed_mps:.1f} km/h"),
        ("acceleration", f"{numbers.min_acceleration_mps2:.2f} to {numbers.max_acceleration_mps2:.2f} m/s²"),
        ("stops", str(numbers.stops)),
        ("standing", f"{100.0 * numbers.idle_fraction:.1f} % of the time"),
        ("climb", f"{numbers.ascent_m:.0f} m"),
        ("grade", f"{100.0 * numbers.min_grade:.1f} to {100.0 * numbers.max_grade:.1f} %"),
    ]


def _safe(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.+-]+", "-", name).strip("-.") or "cycle"

"""Pictures of a comparison. Every plot takes and returns an ``ax``; no window is opened."""

from socwise.figures.belief import plot_ensemble, plot_error, plot_soc, plot_spread
from socwise.figures.cost import plot_cost_split, plot_differences
from socwise.figures.files import write_figures
from socwise.figures.operation import plot_current, plot_engine, plot_speed

__all__ = [
    "plot_cost_split",
    "plot_current",
    "plot_differences",
    "plot_engine",
    "plot_ensemble",
    "plot_error",
    "plot_soc",
    "plot_speed",
    "plot_spread",
    "write_figures",
]

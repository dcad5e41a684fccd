"""The cost of certainty equivalence over the factors of a study, as a map."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

from socwise.figures.style import INK, LIMIT
from socwise.labels import CERTAINTY_EQUIVALENT, STOCHASTIC, concept_label
from socwise.report.study_influence import factor_label, value_label
from socwise.report.study_judge import Judged

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEAST, MOST = 1.0, 1000.0
"""Between these the colour changes, in the logarithm; in per cent."""
_DARK = 0.55
_HATCH = "/////"


def plot_loss_map(
    judged: Sequence[Judged], x: Sequence[str], y: Sequence[str], ax: Axes | None = None
) -> Axes:
    """Draw what certainty equivalence costs, a cell for each case, hatched where it may be nothing.

    Parameters
    ----------
    judged : sequence of Judged
        Cases, from `socwise.report.study_judge.judge`. Of several that meet in a cell the last is drawn.
    x, y : sequence of str
        Factors along the two axes; of several on one axis the last varies fastest.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure if not given.

    Returns
    -------
    matplotlib.axes.Axes
        Numbers and colours are the loss in per cent of the stochastic policy's realised cost. A hatched cell
        has a 95 % interval that holds zero; a cross is a case that is not to be trusted, because a policy
        left its grid; an empty cell has no finished case.
    """
    from matplotlib.patches import Rectangle

    ax = ax or _new_axes()
    columns, rows = _places(judged, x), _places(judged, y)
    colors = _colors()
    for one in judged:
        at = columns[_values(one, x)], rows[_values(one, y)]
        if one.percent is None:
            continue
        if one.doubts:
            ax.text(*at, "×", ha="center", va="center", fontsize=6.5, color=LIMIT)
            continue
        shade = _shade(one.percent)
        look: dict[str, Any] = {"facecolor": colors(shade), "edgecolor": "white", "linewidth": 0.5}
        ax.add_patch(Rectangle((at[0] - 0.5, at[1] - 0.5), 1.0, 1.0, **look))
        if may_be_nothing(one):
            hatched = Rectangle((at[0] - 0.5, at[1] - 0.5), 1.0, 1.0, fill=False, hatch=_HATCH, linewidth=0.0)
            hatched.set_edgecolor("#9A9A9A")
            ax.add_patch(hatched)
        color = "white" if shade > _DARK else INK
        ax.text(*at, _number(one.percent), ha="center", va="center", fontsize=6.5, color=color)
    _label(ax, x, columns, y, rows)
    return ax


def plot_atlas(
    judged: Sequence[Judged],
    x: Sequence[str],
    y: Sequence[str],
    panels: tuple[str, str] = ("concept", "cycle"),
) -> Figure:
    """Draw a map for each pair of values of two factors, and one scale for all.

    Parameters
    ----------
    judged, x, y
        As of `plot_loss_map`.
    panels : tuple of str
        The factors of the rows and of the columns of maps.
    """
    from matplotlib.figure import Figure

    down, across = ([*dict.fromkeys(one.case.factors[name] for one in judged)] for name in panels)
    figure = Figure(figsize=(4.4 * len(across) + 0.6, 3.6 * len(down) + 0.5), layout="constrained")
    axes = figure.subplots(len(down), len(across), squeeze=False)
    for (row, first), (column, second) in product(enumerate(down), enumerate(across)):
        wanted = (first, second)
        cases = [one for one in judged if tuple(one.case.factors[name] for name in panels) == wanted]
        ax = plot_loss_map(cases, x, y, axes[row, column])
        ax.set_title(f"{concept_label(str(first))}, {second}", fontsize="medium")
        if column:
            ax.set_ylabel("")
        if row < len(down) - 1:
            ax.set_xlabel("")
    _scale(figure, axes)
    return figure


def may_be_nothing(one: Judged) -> bool:
    """Whether the 95 % interval of the paired difference of the two policies holds zero, or is not known.

    The interval of the difference itself: that of its share of the cost is unbounded where the cost is not
    known either, and says less.
    """
    pair = one.case.pair(STOCHASTIC, CERTAINTY_EQUIVALENT) or {}
    limits = pair.get("cost_kg", {}).get("ci95")
    if limits is None:
        return not one.distinguishable
    return bool(limits[0] <= 0.0 <= limits[1])


def _new_axes() -> Axes:
    from matplotlib.figure import Figure

    return Figure(figsize=(6.0, 4.0), layout="constrained").subplots()


def _values(one: Judged, names: Sequence[str]) -> tuple[Any, ...]:
    return tuple(one.case.factors[name] for name in names)


def _places(judged: Sequence[Judged], names: Sequence[str]) -> dict[tuple[Any, ...], int]:
    levels = [sorted({one.case.factors[name] for one in judged}) for name in names]
    return {values: place for place, values in enumerate(product(*levels))}


def _shade(percent: float) -> float:
    span = math.log(MOST) - math.log(LEAST)
    return min(1.0, max(0.0, (math.log(max(percent, LEAST)) - math.log(LEAST)) / span))


def _colors() -> Any:
    from matplotlib import colormaps

    return colormaps["YlOrRd"]


def _number(percent: float) -> str:
    if abs(percent) >= 10.0:
        return f"{percent:.0f}".replace("-", "−")
    return f"{percent:.1f}".replace("-", "−").replace("−0.0", "0.0")


def _label(ax: Axes, x: Sequence[str], columns: Any, y: Sequence[str], rows: Any) -> None:
    ax.set_xlim(-0.5, len(columns) - 0.5)
    ax.set_ylim(-0.5, len(rows) - 0.5)
    ax.set_xticks(range(len(columns)), [_tick(values) for values in columns], fontsize=6.5)
    ax.set_yticks(range(len(rows)), [" | ".join(map(_value, values)) for values in rows], fontsize=6.5)
    ax.set_xlabel(" over ".join(_name(name) for name in reversed(x)), fontsize="small")
    ax.set_ylabel(" | ".join(_name(name) for name in y), fontsize="small")
    ax.tick_params(length=0)
    for side in ax.spines.values():
        side.set_visible(False)
    for names, places, line in ((x, columns, ax.axvline), (y, rows, ax.axhline)):
        inner = len({values[-1] for values in places})
        for at in range(inner, len(places), inner) if len(names) > 1 else ():
            line(at - 0.5, color=INK, linewidth=0.8)


def _tick(values: Sequence[Any]) -> str:
    return "\n".join(_value(value) for value in reversed(values))


def _value(value: Any) -> str:
    return value_label(value) if not isinstance(value, float) else f"{value:g}"


def _name(name: str) -> str:
    return factor_label(name)


def _scale(figure: Figure, axes: Any) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    bar = figure.colorbar(
        ScalarMappable(LogNorm(LEAST, MOST), _colors()), ax=axes, extend="both", shrink=0.6, aspect=30
    )
    bar.set_label(
        "Cost of certainty equivalence, % of the stochastic policy's;\nhatched: the 95 % interval holds zero"
    )


def write_atlas(judged: Sequence[Judged], x: Sequence[str], y: Sequence[str], path: Any) -> None:
    """Write the maps of a study as a picture; the same cases give the same bytes."""
    plot_atlas(judged, x, y).savefig(path, dpi=150, metadata=_metadata(path))


def _metadata(path: Any) -> dict[str, Any]:
    return {"Software": None} if str(path).endswith(".png") else {"Date": None}

"""Draw atlas.png and write studies/atlas.csv: `python docs/images/atlas.py FOLDER`, where

`socwise run docs/studies/atlas.toml --out FOLDER` has put the atlas.
"""

from __future__ import annotations

import sys
from pathlib import Path

from socwise.figures.atlas import may_be_nothing, write_atlas
from socwise.report.study_judge import Judged, judge
from socwise.results.plain import write_rows
from socwise.study import read_study

PICTURE = Path(__file__).with_suffix(".png")
TABLE = Path(__file__).parents[1] / "studies/atlas.csv"
X, Y = ["capacity_factor", "penalty_steepness"], ["window_width", "mu"]
DIGITS = 5


def row(one: Judged) -> dict[str, object]:
    """One case: factors, both costs, the paired difference with its 95 % interval, and the loss."""
    case = one.case
    pair = case.pair("stochastic", "certainty_equivalent")["cost_kg"]
    costs = {name: case.policy(name) for name in ("stochastic", "certainty_equivalent")}
    numbers = {
        **{f"{name}_cost_kg": found["cost_kg"]["mean"] for name, found in costs.items()},
        **{f"{name}_fuel_l_per_100km": found["fuel_l_per_100km"]["mean"] for name, found in costs.items()},
        **{f"{name}_outside": found["window_violation"] for name, found in costs.items()},
        "loss_kg": -pair["mean"],
        "loss_kg_low": -pair["ci95"][1],
        "loss_kg_high": -pair["ci95"][0],
        "loss_percent": one.percent,
    }
    shortened = {name: float(f"{value:.{DIGITS}g}") for name, value in numbers.items()}
    return {**case.factors, **shortened, "may_be_nothing": int(may_be_nothing(one))}


def main() -> None:
    """Read the study that the command line names."""
    judged = judge(read_study(Path(sys.argv[1])))
    write_atlas(judged, X, Y, PICTURE)
    write_rows(TABLE, [row(one) for one in judged])


if __name__ == "__main__":
    main()

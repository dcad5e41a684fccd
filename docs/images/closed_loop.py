"""Draw closed-loop.png and write the tables of docs/closed-loop.md: `python docs/images/closed_loop.py`.

Takes some minutes: both concepts, the postulated plant and the circuit, several estimators.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from bms.cells import load_cell
from drivecycles import load_cycle
from ems import load_concept
from ems.closed import ClosedLoop, Identified, Training, battery_for, compare_closed, identify
from ems.closed.identify import TRIP
from ems.closed.run import run_ensemble
from ems.compare import compare
from ems.policies import build_policy
from ems.problem import build_problem
from ems.records import Case, Comparison
from ems.simulate import summarise
from ems.statistics import mean_interval
from socwise.figures.identified import plot_identified

PAGE = Path(__file__).parents[1] / "closed-loop.md"
PICTURE = Path(__file__).parent / "closed-loop.png"
CONCEPTS = ("hev", "phev")
LOOPS = {
    "`ekf`": ClosedLoop(),
    "`ekf`, `model_error_V=0.002`": ClosedLoop(options={"model_error_V": 0.002}),
    "`ukf`": ClosedLoop(estimator="ukf"),
    "`gpc-ekf`": ClosedLoop(estimator="gpc_ekf"),
    "`gpc-gradient`": ClosedLoop(estimator="gpc_gradient"),
    "`coulomb`": ClosedLoop(estimator="coulomb"),
    "`ekf` on `--cell a123-26650`": ClosedLoop(cell=load_cell("a123-26650")),
}
JOBS = 2


def write_table(key: str, rows: list[list[str]]) -> None:
    """Put a table between its comments on the page."""
    head, *body = [f"| {' | '.join(cells)} |" for cells in rows]
    text = "\n".join([head, "|" + "---|" * len(rows[0]), *body])
    page, found = re.subn(
        rf"(% table: {re.escape(key)}\n).*?(\n% end)",
        lambda old: f"{old[1]}\n{text}\n{old[2]}",
        PAGE.read_text(encoding="utf-8"),
        flags=re.DOTALL,
    )
    if found != 1:
        raise SystemExit(f"{PAGE} has no place for the table {key}")
    PAGE.write_text(page, encoding="utf-8")


def power(value: float, error: float | None = None) -> str:
    """A small number with its standard error."""
    if value <= 1e-12:
        return "0"
    text = f"{value:.2g}" if error is None else f"{value:.2g} ± {error:.1g}"
    return text.replace("e-0", "e-").replace("e+0", "e")


def identified_row(label: str, found: Identified) -> list[str]:
    """One estimator of one concept."""
    model, errors, fit = found.fitted.model, found.fitted.standard_errors, found.fitted.fit
    bound = {note.split()[0] for note in found.fitted.notes if "upper bound" in note}
    mu = "at its bound, 100" if "mu" in bound else power(model.mu, errors.mu)
    return [
        f"{found.concept.upper()}, {label}",
        power(model.gamma, errors.gamma),
        power(model.beta, errors.beta),
        mu,
        f"{100.0 * np.sqrt(found.behaviour.variance[:, -1].mean()):.2f}",
        f"{100.0 * np.sqrt(np.mean(found.behaviour.error[:, -1] ** 2)):.2f}",
        f"{100.0 * fit.off_believed:.0f}; {100.0 * fit.off_real:.0f}",
        f"{fit.nees_estimator:.2f}; {fit.nees_model:.2f}",
        f"{fit.step_ratio:.2g}",
        f"{fit.minute_ratio:.2g}",
        f"{fit.correlation:.3f}; {fit.correlation_model:.3f}",
    ]


HEADER = [
    "",
    "γ, 1/s",
    "β, 1/(A s)",
    "μ",
    "claimed √p at the end, %",
    "rms error at the end, %",
    "model off, % of √p; of rms error",
    "e²/p; e²/m",
    "steps over model's",
    "a minute over white",
    "correlation over 5 min; model",
]


def write_identified() -> dict[str, Identified]:
    """Identify every loop, and compare with the postulated parameters."""
    rows = [[*HEADER]]
    model = load_concept("hev").uncertainty
    rows.append(["[L]", f"{model.gamma:g}", f"{model.beta:g}", "0.0007 to 0.006", *[""] * (len(HEADER) - 4)])
    found = {}
    for concept in CONCEPTS:
        for label, loop in LOOPS.items():
            one = identify(load_concept(concept), loop, load_cycle(TRIP), jobs=JOBS)
            rows.append(identified_row(label, one))
            found[f"{concept} {label}"] = one
            print(rows[-1], flush=True)
    write_table("identified", rows)
    return found


def shown(case: Case) -> list[str]:
    """Cost, fuel and the like of a case."""
    rollout = case.rollout
    cost, half = mean_interval(rollout.cost_kg)
    return [
        f"{cost:.4f} ± {half:.4f}",
        f"{case.fuel_l_per_100km.mean():.3f}",
        f"{rollout.penalty_kg.mean():.4f}",
        f"{100.0 * rollout.soc[:, -1].mean():.1f}",
        f"{100.0 * rollout.outside_window.mean():.1f}",
        "" if case.value_kg is None else f"{case.value_kg:.4f}",
    ]


def write_results(comparisons: dict[str, Comparison]) -> None:
    """Put the postulated plant beside the circuit."""
    heads = ["cost, kg", "fuel, l/100 km", "penalties, kg", "final SOC, %", "outside, %", "promised, kg"]
    rows = [["", "plant", *heads]]
    for concept in CONCEPTS:
        for name, comparison in comparisons.items():
            for case in comparison.cases:
                if case.concept == concept:
                    rows.append([f"{concept.upper()} {case.policy.replace('_', ' ')}", name, *shown(case)])
                    print(rows[-1], flush=True)
    write_table("results", rows)


def write_differences(comparisons: dict[str, Comparison]) -> None:
    """What heeding the uncertainty is worth on each plant."""
    others = ("certainty_equivalent", "rule_based", "perfect_information")
    rows = [["", "plant", *(f"{other.replace('_', ' ')}, kg" for other in others)]]
    for concept in CONCEPTS:
        for name, comparison in comparisons.items():
            costs = {c.policy: c.rollout.cost_kg for c in comparison.cases if c.concept == concept}
            cells = []
            for other in others:
                mean, half = mean_interval(costs["stochastic"] - costs[other])
                cells.append(f"{mean:+.4f} ± {half:.4f}".replace("-", "−"))
            rows.append([concept.upper(), name, *cells])
            print(rows[-1], flush=True)
    write_table("differences", rows)


def write_postulates(closed: Comparison) -> None:
    """Drive the circuit with the policy that was solved for [L]'s parameters."""
    rows = [["", "solved for", "cost, kg", "fuel, l/100 km", "final SOC, %", "more than identified, kg"]]
    loop = LOOPS["`ekf`"]
    for name in CONCEPTS:
        concept = load_concept(name)
        battery = battery_for(concept, loop)
        problem = replace(build_problem(concept, load_cycle("larsson"), pack=battery.pack), least_reach=6e-4)
        base = next(c for c in closed.cases if c.concept == name and c.policy == "stochastic")
        rows.append([name.upper(), "identified", *(shown(base)[at] for at in (0, 1, 3)), ""])
        for mu in (0.7e-3, 2e-3, 6e-3):
            policies = {"stochastic": build_policy("stochastic", problem.with_mu(mu))}
            tracks = run_ensemble(
                problem, policies, loop, battery.cell, seed=0, realizations=50, jobs=JOBS
            ).tracks["stochastic"]
            rollout = summarise(problem, tracks)
            fuel = [
                problem.vehicle.fuel_l_per_100km(float(kg), problem.demand.distance_m)
                for kg in rollout.fuel_kg
            ]
            case = replace(base, rollout=rollout, fuel_l_per_100km=np.array(fuel))
            mean, half = mean_interval(rollout.cost_kg - base.rollout.cost_kg)
            difference = f"{mean:+.4f} ± {half:.4f}".replace("-", "−")
            rows.append(
                [name.upper(), f"[L], μ = {mu:g}", *(shown(case)[at] for at in (0, 1, 3)), difference]
            )
            print(rows[-1], flush=True)
    write_table("postulates", rows)


def draw(found: dict[str, Identified]) -> None:
    """Draw error, claim and model of the EKF and of Coulomb counting."""
    figure = Figure(figsize=(8.6, 5.2), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True)
    for row, concept in zip(axes, CONCEPTS, strict=True):
        for ax, label in zip(row, ("`ekf`", "`coulomb`"), strict=True):
            one = found[f"{concept} {label}"]
            pack = battery_for(load_concept(concept), LOOPS[label]).pack
            plot_identified(one.behaviour, pack, one.fitted.model, ax)
            ax.set_title(f"{concept.upper()}, {one.estimator}", fontsize=10)
            ax.set_ylim(0.0, 3.0)
            ax.label_outer()
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    figure.savefig(PICTURE, dpi=100)


def main() -> None:
    """Run everything."""
    draw(write_identified())
    concepts, trip = [load_concept(name) for name in CONCEPTS], load_cycle("larsson")
    training, informed = Training(load_cycle(TRIP)), "`ekf`, `model_error_V=0.002`"
    comparisons = {
        "model": compare(concepts, trip, mus=(2e-3,), jobs=JOBS),
        "ecm, ekf": compare_closed(concepts, trip, LOOPS["`ekf`"], training, jobs=JOBS),
        "ecm, ekf with 2 mV": compare_closed(concepts, trip, LOOPS[informed], training, jobs=JOBS),
    }
    write_results(comparisons)
    write_differences(comparisons)
    write_postulates(comparisons["ecm, ekf"])


if __name__ == "__main__":
    main()

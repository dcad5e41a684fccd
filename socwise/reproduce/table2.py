"""[L] Table 2: fuel and final SOC estimate over mu, of both concepts, and what section 5 says of them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ems.concept import load_concept
from ems.records import Case, Comparison
from ems.statistics import mean_and_error
from socwise.reproduce.control_variate import adjust, created_charge, rise_percent
from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import Progress
from socwise.reproduce.simulation import pick, simulate
from socwise.reproduce.sources import CONCEPTS, HIGH, LOW, MUS, larsson
from socwise.reproduce.table2_figure import draw_table2

REALIZATIONS = 200
FUEL = {"hev": (3.49, 3.51, 3.55), "phev": (1.16, 1.18, 1.23)}
FINAL = {"hev": (0.655, 0.658, 0.659), "phev": (0.281, 0.284, 0.296)}
FINAL_TOLERANCE = {"hev": 0.015, "phev": 0.03}
HEV_FUEL_SHARE = 0.10
PHEV_FUEL = (0.8, 1.6)
RISE_PERCENT = {"hev": (0.5, 4.0), "phev": (1.0, 12.0)}
END_S = 300.0

Array = NDArray[np.float64]


def reproduce(
    *, jobs: int = 2, progress: Progress | None = None, realizations: int = REALIZATIONS
) -> Reproduction:
    """Simulate both concepts at the three values of mu, 200 realizations of seed 0 each.

    Fuel rises are reported twice. Plain, they hold the luck of the draw: noise creates and destroys battery
    energy. With the created charge as control variate (`socwise.reproduce.control_variate`) they estimate the
    same expectation with much less scatter, and the verdict stands on them.
    """
    return from_comparison(simulate(CONCEPTS, MUS, realizations, jobs=jobs, progress=progress))


def from_comparison(comparison: Comparison) -> Reproduction:
    """Make the table of a comparison that holds the stochastic policy of both concepts at the three mu."""
    rows = [row for name in CONCEPTS for row in _table(comparison, name)]
    rows += [row for name in CONCEPTS for row in _story(comparison, name)]
    first = pick(comparison, CONCEPTS[0], LOW).rollout
    note = (
        f"{first.fuel_kg.size} realizations in antithetic pairs, seed {comparison.seed}, on two laps"
        f" ({comparison.distance_m / 1e3:.1f} km); the paper drives 50 realizations and draws one lap. s.e.:"
        " standard error of ours. Control variate: the process noise creates and destroys charge, D = SOC_N -"
        " SOC_0 - sum(h i / Q), whose expectation is exactly zero because d is a martingale difference;"
        " per case, fuel is regressed on D and b D is subtracted. The mean keeps its expectation and loses"
        " most of the luck of the draw, so the verdict on the rises stands on it; the plain rises are shown"
        " beside it, without verdict. Fuel, final SOC and the size of the rises depend on own choices: maps,"
        " penalties, end cost."
    )
    return Reproduction(
        "larsson-table2", larsson("Table 2"), tuple(rows), note, lambda: draw_table2(comparison, FUEL, FINAL)
    )


def adjusted_fuel(case: Case) -> Array:
    """Fuel of each realization in l/100 km less what the created charge explains, shape (n,)."""
    capacity_C = load_concept(case.concept).load_pack().capacity_C
    return adjust(case.fuel_l_per_100km, created_charge(case, capacity_C))


def _table(comparison: Comparison, concept: str) -> list[Row]:
    who, rows = concept.upper(), []
    for mu, published in zip(MUS, FUEL[concept], strict=True):
        mean, error = mean_and_error(pick(comparison, concept, mu).fuel_l_per_100km)
        name = f"{who} fuel, mu = {mu:g}"
        if concept == "hev":
            rows.append(Row.near(name, published, mean, HEV_FUEL_SHARE * published, "l/100 km", error))
        else:
            rows.append(Row.between(name, *PHEV_FUEL, mean, "l/100 km", published=published, error=error))
    for mu, published in zip(MUS, FINAL[concept], strict=True):
        mean, error = mean_and_error(pick(comparison, concept, mu).rollout.soc_estimate[:, -1])
        name = f"{who} final SOC estimate, mu = {mu:g}"
        rows.append(Row.near(name, published, mean, FINAL_TOLERANCE[concept], "", error))
    return rows


def _story(comparison: Comparison, concept: str) -> list[Row]:
    who, cases = concept.upper(), [pick(comparison, concept, mu) for mu in MUS]
    plain = [case.fuel_l_per_100km for case in cases]
    fuel = [adjusted_fuel(case) for case in cases]
    final = [case.rollout.soc_estimate[:, -1].astype(np.float64) for case in cases]
    rise, error = rise_percent(fuel[0], fuel[-1])
    plain_rise, plain_error = rise_percent(plain[0], plain[-1])
    low, high = FUEL[concept][0], FUEL[concept][-1]
    published = 100.0 * (high - low) / low
    name = f"{who} fuel, rise from mu = {LOW:g} to {HIGH:g}"
    rows = [
        Row.between(
            f"{name}, control variate", *RISE_PERCENT[concept], rise, "%", published=published, error=error
        ),
        Row.shown(f"{name}, plain", plain_rise, "%", published=published, error=plain_error),
        trend(f"{who} fuel rises with mu, control variate", fuel, 3, "l/100 km"),
        trend(f"{who} final SOC estimate rises with mu", final, 4),
    ]
    if concept == "hev":
        currents = [case.rollout.mean_abs_current_A for case in cases]
        return [*rows, trend(f"{who} mean |current| falls with mu", currents, 2, "A", falls=True)]
    return [*rows, *(_end_row(f"{who} sqrt(p)", case) for case in cases)]


def trend(name: str, values: list[Array], digits: int, unit: str = "", *, falls: bool = False) -> Row:
    """Build a row that is right if the means of successive cases rise, or fall.

    Parameters
    ----------
    name, unit : str
        Of the row.
    values : list of ndarray, each of shape (n,)
        A value per realization, one array per case.
    digits : int
        Decimals shown.
    falls : bool
        Whether they should fall.
    """
    means = [float(value.mean()) for value in values]
    ok = all((later < earlier) if falls else (later > earlier) for earlier, later in pairwise(means))
    shown = (" > " if falls else " < ").join(f"{mean:.{digits}f}" for mean in means)
    text = shown if ok else ", ".join(f"{mean:.{digits}f}" for mean in means)
    return Row.holds(name, ok, text, unit)


def end_against_middle(case: Case) -> Array:
    """sqrt(p) over the last 300 s less that over the middle third, per realization, in per cent of SOC."""
    time_s = case.rollout.time_s - case.rollout.time_s[0]
    spread = 100.0 * np.sqrt(case.rollout.variance.astype(np.float64))
    middle = (time_s >= time_s[-1] / 3.0) & (time_s <= 2.0 * time_s[-1] / 3.0)
    return np.asarray(spread[:, time_s >= time_s[-1] - END_S].mean(axis=1) - spread[:, middle].mean(axis=1))


def _end_row(what: str, case: Case) -> Row:
    mean, error = mean_and_error(end_against_middle(case))
    name = f"{what} falls towards the end, mu = {case.mu:g}: last {END_S:g} s less middle third"
    return Row.holds(name, mean < 0.0, mean, "% SOC", error=error)

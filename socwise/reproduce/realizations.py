"""[L] Figs 6 to 9: realizations of the optimal strategy, and what section 5 says about them in words.

The paper publishes pictures only, so no row has a published value: each states what the paper says and is
measured over all realizations, of which the picture shows three. Averages over time leave out the first
300 s, in which the variance settles from its initial value.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ems.grid import GridSettings
from ems.records import Case, Comparison
from ems.statistics import mean_and_error
from socwise.reproduce.realizations_figure import draw_one, draw_two
from socwise.reproduce.record import Reproduction, Row
from socwise.reproduce.registry import Progress
from socwise.reproduce.simulation import pick, simulate
from socwise.reproduce.sources import HIGH, LOW, MEDIUM, SQRT_P, larsson
from socwise.reproduce.table2 import end_against_middle, trend

REALIZATIONS = 40
SETTLED_S = 300.0
END_S = 300.0
CONSTANT_CV = 0.2
TARGET_SOC = 0.65

Array = NDArray[np.float64]


def figure6(
    *,
    jobs: int = 2,
    progress: Progress | None = None,
    realizations: int = REALIZATIONS,
    settings: GridSettings | None = None,
) -> Reproduction:
    """Reproduce Fig 6: the HEV at the medium mu."""
    return hev_medium(
        simulate(["hev"], [MEDIUM], realizations, jobs=jobs, progress=progress, settings=settings)
    )


def figure7(
    *,
    jobs: int = 2,
    progress: Progress | None = None,
    realizations: int = REALIZATIONS,
    settings: GridSettings | None = None,
) -> Reproduction:
    """Reproduce Fig 7: the HEV at the low and the high mu."""
    return hev_low_high(
        simulate(["hev"], [LOW, HIGH], realizations, jobs=jobs, progress=progress, settings=settings)
    )


def figure8(
    *,
    jobs: int = 2,
    progress: Progress | None = None,
    realizations: int = REALIZATIONS,
    settings: GridSettings | None = None,
) -> Reproduction:
    """Reproduce Fig 8: the PHEV at the medium mu; the HEV is simulated as well, to be compared with."""
    return phev_medium(
        simulate(["hev", "phev"], [MEDIUM], realizations, jobs=jobs, progress=progress, settings=settings)
    )


def figure9(
    *,
    jobs: int = 2,
    progress: Progress | None = None,
    realizations: int = REALIZATIONS,
    settings: GridSettings | None = None,
) -> Reproduction:
    """Reproduce Fig 9: the PHEV at the low and the high mu."""
    return phev_low_high(
        simulate(["phev"], [LOW, HIGH], realizations, jobs=jobs, progress=progress, settings=settings)
    )


def hev_medium(comparison: Comparison) -> Reproduction:
    """Make Fig 6 of a comparison that holds the HEV at the medium mu."""
    case = pick(comparison, "hev", MEDIUM)
    level, error = mean_and_error(100.0 * settled_spread(case).mean(axis=1))
    name = f"HEV: sqrt(p), ERRATA.md: about {SQRT_P[MEDIUM]:g}"
    rows = (
        Row(name, None, level, 0.15, abs(level - SQRT_P[MEDIUM]) <= 0.15, "% SOC", error),
        _constant(case),
        *_honest(case),
    )
    return Reproduction("larsson-fig6", larsson("Fig 6"), rows, _note(case), lambda: draw_one(case))


def hev_low_high(comparison: Comparison) -> Reproduction:
    """Make Fig 7 of a comparison that holds the HEV at the low and the high mu."""
    cases = [pick(comparison, "hev", mu) for mu in (LOW, HIGH)]
    less, error = mean_and_error(100.0 * (deviation_from_target(cases[1]) - deviation_from_target(cases[0])))
    calmer, calmer_error = mean_and_error(
        cases[1].rollout.mean_abs_current_A - cases[0].rollout.mean_abs_current_A
    )
    rows = (
        *(_constant(case) for case in cases),
        trend(
            "HEV: sqrt(p) rises with mu",
            [100.0 * settled_spread(case).mean(axis=1) for case in cases],
            3,
            "% SOC",
        ),
        Row.holds(
            f"HEV: true SOC deviates less from {TARGET_SOC:.0%} at the high mu, high less low (rms)",
            less < 0.0,
            less,
            "% SOC",
            error=error,
        ),
        Row.holds(
            "HEV: mean |current| is lower at the high mu, high less low",
            calmer < 0.0,
            calmer,
            "A",
            error=calmer_error,
        ),
    )
    return Reproduction("larsson-fig7", larsson("Fig 7"), rows, _note(cases[0]), lambda: draw_two(cases))


def phev_medium(comparison: Comparison) -> Reproduction:
    """Make Fig 8 of a comparison that holds both concepts at the medium mu."""
    hev, case = (pick(comparison, concept, MEDIUM) for concept in ("hev", "phev"))
    more, error = mean_and_error(variation(case) - variation(hev))
    rows = (
        Row.holds(
            "PHEV: sqrt(p) varies more over a trip than the HEV's, PHEV less HEV, coefficient of variation",
            more > 0.0,
            more,
            error=error,
        ),
        *_honest(case),
        _falls(case),
        *_end(case),
    )
    note = (
        f"{_note(case)} The paper's main reason for the fall of sqrt(p) is that the strategy saves current in"
        " order to end with a more precise estimate. The last minutes ask for little power"
        " whatever the strategy, so they are also compared with the same road on the first lap, where nothing"
        " ends; these rows are shown without verdict."
    )
    return Reproduction("larsson-fig8", larsson("Fig 8"), rows, note, lambda: draw_one(case))


def phev_low_high(comparison: Comparison) -> Reproduction:
    """Make Fig 9 of a comparison that holds the PHEV at the low and the high mu."""
    cases = [pick(comparison, "phev", mu) for mu in (LOW, HIGH)]
    final = [100.0 * case.rollout.soc_estimate[:, -1].astype(np.float64) for case in cases]
    more, error = mean_and_error(final[1] - final[0])
    rows = (
        trend(
            "PHEV: sqrt(p) rises with mu",
            [100.0 * settled_spread(case).mean(axis=1) for case in cases],
            3,
            "% SOC",
        ),
        *(_falls(case) for case in cases),
        Row.holds(
            "PHEV: final SOC estimate is higher at the high mu, high less low",
            more > 0.0,
            more,
            "% SOC",
            error=error,
        ),
    )
    return Reproduction("larsson-fig9", larsson("Fig 9"), rows, _note(cases[0]), lambda: draw_two(cases))


def settled_spread(case: Case) -> Array:
    """sqrt(p) of each realization from 300 s on, shape (n, k)."""
    return np.sqrt(case.rollout.variance[:, _settled(case)].astype(np.float64))


def variation(case: Case) -> Array:
    """Coefficient of variation over time of each realization's sqrt(p), shape (n,)."""
    spread = settled_spread(case)
    return np.asarray(spread.std(axis=1) / spread.mean(axis=1))


def deviation_from_target(case: Case) -> Array:
    """Root mean square over time of each realization's true SOC less 0.65, shape (n,)."""
    soc = case.rollout.soc[:, _settled(case)].astype(np.float64)
    return np.asarray(np.sqrt(np.square(soc - TARGET_SOC).mean(axis=1)))


def _settled(case: Case) -> NDArray[np.bool_]:
    return np.asarray(case.rollout.time_s >= case.rollout.time_s[0] + SETTLED_S)


def _constant(case: Case) -> Row:
    mean = settled_spread(case).mean(axis=0)
    name = (
        f"HEV: sqrt(p) is almost constant, mu = {case.mu:g}, coefficient of variation over time of its mean"
    )
    return Row.between(name, -np.inf, CONSTANT_CV, float(mean.std() / mean.mean()))


def _honest(case: Case) -> list[Row]:
    """Build the rows that hold the realised error of the estimate against what the model believes of it."""
    who = case.concept.upper()
    error = (case.rollout.soc.astype(np.float64) - case.rollout.soc_estimate)[:, _settled(case)]
    bias, bias_error = mean_and_error(100.0 * error.mean(axis=1))
    root = float(np.sqrt(np.square(error).mean()) / np.sqrt(np.square(settled_spread(case)).mean()))
    return [
        Row.between(f"{who}: mean error of the estimate", -0.05, 0.05, bias, "% SOC", error=bias_error),
        Row.between(f"{who}: rms error of the estimate over root mean p", 0.9, 1.1, root),
    ]


def _falls(case: Case) -> Row:
    mean, error = mean_and_error(end_against_middle(case))
    name = f"PHEV: sqrt(p) falls towards the end, mu = {case.mu:g}: last {END_S:g} s less middle third"
    return Row.holds(name, mean < 0.0, mean, "% SOC", error=error)


def _end(case: Case) -> list[Row]:
    """Build the rows that hold the end against the middle and against the same road a lap earlier."""
    current_A = np.abs(case.rollout.current_A.astype(np.float64))
    spread = 100.0 * np.sqrt(case.rollout.variance[:, 1:].astype(np.float64))
    steps = current_A.shape[1]
    last, lap = round(END_S / float(np.diff(case.rollout.time_s).mean())), steps // 2
    end, before, middle = slice(steps - last, None), slice(lap - last, lap), slice(steps // 3, 2 * steps // 3)

    def less(values: Array, other: slice) -> tuple[float, float | None]:
        return mean_and_error(values[:, end].mean(axis=1) - values[:, other].mean(axis=1))

    saved, saved_error = less(current_A, middle)
    lap_A, lap_A_error = less(current_A, before)
    lap_p, lap_p_error = less(spread, before)
    where = f"last {END_S:g} s less the same road a lap earlier"
    return [
        Row.holds(
            f"PHEV: |current| is lower at the end: last {END_S:g} s less middle third",
            saved < 0.0,
            saved,
            "A",
            error=saved_error,
        ),
        Row.shown(f"PHEV: |current|, {where}", lap_A, "A", error=lap_A_error),
        Row.shown(f"PHEV: sqrt(p), {where}", lap_p, "% SOC", error=lap_p_error),
    ]


def _note(case: Case) -> str:
    return (
        f"{case.rollout.fuel_kg.size} realizations, of which the picture shows up to three. Only pictures are"
        " published; the rows hold what the paper says about them. The cycle is driven twice (ERRATA.md)."
        " s.e.: standard error of ours."
    )

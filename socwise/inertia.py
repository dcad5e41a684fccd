"""Estimates of mass, inertia and centre of gravity, many methods and seeds side by side, and how they did."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpc.consistency import Consistency, consistency
from socwise.results.plain import finite
from socwise.thinning import stride_for
from vehicle.inertia.record import InertiaEstimate

LEAN_ROWS = 2000


@dataclass(frozen=True, eq=False)
class InertiaRun:
    """One method on one log.

    Parameters
    ----------
    model : str
        ``mass-spring``, ``ride``, ``ltm`` or ``mltm``.
    scenario : str
        ``urban`` or ``rural``; empty where there is no such choice.
    seed : int or None
        Of the synthetic log; None for the user's.
    estimate : InertiaEstimate
        What came out.
    truth : mapping of str to float
        Empty where it is not known.
    run_s : float
        Time it took.
    course : mapping of str to ndarray, shape (n,)
        Truth over time of quantities that change.
    """

    model: str
    scenario: str
    seed: int | None
    estimate: InertiaEstimate
    truth: Mapping[str, float]
    run_s: float
    course: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    @property
    def key(self) -> tuple[str, str, str]:
        """Model, scenario and method: what runs with several seeds share."""
        return self.model, self.scenario, self.estimate.method

    @property
    def label(self) -> str:
        """Name for files: model, scenario and method."""
        return "-".join(part for part in self.key if part).replace("_", "-")

    @property
    def nees(self) -> float:
        """Normalised square of the final error per quantity; NaN where no truth is known."""
        known = [name for name in self.estimate.names if name in self.truth]
        return self.estimate.nees(self.truth) if known else math.nan


@dataclass(frozen=True)
class Spread:
    """Errors of one quantity over seeds, as fractions of the truth.

    Attributes
    ----------
    mean, rms, worst, p95 : float
        Mean error with its sign; of its size the root mean square, the largest, and what 95 % stay below.
    sd : float
        Mean standard deviation as claimed, as a fraction of the truth.
    """

    mean: float
    rms: float
    worst: float
    p95: float
    sd: float


def spread(runs: Sequence[InertiaRun], name: str) -> Spread | None:
    """Gather the final errors of a quantity over runs; None where its truth is not known."""
    known = [run for run in runs if name in run.truth and name in run.estimate.names]
    if not known:
        return None
    errors = np.array([run.estimate.error(run.truth)[name] for run in known])
    sds = [run.estimate.final_sd[name] / (abs(run.truth[name]) or 1.0) for run in known]
    size = np.abs(errors)
    rms = float(np.sqrt(np.mean(errors**2)))
    within = float(np.quantile(size, 0.95, method="inverted_cdf"))
    return Spread(float(errors.mean()), rms, float(size.max()), within, float(np.mean(sds)))


def honesty(runs: Sequence[InertiaRun]) -> Consistency | None:
    """Judge the NEES of runs with several seeds; None where the truth or a covariance is missing."""
    squares = np.array([run.nees for run in runs])
    if np.isnan(squares).any() or not squares.size:
        return None
    count = sum(name in runs[0].truth for name in runs[0].estimate.names)
    return consistency(count * squares, count)


def grouped(runs: Sequence[InertiaRun]) -> dict[tuple[str, str, str], list[InertiaRun]]:
    """Put runs that differ in their seed alone together, in the order of the first of each."""
    order = {key: place for place, key in enumerate(dict.fromkeys(run.key for run in runs))}
    ordered = sorted(runs, key=lambda run: order[run.key])
    return {key: list(group) for key, group in groupby(ordered, key=lambda run: run.key)}


def lean(run: InertiaRun, rows: int = LEAN_ROWS) -> InertiaRun:
    """Keep some rows of a trace, the last among them: 50 whole ones would take half a gigabyte."""
    one = run.estimate
    every = stride_for(one.time_s.size, rows)
    kept = slice((one.time_s.size - 1) % every, None, every)
    thin = replace(one, time_s=one.time_s[kept], values=one.values[kept], sds=one.sds[kept])
    return replace(run, estimate=thin, course={name: true[kept] for name, true in run.course.items()})


def to_json(runs: Sequence[InertiaRun], data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the object that ``socwise inertia --json`` prints; what is not known is None.

    Parameters
    ----------
    runs : sequence of InertiaRun
        At least one.
    data : mapping
        Where the logs come from.
    """
    return dict(
        finite(
            {
                "schema": 1,
                "data": dict(data),
                "estimates": [_entry(run) for run in runs],
                "summary": [_summary(group) for group in grouped(runs).values()],
            }
        )
    )


def runs_over(
    seeds: Sequence[int],
    run: Callable[[int], list[InertiaRun]],
    progress: Callable[[int, int], None] | None = None,
) -> list[InertiaRun]:
    """Run something for each seed and say how far it is; whole traces are kept of the first alone."""
    found: list[InertiaRun] = []
    for done, seed in enumerate(seeds, 1):
        found += run(seed) if done == 1 else [lean(one) for one in run(seed)]
        if progress is not None:
            progress(done, len(seeds))
    return found


def _entry(run: InertiaRun) -> dict[str, Any]:
    one = run.estimate
    errors = one.error(run.truth)
    settled = dict(zip(one.names, one.settled_s.tolist(), strict=True))
    return {
        "model": run.model,
        "scenario": run.scenario or None,
        "method": one.method,
        "seed": run.seed,
        "parameters": {
            name: {
                "value": one.final[name],
                "sd": one.final_sd[name],
                "truth": run.truth.get(name),
                "error": errors.get(name),
                "settled_s": None if name in run.course else settled[name],
            }
            for name in one.names
        },
        "nis": one.nis,
        "nees": run.nees,
        "notes": list(one.notes),
        "run_s": run.run_s,
    }


def _summary(runs: Sequence[InertiaRun]) -> dict[str, Any]:
    first, judged = runs[0], honesty(runs)
    spreads = {name: spread(runs, name) for name in first.estimate.names}
    return {
        "model": first.model,
        "scenario": first.scenario or None,
        "method": first.estimate.method,
        "runs": len(runs),
        "errors": {name: vars(one) for name, one in spreads.items() if one is not None},
        "nees": None if judged is None else {**vars(judged), "verdict": judged.verdict},
    }

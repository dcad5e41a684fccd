"""Run estimators side by side over a log, and say how they did.

Every sample counts in the statistics; the trace that is kept and drawn holds a row for every so many samples,
with all flags that were raised in between.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bms.flags import Flag
from socwise.results.plain import finite
from socwise.thinning import stride_for

if TYPE_CHECKING:
    from bms.estimators.base import Estimate, KernelEstimator, Trace
    from bms.logged_data import LoggedData

Array = NDArray[np.float64]

MOST_ROWS = 200_000
CHUNK = 200_000
TWO_SIGMA = 2.0


@dataclass(frozen=True, eq=False)
class EstimateRun:
    """What one estimator made of a log.

    Parameters
    ----------
    name : str
        Name of the estimator.
    trace : Trace
        Rows that were kept, each after the last sample of its stretch.
    soc_true : ndarray or None
        SOC of the log in the same rows.
    soc, soc_sd : float
        Belief at the end.
    parameters : mapping of str to Estimate
        Estimated parameters at the end.
    residual_rms_V : float
        Root of the mean square of measured minus expected voltage, outliers left out; NaN without any.
    trusted_share : float
        Share of samples that the estimator took without reservation.
    flags : mapping of str to float
        Share of samples with each flag that was raised at all.
    soc_rmse, soc_error, inside_share : float
        Against the SOC of the log: root of the mean square error, last error, share of samples within two
        standard deviations; NaN without one.
    run_s : float
        Processor time.
    """

    name: str
    trace: Trace
    soc_true: Array | None
    soc: float
    soc_sd: float
    parameters: Mapping[str, Estimate]
    residual_rms_V: float
    trusted_share: float
    flags: Mapping[str, float]
    soc_rmse: float
    soc_error: float
    inside_share: float
    run_s: float


@dataclass
class _Tally:
    """Sums over all samples seen so far."""

    samples: int = 0
    trusted: int = 0
    residuals: int = 0
    residual_V2: float = 0.0
    compared: int = 0
    error2: float = 0.0
    inside: int = 0
    last_error: float = math.nan
    raised: dict[Flag, int] = field(default_factory=lambda: dict.fromkeys(Flag, 0))

    def add(self, trace: Trace, soc_true: Array | None) -> None:
        flags = trace.flags
        self.samples += flags.size
        self.trusted += int(np.count_nonzero((flags & ~_HARMLESS) == 0))
        for flag in Flag:
            self.raised[flag] += int(np.count_nonzero(flags & flag.value))
        seen = np.isfinite(trace.residual_V) & ((flags & Flag.OUTLIER.value) == 0)
        self.residuals += int(np.count_nonzero(seen))
        self.residual_V2 += float(np.sum(np.square(trace.residual_V[seen])))
        if soc_true is None:
            return
        known = np.isfinite(soc_true)
        error = (trace.soc - soc_true)[known]
        if error.size:
            self.compared += error.size
            self.error2 += float(np.sum(np.square(error)))
            self.inside += int(np.count_nonzero(np.abs(error) <= TWO_SIGMA * np.sqrt(trace.variance[known])))
            self.last_error = float(error[-1])


_HARMLESS = (Flag.REST | Flag.FULL).value


def default_every(samples: int) -> int:
    """Samples to a kept row, so that a trace has at most 200,000 rows."""
    return stride_for(samples, MOST_ROWS)


def run_estimator(
    estimator: KernelEstimator,
    log: LoggedData,
    *,
    every: int = 1,
    progress: Callable[[int], None] | None = None,
) -> EstimateRun:
    """Run one estimator over a log.

    Parameters
    ----------
    estimator : KernelEstimator
        A fresh one; it is moved to the end of the log.
    log : LoggedData
        The log.
    every : int
        Samples to a row of the trace, at least 1.
    progress : callable, optional
        Called with the number of samples done.

    Returns
    -------
    EstimateRun
    """
    began = time.process_time()
    steps = np.diff(log.time_s, prepend=log.time_s[0])
    tally, kept, truths = _Tally(), [], []
    size = max(CHUNK // every, 1) * every
    for start in range(0, len(log), size):
        part = slice(start, min(start + size, len(log)))
        # Copies, because a kernel is compiled anew for arrays that cannot be written.
        celsius = None if log.temperature_C is None else log.temperature_C[part].copy()
        truth = None if log.soc_true is None else log.soc_true[part]
        current_A, voltage_V = log.current_A[part].copy(), log.voltage_V[part].copy()
        trace = estimator.run(current_A, voltage_V, steps[part], celsius)
        tally.add(trace, truth)
        rows = _last_of_each(trace.flags.size, every)
        kept.append(_thinned(trace, log.time_s[part], rows, every))
        if truth is not None:
            truths.append(truth[rows])
        if progress is not None:
            progress(part.stop)
    belief = estimator.belief
    return EstimateRun(
        name=estimator.name,
        trace=_joined(kept),
        soc_true=np.concatenate(truths) if truths else None,
        soc=belief.mean,
        soc_sd=math.sqrt(belief.variance),
        parameters=estimator.parameters,
        residual_rms_V=_root(tally.residual_V2, tally.residuals),
        trusted_share=tally.trusted / tally.samples,
        flags={str(f.name).lower(): count / tally.samples for f, count in tally.raised.items() if count},
        soc_rmse=_root(tally.error2, tally.compared),
        soc_error=tally.last_error,
        inside_share=tally.inside / tally.compared if tally.compared else math.nan,
        run_s=time.process_time() - began,
    )


def to_json(log: LoggedData, cell: str, runs: list[EstimateRun]) -> dict[str, Any]:
    """Return the object that ``socwise estimate --json`` prints; what is not known is None.

    Parameters
    ----------
    log : LoggedData
        The log.
    cell : str
        Name of the cell.
    runs : list of EstimateRun
        One for each estimator.
    """
    lost = {
        name: int(np.count_nonzero(~np.isfinite(values)))
        for name, values in (("current", log.current_A), ("voltage", log.voltage_V))
    }
    data = {
        "source": log.source,
        "columns": dict(log.headers),
        "samples": len(log),
        "start_s": float(log.time_s[0]),
        "duration_s": log.duration_s,
        "step_s": log.step_s,
        "jitter_s": log.jitter_s,
        "gaps": {"count": len(log.gaps), "longest_s": max((gap.length_s for gap in log.gaps), default=0.0)},
        "missing": lost,
        "notes": list(log.notes),
        "doubts": list(log.doubts),
    }
    content = {"schema": 1, "data": data, "cell": cell, "estimators": [_entry(run) for run in runs]}
    return dict(finite(content))


def _entry(run: EstimateRun) -> dict[str, Any]:
    return {
        "name": run.name,
        "soc": {
            "final": run.soc,
            "sd": run.soc_sd,
            "error": run.soc_error,
            "rmse": run.soc_rmse,
            "inside_2sd": run.inside_share,
        },
        "parameters": {name: {"value": one.value, "sd": one.sd} for name, one in run.parameters.items()},
        "residual_rms_V": run.residual_rms_V,
        "trusted_share": run.trusted_share,
        "flags": dict(run.flags),
        "run_s": run.run_s,
    }


def _last_of_each(samples: int, every: int) -> NDArray[np.intp]:
    """Index of the last sample of each stretch."""
    return np.minimum(np.arange(every - 1, samples + every - 1, every, dtype=np.intp), samples - 1)


def _thinned(trace: Trace, time_s: Array, rows: NDArray[np.intp], every: int) -> Trace:
    kind = type(trace)
    return kind(
        time_s=time_s[rows],
        soc=trace.soc[rows],
        variance=trace.variance[rows],
        residual_V=trace.residual_V[rows],
        flags=np.bitwise_or.reduceat(trace.flags, np.arange(0, trace.flags.size, every)),
        parameters={name: values[rows] for name, values in trace.parameters.items()},
        deviations={name: values[rows] for name, values in trace.deviations.items()},
    )


def _joined(parts: list[Trace]) -> Trace:
    kind = type(parts[0])

    def every_part(field_name: str) -> dict[str, Array]:
        names = getattr(parts[0], field_name)
        return {name: np.concatenate([getattr(part, field_name)[name] for part in parts]) for name in names}

    return kind(
        time_s=np.concatenate([part.time_s for part in parts]),
        soc=np.concatenate([part.soc for part in parts]),
        variance=np.concatenate([part.variance for part in parts]),
        residual_V=np.concatenate([part.residual_V for part in parts]),
        flags=np.concatenate([part.flags for part in parts]),
        parameters=every_part("parameters"),
        deviations=every_part("deviations"),
    )


def _root(total: float, count: int) -> float:
    return math.sqrt(total / count) if count else math.nan

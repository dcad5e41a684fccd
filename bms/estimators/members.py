"""Many estimators in one call: the cells of a pack, or the members of a Monte Carlo study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bms.errors import BatteryError
from bms.estimators.base import KernelEstimator, Trace
from bms.simulation import run_parts

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class MembersTrace:
    """What many estimators believed along their logs; see `bms.estimators.base.Trace`.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Time of the rows.
    soc, variance, residual_V : ndarray, shape (m, n)
        Beliefs and residuals.
    flags : ndarray of int, shape (m, n)
        Every flag raised since the row before.
    parameters, deviations : dict of str to ndarray, shape (m, n)
        Estimated parameters and their standard deviations.
    """

    time_s: Array
    soc: Array
    variance: Array
    residual_V: Array
    flags: NDArray[np.int64]
    parameters: dict[str, Array]
    deviations: dict[str, Array]


def run_members(
    estimators: Sequence[KernelEstimator],
    current_A: ArrayLike,
    voltage_V: ArrayLike,
    step_s: ArrayLike = 1.0,
    temperature_C: ArrayLike | None = None,
    *,
    time_s: ArrayLike | None = None,
    every: int = 1,
    threads: int = 1,
) -> MembersTrace:
    """Run each estimator over its own log.

    Parameters
    ----------
    estimators : sequence of KernelEstimator
        m estimators of one kind; each is left in the state after its log.
    current_A, voltage_V : array_like, shape (n,) or (m, n)
        One log for all, or one for each.
    step_s, temperature_C, time_s, every
        As in `KernelEstimator.run`; the same for all.
    threads : int
        Members are independent; more than one thread divides them.

    Raises
    ------
    BatteryError
        When there is no estimator, they differ in kind, one is given twice, or shapes do not fit together.
    """
    members = len(estimators)
    if members == 0 or len({type(estimator) for estimator in estimators}) != 1:
        raise BatteryError(f"give one estimator or more, all of one kind; got {members}")
    if len({id(estimator) for estimator in estimators}) != members:
        raise BatteryError("an estimator is given twice; give each member its own: estimator.copy()")
    currents, voltages = _logs("current_A", current_A, members), _logs("voltage_V", voltage_V, members)
    traces: list[Trace | None] = [None] * members

    def work(part: slice) -> None:
        for i in range(*part.indices(members)):
            traces[i] = estimators[i].run(
                currents[i], voltages[i], step_s, temperature_C, time_s=time_s, every=every
            )

    run_parts(work, members, threads)
    done = [trace for trace in traces if trace is not None]
    names = done[0].parameters
    return MembersTrace(
        time_s=done[0].time_s,
        soc=np.stack([trace.soc for trace in done]),
        variance=np.stack([trace.variance for trace in done]),
        residual_V=np.stack([trace.residual_V for trace in done]),
        flags=np.stack([trace.flags for trace in done]),
        parameters={name: np.stack([trace.parameters[name] for trace in done]) for name in names},
        deviations={name: np.stack([trace.deviations[name] for trace in done]) for name in names},
    )


def _logs(name: str, values: ArrayLike, members: int) -> Array:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim not in (1, 2) or (array.ndim == 2 and array.shape[0] != members):
        raise BatteryError(
            f"{name} has the shape {array.shape} for {members} estimators; give (n,) or ({members}, n)"
        )
    return np.broadcast_to(array, (members, array.shape[-1]))

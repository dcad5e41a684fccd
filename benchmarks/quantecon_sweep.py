"""The deterministic program on QuantEcon's `DiscreteDP`, where that is installed.

`DiscreteDP` wants finitely many states, a reward for every (state, action) and probabilities of the next
state. The two weights of a linear look-up are such probabilities, and the choice of the engine's next state
is made on the nodes before, as the project's kernel does, so both solve the very same problem. Rewards and
probabilities change with every step: making them, as a sparse matrix of state-action pairs, is part of the
work.
"""

from __future__ import annotations

import importlib
import warnings
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from benchmarks.cases import Case
from benchmarks.errors import UnavailableError
from benchmarks.numpy_sweep import Moves, best_of_both, stage_moves

Array = NDArray[np.float64]


@cache
def discrete_dp() -> Any:
    """Import `DiscreteDP`.

    Raises
    ------
    UnavailableError
        QuantEcon is not installed.
    """
    try:
        return importlib.import_module("quantecon.markov").DiscreteDP
    except ImportError as error:
        raise UnavailableError(f"QuantEcon is not installed ({error})") from error


def quantecon_sweep(case: Case) -> Array:
    """Solve the program without noise, linear look-ups; ``J_0``, shape (2, 1, n)."""
    after = np.array([case.terminal_kg[0], case.terminal_kg[0]])
    everything = case.distinct
    for k in range(everything.shape[0] - 1, -1, -1):
        stage = pose(stage_moves(case, k, everything[k]))
        tables = best_of_both(after[0], after[1], case.scalars.start_cost_kg)
        after = -stage.bellman_operator(-tables.ravel()).reshape(2, -1) + case.penalty_kg
    return after[:, None, :]


def pose(moves: Moves) -> Any:
    """Pose one step: with the engine off there is one action, with it on there are the others."""
    controls, n = moves.cell.shape
    first, part = (np.concatenate((x[0], x[1:].T.ravel())) for x in (moves.cell, moves.part))
    first[n:] += n
    pairs = first.size
    probabilities = csr_array(
        (
            np.column_stack((1.0 - part, part)).ravel(),
            np.column_stack((first, first + 1)).ravel(),
            np.arange(0, 2 * pairs + 1, 2),
        ),
        shape=(pairs, 2 * n),
    )
    rewards = -np.concatenate((moves.cost[0], moves.cost[1:].T.ravel()))
    states = np.concatenate((np.arange(n), np.repeat(np.arange(n, 2 * n), controls - 1)))
    actions = np.concatenate((np.zeros(n, dtype=np.int64), np.tile(np.arange(1, controls), n)))
    with warnings.catch_warnings():
        # No discounting: it warns that infinite horizons are then out of the question.
        warnings.simplefilter("ignore", UserWarning)
        return discrete_dp()(rewards, probabilities, 1.0, states, actions)

"""The cost-to-go of every stage: kept whole, or computed anew in parts from a few stages that are kept.

A table of all stages grows with the length of the trip: gigabytes for a day in a lorry. Kept instead are some
stages in double precision, about as many as a part between two of them is long; a rollout, which goes
forward, computes each part once more as it comes to it. That doubles the time of the solve and takes the
square root of the memory. The numbers are the same to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Protocol, final

import numpy as np
from numpy.typing import NDArray

from ems._sdp import Grid, Scalars, Stages, sweep

Array = NDArray[np.float64]
Table = NDArray[np.float32]

KEEP_BYTES = 256 * 2**20
"""A table that is larger is computed in parts."""


class CostToGo(Protocol):
    """Stages 0 to N, each of shape (2, r, n) over (engine state, variance row, node), less `offset_kg`."""

    def parts(self) -> Iterator[tuple[int, int, Table]]:
        """Give first step, the step after the last, and stages first to last of them, in order."""

    def stage(self, k: int) -> Table:
        """Give one stage."""

    def whole(self) -> Table:
        """Give all stages, shape (N + 1, 2, r, n)."""


@final
@dataclass(frozen=True, eq=False)
class Kept:
    """All stages in one table.

    Parameters
    ----------
    table : ndarray of float32, shape (N + 1, 2, r, n)
    """

    table: Table

    def parts(self) -> Iterator[tuple[int, int, Table]]:
        """Give everything at once."""
        yield 0, self.table.shape[0] - 1, self.table

    def stage(self, k: int) -> Table:
        """Give one stage."""
        stage: Table = self.table[k]
        return stage

    def whole(self) -> Table:
        """Give all stages."""
        return self.table


@final
@dataclass(eq=False)
class Recomputed:
    """Some stages, and what it takes to compute those between them.

    Parameters
    ----------
    grid, scalars, stages
        The problem.
    penalty : ndarray, shape (r, n)
        Expected running penalty in kg.
    starts : ndarray of int, shape (m + 1,)
        First step of every part, and N.
    after : ndarray, shape (m, 2, r, n)
        Cost-to-go after the last step of every part.
    """

    grid: Grid
    scalars: Scalars
    stages: Stages
    penalty: Array
    starts: NDArray[np.int64]
    after: Array
    _latest: tuple[int, Table] | None = field(default=None, repr=False)

    def parts(self) -> Iterator[tuple[int, int, Table]]:
        """Compute part by part."""
        for part in range(self.after.shape[0]):
            yield int(self.starts[part]), int(self.starts[part + 1]), self._part(part)

    def stage(self, k: int) -> Table:
        """Give one stage; its part is kept until another is asked for."""
        part = min(max(int(np.searchsorted(self.starts, k, side="right")) - 1, 0), self.after.shape[0] - 1)
        latest = self._latest
        if latest is None or latest[0] != part:
            latest = self._latest = (part, self._part(part))
        stage: Table = latest[1][k - self.starts[part]]
        return stage

    def whole(self) -> Table:
        """Compute all stages, however much memory that takes."""
        table = np.empty((int(self.starts[-1]) + 1, 2, *self.penalty.shape), dtype=np.float32)
        for first, last, part in self.parts():
            table[first : last + 1] = part
        return table

    def _part(self, part: int) -> Table:
        first, last = self.starts[part], self.starts[part + 1]
        table = np.empty((last - first + 1, 2, *self.penalty.shape), dtype=np.float32)
        stages = Stages(*(rows[first:last] for rows in self.stages))
        offset = np.empty(last - first + 1)
        sweep(self.grid, self.scalars, stages, self.penalty, self.after[part], False, table, offset)
        return table


def solve_backwards(
    grid: Grid,
    scalars: Scalars,
    stages: Stages,
    penalty: Array,
    terminal: Array,
    keep_bytes: int | None = None,
) -> tuple[CostToGo, Array, Array]:
    """Sweep backwards over all stages.

    Parameters
    ----------
    grid, scalars, stages
        The problem, N steps.
    penalty, terminal : ndarray, shape (r, n)
        Expected running and terminal penalty in kg.
    keep_bytes : int, optional
        Keep the whole table if it is no larger than this, `KEEP_BYTES` unless told.

    Returns
    -------
    tuple
        The cost-to-go; the least of each stage, shape (N + 1,), which is subtracted in it; and the cost-to-go
        of stage 0, shape (2, r, n), in double precision, nothing subtracted.
    """
    steps = stages.power_W.shape[0]
    shape = (2, *penalty.shape)
    last = np.ascontiguousarray(np.stack((terminal, terminal)))
    offset = np.empty(steps + 1)
    most = KEEP_BYTES if keep_bytes is None else keep_bytes
    if table_bytes(steps, *penalty.shape) <= most:
        table = np.empty((steps + 1, *shape), dtype=np.float32)
        first = sweep(grid, scalars, stages, penalty, last, False, table, offset)
        return Kept(table), offset, first
    starts = part_starts(steps)
    after = np.empty((starts.size - 1, *shape))
    nothing = np.empty((0, *shape), dtype=np.float32)
    for part in range(starts.size - 2, -1, -1):
        after[part] = last
        here = slice(int(starts[part]), int(starts[part + 1]))
        own = np.empty(here.stop - here.start + 1)
        some = Stages(*(rows[here] for rows in stages))
        last = sweep(grid, scalars, some, penalty, last, False, nothing, own)
        offset[here.start : here.stop + 1] = own
    return Recomputed(grid, scalars, stages, penalty, starts, after), offset, last


def part_starts(steps: int) -> NDArray[np.int64]:
    """First step of every part, and N: parts in single precision take what their ends in double take."""
    parts = max(1, round(math.sqrt(steps / 2.0)))
    return np.unique(np.linspace(0, steps, parts + 1).round().astype(np.int64))


def table_bytes(steps: int, rows: int, nodes: int) -> int:
    """Size of the table of all stages."""
    return 4 * (steps + 1) * 2 * rows * nodes

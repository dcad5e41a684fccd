"""How much memory a solve takes, said before it starts."""

from __future__ import annotations

from pathlib import Path

from ems.cost_to_go import KEEP_BYTES, part_starts, table_bytes
from ems.errors import EmsError

SPARE = 0.9
"""Share of the available memory that a solve may take."""


def solve_bytes(steps: int, rows: int, nodes: int, keep_bytes: int = KEEP_BYTES) -> int:
    """Memory that the cost-to-go of a solve takes, and that of a rollout with it.

    Parameters
    ----------
    steps, rows, nodes : int
        Steps N, variance rows r, SOC nodes n.
    keep_bytes : int
        See `ems.cost_to_go.solve_backwards`.
    """
    table = table_bytes(steps, rows, nodes)
    if table <= keep_bytes:
        return table
    starts = part_starts(steps)
    longest = int((starts[1:] - starts[:-1]).max())
    return 8 * (starts.size - 1) * 2 * rows * nodes + table_bytes(longest, rows, nodes)


def available_bytes() -> int | None:
    """Memory that this machine has available now; None where it does not say."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    for line in lines:
        name, _, amount = line.partition(":")
        if name == "MemAvailable":
            return int(amount.split()[0]) * 1024
    return None


def require_memory(steps: int, rows: int, nodes: int) -> None:
    """Refuse a solve that would not fit.

    Raises
    ------
    EmsError
        Says what it would take, what there is, and what to do.
    """
    needed, available = solve_bytes(steps, rows, nodes), available_bytes()
    if available is not None and needed > SPARE * available:
        raise EmsError(
            f"the cost-to-go over {nodes} SOC nodes, {rows} variance rows and {steps} steps takes"
            f" {needed / 1e9:.1f} GB of memory, and {available / 1e9:.1f} GB are available; take a larger"
            " soc_step or fewer variance_rows, or a shorter cycle"
        )

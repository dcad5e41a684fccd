"""What an FMU in a process of its own may take before its realization is ended."""

from __future__ import annotations

from dataclasses import dataclass

from bms.plants.fmu.errors import FmuError

GIB = 2**30
LONGEST_S = 1e6
"""Systems wait no longer than some weeks."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of an isolated FMU; where the platform cannot hold one, it is not held, see docs/fmu.md.

    Parameters
    ----------
    step_deadline_s : float
        Time of the clock that one call of `Channel.step` may take.
    start_deadline_s : float
        Time of the clock to start a worker and load the FMU, and again to initialise a realization.
    close_deadline_s : float
        Time of the clock that the FMU has to free itself before its process is killed.
    memory_bytes : int or None
        Address space that the FMU may take beyond what its worker has before loading it; None: no limit.
    file_bytes : int or None
        Largest file that it may write; None: no limit.

    Raises
    ------
    FmuError
        A limit that is not positive, or a time of weeks.
    """

    step_deadline_s: float = 10.0
    start_deadline_s: float = 60.0
    close_deadline_s: float = 5.0
    memory_bytes: int | None = 4 * GIB
    file_bytes: int | None = GIB

    def __post_init__(self) -> None:
        for name in ("step_deadline_s", "start_deadline_s", "close_deadline_s"):
            value = getattr(self, name)
            if not 0.0 < value <= LONGEST_S:
                raise FmuError(f"{name} is {value}; give seconds above zero, at most {LONGEST_S:g}")
        for name in ("memory_bytes", "file_bytes"):
            value = getattr(self, name)
            if value is not None and value <= 0:
                raise FmuError(f"{name} is {value}; give a number of bytes above zero, or None for no limit")

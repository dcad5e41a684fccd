"""What FMI's status codes mean, in words that help."""

from __future__ import annotations

from bms.plants.fmu.errors import FmuCrash
from bms.plants.fmu.logs import LogSink

OK, WARNING, DISCARD, ERROR, FATAL, PENDING = range(6)

MEANING = {
    DISCARD: (
        "discarded the call: it could not solve its equations there, or not with a step of this length; try a"
        " smaller step_s, or a gentler input"
    ),
    ERROR: "reports an error: this realization cannot go on",
    FATAL: "reports a fatal error: this process can no longer use it",
    PENDING: "wants to go on in the background, which is not supported",
}


def crash(name: str, status: int, log: LogSink, when: str = "") -> FmuCrash:
    """The error of a call that failed.

    Parameters
    ----------
    name : str
        The function of FMI.
    status : int
        What it returned.
    log : LogSink
        What the FMU said.
    when : str
        Where the realization was, such as ``at 12 s``.
    """
    meaning = MEANING.get(status, f"returned {status}, a status that FMI does not know")
    return FmuCrash(f"the FMU {meaning} ({name}{f' {when}' if when else ''}){log.tail()}")

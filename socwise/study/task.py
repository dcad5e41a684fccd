"""What a worker is given and what it gives back: plain records that travel between processes and machines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from drivecycles import DriveCycle
from ems.closed import ClosedLoop, Training
from ems.grid import GridSettings
from socwise.study.car import StudyConcept

Json = dict[str, Any]


@dataclass(frozen=True)
class PlannedCase:
    """One case, ready to be computed.

    Parameters
    ----------
    key : str
        Hash of everything that decides the result.
    factors : mapping
        What the study says of it.
    concept : StudyConcept
        The car with the values of the factors; its uncertainty model too.
    trip : str
        Digest of the cycle or traffic scenario, by which the plan keeps it.
    policies : tuple of str
        The policies, the first compared with the others.
    seed, realizations : int
        Which noise, and how much.
    settings : GridSettings
        Spacings of the grids.
    on_infeasible : {"error", "limit"}
        See `ems.problem.build_problem`.
    loop : ClosedLoop or None
        Plant and estimator, where they are not the model.
    training : Training or None
        How the uncertainty model of a closed loop is identified.
    given_mu : bool
        Whether mu is a factor; a closed loop identifies it otherwise.
    trajectories : bool
        Whether they are kept.
    """

    key: str
    factors: Mapping[str, Any]
    concept: StudyConcept
    trip: str
    policies: tuple[str, ...]
    seed: int
    realizations: int
    settings: GridSettings
    on_infeasible: Literal["error", "limit"]
    loop: ClosedLoop | None
    training: Training | None
    given_mu: bool
    trajectories: bool


@dataclass(frozen=True)
class WorkUnit:
    """Cases that are computed by one worker, one after another, because they share solves.

    Parameters
    ----------
    cases : tuple of PlannedCase
        They differ in the uncertainty model, the seed or the number of realizations only.
    trip : DriveCycle or Scenario
        What is driven.
    code : str
        Digest of the code that the plan was made with; a worker with other code refuses.
    """

    cases: tuple[PlannedCase, ...]
    trip: DriveCycle | Any
    code: str


@dataclass(frozen=True)
class Outcome:
    """What came out for one case.

    Parameters
    ----------
    key : str
        Of the case.
    content : dict or None
        ``result``, ``resolved`` and ``warnings``; None where the case failed.
    error : dict or None
        ``kind``, ``message``, and ``traceback`` where the error was not expected.
    timing : dict
        ``wall_s``, ``solve_s``, ``peak_rss_MB``, ``host``, ``process``.
    trajectories : mapping of str to bytes
        NetCDF files by policy.
    """

    key: str
    content: Json | None
    error: Json | None
    timing: Json
    trajectories: Mapping[str, bytes] = field(default_factory=dict)


def absolute(folder: Path, name: str) -> Path:
    """Anchor a path of the study file."""
    return (folder / name).absolute()

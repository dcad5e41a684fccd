"""The simulations of [L] section 5: the stochastic policy of both concepts on the cycle `larsson`."""

from __future__ import annotations

from collections.abc import Sequence

from drivecycles import load_cycle
from ems.compare import compare
from ems.concept import load_concept
from ems.grid import GridSettings
from ems.records import Case, Comparison
from socwise.labels import STOCHASTIC
from socwise.reproduce.registry import Progress
from socwise.reproduce.sources import CYCLE

SEED = 0


def simulate(
    concepts: Sequence[str],
    mus: Sequence[float],
    realizations: int,
    *,
    jobs: int = 2,
    progress: Progress | None = None,
    settings: GridSettings | None = None,
) -> Comparison:
    """Solve and simulate the stochastic policy.

    Parameters
    ----------
    concepts : sequence of str
        Names of presets.
    mus : sequence of float
        Measurement variances.
    realizations : int
        Realizations of each; the first of them do not depend on how many there are.
    jobs, progress
        See `ems.compare.compare`.
    settings : GridSettings, optional
        Grid spacings; the defaults when left out.
    """
    return compare(
        [load_concept(name) for name in concepts],
        load_cycle(CYCLE),
        mus=mus,
        policies=(STOCHASTIC,),
        realizations=realizations,
        seed=SEED,
        settings=settings,
        jobs=jobs,
        progress=progress,
    )


def pick(comparison: Comparison, concept: str, mu: float) -> Case:
    """Return the case of a concept and a mu; KeyError if it was not simulated."""
    for case in comparison.cases:
        if (case.concept, case.mu) == (concept, mu):
            return case
    raise KeyError(f"no case of concept {concept!r} at mu = {mu:g} was simulated")

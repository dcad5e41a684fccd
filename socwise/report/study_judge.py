"""How certainty equivalence does in each case of a study.

Loss is what the certainty-equivalent policy costs more than the stochastic one, in per cent of the latter's
realised cost, on the same noise, with its 95 % interval. A difference that cannot be told from zero is no
proof that there is none, so cases are sorted by the whole interval: good enough is where even its upper end
stays below a limit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from socwise.labels import CERTAINTY_EQUIVALENT, STOCHASTIC
from socwise.report.answer import saving
from socwise.study.layout import case_file
from socwise.study.reading import StoredStudy, StudyCase, read_json

LIMIT = 1.0
"""Loss in per cent that is still good enough."""

Standing = Literal["good enough", "costs more", "undecided", "not trusted", "not known"]
_UNJUDGED = ("not trusted", "not known")
_POLICIES = (STOCHASTIC, CERTAINTY_EQUIVALENT)
_DISTRUST = "not to be trusted"


@dataclass(frozen=True)
class Judged:
    """One case and what the certainty-equivalent policy loses in it.

    Parameters
    ----------
    case : StudyCase
        The case.
    percent, low, high : float or None
        Loss and its 95 % interval; None where the case is not finished, lacks one of the two policies, or has
        a single realization (the interval alone).
    warnings : tuple of str
        What was said while it was computed.
    """

    case: StudyCase
    percent: float | None
    low: float | None
    high: float | None
    warnings: tuple[str, ...] = ()

    @property
    def doubts(self) -> tuple[str, ...]:
        """Warnings that one of the two policies left its grid: the loss is then not to be trusted."""
        return tuple(said for said in self.warnings if said.startswith(_POLICIES) and _DISTRUST in said)

    @property
    def standing(self) -> Standing:
        """How certainty equivalence stands in this case."""
        if self.percent is None or self.low is None or self.high is None:
            return "not known"
        if self.doubts:
            return "not trusted"
        if self.high <= LIMIT:
            return "good enough"
        return "costs more" if self.low > 0.0 else "undecided"

    @property
    def distinguishable(self) -> bool:
        """Whether the loss differs from zero beyond doubt."""
        return self.low is not None and self.high is not None and not self.low <= 0.0 <= self.high

    @property
    def is_judged(self) -> bool:
        """Whether the case counts: the loss and its interval are known and can be trusted."""
        return self.standing not in _UNJUDGED


def judge(study: StoredStudy) -> list[Judged]:
    """Return every case of a study with its loss, in the order of the study."""
    return [Judged(case, *loss(case), _warnings(study, case)) for case in study.cases]


def loss(case: StudyCase, what: str = "cost_kg") -> tuple[float | None, float | None, float | None]:
    """Return what the certainty-equivalent policy costs more, in per cent of the stochastic one's cost.

    Parameters
    ----------
    case : StudyCase
        The case.
    what : str
        "cost_kg", or "fuel_l_per_100km" for the fuel alone.

    Returns
    -------
    tuple of float or None
        Loss, low and high end of its 95 % interval (Fieller's theorem); None what is not known.
    """
    row = case.policy(CERTAINTY_EQUIVALENT)
    if row is None or case.policy(STOCHASTIC) is None or case.result is None:
        return None, None, None
    spared = saving(case.result, row["concept"], row["mu"], CERTAINTY_EQUIVALENT, STOCHASTIC, what)
    if spared is None or not spared.baseline > 0.0:
        return None, None, None
    low, high = (-100.0 * share for share in reversed(spared.share))
    percent = -100.0 * spared.absolute / spared.baseline
    return (percent, low, high) if math.isfinite(low) and math.isfinite(high) else (percent, None, None)


def _warnings(study: StoredStudy, case: StudyCase) -> tuple[str, ...]:
    if case.state != "done":
        return ()
    content = read_json(case_file(study.folder, case.key)) or {}
    return tuple(content.get("warnings", ()))

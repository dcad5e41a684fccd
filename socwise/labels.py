"""Names, colours and order of policies, the same in every table, figure and report."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

STOCHASTIC = "stochastic"
CERTAINTY_EQUIVALENT = "certainty_equivalent"
PERFECT_INFORMATION = "perfect_information"
RULE_BASED = "rule_based"


@dataclass(frozen=True)
class PolicyStyle:
    """How a policy is shown.

    Parameters
    ----------
    label, short : str
        Name in running text, and where there is little room.
    color, dark_color : str
        Colour on white and on dark ground; told apart with every common colour vision.
    line : tuple
        Dashes of a line, in matplotlib's notation, to tell lines on top of each other apart.
    """

    label: str
    short: str
    color: str
    dark_color: str
    line: tuple[int, tuple[float, ...] | None] = (0, None)


# Okabe and Ito's palette; lighter relatives on dark ground.
_KNOWN = {
    STOCHASTIC: PolicyStyle("stochastic", "stochastic", "#0072B2", "#56B4E9"),
    CERTAINTY_EQUIVALENT: PolicyStyle(
        "certainty-equivalent", "cert.-equiv.", "#D55E00", "#FF8A3D", (0, (6, 2))
    ),
    PERFECT_INFORMATION: PolicyStyle(
        "perfect-information", "perfect info", "#009E73", "#3CCFA4", (0, (1.5, 1.5))
    ),
    RULE_BASED: PolicyStyle("rule-based", "rule-based", "#B5609A", "#E79BCB", (3, (3, 3))),
}
_OTHERS = (("#8C6D00", "#F0E442"), ("#555555", "#BBBBBB"), ("#4B3FA0", "#A99BFF"))


def policy_style(policy: str, policies: Iterable[str] = ()) -> PolicyStyle:
    """Return how a policy is shown.

    Parameters
    ----------
    policy : str
        Its name.
    policies : iterable of str
        All policies shown together; a policy of the user's own gets a colour by its place among them.

    Returns
    -------
    PolicyStyle
    """
    if policy in _KNOWN:
        return _KNOWN[policy]
    own = [name for name in dict.fromkeys(policies) if name not in _KNOWN]
    color, dark = _OTHERS[(own.index(policy) if policy in own else 0) % len(_OTHERS)]
    label = policy.replace("_", "-")
    return PolicyStyle(label, label, color, dark)


def concept_label(concept: str) -> str:
    """Return a concept's name for people: HEV and PHEV in capitals, a user's own as given."""
    return concept.upper() if concept in {"hev", "phev"} else concept


def middle(values: Sequence[float]) -> float:
    """Return the middle value, the lower of two: the one to show where one must stand for all."""
    ordered = sorted(values)
    return ordered[(len(ordered) - 1) // 2]

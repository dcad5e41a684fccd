"""The findings in plain sentences: who wins, by how much, how sure that is, and what is left to gain."""

from __future__ import annotations

import math
from collections.abc import Sequence

from socwise.labels import concept_label, policy_style
from socwise.report.answer import Finding, Saving
from socwise.report.wording import amount, listing

_ENOUGH = 4
_INTERVAL = "95 % interval "
_UNSURE = ("saving {}", "costing {} more")


def answer(concept: str, found: Sequence[Finding]) -> list[str]:
    """Return the answer for one concept, as sentences of plain text.

    Parameters
    ----------
    concept : str
        Its name.
    found : sequence of Finding
        Its findings, in the order of mu.

    Returns
    -------
    list of str
        Realised cost first, then fuel, then other policies that win, then the gap to perfect information.
    """
    name = concept_label(concept)
    pairs = [(one, one.cost) for one in found if one.cost is not None]
    if not pairs:
        lowest = _series([f"{policy_style(f.lowest).label} at μ = {f.mu:g}" for f in found])
        return [
            f"{name}: the stochastic and the certainty-equivalent policy were not both run, so what the "
            f"uncertainty is worth stays open. Lowest mean realised cost: {lowest}."
        ]
    sentences = [_cost_sentence(name, pairs)]
    fuel = [(one, one.fuel) for one in found if one.fuel is not None]
    if fuel:
        parts = [f"{_fuel_phrase(saving)} at μ = {one.mu:g}" for one, saving in fuel]
        sentences.append(f"Fuel alone: {_series(parts)}.")
    bought = [one for one in found if one.cost and one.fuel and one.cost.verdict > 0 > one.fuel.absolute]
    if bought:
        sentences.append(
            "What is saved is penalties, for time outside the SOC window and for the final SOC, at the price "
            "that the concept sets; it is bought with more fuel."
        )
    sentences += _better_sentences(found)
    gap = [one for one in found if one.gap_left is not None]
    if gap:
        shares = [_share(one) for one in gap]
        parts = [f"{share} at μ = {one.mu:g}" for share, one in zip(shares, gap, strict=True)]
        same = len(gap) > 1 and len(set(shares)) == 1
        still = f"{shares[0]} at any of the {len(gap)} μ" if same else _series(parts)
        sentences.append(
            f"Of what the certainty-equivalent policy loses against perfect information, {still} "
            "is still lost with the stochastic policy."
        )
    return sentences


def verdict(finding: Finding) -> str:
    """Return in a few words who is cheaper, the stochastic or the certainty-equivalent policy."""
    if finding.cost is None:
        return "not compared"
    if math.isnan(finding.cost.low):
        return "no interval: one realization"
    words = {1: "stochastic cheaper", 0: "no significant difference", -1: "certainty-equivalent cheaper"}
    return words[finding.cost.verdict]


def _cost_sentence(name: str, pairs: Sequence[tuple[Finding, Saving]]) -> str:
    templates = {
        1: "lowers the realised cost by {}",
        0: "makes no significant difference to the realised cost, {}",
        -1: "raises the realised cost by {}",
    }
    phrases = []
    for outcome, template in templates.items():
        group = [(one, saving) for one, saving in pairs if saving.verdict == outcome]
        words = _UNSURE if outcome == 0 else ("{}", "{}")
        parts = [f"{_amount(saving, 'kg', words)} at μ = {one.mu:g}" for one, saving in group]
        if parts:
            phrases.append(template.format(_series(parts)))
    return (
        f"{name}: against the certainty-equivalent policy, which takes the estimate for the truth, "
        f"the stochastic policy {'; it '.join(phrases)}."
    )


def _fuel_phrase(saving: Saving) -> str:
    if saving.verdict == 0:
        return f"no significant difference, {_amount(saving, 'l/100 km', _UNSURE)}"
    return _amount(saving, "l/100 km", ("{} less", "{} more"))


def _amount(saving: Saving, unit: str, words: tuple[str, str]) -> str:
    """Return the size of a saving or of a loss with its interval, in the words for the one or the other."""
    values, shown = saving.figures(unit)
    loss = saving.absolute < 0.0
    mean, low, high = (-values[0], -values[2], -values[1]) if loss else values
    interval = (
        "no interval" if math.isnan(low) else f"{_INTERVAL}{amount(low, shown)} to {amount(high, shown)}"
    )
    return words[loss].format(f"{amount(mean, shown)} {shown} ({interval})")


def _better_sentences(found: Sequence[Finding]) -> list[str]:
    by_policy: dict[str, list[str]] = {}
    for one in found:
        for policy in one.better:
            by_policy.setdefault(policy, []).append(f"μ = {one.mu:g}")
    return [
        f"The {policy_style(policy).label} policy realises a significantly lower cost than the stochastic "
        f"one at {_series(places)}."
        for policy, places in by_policy.items()
    ]


def _share(finding: Finding) -> str:
    left = 100.0 * (finding.gap_left or 0.0)
    if left <= 0.0:
        return "nothing"
    return "less than 1 %" if left < 1.0 else f"{left:.0f} %"


def _series(parts: Sequence[str]) -> str:
    """Join what holds at several mu; of a long sweep only the first and the last.

    That an interval is one of 95 % is said once.
    """
    short = [parts[0], *(part.replace(_INTERVAL, "") for part in parts[1:])]
    if len(parts) <= _ENOUGH:
        return listing(short)
    return f"{short[0]} and {short[-1]} (first and last of {len(parts)} in the table)"

"""What the comparison says: what the stochastic policy saves, where it loses, what is left to gain."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ems.statistics import half_width
from socwise.labels import CERTAINTY_EQUIVALENT, PERFECT_INFORMATION, STOCHASTIC
from socwise.report.ratio import ratio_interval

Result = Mapping[str, Any]


@dataclass(frozen=True)
class Saving:
    """How much less one policy spends than another, on the same noise.

    Parameters
    ----------
    absolute : float
        Mean of the paired saving, in the unit of what is compared; > 0 saves.
    low, high : float
        Its 95 % interval; NaN if the comparison gives none.
    baseline : float
        Mean of what the other policy spends: the per cent are of this.
    share : tuple of float
        The 95 % interval of the saving as a share of the baseline; NaN if there is none.
    """

    absolute: float
    low: float
    high: float
    baseline: float
    share: tuple[float, float] = (math.nan, math.nan)

    @property
    def verdict(self) -> int:
        """Return 1 if the saving is significant, -1 if the loss is, 0 if neither is sure."""
        if self.low > 0.0:
            return 1
        return -1 if self.high < 0.0 else 0

    def in_per_cent(self) -> tuple[float, float, float]:
        """Return mean, low and high in per cent of the baseline, NaN where it is not well known.

        That is where it is small against them, where it may be zero, and where the interval passes 100 % on
        either side: nobody saves more than all there is, and so large a loss is one of a small baseline.
        """
        largest = max(abs(self.absolute), abs(self.low), abs(self.high))
        known = math.isnan(self.low) or max(abs(end) for end in self.share) <= 1.0
        scale = 100.0 / self.baseline if known and self.baseline > 0.5 * largest else math.nan
        low, high = self.share if not math.isnan(scale) else (math.nan, math.nan)
        return scale * self.absolute, 100.0 * low, 100.0 * high

    def figures(self, unit: str) -> tuple[tuple[float, float, float], str]:
        """Return mean, low and high with their unit: per cent, or where those say nothing, the unit given."""
        shares = self.in_per_cent()
        if math.isnan(shares[0]):
            return (self.absolute, self.low, self.high), unit
        return shares, "%"


@dataclass(frozen=True)
class Finding:
    """What one concept at one mu shows.

    Parameters
    ----------
    concept, mu
        Where.
    cost, fuel : Saving or None
        Of the stochastic against the certainty-equivalent policy; None if one of them was not run.
    gap_left : float or None
        Part of the certainty-equivalent policy's extra cost over perfect information that the stochastic
        policy still has; None if a policy was not run or there is no extra cost to lose.
    further : Saving or None
        What perfect information would save against the stochastic policy.
    better : tuple of str
        Policies, perfect information aside, whose realised cost is significantly below the stochastic one's.
    lowest : str
        The policy, perfect information aside if there is any other, with the lowest mean realised cost.
    """

    concept: str
    mu: float
    cost: Saving | None
    fuel: Saving | None
    gap_left: float | None
    further: Saving | None
    better: tuple[str, ...]
    lowest: str


def findings(result: Result) -> list[Finding]:
    """Return what a comparison shows, for every concept and mu in its order.

    Parameters
    ----------
    result : mapping
        The object that ``socwise compare --json`` prints.
    """
    settings = dict.fromkeys((row["concept"], row["mu"]) for row in result["cases"])
    return [_finding(result, concept, mu) for concept, mu in settings]


def saving(result: Result, concept: str, mu: float, policy: str, versus: str, what: str) -> Saving | None:
    """Return what one policy saves against another, or None if they were not compared.

    Parameters
    ----------
    result : mapping
        The object that ``socwise compare --json`` prints.
    concept, mu, policy, versus
        Which pair; the comparison may hold it the other way round.
    what : str
        "cost_kg" or "fuel_l_per_100km".
    """
    rows = _rows(result, concept, mu)
    for pair in result["paired"]:
        if (pair["concept"], pair["mu"]) != (concept, mu) or not {policy, versus} <= rows.keys():
            continue
        names = (pair["policy"], pair["versus"])
        if names not in {(policy, versus), (versus, policy)}:
            continue
        mean, (low, high) = pair[what]["mean"], _interval(pair[what])
        if names == (policy, versus):
            mean, low, high = -mean, -high, -low
        ours, theirs = (_half_width(rows[name], what) for name in (policy, versus))
        baseline = rows[versus][what]["mean"]
        left = ratio_interval(baseline - mean, baseline, ours, theirs, 0.5 * (high - low))
        return Saving(mean, low, high, baseline, (1.0 - left[1], 1.0 - left[0]))
    return None


def _finding(result: Result, concept: str, mu: float) -> Finding:
    costs = _means(result, concept, mu, "cost_kg")
    realisable = {name: cost for name, cost in costs.items() if name != PERFECT_INFORMATION} or costs
    against = [name for name in realisable if name != STOCHASTIC]
    savings = {name: saving(result, concept, mu, STOCHASTIC, name, "cost_kg") for name in against}
    return Finding(
        concept=concept,
        mu=mu,
        cost=savings.get(CERTAINTY_EQUIVALENT),
        fuel=saving(result, concept, mu, STOCHASTIC, CERTAINTY_EQUIVALENT, "fuel_l_per_100km"),
        gap_left=_gap_left(costs),
        further=saving(result, concept, mu, PERFECT_INFORMATION, STOCHASTIC, "cost_kg"),
        better=tuple(name for name, one in savings.items() if one is not None and one.verdict < 0),
        lowest=min(realisable, key=lambda name: realisable[name]),
    )


def _gap_left(costs: Mapping[str, float]) -> float | None:
    if not {STOCHASTIC, CERTAINTY_EQUIVALENT, PERFECT_INFORMATION} <= costs.keys():
        return None
    bound = costs[PERFECT_INFORMATION]
    gap = costs[CERTAINTY_EQUIVALENT] - bound
    return (costs[STOCHASTIC] - bound) / gap if gap > 0.0 else None


def _means(result: Result, concept: str, mu: float, what: str) -> dict[str, float]:
    return {name: row[what]["mean"] for name, row in _rows(result, concept, mu).items()}


def _rows(result: Result, concept: str, mu: float) -> dict[str, Mapping[str, Any]]:
    return {row["policy"]: row for row in result["cases"] if (row["concept"], row["mu"]) == (concept, mu)}


def _half_width(row: Mapping[str, Any], what: str) -> float:
    return half_width(row[what]["se"], row["realizations"])


def _interval(difference: Mapping[str, Any]) -> tuple[float, float]:
    low, high = difference.get("ci95") or (None, None)
    return (math.nan, math.nan) if low is None or high is None else (float(low), float(high))

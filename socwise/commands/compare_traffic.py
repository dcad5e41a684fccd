"""``socwise compare --cycle traffic:NAME``: policies for the mean cycle, judged on an ensemble of cycles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from socwise.commands.errors import CommandError
from socwise.commands.screen import Advance

if TYPE_CHECKING:
    from ems import Concept
    from ems.records import Comparison

PREFIX = "traffic:"


def is_traffic(cycle: str) -> bool:
    """Whether ``--cycle`` names a traffic scenario."""
    return cycle.strip().lower().startswith(PREFIX)


def scenario_of(cycle: str) -> str:
    """Give the name or path behind ``traffic:``.

    Raises
    ------
    CommandError
        If there is none, or cycles are joined to it.
    """
    name = cycle.strip()[len(PREFIX) :].strip()
    if not name:
        raise CommandError(
            f"--cycle is {cycle!r}; give traffic:NAME or traffic:FILE.toml, such as traffic:commute"
        )
    return name


def traffic_comparison(
    concepts: Sequence[Concept], cycle: str, given: Mapping[str, Any], advance: Advance | None
) -> Comparison:
    """Draw the ensemble of a scenario and compare policies over it.

    Parameters
    ----------
    concepts : sequence of Concept
        The cars.
    cycle : str
        ``traffic:`` and a scenario.
    given : mapping
        Options of the comparison; ``realizations``, where given, is twice the number of cycles.
    advance : callable or None
        Shows progress.

    Raises
    ------
    CommandError
        If the number of realizations is odd or below 4.
    """
    from drivecycles.traffic.ensemble import draw_cycles
    from drivecycles.traffic.scenario_file import load_scenario
    from ems.ensemble import PER_MEMBER, compare_ensemble

    options = dict(given)
    realizations = options.pop("realizations", None)
    if realizations is not None and (realizations % PER_MEMBER or realizations < 2 * PER_MEMBER):
        raise CommandError(
            f"--realizations is {realizations}; each cycle of an ensemble is driven by a pair of them, so"
            " give an even number, 4 or more: half of it is the number of cycles"
        )
    scenario = load_scenario(scenario_of(cycle))
    cycles = None if realizations is None else realizations // PER_MEMBER
    ensemble = draw_cycles(scenario, cycles=cycles, seed=options.get("seed", 0))
    facts = {
        "scenario": scenario.model_dump(mode="json", exclude_none=True),
        "plan": scenario.ensemble.plan,
        "parameters": list(ensemble.names),
        "values": ensemble.values.tolist(),
    }
    return compare_ensemble(
        concepts, ensemble.planned, ensemble.members, progress=advance, facts=facts, **options
    )


def ensemble_sentences(result: Mapping[str, Any]) -> list[str]:
    """Say what the ensemble is and on how many of its cycles the first policy wins; nothing of one cycle.

    Parameters
    ----------
    result : mapping
        The object that ``socwise compare --json`` prints.
    """
    from socwise.labels import CERTAINTY_EQUIVALENT, concept_label, policy_style

    ensemble = result.get("ensemble")
    if ensemble is None:
        return []
    duration, cycle = ensemble["duration_s"], result["cycle"]
    opening = (
        f"{ensemble['cycles']} cycles of {cycle['distance_km']:.1f} km through uncertain traffic, of"
        f" {duration['least']:.0f} to {duration['greatest']:.0f} s, {duration['mean']:.0f} ±"
        f" {duration['sd']:.0f} s; policies are solved for the planned one, of {cycle['duration_s']:.0f} s,"
        " and judged on all."
    )
    return [
        opening,
        *(
            f"{concept_label(pair['concept'])}, μ = {pair['mu']:g}: {policy_style(pair['policy']).label}"
            f" costs less than {policy_style(pair['versus']).label} on"
            f" {round(pair['cheaper_share'] * ensemble['cycles'])} of {ensemble['cycles']} cycles."
            for pair in ensemble["paired"]
            if pair["versus"] == CERTAINTY_EQUIVALENT
        ),
    ]

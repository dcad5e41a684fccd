"""``socwise compare``: the main job."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from socwise.commands.options import (
    DEFAULT_JOBS,
    CycleOption,
    JobsOption,
    JsonOption,
    OnInfeasibleOption,
    concepts,
    only_the_model,
    split,
    variances,
)
from socwise.commands.screen import progress, show, show_json

if TYPE_CHECKING:
    from socwise.results import StoredComparison

_FIRST_RUN = "solving and simulating (the first run also compiles)"


def compare(
    concept: Annotated[
        str, typer.Option(metavar="NAME[,NAME...]", help="hev, phev, both, or the path of a .toml file.")
    ] = "both",
    cycle: CycleOption = "larsson",
    mu: Annotated[
        str | None,
        typer.Option(
            metavar="V[,V...]", help="Variance of the measured SOC.", show_default="0.0007,0.002,0.006"
        ),
    ] = None,
    realizations: Annotated[
        int, typer.Option(metavar="N", help="Realizations of the noise, in each case.")
    ] = 50,
    policy: Annotated[
        str | None,
        typer.Option(metavar="NAME[,NAME...]", help="Policies to compare.", show_default="all four"),
    ] = None,
    plant: Annotated[str, typer.Option(metavar="model", help="What the battery really does.")] = "model",
    estimator: Annotated[str, typer.Option(metavar="model", help="What believes the SOC.")] = "model",
    seed: Annotated[int, typer.Option(metavar="S", help="Seed of the noise.")] = 0,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for results, figures and report.")] = Path(
        "results/compare"
    ),
    on_infeasible: OnInfeasibleOption = "error",
    jobs: JobsOption = DEFAULT_JOBS,
    as_json: JsonOption = False,
) -> None:
    """Compare energy-management policies on the same noise, and say what heeding the uncertainty is worth.

    Writes results, figures and a report to --out.
    """
    only_the_model(plant, "--plant")
    only_the_model(estimator, "--estimator")
    given_mus = None if mu is None else variances(mu)
    given_policies = None if policy is None else split(policy, "--policy")
    from drivecycles import load_cycle
    from ems.compare import DEFAULT_MU, DEFAULT_POLICIES
    from ems.compare import compare as run
    from ems.summary import to_json
    from socwise.store import check_writable, read, write

    check_writable(out)
    with progress(_FIRST_RUN) as advance:
        comparison = run(
            concepts(concept),
            load_cycle(cycle),
            mus=DEFAULT_MU if given_mus is None else given_mus,
            policies=DEFAULT_POLICIES if given_policies is None else given_policies,
            realizations=realizations,
            seed=seed,
            on_infeasible=on_infeasible,
            jobs=jobs,
            progress=advance,
        )
    with progress("drawing figures and writing the report"):
        write(comparison, to_json(comparison), out)
    _show(read(out), as_json=as_json)


def _show(stored: StoredComparison, *, as_json: bool) -> None:
    if as_json:
        show_json(stored.result)
        return
    from socwise.commands.compare_table import cases_table
    from socwise.report.answer import findings
    from socwise.report.sentences import answer

    found = findings(stored.result)
    for concept in dict.fromkeys(one.concept for one in found):
        sentences = answer(concept, [one for one in found if one.concept == concept])
        show(" ".join(sentences[:2]), "")
    folder = stored.folder
    show(
        cases_table(stored.result["cases"]),
        "",
        "cost: fuel and penalties at the true SOC; ±: half of the 95 % interval of the mean; "
        "end: estimate at the end; out: time outside the SOC window.",
        f"Results are in {folder}, the report is {folder / 'report.html'}",
    )

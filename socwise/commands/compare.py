"""``socwise compare``: the main job."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from socwise.commands.compare_traffic import ensemble_sentences, is_traffic, traffic_comparison
from socwise.commands.errors import CommandError
from socwise.commands.loop_options import (
    MODEL,
    CellOption,
    EstimatorOption,
    IsolateOption,
    MappingOption,
    PlantOption,
    ScatterOption,
    SensorsOption,
    SetOption,
    TrainingCountOption,
    TrainingOption,
    closed_loop,
    names_of,
    only_in_the_loop,
)
from socwise.commands.mass_option import MassOption, mass_effects, mass_sentences, weighed
from socwise.commands.options import (
    DEFAULT_JOBS,
    CycleOption,
    JobsOption,
    JsonOption,
    OnInfeasibleOption,
    concepts,
    split,
    variances,
)
from socwise.commands.screen import Advance, progress, show, show_json

if TYPE_CHECKING:
    from ems import Concept
    from ems.closed import ClosedLoop
    from ems.records import Comparison
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
            metavar="V[,V...]",
            help="Variance of the measured SOC.",
            show_default="0.0007,0.002,0.006; in a closed loop the identified one",
        ),
    ] = None,
    realizations: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Realizations of the noise, in each case; of traffic two for each cycle.",
            show_default="50",
        ),
    ] = None,
    policy: Annotated[
        str | None,
        typer.Option(metavar="NAME[,NAME...]", help="Policies to compare.", show_default="all four"),
    ] = None,
    plant: PlantOption = None,
    estimator: EstimatorOption = None,
    mapping: MappingOption = None,
    isolate: IsolateOption = None,
    cell: CellOption = None,
    option: SetOption = None,
    sensors: SensorsOption = None,
    scatter: ScatterOption = None,
    training: TrainingOption = None,
    training_realizations: TrainingCountOption = None,
    mass: MassOption = None,
    seed: Annotated[int, typer.Option(metavar="S", help="Seed of the noise.")] = 0,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for results, figures and report.")] = Path(
        "results/compare"
    ),
    on_infeasible: OnInfeasibleOption = "error",
    jobs: JobsOption = DEFAULT_JOBS,
    as_json: JsonOption = False,
) -> None:
    """Compare energy-management policies on the same noise, and say what heeding the uncertainty is worth.

    Writes results, figures and a report to --out. With --plant ecm or an FMU the loop is closed: an estimator
    believes, and the uncertainty model is identified from what it does.
    """
    answers, believes = names_of(plant, estimator)
    only_for_a_loop = {
        "--mapping": mapping,
        "--isolate": isolate,
        "--cell": cell,
        "--option": option,
        "--sensors": sensors,
        "--scatter": scatter,
        "--training": training,
        "--training-realizations": training_realizations,
    }
    common: dict[str, Any] = {
        "mus": None if mu is None else variances(mu),
        "policies": None if policy is None else split(policy, "--policy"),
        "realizations": realizations,
        "seed": seed,
        "on_infeasible": on_infeasible,
        "jobs": jobs,
    }
    loop: ClosedLoop | None = None
    if answers == MODEL:
        only_in_the_loop(only_for_a_loop)
    elif is_traffic(cycle):
        raise CommandError("an ensemble of traffic takes --plant model; leave --plant and --estimator out")
    else:
        loop = closed_loop(
            answers,
            believes,
            mapping=mapping,
            isolate=isolate,
            cell=cell,
            options=option,
            sensors=sensors,
            scatter=scatter,
        )
    from ems.ensemble_summary import ensemble_json
    from ems.summary import to_json
    from socwise.store import check_writable, read, write

    check_writable(out)
    cars = weighed(concepts(concept), mass)
    effects = {} if is_traffic(cycle) else mass_effects(cars, cycle)
    given = {key: value for key, value in common.items() if value is not None}
    with progress(_FIRST_RUN) as advance:
        if loop is None:
            comparison = _model_comparison(cars, cycle, given, advance)
        else:
            comparison = _loop_comparison(cars, cycle, loop, training, training_realizations, given, advance)
    with progress("drawing figures and writing the report"):
        write(comparison, {**to_json(comparison), **ensemble_json(comparison), **effects}, out, jobs)
    _show(read(out), as_json=as_json)


def _model_comparison(
    cars: list[Concept], cycle: str, given: dict[str, Any], advance: Advance | None
) -> Comparison:
    from drivecycles import load_cycle
    from ems.compare import compare as run

    if is_traffic(cycle):
        return traffic_comparison(cars, cycle, given, advance)

    return run(cars, load_cycle(cycle), progress=advance, **given)


def _loop_comparison(
    cars: list[Concept],
    cycle: str,
    loop: ClosedLoop,
    training: str | None,
    training_realizations: int | None,
    given: dict[str, Any],
    advance: Advance | None,
) -> Comparison:
    from drivecycles import load_cycle
    from ems.closed import Training, compare_closed
    from ems.closed.identify import REALIZATIONS, training_trip

    driven = load_cycle(cycle)
    plan = Training(
        trip=load_cycle(training or training_trip(driven.name)),
        realizations=training_realizations or REALIZATIONS,
    )
    return compare_closed(cars, driven, loop, plan, progress=advance, **given)


def _show(stored: StoredComparison, *, as_json: bool) -> None:
    if as_json:
        show_json(stored.result)
        return
    from socwise.commands.compare_table import cases_table
    from socwise.report.answer import findings
    from socwise.report.closed import loop_sentences
    from socwise.report.sentences import answer

    kinds = (loop_sentences, ensemble_sentences, mass_sentences)
    for sentence in (sentence for kind in kinds for sentence in kind(stored.result)):
        show(sentence, "")
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

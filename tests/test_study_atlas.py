"""The atlas: its picture, and the reduced study of 24 cases."""

import csv
import time
from dataclasses import replace
from itertools import product

import pytest
from study_cases import ROOT, results

from socwise.figures.atlas import plot_atlas, plot_loss_map, write_atlas
from socwise.report.study_judge import Judged, judge
from socwise.study import load_study, make_plan, read_study, run_study
from socwise.study.reading import StudyCase

STUDIES = ROOT / "docs/studies"


def judged(percent, low, high, **factors):
    case = StudyCase(1, "0", factors, "done", None, None, None, None, {})
    return Judged(case, percent, low, high)


def twelve():
    found = []
    for concept, mu, steepness, width in product(("hev",), (1e-3, 2e-3), (0.1, 1.0, 10.0), (0.1, 0.2)):
        loss = 100.0 * steepness * mu / width
        sure = steepness > 0.5
        factors = {"concept": concept, "cycle": "us06", "mu": mu, "penalty_steepness": steepness}
        low = 0.5 * loss if sure else -0.5 * loss
        found.append(judged(loss, low, 2.0 * loss, **factors, window_width=width))
    return found


def test_a_map_has_a_cell_for_each_case_and_hatches_what_may_be_nothing():
    ax = plot_loss_map(twelve(), ["penalty_steepness"], ["window_width", "mu"])
    filled = [patch for patch in ax.patches if patch.get_fill()]
    hatched = [patch for patch in ax.patches if patch.get_hatch()]
    assert (len(filled), len(hatched)) == (12, 4)
    assert {patch.get_x() for patch in hatched} == {-0.5}
    # steepness 10, width 0.1, mu 0.002: the greatest loss, 20 %
    texts = {tuple(text.get_position()): text.get_text() for text in ax.texts}
    assert texts[2, 1] == "20"
    assert texts[0, 3] == "0.1"
    assert [label.get_text() for label in ax.get_yticklabels()] == [
        "0.1 | 0.001",
        "0.1 | 0.002",
        "0.2 | 0.001",
        "0.2 | 0.002",
    ]
    assert ax.get_xlabel() == "penalty steepness"


def test_a_case_that_is_not_known_leaves_its_cell_empty():
    cases = [judged(None, None, None, mu=1.0, beta=1.0), judged(3.0, 1.0, 5.0, mu=2.0, beta=1.0)]
    ax = plot_loss_map(cases, ["mu"], ["beta"])
    assert [text.get_text() for text in ax.texts] == ["3.0"]
    assert len(ax.get_xticks()) == 2


def test_a_case_that_left_its_grid_gets_a_cross_instead_of_a_number():
    said = ("stochastic on 'hev': its cost is not to be trusted",)
    doubtful = replace(judged(-70.0, -90.0, -50.0, mu=1.0, beta=1.0), warnings=said)
    ax = plot_loss_map([doubtful], ["mu"], ["beta"])
    assert [text.get_text() for text in ax.texts] == ["×"]
    assert list(ax.patches) == []


def test_an_atlas_has_a_map_for_each_concept_and_cycle(tmp_path):
    figure = plot_atlas(twelve(), ["penalty_steepness"], ["window_width", "mu"])
    assert [ax.get_title() for ax in figure.axes[:-1]] == ["HEV, us06"]
    paths = [tmp_path / name for name in ("a.png", "b.png")]
    for path in paths:
        write_atlas(twelve(), ["penalty_steepness"], ["window_width", "mu"], path)
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_the_atlas_has_as_many_cases_as_it_says():
    plan = make_plan(load_study(STUDIES / "atlas.toml"))
    assert len(plan.cases) == 432
    assert len({case.key for case in plan.cases}) == 432
    assert {(case.factors["concept"], case.factors["cycle"]) for case in plan.cases} == set(
        product(("hev", "phev"), ("hwfet+ftp72", "us06", "wltc-3b"))
    )


def test_the_page_says_what_the_table_says():
    with (STUDIES / "atlas.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    page = " ".join((ROOT / "docs/atlas.md").read_text(encoding="utf-8").split())
    plan = make_plan(load_study(STUDIES / "atlas.toml"))
    # A CSV has text in it, so factors are compared as text.
    assert [{name: str(value) for name, value in case.factors.items()} for case in plan.cases] == [
        {name: row[name] for name in plan.cases[0].factors} for row in rows
    ]
    unsure = [row for row in rows if float(row["loss_kg_low"]) <= 0.0 <= float(row["loss_kg_high"])]
    assert [row for row in rows if row["may_be_nothing"] == "1"] == unsure
    dearer = [row for row in rows if float(row["loss_kg_low"]) > 0.0]
    assert f"In {len(dearer)} of {len(rows)} cases certainty equivalence costs more beyond doubt" in page
    assert f"in {len(unsure)} the difference cannot be told from zero, in none it costs less" in page
    assert len(dearer) + len(unsure) == len(rows)
    hev = [row for row in dearer if row["concept"] == "hev"]
    assert f"{len(hev)} of 216 cases cost more beyond doubt" in page
    own = [row for row in hev if (row["window_width"], row["penalty_steepness"]) == ("0.2", "1.0")]
    losses = [float(row["loss_percent"]) for row in own]
    assert f"the loss is {min(losses):.0f} to {max(losses):.0f} %" in page
    reach = [100.0 * float(row["loss_kg_high"]) / float(row["stochastic_cost_kg"]) for row in unsure]
    assert f"of {len(unsure)} hatched cases {sum(one > 5.0 for one in reach)} have intervals" in page


@pytest.mark.slow
def test_the_reduced_atlas_takes_three_minutes_and_two_gigabytes_at_most(tmp_path):
    started = time.perf_counter()
    outcome = run_study(STUDIES / "atlas-reduced.toml", tmp_path / "out", jobs=2)
    assert time.perf_counter() - started < 180.0
    assert (outcome.computed, outcome.failed) == (24, ())
    stored = read_study(tmp_path / "out")
    assert 50.0 < max(case.timing["peak_rss_MB"] for case in stored.cases) < 2000.0
    found = judge(stored)
    steep = [one for one in found if one.case.factors["penalty_steepness"] == 1.0]
    # Where leaving the window costs what the presets say, certainty equivalence is dear for the HEV.
    hev = [one for one in steep if one.case.factors["concept"] == "hev"]
    assert all(one.distinguishable and one.percent > 20.0 for one in hev)
    mild = [one for one in found if one.case.factors["penalty_steepness"] == 0.01]
    assert max(one.percent for one in mild) < max(one.percent for one in hev)
    write_atlas(found, ["penalty_steepness"], ["mu"], tmp_path / "atlas.png")
    assert (tmp_path / "atlas.png").stat().st_size > 10_000
    assert "summary.csv" in results(tmp_path / "out")

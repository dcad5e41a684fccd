"""The page of a study says what its cases say, of every design, finished or not."""

import json
import re

import pytest
from command_line import run
from synthetic_study import factorial, scattered, write_study

from socwise.report import render_any, write_study_report
from socwise.report.study_answer import concept_answers, study_answer
from socwise.report.study_influence import factor_label, influence, value_label
from socwise.report.study_judge import judge, loss
from socwise.report.study_page import render_study, study_payload
from socwise.report.study_tables import failures_table, influence_table, study_table
from socwise.results import StoreError
from socwise.study.reading import read_study

CASES = factorial(concept=["hev", "phev"], penalty_steepness=[0.1, 1.0])


def study_of(tmp_path, points, **more):
    return read_study(write_study(tmp_path / "study", points, **more))


def answer_of(study):
    return " ".join(study_answer(study, judge(study)))


def test_loss_is_that_of_the_certainty_equivalent_policy(tmp_path):
    """The stochastic policy costs 1 kg for sure, so the interval scales."""
    study = study_of(tmp_path, CASES, losses=[(2.0, 0.5), (640.0, 100.0), (0.2, 0.5), (-3.0, 1.0)])
    assert loss(study.cases[0]) == pytest.approx((2.0, 1.5, 2.5), rel=2e-3)
    assert loss(study.cases[1]) == pytest.approx((640.0, 540.0, 740.0), rel=2e-3)
    assert loss(study.cases[0], "fuel_l_per_100km") == pytest.approx((0.25, 0.15, 0.35), rel=1e-4)
    judged = judge(study)
    assert [one.standing for one in judged] == ["costs more", "costs more", "good enough", "good enough"]
    assert [one.distinguishable for one in judged] == [True, True, False, True]


def test_a_difference_that_cannot_be_told_is_not_good_enough_by_that_alone(tmp_path):
    study = study_of(tmp_path, CASES[:2], losses=[(0.5, 0.4), (0.5, 5.0)])
    assert [one.standing for one in judge(study)] == ["good enough", "undecided"]
    text = answer_of(study)
    assert "good enough in 1 of 2 cases" in text
    assert "in 1 the difference cannot be told from zero but may exceed 1 %" in text


def test_the_answer_counts_says_what_decides_and_where_it_is_worst(tmp_path):
    study = study_of(tmp_path, CASES, losses=[(0.1, 0.2), (30.0, 5.0), (0.0, 0.3), (50.0, 10.0)])
    text = answer_of(study)
    assert text.startswith("Certainty equivalence is good enough in 2 of 4 cases")
    assert "in 2 it costs more beyond doubt" in text
    assert "penalty steepness: 100 % of the cases are good enough at 0.1, 0 % at 1" in text
    assert "it is 40.0 % in the middle and 50.0 % (95 % interval 40.0 to 60.0) at most" in text
    assert "at concept PHEV and penalty steepness 1." in text
    assert "dearer" not in text and "failed" not in text
    assert [sentences[0] for sentences in concept_answers(judge(study))] == [
        "HEV: good enough in 1 of 2 cases, costs more in 1, undecided in 0.",
        "PHEV: good enough in 1 of 2 cases, costs more in 1, undecided in 0.",
    ]


def test_where_the_stochastic_policy_loses_it_is_said(tmp_path):
    study = study_of(tmp_path, CASES, losses=[(-20.0, 5.0), (30.0, 5.0), (-30.0, 3.0), (50.0, 10.0)])
    assert "In 2 the stochastic policy is the dearer one beyond doubt." in answer_of(study)
    assert study_table(study, judge(study)).count("better than stochastic") == 2


def test_an_unfinished_study_says_so_and_has_a_page(tmp_path):
    study = study_of(tmp_path, CASES, failed=(2,), missing=(3, 4))
    assert "1 of 4 cases failed and 2 of 4 cases are still to be computed." in answer_of(study)
    page = render_study(study)
    assert "1 of 4 cases finished" in page
    assert "the cycle &lt;b&gt;is&lt;/b&gt; too steep" in page
    table = study_table(study, judge(study))
    assert table.count("<tr data-case=") == 4
    assert table.count(">missing<") == 2 and table.count(">failed<") == 1
    columns = table.count('<th scope="col"')
    for row in re.findall(r"<tr data-case.*?</tr>", table):
        assert row.count("<td") + row.count("<th") == columns
    nothing = study_of(tmp_path / "b", CASES, missing=(1, 2, 3, 4))
    assert "the question stays open" in answer_of(nothing)
    render_study(nothing)


def test_a_case_whose_policy_leaves_its_grid_counts_for_nothing(tmp_path):
    told = "stochastic on 'phev': 15.2% of the samples lie outside, and its cost is not to be trusted"
    other = "perfect_information on 'hev': 19.9% lie outside the SOC grid, and its cost is not to be trusted"
    losses = [(0.1, 0.2), (30.0, 5.0), (-70.0, 1.0), (50.0, 10.0)]
    study = study_of(tmp_path, CASES, losses=losses, warnings={3: [told], 4: [other]})
    judged = judge(study)
    assert [one.standing for one in judged] == ["good enough", "costs more", "not trusted", "costs more"]
    text = answer_of(study)
    assert "good enough in 1 of 3 cases" in text
    assert "1 more case is left out" in text and "dearer" not in text
    assert study_payload(study, judged)["cases"][2]["loss"] is None
    page = render_study(study)
    assert "Cases not to be trusted" in page and "15.2% of the samples" in page and "19.9%" not in page


def test_factors_are_ordered_by_what_they_decide(tmp_path):
    study = study_of(tmp_path, CASES, losses=[(0.1, 0.2), (30.0, 5.0), (0.0, 0.3), (50.0, 10.0)])
    rows = influence(study, judge(study))
    assert [(row.factor, row.value, row.cases, row.share) for row in rows] == [
        ("penalty_steepness", "0.1", 2, 1.0),
        ("penalty_steepness", "1", 2, 0.0),
        ("concept", "HEV", 2, 0.5),
        ("concept", "PHEV", 2, 0.5),
    ]
    assert (rows[1].median, rows[1].largest) == pytest.approx((40.0, 50.0))
    assert influence_table(study, judge(study)).count("<tr>") == 5


def test_many_numbers_are_parted_by_thirds(tmp_path):
    study = study_of(tmp_path, scattered(30))
    rows = [row for row in influence(study, judge(study)) if row.factor == "window_width"]
    assert [row.cases for row in rows] == [10, 10, 10]
    assert rows[0].median > rows[1].median > rows[2].median, "a wide window forgives"


def test_the_plots_get_every_case_of_every_design(tmp_path):
    grid = study_of(tmp_path, [*CASES, {"concept": "hev", "penalty_steepness": 0.5}], failed=(1,))
    numbers = study_payload(grid, judge(grid))
    concept, steepness = numbers["factors"]
    assert (concept["numeric"], concept["values"]) == (False, ["HEV", "PHEV"])
    assert (steepness["numbers"], steepness["values"]) == ([0.1, 0.5, 1.0], ["0.1", "0.5", "1"])
    assert [one["factors"] for one in numbers["cases"]] == [[0, 0], [0, 2], [1, 0], [1, 2], [0, 1]]
    assert [one["loss"] is None for one in numbers["cases"]] == [True, False, False, False, False]
    assert sorted(numbers["deciding"]) == [0, 1]
    points = scattered(40)
    scatter = study_of(tmp_path / "b", points)
    numbers = study_payload(scatter, judge(scatter))
    mu = numbers["factors"][1]
    assert not mu["few"]
    assert [mu["numbers"][one["factors"][1]] for one in numbers["cases"]] == [point["mu"] for point in points]


def test_the_page_is_one_safe_small_file_and_always_the_same(tmp_path):
    evil = "</script><script>alert(1)</script><img src=x>@@DATA@@.toml"
    points = factorial(
        concept=["hev", evil],
        mu=[0.001 * k for k in range(1, 11)],
        window_width=[0.01 * k for k in range(10, 33)],
    )
    folder = write_study(tmp_path / "study", points)
    assert len(points) == 460
    page = render_any(folder)
    write_study_report(folder, tmp_path / "b.html")
    assert (tmp_path / "b.html").read_text(encoding="utf-8") == page
    assert len(page.encode()) < 10e6
    assert page.count("</script>") == 3
    assert "<script>alert" not in page and "<img src" not in page
    harmless = page.replace("src=x", "")
    ours = harmless[: harmless.index('<script type="application/json"')]
    ours += harmless[harmless.rindex("<script>") :]
    assert not re.search(r"(src|href)\s*=\s*(?![\"']?data:)", ours), "nothing is fetched from anywhere"
    assert not re.search(r"https?://", ours)
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])
    assert len(data["cases"]) == 460
    assert evil in data["factors"][0]["values"]


def test_one_case_and_a_factor_that_some_cases_lack(tmp_path):
    single = study_of(tmp_path, CASES[:1])
    assert study_payload(single, judge(single))["factors"] == []
    render_study(single)
    mixed = study_of(
        tmp_path / "b", [*CASES, {"concept": "hev", "penalty_steepness": 1.0, "mu": 0.002}, {"mu": 0.006}]
    )
    numbers = study_payload(mixed, judge(mixed))
    assert numbers["cases"][0]["factors"][2] is None
    assert "n/a" in study_table(mixed, judge(mixed))
    assert failures_table([]).count("<tr>") == 1


def test_names_as_people_read_them():
    assert [factor_label(name) for name in ("mu", "capacity_Ah", "window_width", "terminal.slope_kg")] == [
        "μ", "capacity [Ah]", "window width", "terminal.slope [kg]",
    ]  # fmt: skip
    assert [value_label(value) for value in (0.0007, 12, "hev", "my car.toml", 123456.7)] == [
        "0.0007", "12", "HEV", "my car.toml", "1.2346e+05",
    ]  # fmt: skip


def test_a_folder_of_another_kind_is_refused(tmp_path):
    with pytest.raises(StoreError, match="holds no results"):
        render_any(tmp_path)
    (tmp_path / "manifest.json").write_text('{"format": "socwise estimate"}', encoding="utf-8")
    with pytest.raises(StoreError, match="holds a socwise estimate, of which there is no page"):
        render_any(tmp_path)


def test_the_command_writes_beside_the_results_or_where_it_is_told(capsys, tmp_path):
    folder = write_study(tmp_path / "study", CASES)
    shown = run(capsys, "report", folder)
    assert (shown.code, shown.err) == (0, "")
    page = (folder / "report.html").read_bytes()
    assert run(capsys, "report", folder, "--out", tmp_path / "new" / "page.html").code == 0
    assert (tmp_path / "new" / "page.html").read_bytes() == page
    shown = run(capsys, "report", folder, "--out", tmp_path / "page.txt")
    assert shown.code == 2
    assert "must end in .html or .htm" in " ".join(shown.err.split())
    (folder / "cases" / f"{1:064x}.json").write_text("{", encoding="utf-8")
    before = (folder / "report.html").read_bytes()
    assert run(capsys, "report", folder).code == 2
    assert (folder / "report.html").read_bytes() == before

"""The report says what the numbers say, also where they do not flatter, and stays one safe small file."""

import base64
import copy
import dataclasses
import json
import math
import re

import numpy as np
import pytest
from scipy import stats
from synthetic import POLICIES, make_comparison, make_result, store_without_figures

from ems.statistics import half_width
from socwise.report import write_report
from socwise.report.answer import Saving, findings, saving
from socwise.report.page import render
from socwise.report.payload import _CHARACTERS_PER_VALUE, TRAJECTORY_CHARACTERS, _plan, pack, payload
from socwise.report.ratio import ratio_interval
from socwise.report.sentences import answer, verdict
from socwise.report.tables import cases_table, findings_table
from socwise.report.wording import listing, number, per_cent, plus_minus
from socwise.results import StoreError
from socwise.store import write

COSTS = {"stochastic": 1.0, "certainty_equivalent": 1.25, "perfect_information": 0.9, "rule_based": 1.1}


def _case(policy, cost, fuel, concept="hev", mu=0.002):
    return {
        "concept": concept,
        "mu": mu,
        "policy": policy,
        "realizations": 200,
        "cost_kg": {"mean": cost, "se": 0.01},
        "fuel_l_per_100km": {"mean": fuel, "se": 0.01},
    }


def _pair(policy, versus, cost, fuel, concept="hev", mu=0.002):
    """Mean and half-width of the differences in cost and in fuel."""

    def entry(mean, half):
        return {"mean": mean, "ci95": [mean - half, mean + half]}

    return {
        "concept": concept,
        "mu": mu,
        "policy": policy,
        "versus": versus,
        "cost_kg": entry(*cost),
        "fuel_l_per_100km": entry(*fuel),
    }


def _result(pairs, costs=COSTS, fuel=5.0):
    """The uncertainty of a difference is all the stochastic policy's: its interval scales to per cent."""
    cases = [_case(name, cost, fuel) for name, cost in costs.items()]
    for pair in pairs[:1]:
        for what in ("cost_kg", "fuel_l_per_100km"):
            limits = pair[what]["ci95"]
            error = limits and 0.5 * (limits[1] - limits[0]) / half_width(1.0, 200)
            for case in cases:
                case[what]["se"] = error if case["policy"] == "stochastic" else 0.0 if limits else None
    return {"cases": cases, "paired": pairs}


def _text(result):
    return " ".join(answer("hev", findings(result)))


WIN = _pair("stochastic", "certainty_equivalent", (-0.25, 0.05), (-0.01, 0.02))


def test_a_win_is_stated_in_per_cent_with_its_interval():
    text = _text(_result([WIN]))
    assert text.startswith("HEV: against the certainty-equivalent policy")
    assert "lowers the realised cost by 20.0 % (95 % interval 16.0 to 24.0) at μ = 0.002." in text
    assert "Fuel alone: no significant difference, saving 0.20 % (95 % interval −0.20 to 0.60)" in text
    assert "29 % at μ = 0.002 is still lost" in text, "(1.0 - 0.9) / (1.25 - 0.9)"


def test_a_pair_given_the_other_way_round_says_the_same():
    turned = _pair("certainty_equivalent", "stochastic", (0.25, 0.05), (0.01, 0.02))
    assert _text(_result([turned])) == _text(_result([WIN]))


def test_a_loss_is_said_to_be_a_loss():
    costs = {**COSTS, "certainty_equivalent": 0.8}
    loss = _pair("stochastic", "certainty_equivalent", (0.2, 0.04), (0.5, 0.1))
    found = findings(_result([loss], costs))
    text = _text(_result([loss], costs))
    assert "raises the realised cost by 25.0 % (95 % interval 20.0 to 30.0)" in text
    assert "10.0 % (95 % interval 8.00 to 12.0) more" in text
    assert "The certainty-equivalent policy realises a significantly lower cost" in text
    assert "still lost" not in text, "no gap to close where the baseline beats the bound"
    assert verdict(found[0]) == "certainty-equivalent cheaper"
    assert found[0].lowest == "certainty_equivalent"


def test_no_significant_difference_is_called_that():
    costs = {**COSTS, "certainty_equivalent": 1.0}
    draw = _pair("stochastic", "certainty_equivalent", (-0.01, 0.02), (0.0, 0.1))
    result = _result([draw], costs)
    assert (
        "makes no significant difference to the realised cost, saving 1.00 % (95 % interval −1.00 to 3.00)"
        in (_text(result))
    )
    assert verdict(findings(result)[0]) == "no significant difference"


def test_a_rule_based_policy_that_wins_is_named():
    rule = _pair("stochastic", "rule_based", (0.1, 0.02), (0.0, 0.1))
    text = _text(_result([WIN, rule], {**COSTS, "rule_based": 0.95}))
    assert (
        "The rule-based policy realises a significantly lower cost than the stochastic one at μ = 0.002."
        in text
    )


def test_a_policy_at_the_bound_has_nothing_left_to_gain():
    assert "nothing at μ = 0.002 is still lost" in _text(_result([WIN], {**COSTS, "stochastic": 0.89}))


def test_without_both_policies_the_question_stays_open():
    result = _result([], {"rule_based": 1.0, "perfect_information": 0.9})
    text = _text(result)
    assert "not both run" in text
    assert "Lowest mean realised cost: rule-based at μ = 0.002" in text
    assert verdict(findings(result)[0]) == "not compared"


def test_no_fuel_no_per_cent():
    text = _text(_result([_pair("stochastic", "certainty_equivalent", (-0.2, 0.1), (0.3, 0.1))], fuel=0.0))
    assert "Fuel alone: 0.30 l/100 km (95 % interval 0.20 to 0.40) more" in text


def test_one_realization_claims_nothing():
    single = copy.deepcopy(WIN)
    for what in ("cost_kg", "fuel_l_per_100km"):
        single[what]["ci95"] = None
    result = _result([single])
    assert "makes no significant difference to the realised cost, saving 20.0 % (no interval)" in _text(
        result
    )
    assert verdict(findings(result)[0]) == "no interval: one realization"


def test_a_long_sweep_names_its_ends():
    mus = [0.001 * k for k in range(1, 7)]
    result = _result([{**WIN, "mu": mu} for mu in mus])
    result["cases"] = [{**row, "mu": mu} for mu in mus for row in result["cases"]]
    text = _text(result)
    assert "at μ = 0.001 and 20.0 % (16.0 to 24.0) at μ = 0.006 (first and last of 6" in text
    assert "0.003" not in text


def _with_errors(result, errors):
    """Give policies the half widths of their own intervals of the cost."""
    for case in result["cases"]:
        if case["policy"] in errors:
            case["cost_kg"]["se"] = errors[case["policy"]] / half_width(1.0, 200)
    return result


def test_no_per_cent_beyond_all_there_is():
    """What is left of 1.25 kg is 0.25 kg, known to 0.3 kg: Fieller's interval passes a saving of 100 %."""
    costs = {**COSTS, "stochastic": 0.25}
    win = _pair("stochastic", "certainty_equivalent", (-1.0, 0.6), (-0.01, 0.02))
    result = _with_errors(_result([win], costs), {"stochastic": 0.3, "certainty_equivalent": 0.75})
    one = findings(result)[0].cost
    assert 1.0 < one.share[1] < 1.1
    assert all(math.isnan(value) for value in one.in_per_cent())
    assert "lowers the realised cost by 1.00 kg (95 % interval 0.400 to 1.60) at μ = 0.002." in _text(result)
    assert ">1.00 kg (0.400 to 1.60)</td>" in findings_table(findings(result))


def test_a_loss_beyond_all_there_is_has_no_per_cent_either():
    costs = {**COSTS, "stochastic": 1.4, "certainty_equivalent": 0.8}
    loss = _pair("stochastic", "certainty_equivalent", (0.6, 0.35), (-0.01, 0.02))
    text = _text(_result([loss], costs))
    assert "raises the realised cost by 0.600 kg (95 % interval 0.250 to 0.950)" in text


def test_a_loss_that_is_not_sure_is_no_negative_saving():
    costs = {**COSTS, "certainty_equivalent": 1.0}
    draw = _pair("stochastic", "certainty_equivalent", (0.01, 0.03), (0.05, 0.1))
    text = _text(_result([draw], costs))
    assert (
        "makes no significant difference to the realised cost, "
        "costing 1.00 % (95 % interval −2.00 to 4.00) more at μ = 0.002."
    ) in text
    assert "no significant difference, costing 1.00 % (95 % interval −1.00 to 3.00) more at" in text
    assert "saving" not in text


def test_the_sign_of_a_saving():
    assert [Saving(0.1, *ends, 1.0).verdict for ends in ((0.05, 0.2), (-0.3, -0.1), (-0.1, 0.1))] == [
        1,
        -1,
        0,
    ]
    assert Saving(0.1, math.nan, math.nan, 1.0).verdict == 0
    assert saving(_result([WIN]), "hev", 0.002, "stochastic", "rule_based", "cost_kg") is None
    assert saving(_result([WIN]), "hev", 0.006, "stochastic", "certainty_equivalent", "cost_kg") is None


def test_a_saving_in_per_cent_is_never_more_than_all():
    """A baseline as uncertain as the saving: 12 of 14 kg, where the difference alone allows 103 %."""
    low, high = ratio_interval(1.6, 14.0, 0.005, 2.4, 2.4)
    assert 0.08 < low < 1.6 / 14.0 < high < 0.16
    naive = (1.0 - (12.4 + 2.4) / 14.0, 1.0 - (12.4 - 2.4) / 14.0)
    assert naive[0] < 0.0
    assert all(math.isnan(end) for end in ratio_interval(1.0, 2.0, 0.5, 2.1, 1.0))


@pytest.mark.parametrize("half_difference", [0.0999, 0.1001])
def test_the_interval_in_per_cent_agrees_with_the_difference(half_difference):
    low, high = ratio_interval(1.1, 1.0, 0.3, 0.25, half_difference)
    assert (low <= 1.0 <= high) == (half_difference > 0.1)


def test_the_interval_in_per_cent_by_test_inversion():
    """At the ends of the interval of A / B the paired t interval of A - R B ends at zero."""
    rng = np.random.default_rng(5)
    ours = rng.normal(1.0, 0.2, 30)
    theirs = 0.5 * ours + rng.normal(1.0, 0.3, 30)

    def half(sample):
        return stats.t.ppf(0.975, 29) * stats.sem(sample)

    ends = ratio_interval(ours.mean(), theirs.mean(), half(ours), half(theirs), half(ours - theirs))
    for ratio in ends:
        rest = ours - ratio * theirs
        assert abs(rest.mean()) == pytest.approx(half(rest), rel=1e-9)


def test_numbers_as_people_read_them():
    assert number(-0.0001, 2) == "0.00"
    assert number(-1.5, 1) == "−1.5"
    assert (number(None), number(math.nan)) == ("n/a", "n/a")
    assert (per_cent(12.345), per_cent(1.2345)) == ("12.3", "1.23")
    assert plus_minus(1.0, math.nan, 1) == "1.0"
    assert (listing([]), listing(["a"]), listing(["a", "b", "c"])) == ("", "a", "a, b and c")


@pytest.fixture(scope="module")
def comparison():
    return make_comparison(("hev", "phev"), (0.0007, 0.006), POLICIES, steps=300, realizations=12)


@pytest.fixture(scope="module")
def stored(comparison, tmp_path_factory):
    return store_without_figures(comparison, tmp_path_factory.mktemp("report") / "out")


def test_the_tables_hold_every_case_and_its_interval(comparison):
    table = cases_table(make_result(comparison)["cases"])
    assert table.count("<tr") == 1 + 4 + len(comparison.cases)
    assert table.count('class="group"') == 4
    assert table.count("class=best") == 4
    assert table.count("±") == 7 * len(comparison.cases)
    assert "n/a" in table, "the rule-based policy promises nothing"
    savings = findings_table(findings(make_result(comparison)))
    assert savings.count("stochastic cheaper") == 4


def test_the_plots_get_what_was_computed(comparison, stored):
    numbers = payload(stored)
    assert len(numbers["cases"]) == len(comparison.cases)
    for case, entry in zip(comparison.cases, numbers["cases"], strict=True):
        assert entry["fuel_kg"] + entry["extra_kg"] == pytest.approx(entry["cost_kg"])
        assert entry["cost_kg"] == pytest.approx(case.rollout.cost_kg.mean())
        assert len(entry["traces"]) == 8
        assert _unpack(entry["traces"][2]["current"]).max() == pytest.approx(
            case.rollout.current_A[2].max(), abs=2e-3
        )
        assert len(numbers["cycle"]["time_s"]) == len(_unpack(entry["traces"][0]["soc"]))
    first = numbers["differences"][0]
    costs = {case.policy: case.rollout.cost_kg for case in comparison.cases[:4]}
    difference = costs["stochastic"] - costs["certainty_equivalent"]
    assert first["mean"] == pytest.approx(difference.mean())
    assert first["low"] < first["mean"] < first["high"] < 0.0


def test_a_short_cycle_is_drawn_sample_by_sample(comparison, stored):
    numbers = payload(stored)
    assert numbers["points_per_stretch"] == 1
    assert numbers["cycle"]["time_s"] == comparison.time_s.tolist()
    np.testing.assert_allclose(
        _unpack(numbers["cases"][0]["traces"][0]["soc"]),
        100.0 * comparison.cases[0].rollout.soc[0],
        atol=1e-3,
    )


def test_a_long_cycle_keeps_its_peaks(tmp_path):
    long = make_comparison(("hev",), (0.002,), ("stochastic",), steps=2500, realizations=1)
    numbers = payload(store_without_figures(long, tmp_path / "out"))
    assert numbers["points_per_stretch"] == 2
    assert numbers["stretch_s"] == 3.0
    assert len(numbers["cycle"]["time_s"]) == len(numbers["cycle"]["speed_kmh"]) == 2 * 834
    assert np.all(np.diff(numbers["cycle"]["time_s"]) >= 0.0)
    assert max(numbers["cycle"]["speed_kmh"]) == pytest.approx(3.6 * long.speed_mps.max(), abs=0.01)
    current = _unpack(numbers["cases"][0]["traces"][0]["current"])
    assert current.min() == pytest.approx(long.cases[0].rollout.current_A.min(), abs=1e-3)


def _unpack(packed):
    integers = np.frombuffer(base64.b64decode(packed["data"]), dtype="<u2")
    return packed["low"] + packed["step"] * integers


@pytest.mark.parametrize(
    "values", [np.linspace(-3.0, 7.0, 999), np.full(5, 0.65), np.array([]), np.array([1e-9, 2e-9])]
)
def test_packing_loses_less_than_anyone_can_see(values):
    packed = pack(values)
    np.testing.assert_allclose(_unpack(packed), values, rtol=0, atol=0.5001 * packed["step"])
    assert packed["step"] <= (np.ptp(values) if values.size else 0.0) / 65535


@pytest.mark.parametrize("cases", [1, 24, 500, 20_000])
def test_trajectories_stay_within_their_part_of_the_page(cases):
    stretches, realizations = _plan(cases, 83_044)
    characters = cases * realizations * stretches * 7 * _CHARACTERS_PER_VALUE
    assert characters <= TRAJECTORY_CHARACTERS
    assert stretches >= 1 <= realizations


def test_the_page_is_small_self_contained_and_always_the_same(stored, tmp_path):
    write_report(stored, tmp_path / "a.html")
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert len(page.encode()) < 8e6
    assert render(stored) == page
    ours = page[: page.index('<script type="application/json"')] + page[page.rindex("<script>") :]
    assert not re.search(r"(src|href)\s*=\s*(?![\"']?data:)", ours), "nothing is fetched from anywhere"
    assert not re.search(r"https?://", ours)
    assert "@@" not in ours
    assert page.count("</script>") == 3


def test_a_folder_will_do_and_a_wrong_one_is_refused(comparison, tmp_path):
    few = dataclasses.replace(comparison, cases=comparison.cases[:1])
    write(few, make_result(few), tmp_path / "out")
    write_report(tmp_path / "out", tmp_path / "again.html")
    assert (tmp_path / "again.html").read_bytes() == (tmp_path / "out" / "report.html").read_bytes()
    with pytest.raises(StoreError, match="holds no results"):
        write_report(tmp_path, tmp_path / "x.html")


def test_what_users_name_things_cannot_become_markup(comparison, stored):
    evil = "</script><script>alert(1)</script><img src=x onerror=alert(2)>@@DATA@@"
    result = json.loads(json.dumps(make_result(comparison)).replace('"hev"', json.dumps(evil)))
    result["cycle"]["name"] = evil
    manifest = {**stored.manifest, "cycle": evil, "settings": {evil: evil}}
    manifest["cases"] = [
        {**entry, "concept": evil} if entry["concept"] == "hev" else entry for entry in manifest["cases"]
    ]
    page = render(dataclasses.replace(stored, result=result, manifest=manifest))
    assert "<img" not in page.replace("<img>", "")
    assert "<script>alert" not in page
    data = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert evil in json.loads(data[1])["concepts"]

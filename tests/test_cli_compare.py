"""`socwise compare` from end to end on a short cycle: the JSON object, the files, the same bits each time."""

import json

import pytest
from command_line import preset_text, run, tree, write_cycle

from ems import policy_names
from ems.statistics import half_width

MEANS = (
    "cost_kg",
    "fuel_l_per_100km",
    "penalty_kg",
    "final_soc",
    "final_soc_estimate",
    "mean_abs_current_A",
    "engine_starts",
    "shortfall_kg",  # beyond DESIGN.md section 4: without it the cost would not add up
)
NUMBERS = ("value_kg", "soc_rmse", "window_violation", "solve_s")
CASE = {"concept", "mu", "policy", "realizations", "sqrt_p", *MEANS, *NUMBERS}
HEV = ("--concept", "hev", "--mu", "0.002", "--realizations", 4)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_cycle(tmp_path / "trip.csv")
    return tmp_path


def strict(text):
    """Parse one JSON object; NaN and infinity are no JSON."""

    def refuse(constant):
        raise AssertionError(constant)

    return json.loads(text, parse_constant=refuse)


def untimed(folder):
    """Return the files of a folder of results without the seconds that solving took."""
    files = tree(folder)
    result = json.loads(files.pop("result.json"))
    for case in result["cases"]:
        assert case.pop("solve_s") >= 0.0
    return files, result


def check_object(found, concepts, mus, realizations):
    """Hold an object against DESIGN.md section 4, field by field."""
    assert set(found) == {"schema", "seed", "cycle", "cases", "paired"}
    assert found["schema"] == 1
    assert set(found["cycle"]) == {"name", "duration_s", "distance_km"}
    order = [(c, mu, policy) for c in concepts for mu in mus for policy in policy_names()]
    assert [(case["concept"], case["mu"], case["policy"]) for case in found["cases"]] == order
    for case in found["cases"]:
        assert set(case) == CASE
        assert case["realizations"] == realizations
        for name in MEANS:
            assert set(case[name]) == {"mean", "se"}
            assert case[name]["se"] >= 0.0
        assert set(case["sqrt_p"]) == {"mean", "final"}
        assert all(isinstance(case[name], float) for name in NUMBERS[1:])
        assert (case["value_kg"] is None) == (case["policy"] == "rule_based")
        parts = [case[name]["mean"] for name in ("penalty_kg", "shortfall_kg")]
        assert case["cost_kg"]["mean"] > sum(parts) - 1e-12
        assert 0.0 <= case["window_violation"] <= 1.0
    first, *others = policy_names()
    order = [(c, mu, first, other) for c in concepts for mu in mus for other in others]
    assert [(p["concept"], p["mu"], p["policy"], p["versus"]) for p in found["paired"]] == order
    costs = {
        (case["concept"], case["mu"], case["policy"]): case["cost_kg"]["mean"] for case in found["cases"]
    }
    for pair in found["paired"]:
        assert set(pair) == {"concept", "mu", "policy", "versus", "cost_kg", "fuel_l_per_100km"}
        for name in ("cost_kg", "fuel_l_per_100km"):
            assert set(pair[name]) == {"mean", "ci95"}
            low, high = pair[name]["ci95"]
            assert low <= pair[name]["mean"] <= high
        key = pair["concept"], pair["mu"]
        difference = costs[*key, pair["policy"]] - costs[*key, pair["versus"]]
        assert pair["cost_kg"]["mean"] == pytest.approx(difference, abs=1e-12)


def test_the_json_object(capsys, folder):
    shown = run(
        capsys, "compare", "--cycle", "trip.csv", "--mu", "0.0007,0.006", "--realizations", 4, "--seed", 3,
        "--out", "all", "--json",
    )  # fmt: skip
    assert (shown.code, shown.err) == (0, "")
    found = strict(shown.out)
    check_object(found, ("hev", "phev"), (0.0007, 0.006), 4)
    assert found["seed"] == 3
    assert found["cycle"]["name"] == "trip"
    assert found["cycle"]["duration_s"] == 60.0
    assert found["cycle"]["distance_km"] == pytest.approx(0.6365, abs=1e-3)
    assert found == strict((folder / "all" / "result.json").read_text(encoding="utf-8"))
    # The PHEV is full: every policy drives this minute electrically.
    phev = [case for case in found["cases"] if case["concept"] == "phev"]
    assert [case["fuel_l_per_100km"]["mean"] for case in phev] == [0.0] * 8
    manifest = json.loads((folder / "all" / "manifest.json").read_text(encoding="utf-8"))
    assert (
        sorted(name for name, content in tree(folder / "all").items() if content is not None)
        == (manifest["files"])
    )
    assert len(manifest["cases"]) == 16
    assert set(tree(folder)) - {f"all/{name}" for name in tree(folder / "all")} == {"all", "trip.csv"}


def test_the_same_bits_whatever_the_number_of_threads(capsys, folder):
    """The second run replaces the first. And the table for people: it holds the numbers of the object."""
    arguments = (*HEV, "--policy", "stochastic,certainty-equivalent,rule_based", "--out", "r")
    found = []
    for jobs in (1, 2):
        shown = run(capsys, "compare", "--cycle", "trip.csv", *arguments, "--jobs", jobs)
        assert (shown.code, shown.err) == (0, "")
        found.append(untimed(folder / "r"))
    (files, result), (files_again, result_again) = found
    assert files == files_again
    assert result == result_again
    lines = [line.rstrip() for line in shown.out.splitlines()]
    assert lines[0].startswith("HEV: against the certainty-equivalent policy")
    case = result["cases"][0]
    row = next(line for line in lines if line.startswith("stochastic "))
    half = half_width(case["cost_kg"]["se"], 4)
    assert f"{case['cost_kg']['mean']:.4f}±{half:.4f}" in row
    assert f"{100.0 * case['final_soc_estimate']['mean']:.1f}" in row
    table = lines[lines.index("HEV, μ = 0.002") :][:4]
    assert len(table) == 4 and max(map(len, table)) <= 80
    assert lines[-1] == "Results are in r, the report is r/report.html"


def test_one_policy_one_realization_and_a_concept_of_the_users_own(capsys, folder):
    """Nothing to pair, no standard errors: null, never NaN. And `socwise report` writes the page again."""
    (folder / "own, mine.toml").write_text(preset_text().replace('name = "hev"', 'name = "m[b]ine"'))
    shown = run(
        capsys, "compare", "--cycle", "trip.csv", "--concept", "own, mine.toml", "--mu", "0",
        "--realizations", 1, "--policy", "certainty-equivalent", "--json", "--out", "deep/r",
    )  # fmt: skip
    assert (shown.code, shown.err) == (0, "")
    found = strict(shown.out)
    assert found["paired"] == []
    (case,) = found["cases"]
    assert (case["concept"], case["policy"], case["mu"]) == ("m[b]ine", "certainty_equivalent", 0.0)
    assert case["cost_kg"]["se"] is None
    page = folder / "deep" / "r" / "report.html"
    before = tree(folder)
    page.write_text("gone")
    shown = run(capsys, "report", "deep/r")
    assert shown.code == 0
    assert "deep/r/report.html" in shown.out
    assert tree(folder) == before


def test_a_vehicle_too_weak_can_do_its_best(capsys, folder):
    rows = [f"{second},{min(40.0 * second, 120.0)}" for second in range(20)]
    (folder / "sprint.csv").write_text("time_s,speed_kmh\n" + "\n".join(rows) + "\n")
    common = ("compare", "--cycle", "sprint.csv", *HEV, "--policy", "rule_based", "--json")
    assert run(capsys, *common, "--out", "r").code == 2
    shown = run(capsys, *common, "--out", "r", "--on-infeasible", "limit")
    assert shown.code == 0
    assert strict(shown.out)["cases"][0]["shortfall_kg"]["mean"] > 0.0


@pytest.mark.slow
def test_the_main_job(capsys, folder):
    """The acceptance run: both concepts, three mu, four policies, 50 realizations each, on 57 km."""
    shown = run(capsys, "compare", "--json", "--seed", 1)
    assert (shown.code, shown.err) == (0, "")
    found = strict(shown.out)
    check_object(found, ("hev", "phev"), (0.0007, 0.002, 0.006), 50)
    assert found["seed"] == 1
    assert found["cycle"]["name"] == "larsson"
    assert found["cycle"]["distance_km"] == pytest.approx(57.0, abs=0.05)
    assert (folder / "results" / "compare" / "report.html").stat().st_size > 1_000_000

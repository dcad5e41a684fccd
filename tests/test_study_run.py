import json
import os
import shutil
import socket
from dataclasses import replace
from pathlib import Path

import pytest
from command_line import run
from study_cases import EIGHT, HEAD, Suicide, children, finished, gone, results, wait_for, write_study

from drivecycles import read_csv
from ems.compare import compare
from ems.summary import to_json
from socwise.results import StoreError
from socwise.results.netcdf import read_case
from socwise.study import load_study, make_plan, read_study, run_study
from socwise.study.digest import code_digest, digest
from socwise.study.lock import locked, started
from socwise.study.pool import LocalPool
from socwise.study.task import WorkUnit
from socwise.study.units import count_solves, make_units, solve_key
from socwise.study.worker import work


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A study of eight cases, finished: its file and its folder."""
    place = tmp_path_factory.mktemp("study")
    study = write_study(place)
    run_study(study, place / "out", jobs=2)
    return study, place / "out"


@pytest.fixture
def copy(done, tmp_path):
    """A folder of its own with the same content."""
    study, folder = done
    for path in (study, study.parent / "hill.csv"):
        shutil.copy(path, tmp_path)
    shutil.copytree(folder, tmp_path / "out")
    return tmp_path / study.name, tmp_path / "out"


def test_a_case_is_what_a_comparison_of_its_point_gives(done):
    """To the last bit, timings aside: the certainty-equivalent program served other cases, too."""
    study, folder = done
    stored = read_study(folder)
    plan = make_plan(load_study(study))
    assert stored.is_complete
    assert len(stored.cases) == 8
    for planned, case in list(zip(plan.cases, stored.cases, strict=True))[1:8:3]:
        comparison = compare(
            [planned.concept],
            read_csv(study.parent / "hill.csv"),
            mus=[planned.concept.uncertainty.mu],
            policies=planned.policies,
            realizations=4,
            seed=0,
            settings=planned.settings,
        )
        expected = to_json(comparison)
        for row in expected["cases"]:
            del row["solve_s"]
        assert case.result == json.loads(json.dumps(expected))
        assert dict(case.factors) == dict(planned.factors)
        assert case.resolved["inputs_sha256"] == comparison.settings["inputs_sha256"][0]


def test_a_folder_is_read_by_factor_policy_and_pair(done):
    stored = read_study(done[1])
    assert stored.name == "tiny"
    assert stored.varied == {"concept": ["hev", "phev"], "mu": [1e-3, 4e-3], "penalty_steepness": [0.1, 1.0]}
    assert stored.factors["cycle"] == ["hill.csv"]
    case = stored.cases[5]
    assert case.policy("stochastic")["concept"] == "phev"
    assert case.policy("no such") is None
    pair = case.pair("stochastic", "certainty_equivalent")
    means = [case.policy(name)["cost_kg"]["mean"] for name in ("stochastic", "certainty_equivalent")]
    assert pair["cost_kg"]["mean"] == pytest.approx(means[0] - means[1])
    assert case.timing["wall_s"] > 0.0
    assert case.timing["peak_rss_MB"] > 50.0


def test_tables_have_a_row_for_each_case_and_policy(done):
    lines = (done[1] / "summary.csv").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 1 + 8 * 2
    assert lines[0].startswith("case,key,concept,cycle,mu,penalty_steepness,policy,realizations,value_kg,")
    assert "solve_s" not in lines[0]
    pairs = (done[1] / "paired.csv").read_text(encoding="utf-8").splitlines()
    assert len(pairs) == 1 + 8
    row = dict(zip(pairs[0].split(","), pairs[3].split(","), strict=True))
    case = read_study(done[1]).cases[2]
    difference, base = case.pair("stochastic", "certainty_equivalent")["cost_kg"], case.policy("stochastic")
    assert float(row["cost_kg_low"]) == difference["ci95"][0]
    percent = 100.0 * difference["mean"] / base["cost_kg"]["mean"]
    assert float(row["cost_kg_percent"]) == pytest.approx(percent, rel=1e-12)


def test_results_do_not_depend_on_how_many_compute(done, tmp_path):
    run_study(done[0], tmp_path / "one", jobs=1)
    assert results(tmp_path / "one") == results(done[1])


def test_what_is_shared_is_solved_once(done):
    plan = make_plan(load_study(done[0]))
    units = make_units(plan, plan.cases, workers=1)
    # mu is shared: by concept and steepness 2 stochastic solves and 1 certainty-equivalent one
    assert count_solves(units) == (4 * (2 + 1), 16)
    first, second = units[0].cases
    assert solve_key(first, "stochastic") != solve_key(second, "stochastic")
    assert solve_key(first, "certainty_equivalent") == solve_key(second, "certainty_equivalent")
    assert {case.key for unit in make_units(plan, plan.cases, workers=8) for case in unit.cases} == {
        case.key for case in plan.cases
    }


def test_a_folder_with_a_study_is_left_alone_unless_resumed(copy):
    study, folder = copy
    before = results(folder)
    with pytest.raises(StoreError, match="8 of 8 cases finished; --resume"):
        run_study(study, folder)
    outcome = run_study(study, folder, resume=True)
    assert (outcome.kept, outcome.computed) == (8, 0)
    assert results(folder) == before


def test_what_is_no_study_is_not_touched(done, tmp_path, capsys):
    (tmp_path / "diary.txt").write_text("mine")
    outcome = run(capsys, "run", done[0], "--out", tmp_path)
    assert outcome.code == 2
    assert "diary.txt" in outcome.err
    assert [path.name for path in tmp_path.iterdir()] == ["diary.txt"]
    assert run(capsys, "run", done[0], "--out", tmp_path / "diary.txt", "--resume").code == 2


def test_only_what_is_missing_is_computed_and_leftovers_are_cleaned(copy):
    study, folder = copy
    whole = results(folder)
    lost = sorted(finished(folder))[:2]
    for name in lost:
        (folder / "cases" / name).unlink()
    (folder / "cases/.x.json.1.tmp").write_text("half a fi")
    (folder / ".summary.csv.tmp").write_text("half")
    kept = {name: (folder / "cases" / name).stat().st_mtime_ns for name in finished(folder)}
    outcome = run_study(study, folder, resume=True)
    assert (outcome.kept, outcome.computed) == (6, 2)
    assert results(folder) == whole
    assert {name: (folder / "cases" / name).stat().st_mtime_ns for name in kept} == kept


def test_a_changed_study_says_what_becomes_of_its_cases(copy, capsys):
    """One value of mu instead of another: four cases are new, four no longer belong."""
    study, folder = copy
    write_study(study.parent, EIGHT.replace("4e-3", "8e-3"))
    plan = run(capsys, "run", study, "--out", folder, "--dry-run", "--json")
    assert plan.code == 0
    found = json.loads(plan.out)
    assert sorted(case["state"] for case in found["cases"]) == ["done"] * 4 + ["new"] * 4
    assert len(found["no_longer"]) == 4
    assert found["solves"] == {"needed": 8, "without_sharing": 8}
    outcome = run(capsys, "run", study, "--out", folder, "--resume")
    assert outcome.code == 0
    assert "4 cases of the folder are no longer part of the study" in " ".join(outcome.err.split())
    stored = read_study(folder)
    assert stored.is_complete
    assert stored.varied["mu"] == [1e-3, 8e-3]
    assert len(finished(folder)) == 12


def test_a_changed_setting_redoes_every_case_and_says_which(copy, capsys):
    study, folder = copy
    write_study(study.parent, head=HEAD.replace("realizations = 4", "realizations = 6"))
    plan = run(capsys, "run", study, "--out", folder, "--dry-run")
    text = " ".join(plan.out.split())
    assert "Changed since then: realizations 4 -> 6." in text
    assert "8 cases are computed anew: concept hev, cycle hill.csv, mu 0.001, penalty_steepness 0.1;" in text
    assert "12 solves, of 16" in text or "16 solves, of 16" in text
    assert "MB for each process" in text
    outcome = run_study(study, folder, resume=True)
    assert (outcome.kept, outcome.computed) == (0, 8)
    assert read_study(folder).cases[0].policy("stochastic")["realizations"] == 6


def test_a_case_that_fails_is_recorded_and_stops_no_other(tmp_path, capsys):
    factors = EIGHT.replace('["hev", "phev"]', '"hev"') + "mass_kg = [1300, 90000]"
    study, folder = write_study(tmp_path, factors), tmp_path / "out"
    outcome = run(capsys, "run", study, "--out", folder, "--json")
    assert outcome.code == 1
    found = json.loads(outcome.out)
    assert (found["cases"], found["computed"], len(found["failed"])) == (8, 4, 4)
    assert {one["factors"]["mass_kg"] for one in found["failed"]} == {90000.0}
    assert "cannot follow" in found["failed"][0]["error"]
    stored = read_study(folder)
    assert {case.factors["mass_kg"] for case in stored.in_state("done")} == {1300.0}
    failed = stored.in_state("failed")
    assert failed[0].error["kind"] == "EmsError"
    assert not stored.is_complete
    again = run(capsys, "run", study, "--out", folder, "--resume")
    assert again.code == 1
    assert "4 were there, 4 failed" in " ".join(again.out.split())
    assert "mass_kg = 90000.0: concept 'hev' cannot follow" in " ".join(again.err.split())
    assert read_study(folder).in_state("failed")[0].key == failed[0].key


def test_a_case_that_takes_its_worker_along_is_recorded_and_stops_no_other(done, tmp_path):
    """Its trip ends whatever process unpacks it; the other trip's cases are all computed."""
    write_study(tmp_path)
    shutil.copy(tmp_path / "hill.csv", tmp_path / "other.csv")
    with (tmp_path / "other.csv").open("a", encoding="utf-8") as file:
        file.write("61,0,0\n")
    factors = """
[factors]
concept = "hev"
cycle = ["hill.csv", "other.csv"]
mu = 1e-3
"""
    plan = make_plan(load_study(write_study(tmp_path, factors)))
    deadly = digest(read_csv(tmp_path / "other.csv").renamed("other"))
    assert deadly in plan.trips
    plan = replace(plan, trips={**plan.trips, deadly: Suicide()})
    outcome = run_study(plan, tmp_path / "out", jobs=2)
    assert outcome.computed == 1
    ((point, message),) = outcome.failed
    assert point["cycle"] == "other.csv"
    assert "ended without a word" in message
    # Once with the others, and once more by itself.
    assert outcome.lost_workers == 2
    good, bad = read_study(tmp_path / "out").cases
    assert good.result == read_study(done[1]).cases[1].result
    assert (bad.state, bad.error["kind"]) == ("failed", "WorkerLost")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for the worker in /proc")
def test_a_worker_that_is_killed_costs_no_case(done, tmp_path):
    killed = []

    def kill(ended, total):
        workers = [one for one in children(os.getpid()) if "popen_loky" in _command(one)]
        if ended and not killed and workers:
            os.kill(workers[-1], 9)
            killed.append(workers[-1])

    outcome = run_study(done[0], tmp_path / "out", jobs=2, progress=kill)
    assert len(killed) == 1
    assert (outcome.computed, outcome.failed) == (8, ())
    assert results(tmp_path / "out") == results(done[1])


def _command(process):
    return Path(f"/proc/{process}/cmdline").read_text(encoding="utf-8", errors="replace")


def test_one_run_at_a_time_writes_to_a_folder(copy):
    study, folder = copy
    with locked(folder), pytest.raises(StoreError, match=f"is being written by process {os.getpid()} on"):
        run_study(study, folder, resume=True)
    assert not (folder / "lock.json").exists()


@pytest.mark.parametrize("process", ["dead", "younger"])
def test_the_lock_of_a_run_that_is_gone_is_taken_over(copy, process):
    """A number nobody has, or one that belongs to a process that started at another time."""
    study, folder = copy
    number = 2**22 + 1 if process == "dead" else os.getpid()
    lock = {"host": socket.gethostname(), "process": number, "started": "long ago"}
    (folder / "lock.json").write_text(json.dumps(lock))
    assert started(os.getpid()) is not None
    assert run_study(study, folder, resume=True).kept == 8
    assert not (folder / "lock.json").exists()


def test_a_lock_of_another_host_is_respected(copy):
    study, folder = copy
    (folder / "lock.json").write_text(json.dumps({"host": "elsewhere", "process": 1, "started": "now"}))
    with pytest.raises(StoreError, match=r"process 1 on elsewhere.*remove .*lock\.json"):
        run_study(study, folder, resume=True)


def test_trajectories_are_kept_where_asked(tmp_path):
    head = HEAD.replace("realizations = 4", "realizations = 4\nkeep_trajectories = true")
    factors = (
        EIGHT.replace("[1e-3, 4e-3]", "1e-3").replace("[0.1, 1]", "1").replace('["hev", "phev"]', '"hev"')
    )
    run_study(write_study(tmp_path, factors, head), tmp_path / "out", jobs=1)
    (case,) = read_study(tmp_path / "out").cases
    assert set(case.trajectories) == {"stochastic", "certainty_equivalent"}
    stored = read_case(case.trajectories["stochastic"])
    assert stored.rollout.soc.shape == (4, 61)
    assert stored.rollout.cost_kg.mean() == pytest.approx(case.policy("stochastic")["cost_kg"]["mean"])


def test_a_closed_loop_is_identified_and_driven(tmp_path):
    head = HEAD.replace('"stochastic", "certainty_equivalent"', '"certainty_equivalent", "rule_based"')
    factors = """
[factors]
concept = "hev"
cycle = "hill.csv"
estimator = "ekf"
[closed_loop]
training = "hill.csv"
training_realizations = 4
[closed_loop.scatter]
capacity_sd = 0.03
"""
    outcome = run_study(write_study(tmp_path, factors, head), tmp_path / "out", jobs=1)
    assert outcome.failed == ()
    (case,) = read_study(tmp_path / "out").cases
    assert (case.result["plant"], case.result["estimator"]) == ("ecm", "ekf")
    assert case.result["identified"]["hev"]["mu"]["value"] == case.policy("rule_based")["mu"]
    assert case.resolved["closed_loop"]["scatter"]["capacity_sd"] == 0.03


def test_an_ensemble_through_traffic_is_a_cycle_as_any_other(tmp_path):
    factors = (
        EIGHT.replace("hill.csv", "traffic:commute").replace("[0.1, 1]", "1").replace("[1e-3, 4e-3]", "1e-3")
    )
    head = HEAD.replace('"stochastic", "certainty_equivalent"', '"rule_based", "certainty_equivalent"')
    study = write_study(
        tmp_path, factors.replace('["hev", "phev"]', '"hev"'), head + 'on_infeasible = "limit"\n'
    )
    study.write_text(study.read_text().replace('on_infeasible = "limit"\n', ""), encoding="utf-8")
    outcome = run_study(study, tmp_path / "out", jobs=1)
    assert outcome.failed == ()
    (case,) = read_study(tmp_path / "out").cases
    assert case.result["ensemble"]["cycles"] == 2


def test_a_worker_with_other_code_refuses(done):
    plan = make_plan(load_study(done[0]))
    case = plan.cases[0]
    (outcome,) = work(WorkUnit((case,), plan.trips[case.trip], "other"))
    assert outcome.content is None
    assert "other code" in outcome.error["message"]
    (outcome,) = work(WorkUnit((case,), plan.trips[case.trip], code_digest()))
    assert outcome.error is None


def test_workers_end_with_the_process_that_started_them(done, tmp_path):
    """Those of this one do not outlive a pool that is closed at once."""
    pool = LocalPool(1)
    plan = make_plan(load_study(done[0]))
    case = plan.cases[0]
    future = pool.submit(WorkUnit((case,), plan.trips[case.trip], code_digest()))
    (outcome,) = pool.result(future)
    worker = outcome.timing["process"]
    assert worker != os.getpid()
    pool.close(at_once=True)
    wait_for(lambda: gone([worker]), 10.0, "the worker to end")


def test_a_dry_run_shows_cases_and_touches_nothing(done, tmp_path, capsys):
    outcome = run(capsys, "run", done[0], "--out", tmp_path / "out", "--dry-run", "--jobs", 2)
    text = " ".join(outcome.out.split())
    assert outcome.code == 0
    assert "8 cases, 8 to be computed: 16 solves, of 16 if no case shared one, in 8 pieces" in text
    assert text.count("to do") == 8
    assert not (tmp_path / "out").exists()


def test_the_command_prints_the_schema_and_asks_for_a_study(capsys):
    outcome = run(capsys, "run", "--schema")
    assert json.loads(outcome.out)["title"] == "socwise study"
    assert run(capsys, "run").code == 2


def test_every_error_of_a_study_reaches_the_terminal(tmp_path, capsys):
    study = write_study(tmp_path, EIGHT.replace('"phev"', '"phv"') + "mass_kg = -1")
    outcome = run(capsys, "run", study, "--out", tmp_path / "out")
    assert outcome.code == 2
    assert 'factors.concept[1] = "phv"' in outcome.err
    assert "factors.mass_kg = -1" in outcome.err
    assert not (tmp_path / "out").exists()

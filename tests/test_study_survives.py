"""Studies that are interrupted, killed, and computed by others."""

import random
import signal
import subprocess
import sys

import pytest
from study_cases import EIGHT, MANY, children, finished, gone, results, start, wait_for, write_study

from socwise.study import read_study, run_study

KILLS = [1, pytest.param(20, marks=pytest.mark.slow)]
CLUSTER = """
import sys
from distributed import LocalCluster
if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1") as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""


def ends_well(process):
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    return out


@pytest.mark.parametrize("kills", KILLS)
def test_a_study_that_is_killed_again_and_again_ends_as_one_that_is_not(tmp_path, kills):
    """SIGKILL at random moments: some while starting, most while cases are being written."""
    study, folder, chance = write_study(tmp_path, MANY), tmp_path / "out", random.Random(7)
    run_study(study, tmp_path / "whole", jobs=2)
    total = len(finished(tmp_path / "whole"))
    assert total == 40
    written, orphans = {}, set()
    for kill in range(kills):
        running = start(study, "--out", folder, "--resume", "--jobs", 2)
        before = len(finished(folder))
        wanted = before + chance.randint(0, max(1, (total - before) // (kills - kill + 1)))
        wait_for(
            lambda count=wanted, one=running: len(finished(folder)) >= count or one.poll() is not None,
            what=f"{wanted} cases",
        )
        signal_after = chance.uniform(0.0, 0.05)
        try:
            running.wait(signal_after)
        except subprocess.TimeoutExpired:
            orphans |= set(children(running.pid))
        running.kill()
        running.communicate()
        for name in finished(folder):
            path = folder / "cases" / name
            content, changed = path.read_bytes(), path.stat().st_mtime_ns
            # Not half a file, and none that was there is written once more.
            assert content == (tmp_path / "whole/cases" / name).read_bytes()
            assert written.setdefault(name, changed) == changed
    assert 0 < len(written) < total
    wait_for(lambda: gone(orphans), 15.0, "the workers of killed runs to end")
    run_study(study, folder, jobs=1, resume=True)
    assert results(folder) == results(tmp_path / "whole")
    assert {name: (folder / "cases" / name).stat().st_mtime_ns for name in written} == written
    assert not [path for path in folder.rglob("*") if path.name.endswith(".tmp")]


def test_an_interrupted_study_ends_cleanly_and_goes_on(tmp_path):
    study, folder = write_study(tmp_path, MANY), tmp_path / "out"
    running = start(study, "--out", folder, "--jobs", 2)
    wait_for(lambda: len(finished(folder)) >= 3 or running.poll() is not None)
    workers = children(running.pid)
    running.send_signal(signal.SIGINT)
    _, err = running.communicate(timeout=60)
    assert running.returncode == 130
    said = " ".join(err.split())
    count = len(finished(folder))
    assert (
        f"{count} of 40 cases are finished and kept; go on with `socwise run {study} --out {folder} --resume`"
        in said
    )
    assert "Traceback" not in err
    assert 3 <= count < 40
    assert not (folder / "lock.json").exists()
    assert not [path for path in folder.rglob("*") if path.name.endswith(".tmp")]
    wait_for(lambda: gone(workers), 15.0, "the workers to end")
    stored = read_study(folder)
    assert len(stored.in_state("done")) == count
    assert len(stored.in_state("missing")) == 40 - count


@pytest.mark.slow
def test_one_process_two_and_a_cluster_give_the_same_bytes(tmp_path):
    """The cluster has two worker processes and is reached by its TCP address."""
    pytest.importorskip("distributed")
    study = write_study(tmp_path, EIGHT)
    for jobs in (1, 2):
        run_study(study, tmp_path / f"jobs{jobs}", jobs=jobs)
    with subprocess.Popen(
        [sys.executable, "-c", CLUSTER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as cluster:
        try:
            address = cluster.stdout.readline().strip()
            assert address.startswith("tcp://127.0.0.1:")
            out = ends_well(start(study, "--out", tmp_path / "dask", "--dask", address))
            assert "8 of 8 cases computed" in " ".join(out.split())
        finally:
            cluster.stdin.close()
            cluster.wait(30)
    workers = {case.timing["process"] for case in read_study(tmp_path / "dask").cases}
    assert len(workers) == 2
    assert results(tmp_path / "jobs1") == results(tmp_path / "jobs2") == results(tmp_path / "dask")


@pytest.mark.slow
def test_a_cluster_that_is_not_there_is_named(tmp_path):
    pytest.importorskip("distributed")
    running = start(write_study(tmp_path), "--out", tmp_path / "out", "--dask", "tcp://127.0.0.1:9")
    _, err = running.communicate(timeout=60)
    assert running.returncode == 2
    assert "no dask scheduler answers at 'tcp://127.0.0.1:9'" in " ".join(err.split())
    assert "Traceback" not in err

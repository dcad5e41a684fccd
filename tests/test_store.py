"""Results on disk: whole or not at all, the same bytes for the same results, and back again."""

import csv
import dataclasses
import json
import math
import os
import stat
from pathlib import Path

import numpy as np
import pytest
from scipy.io import netcdf_file
from synthetic import make_comparison, make_result

from drivecycles import load_cycle
from socwise.results.netcdf import VARIABLES
from socwise.results.staging import files_below, staged
from socwise.store import StoreError, case_files, check_writable, read, write

TINY = {"concepts": ("hev",), "mus": (0.002,), "policies": ("stochastic", "rule_based"), "steps": 40}


@pytest.fixture(scope="module")
def comparison():
    return make_comparison(**TINY)


@pytest.fixture(scope="module")
def stored(comparison, tmp_path_factory):
    out = tmp_path_factory.mktemp("results") / "deep" / "compare"
    write(comparison, make_result(comparison), out)
    return read(out)


def _bytes_of(folder):
    return {name: (folder / name).read_bytes() for name in files_below(folder)}


def _fail_after_result(comparison, out):
    """A result without cases gets as far as the first file."""
    with pytest.raises(KeyError, match="cases"):
        write(comparison, {"schema": 1}, out)


def test_every_case_comes_back_bit_for_bit(comparison, stored):
    assert stored.keys() == [(case.concept, case.mu, case.policy) for case in comparison.cases]
    for case in comparison.cases:
        back = stored.case(case.concept, case.mu, case.policy)
        for field in dataclasses.fields(case.rollout):
            expected, found = getattr(case.rollout, field.name), getattr(back.rollout, field.name)
            assert found.dtype == expected.dtype, field.name
            assert found.flags.writeable, "a view of the file would die with it"
            np.testing.assert_array_equal(found, expected, err_msg=field.name)
        np.testing.assert_array_equal(back.fuel_l_per_100km, case.fuel_l_per_100km)
        for name in ("concept", "mu", "policy", "value_kg", "solve_s", "window", "target_soc"):
            assert getattr(back, name) == getattr(case, name), name


def test_a_policy_that_promises_nothing_keeps_promising_nothing(stored):
    assert stored.case("hev", 0.002, "rule_based").value_kg is None
    assert stored.case("hev", 0.002, "stochastic").value_kg is not None


def test_the_cycle_on_disk_is_a_cycle_file(comparison, stored):
    cycle = load_cycle(stored.folder / "cycle.csv")
    np.testing.assert_array_equal(cycle.speed_mps, comparison.speed_mps)
    np.testing.assert_array_equal(stored.time_s, comparison.time_s)
    np.testing.assert_array_equal(stored.altitude_m, comparison.altitude_m)


def test_netcdf_says_what_is_in_it(comparison, stored):
    path = stored.folder / "cases/hev_mu0.002_stochastic.nc"
    assert path.read_bytes()[:4] == b"CDF\x02", "classic format, 64-bit offsets"
    with netcdf_file(path, "r", mmap=False) as file:
        assert dict(file.dimensions) == {"realization": 6, "time": 41, "step": 40}
        assert set(file.variables) == set(VARIABLES)
        for name, variable in file.variables.items():
            assert variable.units, name
            assert len(variable.long_name) > 3, name
        np.testing.assert_allclose(
            file.variables["cost_kg"][:], comparison.cases[0].rollout.cost_kg, rtol=1e-15
        )
        assert (file.concept, file.policy, file.seed) == (b"hev", b"stochastic", b"1")
        assert (file.mu, file.window_low, file.window_high, file.target_soc) == (0.002, 0.55, 0.75, 0.65)


def test_the_folder_holds_what_its_manifest_lists(comparison, stored):
    assert stored.manifest["files"] == files_below(stored.folder)
    wanted = {"result.json", "summary.csv", "manifest.json", "cycle.csv", "report.html"}
    assert wanted <= set(stored.manifest["files"])
    assert stored.manifest["settings"] == comparison.settings
    assert len(stored.manifest["settings_sha256"]) == 64
    assert stored.manifest["packages"]["numpy"] == np.__version__


def test_summary_has_one_flat_row_a_case_and_no_timing(comparison, stored):
    with (stored.folder / "summary.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["policy"] for row in rows] == ["stochastic", "rule_based"]
    assert float(rows[0]["cost_kg_mean"]) == comparison.cases[0].rollout.cost_kg.mean()
    assert rows[1]["value_kg"] == ""
    assert "solve_s" not in rows[0]


def test_same_results_same_bytes_and_only_the_result_file_holds_timings(comparison, stored, tmp_path):
    slower = tuple(dataclasses.replace(case, solve_s=9.0) for case in comparison.cases)
    again = dataclasses.replace(comparison, cases=slower)
    write(again, make_result(again), tmp_path / "again")
    first, second = _bytes_of(stored.folder), _bytes_of(tmp_path / "again")
    assert first.keys() == second.keys()
    assert [name for name in first if first[name] != second[name]] == ["result.json"]


def test_the_settings_alone_decide_their_hash(comparison, stored, tmp_path):
    other = dataclasses.replace(comparison, settings={**comparison.settings, "step_s": 2.0}, cases=())
    write(other, make_result(other), tmp_path / "other")
    assert read(tmp_path / "other").manifest["settings_sha256"] != stored.manifest["settings_sha256"]


def test_earlier_results_are_replaced_and_nothing_else_remains(comparison, tmp_path):
    out = tmp_path / "out"
    other = dataclasses.replace(comparison, seed=2, cases=())
    write(other, make_result(other), out)
    fewer = dataclasses.replace(comparison, cases=comparison.cases[:1])
    write(fewer, make_result(fewer), out)
    assert [key[2] for key in read(out).keys()] == ["stochastic"]  # noqa: SIM118
    assert read(out).manifest["seed"] == 1
    assert list(tmp_path.iterdir()) == [out]
    assert stat.S_IMODE(out.stat().st_mode) == 0o777 & ~_umask()


def _umask():
    mask = os.umask(0)
    os.umask(mask)
    return mask


def test_a_failure_leaves_earlier_results_as_they_were(comparison, stored):
    before = _bytes_of(stored.folder)
    _fail_after_result(comparison, stored.folder)
    assert _bytes_of(stored.folder) == before
    assert list(stored.folder.parent.iterdir()) == [stored.folder]


def test_a_failure_leaves_no_new_folder(comparison, tmp_path):
    _fail_after_result(comparison, tmp_path / "a" / "b" / "out")
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_one_clear_message(tmp_path):
    with (
        pytest.raises(StoreError, match=r"cannot write results to .*No space left"),
        staged(tmp_path / "out"),
    ):
        raise OSError(28, "No space left on device")
    assert list(tmp_path.iterdir()) == []


def test_a_foreign_folder_is_refused_and_untouched(comparison, tmp_path):
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(StoreError, match=r"thesis\.tex is there.*nothing was touched"):
        write(comparison, make_result(comparison), tmp_path)
    assert (tmp_path / "thesis.tex").read_text() == "precious"


def test_a_foreign_manifest_does_not_make_a_folder_ours(tmp_path):
    (tmp_path / "manifest.json").write_text('{"format": "something else"}')
    with pytest.raises(StoreError, match="holds no results of socwise"):
        check_writable(tmp_path)


def test_a_users_own_file_among_results_is_not_lost(stored):
    note = stored.folder / "cases" / "my-notes.txt"
    note.write_text("look at case 3")
    try:
        with pytest.raises(StoreError, match=r"also cases/my-notes\.txt; nothing was touched"):
            check_writable(stored.folder)
    finally:
        note.unlink()
    check_writable(stored.folder)


def test_an_empty_folder_or_a_desktops_litter_is_no_obstacle(tmp_path):
    check_writable(tmp_path)
    (tmp_path / ".DS_Store").touch()
    check_writable(tmp_path)


def test_a_link_to_a_folder_stays_a_link(tmp_path):
    real, link = tmp_path / "real", tmp_path / "link"
    real.mkdir()
    link.symlink_to(real)
    with staged(link) as folder:
        (folder / "x").touch()
    assert link.is_symlink()
    assert files_below(real) == ["x"]


@pytest.mark.parametrize("kind", ["file", "below a file", "not writable"])
def test_an_unwritable_out_is_refused_before_any_work(kind, tmp_path):
    file = tmp_path / "file"
    file.touch()
    out = {"file": file, "below a file": file / "x" / "out", "not writable": Path("/proc/no/such")}[kind]
    with pytest.raises(StoreError, match="choose a"):
        check_writable(out)
    assert list(tmp_path.iterdir()) == [file]


def test_checking_leaves_nothing_behind(tmp_path):
    check_writable(tmp_path / "a" / "b")
    assert list(tmp_path.iterdir()) == []


def test_case_files_are_safe_and_distinct(comparison):
    case = comparison.cases[0]
    concepts = ("../my cars/Ünal's.toml", "..", "hev", "HEV", "hev")
    cases = [dataclasses.replace(case, concept=name) for name in concepts]
    cases.append(dataclasses.replace(case, mu=0.002 + 1e-12))
    names = case_files(tuple(cases))
    assert len({name.lower() for name in names}) == len(cases)
    assert all(name.startswith("cases/") and name.count("/") == 1 and ".." not in name for name in names)
    assert all(name.isascii() and " " not in name for name in names)


def test_nan_and_infinity_become_null(comparison, tmp_path):
    empty = dataclasses.replace(comparison, cases=())
    result = {**make_result(empty), "odd": [math.nan, {"x": math.inf}], "paired": []}
    write(empty, result, tmp_path / "out")
    assert json.loads((tmp_path / "out" / "result.json").read_text())["odd"] == [None, {"x": None}]


def test_reading_what_is_not_there(stored, tmp_path):
    with pytest.raises(StoreError, match="there is no folder"):
        read(tmp_path / "nowhere")
    with pytest.raises(StoreError, match="holds no results"):
        read(tmp_path)
    with pytest.raises(StoreError, match=r"no case hev, mu 0.5, stochastic; it holds hev, mu 0.002"):
        stored.case("hev", 0.5, "stochastic")


@pytest.mark.parametrize("content", [b"", b"CDF\x02", b"not a NetCDF file at all", "its first half"])
def test_a_damaged_case_is_one_clear_message(stored, content):
    path = stored.folder / "cases/hev_mu0.002_rule_based.nc"
    before = path.read_bytes()
    path.write_bytes(before[: len(before) // 2] if isinstance(content, str) else content)
    try:
        with pytest.raises(StoreError, match="missing or damaged"):
            stored.case("hev", 0.002, "rule_based")
    finally:
        path.write_bytes(before)

"""Results open elsewhere: tables for pandas, arrays for xarray, files for MATLAB and spreadsheets."""

import csv
import dataclasses
import json
import shutil
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from command_line import run
from scipy.io import netcdf_file
from synthetic import make_comparison, make_result, store_without_figures
from synthetic_study import factorial, scattered, write_study
from traffic_cases import SMALL

import socwise
from socwise.results import Result, StoreError
from socwise.results.netcdf import VARIABLES
from socwise.results.plain import write_json, write_rows

COMPARISON = make_comparison(("hev", "phev"), (0.0007, 0.006), steps=50, realizations=4)


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """A comparison as `socwise compare` leaves it, but for the figures."""
    folder = tmp_path_factory.mktemp("result") / "out"
    stored = store_without_figures(COMPARISON, folder)
    write_json(folder / "result.json", stored.result)
    write_json(folder / "manifest.json", stored.manifest)
    write_rows(folder / "summary.csv", stored.result["cases"], without=("solve_s",))
    return folder


def test_the_table_is_that_of_the_csv(compared):
    frame = Result.load(compared).to_pandas()
    written = pd.read_csv(compared / "summary.csv")
    pd.testing.assert_frame_equal(frame, written, check_dtype=False, rtol=1e-12)
    assert "solve_s" not in frame.columns
    chosen = frame.set_index(["concept", "mu", "policy"]).loc[("phev", 0.006, "stochastic")]
    assert chosen["cost_kg_mean"] == pytest.approx(COMPARISON.cases[9].rollout.cost_kg.mean())


def test_the_arrays_are_those_of_the_cases(compared):
    data = Result.load(str(compared)).to_xarray()
    assert dict(data.sizes) == {
        "concept": 2, "mu": 2, "policy": 3, "realization": 4, "time": 51, "step": 50,
    }  # fmt: skip
    for case in COMPARISON.cases:
        one = data.sel(concept=case.concept, mu=case.mu, policy=case.policy)
        np.testing.assert_array_equal(one.soc, case.rollout.soc)
        np.testing.assert_array_equal(one.engine_on, case.rollout.engine_on)
        np.testing.assert_array_equal(one.current_A, case.rollout.current_A)
        np.testing.assert_array_equal(one.cost_kg, case.rollout.cost_kg)
        assert (float(one.window_low), float(one.target_soc)) == (case.window[0], case.target_soc)
        assert float(one.value_kg) == case.value_kg
    assert set(VARIABLES) - {"time_s"} <= set(data.data_vars)
    assert all(
        variable.attrs["units"] and variable.attrs["long_name"] for variable in data.data_vars.values()
    )
    assert data.time.attrs["units"] == "s"
    np.testing.assert_array_equal(data.time, COMPARISON.time_s)
    np.testing.assert_array_equal(data.speed_mps, COMPARISON.speed_mps)
    assert data.engine_starts.dtype.kind == "i"


def test_the_arrays_survive_a_file(compared, tmp_path):
    data = Result.load(compared).to_xarray()
    data.to_netcdf(tmp_path / "all.nc", engine="scipy")
    with xr.open_dataset(tmp_path / "all.nc", engine="scipy") as again:
        assert again.identical(data) or again.equals(data)


def test_what_a_combination_lacks_is_nan(tmp_path):
    cases = tuple(case for case in COMPARISON.cases if (case.concept, case.mu) != ("phev", 0.0007))
    fewer = dataclasses.replace(COMPARISON, cases=cases)
    stored = store_without_figures(fewer, tmp_path / "out")
    write_json(tmp_path / "out" / "result.json", stored.result)
    write_json(tmp_path / "out" / "manifest.json", stored.manifest)
    data = Result.load(tmp_path / "out").to_xarray()
    assert bool(data.soc.sel(concept="phev", mu=0.0007).isnull().all())
    assert bool(data.engine_starts.sel(concept="phev", mu=0.0007).isnull().all())
    whole = data.sel(concept="hev", mu=0.0007, policy="stochastic")
    np.testing.assert_array_equal(whole.engine_on, COMPARISON.cases[0].rollout.engine_on)


def test_each_file_opens_as_it_is(compared):
    """Classic NetCDF with 64-bit offsets is what MATLAB's ncread and xarray's scipy engine read."""
    manifest = json.loads((compared / "manifest.json").read_text(encoding="utf-8"))
    path = compared / manifest["cases"][0]["file"]
    assert path.read_bytes()[:4] == b"CDF\x02"
    with netcdf_file(path, mmap=False) as raw:
        assert raw.Conventions == b"CF-1.8"
        assert all(variable.data.dtype.kind in "fi" for variable in raw.variables.values())
    with xr.open_dataset(path, engine="scipy") as data:
        assert data.soc.dims == ("realization", "time")
        assert "time_s" in data.coords
        np.testing.assert_array_equal(data.soc, COMPARISON.cases[0].rollout.soc)
    with (compared / "summary.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(COMPARISON.cases)
    assert float(rows[0]["cost_kg_mean"]) == pytest.approx(COMPARISON.cases[0].rollout.cost_kg.mean())


def test_a_study_over_a_grid_has_its_factors_as_dimensions(tmp_path):
    points = factorial(concept=["hev", "phev"], mu=[0.006, 0.002], cycle=["us06"])
    folder = write_study(tmp_path / "study", points, failed=(2,), losses=[(5.0, 1.0)] * 4)
    result = Result.load(folder)
    frame = result.to_pandas()
    assert len(frame) == 3 * 3
    assert {"case", "concept", "mu", "cycle", "policy", "cost_kg_mean"} <= set(frame.columns)
    data = result.to_xarray()
    assert dict(data.sizes) == {"concept": 2, "mu": 2, "policy": 3}
    assert data.mu.values.tolist() == [0.002, 0.006]
    policy = {"policy": "certainty_equivalent"}
    assert float(data.cost_kg_mean.sel(concept="phev", mu=0.006, **policy)) == pytest.approx(1.05)
    assert bool(data.cost_kg_mean.sel(concept="hev", mu=0.002, **policy).isnull())
    assert float(data.loss_percent.sel(concept="phev", mu=0.006)) == pytest.approx(5.0)
    assert float(data.loss_percent_high.sel(concept="phev", mu=0.006)) == pytest.approx(6.0)
    assert data.fuel_l_per_100km_mean.attrs["units"] == "l/(100 km)"
    with pytest.raises(StoreError, match="holds a study"):
        _ = result.summary


def test_a_study_of_samples_has_them_along_case(tmp_path):
    points = scattered(12)
    data = Result.load(write_study(tmp_path / "study", points)).to_xarray()
    assert dict(data.sizes) == {"case": 12, "policy": 3}
    assert data.mu.values.tolist() == [point["mu"] for point in points]
    assert data.concept.values.tolist() == [point["concept"] for point in points]
    single = Result.load(write_study(tmp_path / "single", points[:1])).to_xarray()
    assert dict(single.sizes) == {"case": 1, "policy": 3}


def test_estimates_stand_side_by_side(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    time_s = np.arange(900.0)
    rows = [f"{t:g},{-1.0 if t % 100 < 50 else 0.0},{3.3 - 0.01 * (t % 100 < 50)}" for t in time_s]
    (tmp_path / "log.csv").write_text(
        "time_s,current_A,voltage_V\n" + "\n".join(rows) + "\n", encoding="utf-8"
    )
    shown = run(
        capsys, "estimate", "log.csv", "--cell", "lfp-2ah", "--estimator", "coulomb,ekf", "--out", "out"
    )  # fmt: skip
    assert shown.code == 0, shown.err
    result = Result.load("out")
    assert list(result.to_pandas()["name"]) == ["coulomb", "ekf"]
    data = result.to_xarray()
    assert set(data.estimator.values) == {"coulomb", "ekf"}
    assert data.soc.dims == ("estimator", "time")
    assert data.residual_V.attrs["units"] == "V"
    with xr.open_dataset(tmp_path / "out" / "ekf.nc", engine="scipy") as alone:
        np.testing.assert_array_equal(data.soc.sel(estimator="ekf"), alone.soc)
        np.testing.assert_array_equal(data.time, alone.time_s)


def test_inertia_estimates_stand_side_by_side(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(capsys, "inertia", "mass-spring", "--out", "out").code == 0
    data = Result.load("out").to_xarray()
    assert data.mass_kg.dims == ("run", "time")
    assert data.mass_kg.attrs["units"] == "kg"
    one = data.isel(run=list(data.method.values).index("ukf"))
    with xr.open_dataset(tmp_path / "out" / "mass-spring-ukf.nc", engine="scipy") as alone:
        np.testing.assert_array_equal(one.mass_kg, alone.mass_kg)
    assert len(Result.load("out").to_pandas()) == data.sizes["run"]


def test_traffic_has_a_field_or_spreads_and_no_table(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(SMALL, encoding="utf-8")
    assert run(capsys, "traffic", "run", "small.toml", "--out", "field").code == 0
    result = Result.load("field")
    field = result.to_xarray()
    assert set(field.sizes) == {"time", "cell"}
    assert field.speed_mps.attrs["units"] == "m/s"
    with pytest.raises(StoreError, match=r"no table of cases; take to_xarray\(\)"):
        result.to_pandas()
    options = ("--method", "gpc,mc", "--runs", "16", "--out", "spread")
    assert run(capsys, "traffic", "uncertainty", "small.toml", *options).code == 0
    spread = Result.load("spread").to_xarray()
    assert list(spread.method.values) == ["gpc", "mc"]
    assert set(spread.mean_mps.dims) == {"method", "time", "place"}
    assert run(capsys, "traffic", "cycles", "small.toml", "--out", "cycles").code == 0
    with pytest.raises(StoreError, match=r"holds no NetCDF files; its numbers are in result\.json"):
        Result.load("cycles").to_xarray()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "holds no results of socwise"),
        ('{"format": "theirs"}', "holds no results of socwise"),
        ("{", "holds no results of socwise"),
        ('{"format": "socwise gallery"}', "holds a socwise gallery, which does not open here"),
    ],
)
def test_other_folders_are_refused(tmp_path, content, said):
    if content is not None:
        (tmp_path / "manifest.json").write_text(content, encoding="utf-8")
    with pytest.raises(StoreError, match=said):
        Result.load(tmp_path)
    with pytest.raises(StoreError, match="is no folder"):
        Result.load(tmp_path / "none")


def test_damage_is_told(compared, tmp_path):
    shutil.copytree(compared, tmp_path / "out")
    result = Result.load(tmp_path / "out")
    next((tmp_path / "out" / "cases").iterdir()).write_bytes(b"CDF\x02")
    with pytest.raises(StoreError, match="missing or damaged"):
        result.to_xarray()
    (tmp_path / "out" / "result.json").unlink()
    with pytest.raises(StoreError, match=r"result\.json is missing or damaged"):
        result.to_pandas()


def test_a_package_that_is_not_installed_is_named_with_its_cure(compared, monkeypatch):
    result = Result.load(compared)
    for package, convert in (("pandas", result.to_pandas), ("xarray", result.to_xarray)):
        monkeypatch.setitem(sys.modules, package, None)
        with pytest.raises(StoreError, match=rf"{package} is not installed; .*socwise\[results\]"):
            convert()


def test_it_is_at_the_top_and_costs_nothing_until_it_is_asked_for():
    assert socwise.Result is Result
    with pytest.raises(AttributeError, match="no attribute 'Rezult'"):
        _ = socwise.Rezult
    code = (
        "import sys, socwise; before = set(sys.modules); socwise.Result;"
        "late = {'pandas', 'xarray', 'plotly', 'matplotlib'} & sys.modules.keys();"
        "print(sorted({'numpy'} & before), sorted(late))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[] []"


def test_the_object_of_the_command_is_there(compared):
    expected = json.loads(json.dumps(make_result(COMPARISON)))
    assert Result.load(compared).summary == expected

"""Figures show the numbers they are given, with units, and come out the same every time."""

import dataclasses
import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from scipy import stats
from synthetic import POLICIES, make_comparison

from ems.statistics import half_width, mean_interval
from socwise import figures
from socwise.figures.files import _figures
from socwise.figures.operation import on_intervals
from socwise.figures.scale import cut_of
from socwise.labels import middle, policy_style
from socwise.thinning import extremes, stride_for


@pytest.fixture(scope="module")
def comparison():
    return make_comparison(policies=POLICIES)


@pytest.fixture(scope="module")
def hev(comparison):
    return [case for case in comparison.cases if case.concept == "hev"]


def _line(ax, label):
    return next(line for line in ax.lines if line.get_label() == label)


def test_soc_shows_truth_estimate_band_and_window(hev):
    case = hev[0]
    ax = Figure().subplots()
    assert figures.plot_soc(case, 3, ax) is ax
    np.testing.assert_array_equal(_line(ax, "true").get_ydata().max(), 100.0 * case.rollout.soc[3].max())
    np.testing.assert_array_equal(
        _line(ax, "estimate").get_ydata().min(), 100.0 * case.rollout.soc_estimate[3].min()
    )
    band = ax.collections[0].get_datalim(ax.transData)
    top = 100.0 * (case.rollout.soc_estimate[3] + 2.0 * np.sqrt(case.rollout.variance[3]))
    assert band.y1 == pytest.approx(top.max(), rel=1e-6)
    assert sorted(line.get_ydata()[0] for line in ax.lines if len(line.get_ydata()) == 2) == pytest.approx(
        [55, 75]
    )
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time [s]", "SOC [%]")


def test_ensemble_shows_the_median_of_all_realizations(hev):
    ax = figures.plot_ensemble(hev[0])
    median = 100.0 * np.median(hev[0].rollout.soc, axis=0)
    np.testing.assert_allclose(_line(ax, "median").get_ydata().max(), median.max(), rtol=1e-6)
    assert len(ax.collections) == 2


def test_error_is_estimate_less_truth(hev):
    ax = figures.plot_error(hev[1], 2)
    rollout = hev[1].rollout
    error = 100.0 * (rollout.soc_estimate[2].astype(float) - rollout.soc[2].astype(float))
    shown = _line(ax, "estimate − true").get_ydata()
    assert (shown.min(), shown.max()) == (pytest.approx(error.min()), pytest.approx(error.max()))
    assert ax.get_ylabel() == "SOC error [%]"


def test_spread_is_the_root_of_the_mean_variance(hev):
    ax = figures.plot_spread(hev[:2])
    expected = 100.0 * math.sqrt(hev[0].rollout.variance.mean(axis=0).max())
    assert _line(ax, "stochastic").get_ydata().max() == pytest.approx(expected, rel=1e-6)
    assert "% SOC" in ax.get_ylabel()


def test_current_keeps_its_sign_and_its_peaks(hev):
    ax = figures.plot_current(hev[0], 1)
    shown = ax.lines[-1].get_ydata()
    assert shown.max() == hev[0].rollout.current_A[1].max()
    assert shown.min() == hev[0].rollout.current_A[1].min()
    assert ax.get_ylabel() == "current [A], > 0 charges"
    assert f"{hev[0].rollout.mean_abs_current_A[1]:.1f} A" in ax.get_title()


def test_engine_bars_last_as_long_as_the_engine_runs(hev):
    ax = figures.plot_engine(hev[:2])
    rollout = hev[0].rollout
    spans = [path.vertices[:, 0] for path in ax.collections[0].get_paths()]
    drawn = sum(np.ptp(span) for span in spans)
    assert drawn == pytest.approx(np.count_nonzero(rollout.engine_on[0, :-1]))
    assert f"{rollout.engine_starts[0]} starts" in ax.get_yticklabels()[0].get_text()


def test_on_intervals_hold_until_the_next_sample():
    time_s = np.array([0.0, 1.0, 2.0, 4.0, 5.0, 6.0])
    state = np.array([True, False, True, True, False, True])
    assert on_intervals(time_s, state) == [(0.0, 1.0), (2.0, 3.0)]
    assert on_intervals(time_s, np.zeros(6, dtype=bool)) == []
    assert on_intervals(time_s, np.ones(6, dtype=bool)) == [(0.0, 6.0)]


def test_speed_in_kmh_and_altitude_only_where_the_road_is_not_level(comparison):
    ax = figures.plot_speed(comparison.time_s, comparison.speed_mps, comparison.altitude_m)
    assert ax.lines[0].get_ydata().max() == pytest.approx(3.6 * comparison.speed_mps.max())
    assert ax.get_ylabel() == "speed [km/h]"
    assert [other.get_ylabel() for other in ax.figure.axes if other is not ax] == ["altitude [m], dashed"]
    level = figures.plot_speed(comparison.time_s, comparison.speed_mps, np.zeros_like(comparison.time_s))
    assert level.figure.axes == [level]


def test_cost_bars_add_up_to_the_realised_cost(hev):
    ax = figures.plot_cost_split(hev)
    tops = sorted(bar.get_y() + bar.get_height() for bar in ax.patches)[-1]
    assert tops == pytest.approx(max(case.rollout.cost_kg.mean() for case in hev))
    assert len(ax.patches) == 2 * len(hev)
    assert ax.get_ylabel() == "realised cost [kg fuel]"
    colors = {to_hex(bar.get_facecolor()).upper() for bar in ax.patches[::2]}
    assert colors == {policy_style(policy).color.upper() for policy in POLICIES}


def test_a_credit_goes_below_zero(hev):
    rollout = dataclasses.replace(hev[0].rollout, penalty_kg=np.full(6, -0.25))
    ax = figures.plot_cost_split([dataclasses.replace(hev[0], rollout=rollout)])
    assert min(bar.get_y() + bar.get_height() for bar in ax.patches) == pytest.approx(-0.25)


def test_differences_are_paired_and_point_left_where_the_reference_is_cheaper(hev):
    ax = figures.plot_differences(hev)
    low_mu = {case.policy: case.rollout.cost_kg for case in hev if case.mu == 0.0007}
    difference = low_mu["stochastic"] - low_mu["certainty_equivalent"]
    drawn = ax.containers[0]
    assert drawn.get_label() == "certainty-equivalent"
    assert drawn.lines[0].get_xdata()[0] == pytest.approx(difference.mean())
    assert difference.mean() < 0.0
    ends = drawn.lines[2][0].get_segments()[0][:, 0]
    antithetic = difference.reshape(-1, 2).mean(axis=1)
    wanted = stats.t.interval(0.95, 2, difference.mean(), stats.sem(antithetic))
    np.testing.assert_allclose(ends, wanted)
    assert [label.get_text() for label in ax.get_yticklabels()] == ["μ = 0.0007", "μ = 0.006"]


def test_one_realization_has_no_interval_but_a_picture():
    single = make_comparison(realizations=1, steps=20)
    cases = [case for case in single.cases if case.concept == "hev"]
    for plot in (figures.plot_cost_split, figures.plot_differences):
        ax = plot(cases)
        ax.figure.canvas.draw()
        assert ax.get_xlabel()


def test_a_realization_that_does_not_exist_is_refused(hev):
    with pytest.raises(ValueError, match="realization 6 is not one of 0 to 5"):
        figures.plot_soc(hev[0], 6)
    with pytest.raises(ValueError, match="realization -1"):
        figures.plot_current(hev[0], -1)


def test_the_whole_set_is_written_in_both_formats(comparison, tmp_path):
    few = dataclasses.replace(comparison, cases=comparison.cases[:2])
    written = figures.write_figures(few, tmp_path / "figures")
    names = {path.name for path in written}
    stems = ["cycle", "cost", "differences", "hev_soc", "hev_ensemble", "hev_error", "hev_uncertainty"]
    stems.append("hev_operation")
    assert names == {f"{stem}.{suffix}" for stem in stems for suffix in ("png", "svg")}
    for path in written:
        content = path.read_bytes()
        assert content.startswith(b"\x89PNG" if path.suffix == ".png" else b"<?xml")
        assert b"<dc:date>" not in content


def test_two_processes_write_what_one_writes(comparison, tmp_path, monkeypatch):
    few = dataclasses.replace(comparison, cases=comparison.cases[:1])
    monkeypatch.setattr("socwise.figures.files.WORTH_A_PROCESS", 1)
    one = figures.write_figures(few, tmp_path / "one", jobs=1)
    two = figures.write_figures(few, tmp_path / "two", jobs=2)
    assert {path.name: path.read_bytes() for path in one} == {path.name: path.read_bytes() for path in two}


def test_a_users_concept_gives_safe_file_names(comparison):
    own = dataclasses.replace(comparison.cases[0], concept="../my car.toml")
    names = list(_figures(dataclasses.replace(comparison, cases=(own,))))
    assert "concept1_soc" in names
    assert not any(set(name) & set("/. ") for name in names)


def test_panels_that_share_an_axis_show_all_of_every_case(comparison):
    figure = _figures(comparison)["hev_uncertainty"]()
    for ax in figure.axes:
        top = ax.get_ylim()[1]
        assert all(np.max(line.get_ydata()) <= top for line in ax.lines)


def test_drawing_opens_no_window_and_importing_draws_in_no_matplotlib():
    code = (
        "import sys; sys.path.insert(0, 'tests'); import socwise.figures as f;"
        "assert 'matplotlib' not in sys.modules; from synthetic import make_comparison;"
        "f.plot_soc(make_comparison(('hev',), (0.002,), ('stochastic',), 10, 2).cases[0]);"
        "sys.exit('matplotlib.pyplot' in sys.modules or 'matplotlib' not in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@given(
    arrays(np.float64, st.integers(1, 60), elements=st.floats(-1e6, 1e6)),
    st.integers(1, 12),
)
def test_thinning_keeps_the_extremes_of_every_stretch(values, stride):
    kept = extremes(values, stride)
    assert kept.size == 2 * -(-values.size // stride)
    assert np.all(np.diff(kept) >= 0)
    for place, start in enumerate(range(0, values.size, stride)):
        stretch, pair = values[start : start + stride], values[kept[2 * place : 2 * place + 2]]
        assert (pair.min(), pair.max()) == (stretch.min(), stretch.max())
        assert start <= kept[2 * place] <= kept[2 * place + 1] < start + stretch.size


def test_stride_leaves_no_more_stretches_than_asked_for():
    assert [stride_for(samples, 1000) for samples in (1, 1000, 1001, 83044)] == [1, 1, 2, 84]
    assert extremes(np.array([]), 3).size == 0


def test_intervals_are_student_t_over_the_pairs():
    values = np.array([1.0, 3.0, 4.0, 8.0, 2.0, 5.0])
    mean, width = mean_interval(values)
    pairs = values.reshape(-1, 2).mean(axis=1)
    low, high = stats.t.interval(0.95, 2, pairs.mean(), stats.sem(pairs))
    assert (mean - width, mean + width) == (pytest.approx(low), pytest.approx(high))
    assert half_width(1.0, 10_000_000) == pytest.approx(stats.norm.ppf(0.975), rel=1e-6)
    assert mean_interval([3.0])[0] == 3.0
    assert math.isnan(mean_interval([3.0])[1])
    assert math.isnan(half_width(None, 50))


def test_policies_of_the_users_own_get_distinct_colours():
    names = [*POLICIES, "mine", "yours"]
    assert len({policy_style(name, names).color for name in names}) == len(names)
    assert policy_style("mine", names).label == "mine"
    assert middle([3.0, 1.0, 2.0]) == 2.0
    assert middle([4.0, 1.0, 2.0, 3.0]) == 2.0


def test_a_few_long_bars_are_cut_off_where_the_others_can_be_read():
    assert cut_of([1.0, 1.2, 10.0, 1.1]) == pytest.approx(1.5 * 1.2)
    assert cut_of([1.0, 3.0, 1.1]) is None
    assert cut_of([]) is None
    assert cut_of([0.0, 0.0, 5.0]) is None, "nothing to measure the long one by"

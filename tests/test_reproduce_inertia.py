"""Tables 1 to 6 and Figures 1 to 14 and 17 to 22 of the MAUTC report, with fewer runs than the items have."""

import json

import numpy as np
import pytest

from socwise import reproduce
from socwise.reproduce import load_transfer_items, mass_spring_items, ride_items
from socwise.reproduce.load_transfer_items import PUBLISHED, TRUTH
from socwise.reproduce.mass_spring_case import errors_percent, over_confidence, runs, tracking
from socwise.reproduce.vehicle_case import NOISY, ROAD_GAIN, drives
from vehicle.inertia.defender import DEFENDER

PLACES = [
    *(f"table{number}" for number in range(1, 7)),
    *(f"fig{number}" for number in (*range(1, 15), *range(17, 23))),
]


def wrong(found):
    return [f"{row.label}: {row.ours}" for row in found.rows if not row.ok]


def check(found, label=None):
    """Every row is right and can be written; the picture's axes carry units."""
    assert found.rows
    assert wrong(found) == []
    assert len({row.name for row in found.rows}) == len(found.rows)
    json.dumps(found.to_json(), allow_nan=False)
    assert (found.draw is None) == (label is None)
    if label:
        (ax,) = found.draw().axes
        assert (ax.get_xlabel(), ax.get_ylabel()) == ("time [s]", label)
        assert ax.lines[-1].get_label() == "true"


def test_the_items_are_those_of_the_report():
    assert [f"mautc-{place}" for place in PLACES if f"mautc-{place}" not in reproduce.ids()] == []


def test_tables_of_the_mass_spring_system_hold():
    check(mass_spring_items.table1(seeds=10))
    found = mass_spring_items.table2(seeds=10)
    assert wrong(found) == []
    names = {row.name: row for row in found.rows}
    assert names["UKF: mean NEES"].ours == pytest.approx(1.0, abs=0.6)
    assert names["N of eq 26, in m and m/s"].deviation == 12.0


def test_a_filter_that_works_is_not_called_failed():
    """The verdicts of Table 1 on a filter of Table 2."""
    good = runs("full_germ", 0.2, 10)
    assert np.abs(errors_percent(good)).max() < 0.1
    assert np.median(over_confidence(good)) < 2.0
    error, claimed = tracking(good, "position_m")
    assert error < 1.5 * claimed
    assert not mass_spring_items._tracks(good, "position_m").ok


@pytest.mark.parametrize(
    ("number", "label"),
    [(1, "position [m]"), (3, "mass [kg]"), (5, "velocity [m/s]"), (6, "mass [kg]")],
)
def test_figures_of_the_mass_spring_system_hold(number, label):
    check(mass_spring_items.figure(number, seeds=10), label)


def test_tables_of_the_ride_hold():
    ticks = []
    found = ride_items.table4(seeds=3, input_seeds=1, progress=lambda *done: ticks.append(done))
    assert ticks[-1] == (4, 4)
    # A mean over three drives is looser than over fifty.
    assert [row for row in wrong(found) if "mean error, size, wanted at most" not in row] == []
    shown = {row.name: row.ours for row in found.rows}
    biased = shown["noise on A_x and A_y too, gPC-EKF, roll inertia: mean error"]
    assert biased > 10.0 * abs(shown["EKF, roll inertia: mean error"])
    check(ride_items.table3(seeds=1))


@pytest.mark.parametrize(("number", "label"), [(7, "CG height [m]"), (10, "roll inertia [kg m²]")])
def test_figures_of_the_ride_hold(number, label):
    check(ride_items.figure(number, seeds=1), label)


def test_figures_with_noise_show_four_methods():
    found = ride_items.figure(12, seeds=3)
    labels = [line.get_label() for line in found.draw().axes[0].lines]
    assert labels == [
        "gPC-EKF ± 2 sd",
        "gPC-EKF, report ± 2 sd",
        "RLS, force form ± 2 sd",
        "RLS, acceleration form ± 2 sd",
        "true",
    ]


@pytest.mark.parametrize("scenario", ["urban", "rural"])
def test_tables_of_the_road_hold(scenario):
    found = load_transfer_items.table(scenario, seeds=2)
    assert found.id == {"urban": "mautc-table5", "rural": "mautc-table6"}[scenario]
    check(found)


@pytest.mark.parametrize(("number", "label"), [(17, "mass [kg]"), (22, "CG from front axle [m]")])
def test_figures_of_the_road_hold(number, label):
    check(load_transfer_items.figure(number, seeds=2), label)


def test_the_truth_is_that_of_the_synthetic_vehicle_and_of_the_published_errors():
    assert {name: DEFENDER.truth[name] for name in TRUTH} == TRUTH
    for scenario in PUBLISHED.values():
        for rows in scenario.values():
            for name, (estimate, percent) in rows.items():
                assert 100.0 * abs(estimate / TRUTH[name] - 1.0) == pytest.approx(percent, abs=0.06)


def test_the_number_of_threads_changes_nothing():
    one = drives(("ltm", "mltm"), "urban", ROAD_GAIN, 2, jobs=1)
    from socwise.reproduce import vehicle_case

    vehicle_case._drive.cache_clear()
    two = drives(("ltm", "mltm"), "urban", ROAD_GAIN, 2, jobs=2)
    assert [run.seed for run in two["mltm", "gpc"]] == [0, 1]
    for kind, several in one.items():
        for first, second in zip(several, two[kind], strict=True):
            np.testing.assert_array_equal(first.estimate.values, second.estimate.values)


@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES)
def test_every_item_holds_with_all_its_runs(place):
    assert wrong(reproduce.run(f"mautc-{place}")) == []


@pytest.mark.slow
def test_only_noise_on_the_inputs_biases_the_filters():
    quiet = drives(("ride",), "rural", NOISY, 10)
    for method in ("gpc", "ekf", "ukf", "rls-acceleration"):
        errors = [run.estimate.error(run.truth)["roll_inertia_kgm2"] for run in quiet["ride", method]]
        assert abs(np.mean(errors)) < 0.005

"""The record of an estimate: settling, errors, and what its covariance is worth."""

import numpy as np
import pytest

from vehicle.errors import VehicleError
from vehicle.inertia.record import InertiaEstimate, settling_time_s

TIME = np.arange(5.0)
VALUES = np.column_stack([[90.0, 97.0, 99.0, 101.0, 100.0], [0.5, 0.5, 0.5, 0.5, 0.5]])


def record(**changes):
    given = {
        "method": "gpc",
        "time_s": TIME,
        "names": ("mass_kg", "cg_height_m"),
        "values": VALUES.copy(),
        "sds": np.column_stack([np.full(5, 2.0), np.full(5, 0.0)]),
        "covariance": np.array([[4.0, 0.1], [0.1, 0.01]]),
    }
    return InertiaEstimate(**(given | changes))


def test_a_quantity_has_settled_when_it_stays():
    np.testing.assert_array_equal(record().settled_s, [2.0, 0.0])
    late = np.array([[1.0], [1.0], [1.0], [2.0], [1.0]])
    assert np.isnan(settling_time_s(TIME, late)[0])
    assert settling_time_s(TIME, late, band=1.0)[0] == 0.0
    assert np.isnan(settling_time_s(TIME, np.full((5, 1), np.nan))[0])


def test_errors_are_relative_and_deviations_in_own_standard_deviations():
    found = record()
    truth = {"mass_kg": 104.0, "cg_height_m": 0.4, "C": 1.0}
    assert found.error(truth) == pytest.approx({"mass_kg": -4.0 / 104.0, "cg_height_m": 0.25})
    assert found.error({"cg_height_m": 0.0}) == {"cg_height_m": 0.5}
    assert found.deviations(truth) == {"mass_kg": -2.0, "cg_height_m": np.inf}
    assert found.final_sd == {"mass_kg": 2.0, "cg_height_m": 0.0}
    value, sd = found.column("cg_height_m")
    assert (value[-1], sd[-1]) == (0.5, 0.0)


def test_nees_is_that_of_the_quantities_whose_truth_is_known():
    found, error = record(), np.array([-4.0, 0.1])
    both = error @ np.linalg.inv(found.covariance) @ error / 2.0
    assert found.nees({"mass_kg": 104.0, "cg_height_m": 0.4}) == pytest.approx(both)
    assert found.nees({"mass_kg": 104.0}) == pytest.approx(4.0)
    with pytest.raises(VehicleError, match="none of mass_kg, cg_height_m"):
        found.nees({"C": 1.0})


def test_a_record_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        record().values[0, 0] = 1.0


@pytest.mark.parametrize(
    "wrong",
    [{"names": ("mass_kg",)}, {"time_s": TIME[:4]}, {"sds": np.ones((4, 2))}, {"covariance": np.eye(3)}],
)
def test_shapes_must_fit(wrong):
    with pytest.raises(VehicleError, match=r"is not|do not fit"):
        record(**wrong)

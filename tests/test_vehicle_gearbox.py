"""Shift table and final drive."""

import numpy as np
import pytest
from pydantic import ValidationError

from vehicle import Gearbox

DATA = {
    "ratios": (4.0, 2.0, 1.0),
    "efficiency": 0.97,
    "final_drive_ratio": 4.0,
    "final_drive_efficiency": 0.9,
    "upshift_mps": (5.0, 10.0),
    "downshift_mps": (3.0, 8.0),
}
GEARBOX = Gearbox(**DATA)


def test_hysteresis():
    speed = np.array([0.0, 4.9, 5.0, 4.0, 3.0, 2.9, 4.9, 9.9, 10.0, 8.0, 7.9, 5.0])
    assert GEARBOX.select_gears(speed).tolist() == [0, 0, 1, 1, 1, 0, 0, 1, 2, 2, 1, 1]


def test_gears_may_be_skipped_either_way():
    assert GEARBOX.select_gears(np.array([20.0, 0.0])).tolist() == [2, 0]


def test_one_gear_never_shifts():
    single = Gearbox(**DATA | {"ratios": (1.0,), "upshift_mps": (), "downshift_mps": ()})
    assert single.select_gears(np.array([0.0, 30.0])).tolist() == [0, 0]


def test_final_drive_loses_on_the_side_that_receives():
    np.testing.assert_allclose(GEARBOX.final_drive_input(np.array([360.0, -360.0])), [100.0, -81.0])
    torque = np.linspace(-500.0, 500.0, 11)
    np.testing.assert_allclose(GEARBOX.final_drive_output(GEARBOX.final_drive_input(torque)), torque)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"upshift_mps": (5.0,)}, "upshift_mps has 1 speeds, 3 gears need 2"),
        ({"upshift_mps": (10.0, 5.0)}, "upshift_mps must increase"),
        ({"downshift_mps": (5.0, 8.0)}, "gear 1: downshift_mps 5 must lie below upshift_mps 5"),
        ({"ratios": (1.0, 2.0, 4.0)}, "ratios must decrease"),
        ({"efficiency": 1.2}, "less than or equal to 1"),
    ],
)
def test_bad_tables(change, message):
    with pytest.raises(ValidationError, match=message):
        Gearbox(**DATA | change)

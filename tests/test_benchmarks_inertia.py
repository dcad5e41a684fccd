"""What `make bench` times of the regression filters agrees; nothing here depends on how fast anything is."""

import numpy as np
import pytest

from benchmarks.inertia import update_tasks
from benchmarks.timing import interleave


@pytest.mark.parametrize(("model", "parameters"), [("ride", 4), ("mltm", 7)])
def test_kernel_and_arrays_agree_and_the_updates_are_counted(model, parameters):
    tasks = update_tasks(model, 120, 60)
    assert [task.units for task in tasks] == [120, 120, 120, 60]
    ours, ekf, ukf, arrays = (task.run() for task in tasks)
    assert ours.shape == (120, parameters)
    np.testing.assert_allclose(ours[:60], arrays, rtol=1e-6)
    # Filters of other kinds on the same data: near, and not the same.
    for other in (ekf, ukf):
        assert not np.array_equal(other, ours)
        np.testing.assert_allclose(other[-1, :3], ours[-1, :3], rtol=0.2)
    np.testing.assert_array_equal(tasks[0].run(), ours)
    assert all((timing.wall > 0.0).all() for timing in interleave(tasks, 1))

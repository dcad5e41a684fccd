"""What the traffic benchmark times agrees, and every kernel of the traffic models is stamped."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import traffic
from benchmarks.rivals import DisagreementError
from benchmarks.traffic import CELLS, road_tasks


def test_kernel_and_numpy_drive_alike_and_every_diagram_is_timed(monkeypatch):
    tasks = road_tasks(70, 30)
    assert [task.name for task in tasks] == [
        "greenshields",
        "greenshields, NumPy",
        "underwood",
        "greenberg",
        "triangular",
    ]
    for task in tasks:
        density = task.run()
        assert density.shape == (CELLS, 70)
        assert np.all(density[0] > 0.0)
        assert task.units == 70 * 30 * CELLS
    other = traffic._numpy
    monkeypatch.setattr(traffic, "_numpy", lambda members, steps: 1.01 * other(members, steps))
    with pytest.raises(DisagreementError, match="densities by kernel and numpy"):
        road_tasks(3, 30)


def test_every_kernel_of_traffic_is_stamped():
    """A kernel that is left out would run with yesterday's callees."""
    from drivecycles.traffic import _kernels

    folder = Path(_kernels.__file__).parent
    kernels = {path for path in folder.glob("_*.py") if path.stem not in ("__init__", "_kernels")}
    assert kernels == {Path(module.__file__) for module in _kernels.MODULES}

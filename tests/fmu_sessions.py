"""Sessions with battery FMUs for tests, and the traces that none may leave."""

import gc
import os
import tempfile
from pathlib import Path

import numpy as np
import pytest
from fmu_files import mapping_text

from bms.plants.fmu.isolated import Limits
from bms.plants.fmu.mapping import load_mapping
from bms.plants.fmu.session import open_fmu

CALM = Limits(step_deadline_s=20.0, start_deadline_s=60.0, close_deadline_s=0.5)
QUICK = Limits(step_deadline_s=0.5, start_deadline_s=60.0, close_deadline_s=0.5)
POWER_W = 20.0 * np.sin(np.arange(40) / 4.0)


def session(path, text=None, *, isolate=True, limits=CALM, **mapping):
    """Open an FMU with the mapping of `fmu_files.mapping_text`."""
    file = Path(path).with_suffix(".toml")
    file.write_text(text or mapping_text(**mapping), encoding="utf-8")
    return open_fmu(path, load_mapping(file), isolate=isolate, limits=limits)


def drive(plant, power_W=POWER_W):
    """Carry a load; voltage after every step."""
    return [plant.step(float(power), 0.0, 1.0).voltage_V for power in power_W]


def children(pid=None):
    """Processes below this one, as far as the system tells."""
    found = []
    for file in Path(f"/proc/{pid or os.getpid()}/task").glob("*/children"):
        try:
            direct = [int(child) for child in file.read_text(encoding="ascii").split()]
        except OSError:
            continue
        for child in direct:
            found += [child, *children(child)]
    return found


def handles():
    """Number of files that this process has open."""
    return len(list(Path("/proc/self/fd").iterdir())) if Path("/proc/self/fd").is_dir() else 0


@pytest.fixture
def nothing_left(tmp_path, monkeypatch):
    """Check after a test that no temporary folder, process or handle is left of it."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    for variable in ("TMPDIR", "TEMP", "TMP"):
        monkeypatch.setenv(variable, str(temporary))
    before, open_before = set(children()), handles()

    def left():
        more = handles() - open_before - 2  # a library that stays loaded, a random source
        return [*temporary.iterdir(), *(set(children()) - before), *range(more)]

    yield temporary
    if left():
        gc.collect()  # slow, and what was not closed is only then a leak
    assert left() == []

"""What `make bench` times of FMUs agrees, on a short drive; nothing here depends on how fast anything is."""

import pytest
from fmu_files import needs_compiler

from benchmarks.fmu import fmu_tasks, require_same
from benchmarks.rivals import DisagreementError
from benchmarks.timing import interleave


@needs_compiler
def test_the_ways_to_run_an_fmu_agree_and_the_steps_are_counted():
    with fmu_tasks(20, 3) as (two, three, further, restarts):
        assert [task.units for task in (*two, *three)] == [20] * 4
        assert [task.units for task in further] == [20, 60, 20, 20, 20]
        assert two[0].run() == two[1].run() == further[0].run() == further[1].run()
        assert three[0].run() == three[1].run()
        timings = interleave([*two, *three, *further, *restarts], 1)
    assert all((timing.wall > 0.0).all() for timing in timings)


@pytest.mark.parametrize("theirs", [(3.6, 0.500001), (3.6,), (3.6, float("nan"))])
def test_outputs_that_differ_are_refused(theirs):
    require_same((3.6, 0.5), (3.6, 0.5), "the same")
    with pytest.raises(DisagreementError, match=r"are not the others' .* no time is taken"):
        require_same((3.6, 0.5), theirs, "the others'")

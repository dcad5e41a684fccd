"""The table of error against cost: what it measures, and that the defaults are as accurate as it says."""

import pytest

from benchmarks.__main__ import COMMANDS
from benchmarks.accuracy import CERTAIN, CONCEPTS, DEFAULT, PROGRAMS, REFERENCE, STOCHASTIC, Variant, measure
from ems import GridSettings

SMALL = GridSettings(soc_step=0.00125, deterministic_soc_step=0.000125, variance_rows=20, torque_levels=62)


def test_errors_are_those_against_the_reference_and_times_those_of_the_longest_trip():
    same = Variant("same", SMALL.model_dump())
    coarse = Variant("linear", {"soc_step": 0.005}, cubic=False)
    found = measure("stochastic", ("hev",), (60, 120), SMALL, 1, (DEFAULT, same, coarse))
    assert set(found) == {"default", "same", "linear"}
    assert set(found["same"].error) == {("hev", 60), ("hev", 120)}
    assert found["same"].error["hev", 120] == 0.0
    assert abs(found["default"].error["hev", 120]) < 0.003 < found["linear"].error["hev", 120]
    assert all(one.cpu_s["hev"] > 0.0 for one in found.values())


def test_every_program_has_its_table():
    assert "accuracy" in COMMANDS
    for program in PROGRAMS:
        kinds = measure(program, ("phev",), (20,), SMALL, 1, PROGRAMS[program][1][:2])
        assert len(kinds) == 2


def test_names_tell_the_variants_apart():
    for variants in (STOCHASTIC, CERTAIN):
        assert len({variant.name for variant in variants}) == len(variants)


@pytest.mark.slow
@pytest.mark.parametrize("program", PROGRAMS)
def test_the_default_grid_is_accurate_to_three_in_a_thousand(program):
    first = PROGRAMS[program][1][:1]
    found = measure(program, CONCEPTS, (2134, 4268), REFERENCE, 1, first)
    assert max(abs(error) for error in found["default"].error.values()) < 0.003
    # Two seconds of one core, and half of that again for a machine that others use.
    assert max(found["default"].cpu_s.values()) < 3.0

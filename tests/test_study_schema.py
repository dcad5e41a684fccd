import json
import re
import tomllib

import numpy as np
import pytest
from study_cases import EIGHT, HEAD, ROOT, write_study

from ems import load_concept
from ems.penalty import Window
from socwise.study import StudyError, load_study, make_plan
from socwise.study.car import StudyConcept, car_of, settable
from socwise.study.design import points
from socwise.study.schema import json_schema
from socwise.study.values import Range


def problems(tmp_path, factors, head=HEAD):
    with pytest.raises(StudyError) as caught:
        load_study(write_study(tmp_path, factors, head))
    return caught.value.problems


def plan(tmp_path, factors, head=HEAD):
    return make_plan(load_study(write_study(tmp_path, factors, head)))


def test_six_planted_errors_are_reported_together(tmp_path):
    """Each with its path, the value given, and what is allowed."""
    factors = """
[factors]
concept = ["hev", "phv"]
cycle = "us06+us07"
mu = [1e-3, 2e-3, -1e-3]
gamma = {low = 1e-6, high = 1e-7, count = 5}
capacity = 2.0
[closed_loop]
training_realizations = "many"
"""
    found = problems(tmp_path, factors)
    assert len(found) == 6
    expected = {
        "factors.concept[1]": ('"phv"', "known are hev, phev"),
        "factors.cycle": ('"us06+us07"', "did you mean 'us06'"),
        "factors.mu[2]": ("-0.001", "must be 0 or more"),
        "factors.gamma.high": ("1e-07", "must be above low, which is 1e-06"),
        "factors.capacity": ("2.0", "did you mean 'capacity_Ah'"),
        "closed_loop.training_realizations": ('"many"', "must be a whole number"),
    }
    for path, (given, allowed) in expected.items():
        (line,) = [one for one in found if one.startswith(f"{path} = ")]
        assert line.startswith(f"{path} = {given}: ")
        assert allowed in line


@pytest.mark.parametrize(
    ("factors", "path", "words"),
    [
        ("[factors]\nconcept = 'hev'\ncycle = []", "factors.cycle", "at least one value"),
        ("[factors]\nconcept = 'no.toml'\ncycle = 'us06'", "factors.concept", "there is no file"),
        ("[factors]\nconcept = 'hev'\ncycle = 'no.csv'", "factors.cycle", "there is no file"),
        ("[factors]\nconcept = 'hev'\ncycle = 'traffic:no'", "factors.cycle", "known are commute"),
        ("[factors]\ncycle = 'us06'", "factors.concept", "is missing"),
        (EIGHT + "mass_kg = true", "factors.mass_kg", "must be a number"),
        (EIGHT + "mass_kg = '1200'", "factors.mass_kg", "must be a number"),
        (EIGHT + "mass_kg = inf", "factors.mass_kg", "must be finite"),
        (EIGHT + "mass_kg = [1000, 1000]", "factors.mass_kg[1]", "name each once"),
        (EIGHT + "mass_kg = {low = 1, high = 2}", "factors.mass_kg.count", "factorial design needs it"),
        (
            EIGHT + "gamma = {low = 0, high = 2, count = 2, scale = 'log'}",
            "factors.gamma.scale",
            "above zero",
        ),
        (EIGHT + "estimator = 'efk'", "factors.estimator", "did you mean 'ekf'"),
        (EIGHT + "plant = 'cell.fmu'", "factors.plant", "there is no file"),
        (EIGHT + "plant = 'ecn'", "factors.plant", "'model', 'ecm', or the path"),
        (EIGHT + "seed = {low = 0, high = 3, count = 2}", "factors.seed", "must be a whole number"),
        (EIGHT + "window_width = 0.2\nwindow_low = 0.4", "factors.window_low", "keep one of the two"),
        (EIGHT + "capacity_factor = 2\ncapacity_Ah = [5]", "factors.capacity_Ah", "keep one of the two"),
        (EIGHT + "grid.soc_stp = 0.01", "factors.grid.soc_stp", "did you mean 'soc_step'"),
        (EIGHT + "[[together]]\nmu = [1.0]\nbeta = [0]", "together[0].mu", "given in factors.mu already"),
        (EIGHT + "[[together]]\nbeta = [1, 2]\ngamma = [1]", "together[0]", "same length"),
        (EIGHT + "[[together]]\nbeta = 2", "together[0].beta", "must be a list"),
        (EIGHT + "[design]\nkind = 'halton'", "design.samples", "is missing"),
        (EIGHT + "[design]\nsamples = 3", "design.samples", "leave it out"),
        (EIGHT + "[design]\nkind = 'halton'\nsamples = 4", "factors", "draws from ranges"),
        (
            EIGHT + "beta = {low = 0, high = 1}\n[design]\nkind = 'sobol'\nsamples = 6",
            "design.samples",
            "take 4 or 8",
        ),
        (EIGHT + "[design]\nkind = 'random'", "design.kind", "factorial, sobol, halton, latin-hypercube"),
        (EIGHT + "[closed_loop]\ntraining = 'traffic:commute'", "closed_loop.training", "give one cycle"),
        (EIGHT + "[closed_loop.sensors]\ncurrent_sd = 1", "closed_loop.sensors.current_sd", "current_sd_A"),
    ],
)
def test_what_is_wrong_is_named_with_its_path(tmp_path, factors, path, words):
    lines = [line for line in problems(tmp_path, factors) if re.match(rf"{re.escape(path)}( = |: )", line)]
    assert len(lines) == 1
    assert words in lines[0]


def test_the_rest_of_the_file_is_checked_where_a_table_is_no_table(tmp_path):
    found = problems(tmp_path, "factors = 3\ntogether = 4\ndesign = 5", head='name = "a"\nseed = -1\n')
    assert {line.split(" = ")[0] for line in found} == {"seed", "factors", "together", "design"}


def test_a_file_that_is_no_toml_says_where(tmp_path):
    path = tmp_path / "s.toml"
    path.write_text("name = \n")
    with pytest.raises(StudyError, match=r"not valid TOML.*line 1"):
        load_study(path)
    path.write_bytes(b'name = "\xff"')
    with pytest.raises(StudyError, match="UTF-8"):
        load_study(path)
    with pytest.raises(StudyError, match="cannot read the study"):
        load_study(tmp_path / "absent.toml")


def test_the_schema_for_editors_is_the_one_of_the_models():
    """To renew: socwise run --schema > socwise/study/study.schema.json."""
    kept = json.loads((ROOT / "socwise/study/study.schema.json").read_text(encoding="utf-8"))
    assert kept == json_schema()


def test_editors_find_with_the_schema_what_reading_finds(tmp_path):
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft202012Validator(json_schema())
    good = tomllib.loads(HEAD + EIGHT + "beta = {low = 0, high = 1, count = 3}")
    assert list(validator.iter_errors(good)) == []
    for bad in ("mas_kg = 3", "mass_kg = -3", "mass_kg = []", "mass_kg = {low = 1, hi = 2}"):
        assert list(validator.iter_errors(tomllib.loads(HEAD + EIGHT + bad)))


def test_a_factorial_design_takes_every_combination_the_last_fastest(tmp_path):
    study = load_study(write_study(tmp_path, EIGHT + "set = {'terminal.slope_below_kg' = [1, 2]}")).study
    found = points(study)
    assert len(found) == 16
    assert len({tuple(point.items()) for point in found}) == 16
    assert list(found[0]) == ["concept", "cycle", "mu", "penalty_steepness", "terminal.slope_below_kg"]
    assert [point["terminal.slope_below_kg"] for point in found[:4]] == [1.0, 2.0, 1.0, 2.0]
    assert [point["concept"] for point in found] == ["hev"] * 8 + ["phev"] * 8


def test_a_range_is_even_in_the_value_or_in_its_logarithm():
    assert Range[float](low=0.0, high=1.0, count=5).spaced() == [0.0, 0.25, 0.5, 0.75, 1.0]
    log = Range[float](low=1e-3, high=1e1, count=5, scale="log").spaced()
    np.testing.assert_allclose(log, [1e-3, 1e-2, 1e-1, 1.0, 10.0], rtol=1e-11)
    assert (log[0], log[-1]) == (1e-3, 1e1)


def test_what_varies_together_is_taken_item_by_item(tmp_path):
    factors = """
[factors]
cycle = "hill.csv"
mu = [1e-3, 2e-3]
[[together]]
concept = ["hev", "hev", "phev"]
window_width = [0.1, 0.2, 0.5]
"""
    found = points(load_study(write_study(tmp_path, factors)).study)
    assert [(point["concept"], point["window_width"], point["mu"]) for point in found] == [
        ("hev", 0.1, 1e-3),
        ("hev", 0.1, 2e-3),
        ("hev", 0.2, 1e-3),
        ("hev", 0.2, 2e-3),
        ("phev", 0.5, 1e-3),
        ("phev", 0.5, 2e-3),
    ]


@pytest.mark.parametrize("kind", ["sobol", "halton", "latin-hypercube"])
def test_a_sampled_design_fills_the_ranges_and_crosses_the_lists(tmp_path, kind):
    factors = f"""
[design]
kind = "{kind}"
samples = 16
seed = 3
[factors]
concept = ["hev", "phev"]
cycle = "hill.csv"
mu = {{low = 1e-4, high = 1e-2, scale = "log"}}
mass_kg = {{low = 1000, high = 2000}}
"""
    study = load_study(write_study(tmp_path, factors)).study
    found = points(study)
    assert found == points(study)
    assert len(found) == 32
    mu = np.array([point["mu"] for point in found[:16]])
    mass = np.array([point["mass_kg"] for point in found[:16]])
    assert mu.min() >= 1e-4
    assert mu.max() <= 1e-2
    # low discrepancy: each half of each range has about half of the points, and a half in the logarithm
    assert abs(int((mu < 1e-3).sum()) - 8) <= 1
    assert abs(int((mass < 1500.0).sum()) - 8) <= 1
    assert [(p["mu"], p["mass_kg"]) for p in found[16:]] == [(p["mu"], p["mass_kg"]) for p in found[:16]]


def test_a_narrower_window_takes_start_target_and_rules_along():
    hev, phev = load_concept("hev"), load_concept("phev")
    car = car_of(hev, {"window_width": 0.1})
    assert (car.window.low, car.window.high) == (0.6, 0.7)
    assert (car.initial_soc, car.terminal.target_soc) == (hev.initial_soc, hev.terminal.target_soc)
    car = car_of(phev, {"window_scale": 0.5})
    width = car.window.high - car.window.low
    assert width == pytest.approx(0.325)
    assert car.terminal.target_soc == pytest.approx(car.window.low)
    assert (car.initial_soc - car.window.low) / width == pytest.approx(0.6 / 0.65)
    assert car.rule_based.sustain_soc - car.terminal.target_soc == pytest.approx(0.04)
    kept = car_of(phev, {"window_low": 0.3, "initial_soc": 0.7, "target_soc": 0.4})
    assert (kept.window.low, kept.window.high) == (0.3, phev.window.high)
    assert (kept.initial_soc, kept.terminal.target_soc) == (0.7, 0.4)
    assert car_of(phev, {"window_scale": 1.0}) == car_of(phev, {})


def test_steepness_scales_the_penalty_outside_the_window_and_nothing_inside():
    hev = load_concept("hev")
    soc = np.linspace(0.3, 0.95, 27)
    before, after = (
        car_of(hev, point).window.penalty_kgps()(soc) for point in ({}, {"penalty_steepness": 3.0})
    )
    np.testing.assert_allclose(after, 3.0 * before, rtol=1e-12)
    assert before.max() > 0.0
    slope = car_of(hev, {"penalty_slope": 3.0}).window
    assert isinstance(slope, Window)
    assert slope.jump_below_kgps == hev.window.jump_below_kgps
    assert slope.slope_above_kgps == pytest.approx(3.0 * hev.window.slope_above_kgps)
    ended = car_of(hev, {"terminal_penalty": 2.0}).terminal.penalty_kg()(soc)
    np.testing.assert_allclose(ended, 2.0 * hev.terminal.penalty_kg()(soc), rtol=1e-12)


def test_parallel_strings_carry_in_proportion():
    """At twice the strings, twice the power gives twice the current: each string lives as before."""
    phev = load_concept("phev")
    car = car_of(phev, {"capacity_factor": 2.0})
    one, two = phev.load_pack(), car.load_pack()
    assert two.capacity_Ah == pytest.approx(2.0 * one.capacity_Ah)
    assert two.energy_J == pytest.approx(2.0 * one.energy_J)
    power_W, soc = np.linspace(-6e4, 6e4, 13), np.full(13, 0.5)
    np.testing.assert_allclose(
        two.current_A(2.0 * power_W, soc), 2.0 * one.current_A(power_W, soc), rtol=1e-12
    )
    np.testing.assert_allclose(two.power_limits_W(0.4), 2.0 * np.array(one.power_limits_W(0.4)), rtol=1e-12)
    same = car_of(phev, {"capacity_Ah": 2.0 * one.capacity_Ah})
    assert same.capacity_factor == pytest.approx(2.0)


def test_other_numbers_of_a_concept_are_set_by_their_path():
    assert "terminal.slope_below_kg" in settable()
    assert not {"window.low", "uncertainty.mu", "initial_soc"} & set(settable())
    car = car_of(
        load_concept("hev"), {"terminal.slope_below_kg": 7.0, "start_fuel_kg": 1e-3, "mass_kg": 999.0}
    )
    assert isinstance(car, StudyConcept)
    assert (car.terminal.slope_below_kg, car.start_fuel_kg) == (7.0, 1e-3)
    assert car.load_vehicle().chassis.mass_kg == 999.0


@pytest.mark.parametrize(
    ("factors", "words"),
    [
        (EIGHT + "window_width = [0.2, 0.9]", "window_width = 0.9"),
        (EIGHT + "initial_soc = 0.2", "outside the window"),
        (EIGHT + "grid.soc_step = 0.3", "grid.soc_step = 0.3"),
        (EIGHT + "plant = ['model', 'ecm']\nestimator = ['model', 'ekf']", "do not go together"),
        (EIGHT + "estimator = 'ekf'\ngamma = 1e-6", "a closed loop identifies it"),
        (EIGHT + "estimator = 'ekf'\n[closed_loop.options.ekf]\nno_such = 1", "no_such"),
        (EIGHT.replace("hill.csv", "traffic:commute"), "give an even number"),
    ],
)
def test_values_that_make_no_sense_together_are_reported_with_their_case(tmp_path, factors, words):
    head = HEAD.replace("realizations = 4", "realizations = 5")
    with pytest.raises(StudyError) as caught:
        plan(tmp_path, factors, head)
    assert words in str(caught.value)
    assert "concept = " in caught.value.problems[0]


def test_the_key_of_a_case_knows_what_decides_it_and_nothing_else(tmp_path):
    base = plan(tmp_path / "a", EIGHT)
    keys = [case.key for case in base.cases]
    assert len(set(keys)) == 8
    elsewhere = plan(tmp_path / "b", EIGHT, HEAD.replace('"tiny"', '"other"\ndescription = "moved"'))
    assert [case.key for case in elsewhere.cases] == keys
    longer = plan(tmp_path / "a", EIGHT.replace("4e-3]", "4e-3, 8e-3]"))
    assert set(keys) < {case.key for case in longer.cases}
    for before, after in (
        ("realizations = 4", "realizations = 6"),
        ('"certainty_equivalent"', '"rule_based"'),
        ("torque_levels = 3", "torque_levels = 4"),
        ('name = "tiny"', 'name = "tiny"\nseed = 1'),
        ('name = "tiny"', 'name = "tiny"\non_infeasible = "limit"'),
    ):
        assert before in HEAD
        changed = plan(tmp_path / "a", EIGHT, HEAD.replace(before, after))
        assert not {case.key for case in changed.cases} & set(keys)
    trip = tmp_path / "a/hill.csv"
    trip.write_text(trip.read_text(encoding="utf-8").replace("\n", " \n"), encoding="utf-8")
    assert [case.key for case in plan(tmp_path / "a", EIGHT).cases] == keys
    lines = trip.read_text(encoding="utf-8").splitlines()
    lines[5] = lines[5].replace(",0.", ",1.")
    trip.write_text("\n".join(lines), encoding="utf-8")
    assert not {case.key for case in plan(tmp_path / "a", EIGHT).cases} & set(keys)

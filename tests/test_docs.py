"""Every block of code in the documentation runs, or says why it does not; see `doc_pages` for the marks."""

import re
import runpy
import sys

import doc_pages
import pytest
from doc_makers import MAKERS
from doc_pages import DOCS, Page, blocks, not_run, page_names, source
from fmu_files import needs_compiler

import vehicle
from bms import load_pack
from bms.cells import load_cell
from bms.degradation import load_degradation_map
from bms.estimators.catalogue import estimator_names
from bms.flags import Flag
from drivecycles import load_cycle

SLOW = {
    "bring/car",
    "bring/cell",
    "bring/cycle",
    "bring/estimator",
    "bring/fmu",
    "bring/policy",
    "cli",
    "closed-loop",
    "export",
    "gallery",
    "inertia",
    "start",
    "studies",
    "traffic",
}
COMPILED = {"bring/fmu", "export"}
EXAMPLES = {"bms_on_a_log": False, "certainty_equivalence": True, "traffic_to_policy": True}
"""Example scripts, and whether they are slow."""

NOT_RUN = {
    "atlas": ["socwise run docs/studies/atlas.toml"],
    "benchmarks": ["make bench", "ns per unit", "CPU, ns per unit", "CPU, ns per unit", "wall, ns per unit"],
    "cli": [
        "socwise COMMAND --help",
        "socwise compare --plant PLANT.fmu",
        '{"schema": 1, "seed": 0,',
        "socwise run STUDY.toml",
        '{"schema": 1,',
        "socwise cosim inspect PLANT.fmu",
        "socwise export ems policy.nc",
        "socwise traffic run SCENARIO",
        "socwise reproduce larsson-table2",
        "socwise reproduce larsson-fig5",
        "socwise reproduce all",
        '{"id", "source", "rows"',
        "socwise doctor --warm",
    ],
    "fmu": [
        "pip install pythonfmu",
        "socwise cosim inspect Zelle",
        "# A first mapping of Zelle",
        "socwise cosim probe Zelle",
        "[temperature]",
        "socwise cosim probe Zelle",
        "[drive]        CONTRADICTS",
        "socwise cosim Zelle",
        "socwise compare --concept phev --plant Zelle",
    ],
    "design": ["gpc ", "DriveCycle -> Vehicle.demand"],
    "gallery": ["socwise reproduce all"],
    "inertia": ["time_s,force_fl_kN", "socwise compare --mass results"],
    "start": ["make demo", "socwise reproduce larsson-table2"],
    "studies": ["[[together]]", "[design]", 'name = "wrong"', "dask scheduler"],
}
"""What the pages show and the tests do not run, each with its reason on the page."""

WITH_CODE = [page for page in page_names() if blocks(page)]


def marked(name):
    marks = [pytest.mark.slow] if name in SLOW else []
    return pytest.param(name, marks=[*marks, needs_compiler] if name in COMPILED else marks)


@pytest.fixture
def empty_folder(tmp_path, monkeypatch):
    """A folder of its own to run in, whose modules are forgotten afterwards."""
    if "joblib.externals.loky" in sys.modules:
        # Processes of an earlier test look for modules in that test's folder.
        sys.modules["joblib.externals.loky"].get_reusable_executor().shutdown(wait=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("COLUMNS", doc_pages.COLUMNS)
    known = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - known:
        if getattr(sys.modules[name], "__file__", None) == str(tmp_path / f"{name}.py"):
            del sys.modules[name]


@pytest.mark.filterwarnings("ignore:resource_tracker")
@pytest.mark.parametrize("name", [marked(page) for page in WITH_CODE])
def test_a_page_runs_and_prints_what_it_shows(name, empty_folder):
    Page(name, MAKERS).run()


@pytest.mark.parametrize("name", WITH_CODE)
def test_every_block_is_of_use(name):
    """A file is read by something, Python and commands run, and text is their output."""
    found = blocks(name)
    for block in found:
        if block.mark("not run"):
            continue
        if block.is_file:
            others = [other.text for other in found if other is not block]
            used = block.caption.removesuffix(".py")
            assert block.mark("load") or any(used in text for text in others), block.place
            assert block.mark("load") or block.language != "toml", f"{block.place}: what loads it?"
        else:
            assert block.language in ("python", "console") or "output" in block.marks, block.place
            assert block.language != "python" or not block.caption, block.place


def test_what_is_not_run_is_known():
    pairs = {page: [pair for block in blocks(page) for pair in not_run(block)] for page in WITH_CODE}
    pairs = {page: found for page, found in pairs.items() if found}
    assert pairs.keys() == NOT_RUN.keys()
    for page, found in pairs.items():
        for (first, reason), known in zip(found, NOT_RUN[page], strict=True):
            assert first.startswith(known), page
            assert len(reason) > 5, f"{page}: {first}"


def test_the_comparison_of_outputs_tells_differences():
    block = doc_pages.Block("page", 1, "text", "", "", {"output": ["within 5 %"]})
    doc_pages.compare("a  1.02 ± 0.3 kg\n", "a 1.00 ± 0.3 kg\n", block)
    doc_pages.compare("a 1 b 2 c 3 d 4", "a 1\n...\nc 3 d 4", block)
    doc_pages.compare("a 1 b 2", "a 1\n...\n", block)
    exact = doc_pages.Block("page", 1, "text", "", "", {"output": [""]})
    for printed, shown, one in (
        ("a 1.20 kg", "a 1.00 kg", block),
        ("a 1.02 g", "a 1.00 kg", block),
        ("a 1.02", "a 1.00 b", block),
        ("a 1 b", "a 1", block),
        ("a 1 b 2 c 4", "a 1\n...\nc 5.00", block),
        ("a 1.01", "a 1.02", exact),
    ):
        with pytest.raises(AssertionError):
            doc_pages.compare(printed, shown, one)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if slow else []) for name, slow in EXAMPLES.items()]
)
def test_an_example_ends_in_a_number_that_holds(name, empty_folder, capsys):
    path = DOCS / "examples" / f"{name}.py"
    text = path.read_text(encoding="utf-8")
    assert text.startswith("# %% [markdown]\n")
    assert re.search(r"^assert .*\d", text.split("# %%")[-1], re.MULTILINE)
    runpy.run_path(str(path), run_name="__main__")
    assert re.search(r"\d", capsys.readouterr().out)


def test_every_example_is_listed():
    assert {path.stem for path in (DOCS / "examples").glob("*.py")} == set(EXAMPLES)
    page = source("examples")
    for name in EXAMPLES:
        assert f"examples/{name}" in page


def test_the_files_hold_what_they_say(empty_folder):
    Page("bring/cycle").write_files()
    Page("bring/car").write_files()
    cycle = load_cycle("commute.csv")
    assert cycle.duration_s == 5.0
    assert cycle.speed_mps[3] == pytest.approx(12.2 / 3.6)
    assert cycle.altitude_m[-1] == 12.3
    assert load_pack("my-pack.toml").charge_resistance_ohm == (0.15,) * 6
    assert load_pack("tabled-pack.toml").slope_floor == 0.05
    car = vehicle.load_vehicle("my-car.toml")
    assert car.engine.max_power_W == pytest.approx(95.0 * 628.3, rel=1e-3)
    assert car.shortfall(car.demand(load_cycle("ftp72"))) == ()


def test_the_cells_hold_what_they_say(empty_folder):
    Page("cells").write_files()
    mine = load_cell("my-cell.toml")
    assert len(mine.relaxation) == 2
    assert mine.relaxation[1].capacitance_F == 20000.0
    tabled = load_cell("tabled-cell.toml")
    assert tabled.temperature_C == (10.0, 40.0)
    assert tabled.relaxation[0].time_constant_s[1] == (32.0, 36.0, 40.0, 40.0)
    assert tabled.hysteresis.voltage_V == (0.022, 0.022, 0.014, 0.014)
    fade_per_s, growth_per_s = load_degradation_map("my-map.csv").rates_per_s(-4.0, 0.5, 25.0)
    assert (fade_per_s, growth_per_s) == pytest.approx((2.2e-9, 1.1e-9))


def test_every_estimator_and_flag_has_its_row():
    page = source("estimators")
    for name in estimator_names():
        assert len(re.findall(rf"^\| `{name}` \|", page, re.MULTILINE)) == 4
    for flag in Flag:
        assert re.search(rf"^\|.*`{flag.name}`.*\|", page, re.MULTILINE)

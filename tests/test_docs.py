"""The files and the code of the documentation are what the packages accept."""

import re
from pathlib import Path

import pytest

import vehicle
from bms import load_pack
from bms.cells import load_cell
from bms.degradation import load_degradation_map
from bms.estimators.catalogue import estimator_names
from bms.flags import Flag
from drivecycles import load_cycle

DOCS = Path(__file__).parents[1] / "docs"
BLOCK = re.compile(r"^```\{code-block\} (\w+)\n(?::caption: (\S+)\n)?(.*?)^```$", re.MULTILINE | re.DOTALL)
PAGES = {
    name: BLOCK.findall((DOCS / f"{name}.md").read_text("utf-8"))
    for name in ("bring-your-own", "cells", "estimators")
}
CODE = {
    f"{page}-{number}": (page, text)
    for page, blocks in PAGES.items()
    for number, text in enumerate((text for language, _, text in blocks if language == "python"), 1)
}


def write_files(page, folder):
    """Write every captioned block of a page under its name."""
    for _, caption, text in PAGES[page]:
        if caption:
            (folder / caption).write_text(text, encoding="utf-8")


@pytest.mark.parametrize("example", CODE)
def test_the_code_runs_and_prints(example, tmp_path, monkeypatch, capsys):
    page, code = CODE[example]
    write_files(page, tmp_path)
    monkeypatch.chdir(tmp_path)
    exec(compile(code, example, "exec"), {})
    assert re.search(r"\d", capsys.readouterr().out)


def test_the_files_hold_what_they_say(tmp_path, monkeypatch):
    write_files("bring-your-own", tmp_path)
    monkeypatch.chdir(tmp_path)
    cycle = load_cycle("commute.csv")
    assert cycle.duration_s == 5.0
    assert cycle.speed_mps[3] == pytest.approx(12.2 / 3.6)
    assert cycle.altitude_m[-1] == 12.3
    assert load_pack("my-pack.toml").charge_resistance_ohm == (0.15,) * 6
    assert load_pack("tabled-pack.toml").slope_floor == 0.05
    car = vehicle.load_vehicle("my-car.toml")
    assert car.engine.max_power_W == pytest.approx(95.0 * 628.3, rel=1e-3)
    assert car.shortfall(car.demand(load_cycle("ftp72"))) == ()


def test_the_cells_hold_what_they_say(tmp_path):
    write_files("cells", tmp_path)
    mine = load_cell(tmp_path / "my-cell.toml")
    assert len(mine.relaxation) == 2
    assert mine.relaxation[1].capacitance_F == 20000.0
    tabled = load_cell(tmp_path / "tabled-cell.toml")
    assert tabled.temperature_C == (10.0, 40.0)
    assert tabled.relaxation[0].time_constant_s[1] == (32.0, 36.0, 40.0, 40.0)
    assert tabled.hysteresis.voltage_V == (0.022, 0.022, 0.014, 0.014)
    fade_per_s, growth_per_s = load_degradation_map(tmp_path / "my-map.csv").rates_per_s(-4.0, 0.5, 25.0)
    assert (fade_per_s, growth_per_s) == pytest.approx((2.2e-9, 1.1e-9))


def test_every_estimator_and_flag_has_its_row():
    page = (DOCS / "estimators.md").read_text(encoding="utf-8")
    for name in estimator_names():
        assert len(re.findall(rf"^\| `{name}` \|", page, re.MULTILINE)) == 4
    for flag in Flag:
        assert re.search(rf"^\|.*`{flag.name}`.*\|", page, re.MULTILINE)

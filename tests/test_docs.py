"""The files and the code of docs/bring-your-own.md are what the packages accept."""

import re
from pathlib import Path

import pytest

import vehicle
from bms import load_pack
from drivecycles import load_cycle

PAGE = Path(__file__).parents[1] / "docs" / "bring-your-own.md"
BLOCK = re.compile(r"^```\{code-block\} (\w+)\n(?::caption: (\S+)\n)?(.*?)^```$", re.MULTILINE | re.DOTALL)
BLOCKS = BLOCK.findall(PAGE.read_text(encoding="utf-8"))
CODE = [text for language, _, text in BLOCKS if language == "python"]


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Write every captioned block under its name."""
    for _, caption, text in BLOCKS:
        if caption:
            (tmp_path / caption).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("code", CODE, ids=["cycle", "battery", "car", "concept"])
def test_the_code_runs_and_prints(files, capsys, code):
    exec(compile(code, PAGE.name, "exec"), {})
    assert re.search(r"\d", capsys.readouterr().out)


def test_the_files_hold_what_they_say(files):
    cycle = load_cycle("commute.csv")
    assert cycle.duration_s == 5.0
    assert cycle.speed_mps[3] == pytest.approx(12.2 / 3.6)
    assert cycle.altitude_m[-1] == 12.3
    assert load_pack("my-pack.toml").charge_resistance_ohm == (0.15,) * 6
    assert load_pack("tabled-pack.toml").slope_floor == 0.05
    car = vehicle.load_vehicle("my-car.toml")
    assert car.engine.max_power_W == pytest.approx(95.0 * 628.3, rel=1e-3)
    assert car.shortfall(car.demand(load_cycle("ftp72"))) == ()

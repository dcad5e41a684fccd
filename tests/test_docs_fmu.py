"""The files on the page about FMUs are what the packages accept, and its table of keys is complete."""

import math
import re
from pathlib import Path

import pytest

from bms.cells import load_cell
from bms.plants.fmu.limits import Limits
from bms.plants.fmu.mapping import Drive, Mapping, PackFigures, Scale, load_mapping

PAGE = (Path(__file__).parents[1] / "docs" / "fmu.md").read_text(encoding="utf-8")
BLOCKS = dict(re.findall(r"^```\{code-block\} \w+\n:caption: ([^\n]+)\n(.*?)^```$", PAGE, re.M | re.S))


def test_the_cell_is_one(tmp_path):
    (tmp_path / "cell.toml").write_text(BLOCKS["cell.toml"], encoding="utf-8")
    pack = load_cell(tmp_path / "cell.toml").scaled(84, 6)
    assert pack.capacity_Ah == pytest.approx(25.2)
    assert pack.resistance_ohm == pytest.approx(0.21)


def test_the_first_half_of_the_mapping_is_one(tmp_path):
    text = next(text for caption, text in BLOCKS.items() if caption.startswith("zelle.toml"))
    (tmp_path / "m.toml").write_text(text, encoding="utf-8")
    mapping = load_mapping(tmp_path / "m.toml")
    assert (mapping.drive.variable, mapping.drive.positive) == ("I", "discharge")
    assert mapping.soc.unit == "%"


def test_the_script_is_the_fmus():
    """Its parameters are those that the page says the estimator finds."""
    values = re.search(r"= 50\.0, ([\d., ]+)$", BLOCKS["Zelle21700.py"], re.M).group(1)
    capacity, series, relaxation, _ = (float(value) for value in values.split(","))
    assert (6 * capacity, 84 / 6 * series, 84 / 6 * relaxation) == pytest.approx((24.6, 0.196, 0.112))


def test_every_key_has_its_row():
    for name, field in Mapping.model_fields.items():
        is_table = name not in ("kind", "step_s", "tolerance")
        assert (f"**`[{name}]`**" if is_table else f"| `{name}` |") in PAGE, field
    for model in (Drive, PackFigures):
        for name in model.model_fields:
            assert f"| `{name}` |" in PAGE
    for name in Scale.model_fields:
        assert f"`{name}`" in PAGE


def test_the_limits_are_those_of_the_code():
    code = re.search(r"^Limits\((.*?)\)$", PAGE, re.M).group(1)
    given = dict(item.split("=") for item in code.replace(" ", "").split(","))
    usual = Limits()
    for name, text in given.items():
        factors = [
            float(base) ** float(power or 1) for base, power in re.findall(r"(\d[\d.]*)(?:\*\*(\d+))?", text)
        ]
        assert getattr(usual, name) == pytest.approx(math.prod(factors))

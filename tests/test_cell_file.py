"""A cell that is written and read again is the same cell."""

import pytest

from bms import BatteryError
from bms.cell_file import write_cell
from bms.cells import cell_names, load_cell


@pytest.mark.parametrize("name", cell_names())
def test_presets_come_back(name, tmp_path):
    cell = load_cell(name)
    write_cell(cell, tmp_path / "cell.toml")
    assert load_cell(tmp_path / "cell.toml") == cell
    assert [path.name for path in tmp_path.iterdir()] == ["cell.toml"]


def test_tables_over_temperature_and_odd_words_come_back(tmp_path):
    cell = load_cell("lfp-2ah").with_values(
        name='a "cell" \\ with \x7f',
        source="Prüfstand\n25 °C \N{BATTERY}",
        temperature_C=(0.0, 40.0),
        soc=(0.0, 0.1 + 0.2, 1.0),
        ocv_V=(2.5, 3.3, 3.6),
        resistance_ohm=((0.02, 0.01, 0.01), (0.01, 0.005, 1e-5 / 3)),
        relaxation=(),
    )
    write_cell(cell, tmp_path / "cell.toml")
    assert load_cell(tmp_path / "cell.toml") == cell


def test_places_where_no_cell_belongs(tmp_path):
    cell = load_cell("lfp-2ah")
    with pytest.raises(BatteryError, match="has to end in"):
        write_cell(cell, tmp_path / "cell.txt")
    with pytest.raises(BatteryError, match=r"cannot write the cell file .*: No such file"):
        write_cell(cell, tmp_path / "absent" / "cell.toml")
    assert list(tmp_path.iterdir()) == []

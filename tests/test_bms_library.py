"""Packs by name and from files, and what is said about bad ones."""

import pytest

from bms import BatteryError, load_pack, pack_names

GOOD = """
name = "mine"
source = "bench"
capacity_Ah = 20.0
soc = [0.0, 0.5, 1.0]
ocv_V = [300, 320, 350]
resistance_ohm = 0.2
discharge_limit_A = 150.0
charge_limit_A = 80.0
"""

TABLED = """
name = "mine"
source = "bench"
capacity_Ah = 20.0
tables = "tables/ocv.csv"
discharge_limit_A = 150.0
charge_limit_A = 80.0
"""

TABLE = """# measured at 25 degrees C
soc, ocv_V, resistance_ohm, charge_resistance_ohm
0.0, 300, 0.30, 0.40
0.5, 320, 0.20, 0.25

1.0, 350, 0.18, 0.20
"""


@pytest.fixture
def tabled(tmp_path):
    """Write a pack whose tables stand in a CSV; the CSV's text is to be replaced by tests."""
    (tmp_path / "tables").mkdir()
    csv = tmp_path / "tables" / "ocv.csv"
    csv.write_text(TABLE)
    path = tmp_path / "mine.toml"
    path.write_text(TABLED)
    return path, csv


def write(tmp_path, text):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    return path


def complaint(path):
    with pytest.raises(BatteryError) as caught:
        load_pack(path)
    return str(caught.value)


def test_names_are_known_in_either_case():
    assert pack_names() == ["hev", "phev"]
    assert load_pack("PHEV") == load_pack("phev")


def test_an_unknown_name_gets_a_suggestion():
    assert "no battery pack is called 'phve', did you mean 'phev'?" in complaint("phve")
    message = complaint("submarine")
    assert "did you mean" not in message
    assert "known are hev, phev" in message
    assert ".toml" in message


def test_one_resistance_serves_all_nodes(tmp_path):
    battery = load_pack(write(tmp_path, GOOD))
    assert battery.resistance_ohm == (0.2, 0.2, 0.2)
    assert battery.charge_resistance_ohm is None
    assert battery.ocv(0.5) == 320.0
    both = load_pack(write(tmp_path, GOOD + "charge_resistance_ohm = 1"))
    assert both.charge_resistance_ohm == (1.0, 1.0, 1.0)


def test_tables_come_from_a_csv_beside_the_file(tabled):
    path, csv = tabled
    battery = load_pack(path)
    assert battery.soc == (0.0, 0.5, 1.0)
    assert battery.ocv_V == (300.0, 320.0, 350.0)
    assert battery.resistance_ohm == (0.30, 0.20, 0.18)
    assert battery.charge_resistance_ohm == (0.40, 0.25, 0.20)
    csv.write_text("ocv_V,resistance_ohm,soc\n300,0.3,0\n310,0.3,0.5\n350,0.3,1\n", encoding="utf-8-sig")
    again = load_pack(str(path))
    assert again.charge_resistance_ohm is None
    assert again.ocv_V == (300.0, 310.0, 350.0)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("capacity_Ah = 20.0\n", "", ["key capacity_Ah is missing", "nominal capacity, Ah"]),
        (
            "capacity_Ah = 20.0",
            "capacity_ah = 20.0",
            ["unknown key capacity_ah, did you mean 'capacity_Ah'?"],
        ),
        ("20.0", "-20.0", ["capacity_Ah = -20.0", "greater than 0"]),
        ("20.0", "inf", ["capacity_Ah = inf", "finite"]),
        ("20.0", '"much"', ["capacity_Ah = 'much'", "valid number"]),
        ("320", "299", ["must not fall with SOC", "drops from 300 V at 0 to 299 V at 0.5"]),
        ("320", "nan", ["ocv_V.1 = nan", "finite"]),
        ("[300, 320, 350]", "[300, 350]", ["ocv_V has 2 values for 3 nodes of soc"]),
        ("0.5, 1.0]", "50.0, 100.0]", ["increase strictly from 0 to 1", "not per cent"]),
        ("= 0.2", "= 0.0", ["resistance must be positive, got 0 ohm"]),
        ("capacity_Ah = 20.0", "capacity_Ah = = 20.0", ["not valid TOML", "line 4"]),
        (
            "capacity_Ah = 20.0",
            'capacity_Ah = 20.0\ntables = "t.csv"',
            ["gives soc and names the table t.csv"],
        ),
    ],
)
def test_what_is_wrong_with_a_pack_is_said(tmp_path, old, new, said):
    assert GOOD.count(old) == 1 or old == "0.5, 1.0]"
    path = write(tmp_path, GOOD.replace(old, new))
    message = complaint(path)
    assert str(path) in message
    for part in said:
        assert part in message


def test_many_complaints_are_counted_not_listed(tmp_path):
    cells = ", ".join(["nan"] * 30)
    nodes = ", ".join(f"{i / 29:.6f}" for i in range(30))
    text = GOOD.replace("[0.0, 0.5, 1.0]", f"[{nodes}]").replace("[300, 320, 350]", f"[{cells}]")
    lines = complaint(write(tmp_path, text)).splitlines()
    assert len(lines) == 7
    assert lines[-1] == "  and 25 more"


def test_files_that_cannot_be_read(tmp_path):
    assert "cannot read the pack file" in complaint(tmp_path / "none.toml")
    assert "No such file" in complaint(tmp_path / "none.toml")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    assert "not UTF-8" in complaint(binary)
    folder = tmp_path / "folder.toml"
    folder.mkdir()
    assert "cannot read the pack file" in complaint(folder)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, ["cannot read the table", "No such file"]),
        (b"\xff\xfe\x00", ["not UTF-8"]),
        (b"# only a comment\n", ["holds no table", "soc, ocv_V, resistance_ohm"]),
        (
            b"soc,ocv_V\n0,300\n1,350\n",
            ["its columns are soc, ocv_V", "required: soc, ocv_V, resistance_ohm"],
        ),
        (b"soc,ocv_V,resistance_ohm,temp\n0,300,1,2\n", ["temp", "allowed besides: charge_resistance_ohm"]),
        (b"soc,ocv_V,ocv_V,resistance_ohm\n0,300,300,1\n", ["column ocv_V twice"]),
        (b"soc,ocv_V,resistance_ohm\n0,300,0.1\n1,350\n", ["line 3: 2 cells for 3 columns"]),
        (
            b"# t\nsoc,ocv_V,resistance_ohm\n0,300,0.1\n1,full,0.1\n",
            ["line 4: ocv_V is 'full', not a number"],
        ),
        (b"soc,ocv_V,resistance_ohm\n0,300,0.1\n0.5,nan,0.1\n1,350,0.1\n", ["ocv_V.1 = nan", "finite"]),
        (b"soc,ocv_V,resistance_ohm\n0,300,0.1\n0.5,200,0.1\n1,350,0.1\n", ["must not fall with SOC"]),
    ],
)
def test_what_is_wrong_with_a_table_is_said(tabled, content, said):
    path, csv = tabled
    csv.unlink()
    if content is not None:
        csv.write_bytes(content)
    message = complaint(path)
    for part in said:
        assert part in message

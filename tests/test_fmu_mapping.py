"""MAPPING.toml: read, written, and what is said about bad ones."""

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bms.errors import BatteryError
from bms.plants.fmu.mapping import Drive, Mapping, Output, PackFigures, load_mapping, parse_mapping

GOOD = """
schema = 1
kind = "model-exchange"
step_s = 2
tolerance = 1e-8

[drive]
role = "current"
variable = "pin.i"
unit = "mA"
positive = "discharge"

[voltage]
variable = "v"

[current]
variable = "i_out"
positive = "charge"

[temperature]
variable = "T"
unit = "degC"

[soc]
variable = "SOC"
unit = "%"

[initial_soc]
variable = "SOC0"

[scale]
series = 90
parallel = 2.5

[pack]
capacity_Ah = 5
resistance_ohm = 0.1

[parameters]
"cell.R [Ohm]" = 0.01
aged = true

[inputs]
"T amb" = 298.15
"""


def load(tmp_path, text):
    path = tmp_path / "m.toml"
    path.write_text(text, encoding="utf-8")
    return load_mapping(path)


def complaint(tmp_path, text):
    with pytest.raises(BatteryError) as caught:
        load(tmp_path, text)
    message = str(caught.value)
    assert str(tmp_path / "m.toml") in message
    return message


def test_a_full_mapping_is_read(tmp_path):
    found = load(tmp_path, GOOD)
    assert (found.kind, found.step_s, found.tolerance) == ("model-exchange", 2.0, 1e-8)
    assert found.drive == Drive(role="current", variable="pin.i", unit="mA", positive="discharge")
    assert found.soc == Output(variable="SOC", unit="%")
    assert found.current is not None
    assert found.current.positive == "charge"
    assert (found.scale.series, found.scale.parallel) == (90.0, 2.5)
    assert found.pack == PackFigures(capacity_Ah=5.0, resistance_ohm=0.1)
    assert found.parameters == {"cell.R [Ohm]": 0.01, "aged": True}
    assert found.inputs == {"T amb": 298.15}


def test_what_is_left_out_has_its_default():
    found = Mapping(
        drive=Drive(role="power", variable="P", positive="charge"),
        voltage=Output(variable="U"),
        soc=Output(variable="s"),
    )
    assert (found.kind, found.step_s, found.tolerance) == (None, 1.0, 1e-8)
    assert (found.scale.series, found.scale.parallel) == (1.0, 1.0)
    assert (found.pack.capacity_Ah, found.pack.resistance_ohm) == (None, 0.0)


def test_written_and_read_again_is_the_same(tmp_path):
    found = load(tmp_path, GOOD)
    text = found.to_toml()
    assert load(tmp_path, text) == found
    assert text.startswith("schema = 1\n")


names = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=12)


@given(names, names, st.dictionaries(names, st.floats(allow_nan=False, allow_infinity=False) | st.booleans()))
def test_any_name_survives_writing(drive, voltage, parameters):
    """Names of variables may hold anything: quotes, dots, line ends, other scripts."""
    mapping = Mapping(
        drive=Drive(role="current", variable=drive, positive="charge"),
        voltage=Output(variable=voltage),
        pack=PackFigures(capacity_Ah=1.0),
        parameters=parameters,
    )
    assert parse_mapping(tomllib.loads(mapping.to_toml()), "m") == mapping


def test_comments_stand_above_what_they_are_about(tmp_path):
    found = load(tmp_path, GOOD)
    text = found.to_toml(
        {
            "": "a first mapping",
            "drive": "guessed",
            "drive.positive": "not known\ntry the probe",
            "step_s": "from the FMU",
            "other": "left over",
        }
    )
    assert load(tmp_path, text) == found
    lines = text.splitlines()
    assert lines[0] == "# a first mapping"
    assert lines[lines.index("[drive]") - 1] == "# guessed"
    at = next(at for at, line in enumerate(lines) if line.startswith("positive ="))
    assert lines[at - 2 : at] == ["# not known", "# try the probe"]
    assert lines[lines.index("step_s = 2.0") - 1] == "# from the FMU"
    assert lines[-1] == "# left over"


def test_a_table_that_is_not_there_can_have_a_comment(tmp_path):
    text = load(tmp_path, GOOD.replace('[temperature]\nvariable = "T"\nunit = "degC"\n', "")).to_toml(
        {"temperature": "none found"}
    )
    assert "\n# none found\n" in text
    assert load(tmp_path, text).temperature is None


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("schema = 1", "", "put schema = 1 at its top"),
        ("schema = 1", "schema = 2", "schema = 2"),
        ("schema = 1", "schema = true", "schema = True"),
        ("step_s = 2", "step = 2", "did you mean 'step_s'"),
        ("step_s = 2", 'step_s = "2"', "step_s"),
        ("step_s = 2", "step_s = 0", "step_s = 0"),
        ("step_s = 2", "step_s = inf", "step_s"),
        ("[voltage]", "[volts]", "did you mean 'voltage'"),
        ('unit = "mA"', 'units = "mA"', "did you mean 'unit'"),
        ("series = 90", "serial = 90", "did you mean 'series'"),
        ("series = 90", "series = -1", "scale.series"),
        ('positive = "discharge"', "", 'needs positive = "charge" or "discharge"'),
        ('positive = "discharge"', 'positive = "discharging"', "drive.positive"),
        ('"current"', '"amps"', "drive.role"),
        ('"model-exchange"', '"fmi"', "kind"),
        ('variable = "pin.i"', 'variable = ""', "drive.variable"),
        ('variable = "v"', "", "voltage.variable"),
        ("aged = true", 'aged = "yes"', "parameters.aged"),
        ('[voltage]\nvariable = "v"', "", "[voltage] is missing"),
        ('role = "current"', 'role = "voltage"', "a voltage has no sign"),
    ],
)
def test_what_is_wrong_is_said(old, new, says, tmp_path):
    assert old in GOOD
    assert says in complaint(tmp_path, GOOD.replace(old, new, 1))


def test_a_soc_has_to_come_from_somewhere(tmp_path):
    text = GOOD.replace('[soc]\nvariable = "SOC"\nunit = "%"\n', "")
    assert load(tmp_path, text).soc is None
    assert "neither [soc]" in complaint(tmp_path, text.replace("capacity_Ah = 5", ""))


def test_a_voltage_input_needs_a_current_and_a_resistance(tmp_path):
    text = GOOD.replace('role = "current"', 'role = "voltage"').replace('positive = "discharge"\n', "", 1)
    assert load(tmp_path, text).drive.role == "voltage"
    assert "resistance_ohm" in complaint(tmp_path, text.replace("resistance_ohm = 0.1", ""))
    without = text.replace('[current]\nvariable = "i_out"\npositive = "charge"\n', "")
    assert "[current]" in complaint(tmp_path, without)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(BatteryError, match="cannot read"):
        load_mapping(tmp_path / "none.toml")
    assert "not valid TOML" in complaint(tmp_path, "schema = = 1")

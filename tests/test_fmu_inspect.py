"""Guessing what an FMU's variables mean, and the first mapping that comes of it."""

import tomllib

import pytest
from fmu_files import build_fmu, needs_compiler

from bms.plants.fmu.archive import unpack
from bms.plants.fmu.description import Description, Interface, Variable, read_description
from bms.plants.fmu.first_mapping import MISSING, first_mapping
from bms.plants.fmu.guess import guess
from bms.plants.fmu.guess_words import joined, parts, suffix
from bms.plants.fmu.mapping import load_mapping
from bms.plants.fmu.probe import probe
from bms.plants.fmu.session import open_fmu

CAUSALITY = {"i": "input", "o": "output", "p": "parameter", "l": "local"}


def described(text):
    """An FMU with variables ``name|causality|unit|start|description``, separated by semicolons."""
    variables = {}
    for number, item in enumerate(text.split(";")):
        name, causality, unit, start, words = (item.split("|") + [""] * 4)[:5]
        variables[name] = Variable(
            name=name,
            reference=number,
            type="Real",
            causality=CAUSALITY[causality],
            variability="continuous",
            initial="exact" if start else None,
            start=start or None,
            unit=unit or None,
            description=words or None,
            scalar=True,
        )
    kind = "co-simulation"
    interface = Interface(kind, "battery", False, False, False, True, None, False)
    return Description(
        version=2,
        name="battery",
        tool=None,
        description=None,
        token="",
        interfaces={kind: interface},
        platforms=(),
        variables=variables,
        units={},
        states=0,
        indicators=0,
        step_s=None,
        start_s=None,
        log_categories=(),
    )


def names(found):
    return {role: one.best.name for role, one in found.roles.items() if one.best is not None}


HABITS = {
    "modelica": (
        "p.i|i|A;p.v|o|V;SOC|o|1;SOC_init|p|1|0.8;Qnom|p|C|7200;T_amb|i|K|298;rc.v|l|V;OCV|o|V",
        ["p.i", "p.v", None, None, "SOC", "SOC_init", "Qnom"],
    ),
    "german": (
        "Batteriestrom|i;Klemmenspannung|o;Ladezustand|o;Ladezustand_Anfang|p||50;Zelltemperatur|o"
        ";Leerlaufspannung|o;Nennkapazität|p||40",
        [
            *("Batteriestrom", "Klemmenspannung", None, "Zelltemperatur"),
            *("Ladezustand", "Ladezustand_Anfang", "Nennkapazität"),
        ],
    ),
    "french": (
        "courant|i;tension|o;température|o;etatDeCharge|o;etatDeCharge_initial|p||0.5",
        ["courant", "tension", None, "température", "etatDeCharge", "etatDeCharge_initial", None],
    ),
    "unit in the name": (
        "i_batt_A|i;v_batt_mV|o;soc_pct|o;temp_degC|o;soc_init_pct|p||80;i_max_A|p||100",
        ["i_batt_A", "v_batt_mV", None, "temp_degC", "soc_pct", "soc_init_pct", None],
    ),
    "textbook": (
        "I|i;V|o;z|o;T|o;z0|p||0.5;Q|p||2.5",
        ["I", "V", None, "T", "z", "z0", "Q"],
    ),
    "power": (
        "P_set|i|W;U|o|V;I|o|A;SoC|o;SoC_0|p||0.6;P_loss|o|W;x0|p",
        ["P_set", "U", "I", None, "SoC", "SoC_0", None],
    ),
    "voltage in, current out": (
        "u_term|i|V;i_cell|o|A;stateOfCharge|o;ocv|o|V",
        ["u_term", None, "i_cell", None, "stateOfCharge", None, None],
    ),
    "only descriptions": (
        "In1|i||0|battery current, positive when discharging;Out1|o|||terminal voltage"
        ";Out2|o|||state of charge;Out3|o|||open-circuit voltage",
        ["In1", "Out1", None, None, "Out2", None, None],
    ),
    "many of a kind": (
        "I|i|A;Vcell1|o|V;Vcell2|o|V;Vpack|o|V;Vmin|o|V;SOC|o;SOC_min|p||0;SOC_max|p||1;SOC_start|p||0.5"
        ";SOH|o;T_ambient|o|K;T_cell|o|K;capacity_Ah|p||60",
        ["I", "Vpack", None, "T_cell", "SOC", "SOC_start", "capacity_Ah"],
    ),
}
ROLES = ("drive", "voltage", "current", "temperature", "soc", "initial_soc", "capacity")


@pytest.mark.parametrize("habit", HABITS)
def test_names_of_many_habits(habit):
    text, expected = HABITS[habit]
    wanted = {role: name for role, name in zip(ROLES, expected, strict=True) if name is not None}
    assert names(guess(described(text))) == wanted


def test_a_unit_decides_against_a_name():
    found = guess(described("voltage|i|A;current|o|V"))
    assert names(found) == {"drive": "voltage", "voltage": "current"}
    assert found.roles["drive"].quantity == "current"


@pytest.mark.parametrize(
    ("variable", "sign"),
    [
        ("I|i|A||battery current, positive when charging", "charge"),
        ("I|i|A||current (negative: discharge)", "charge"),
        ("I|i|A||load current", "discharge"),
        ("Entladestrom|i|A", "discharge"),
        ("i_charge|i|A", "charge"),
        ("pin_p.i|i|A", "charge"),
        ("P|i|W||discharge power > 0", "discharge"),
        ("I|i|A||sign: discharging is negative", "charge"),
    ],
)
def test_the_sign_from_words(variable, sign):
    one = guess(described(f"{variable};V|o|V")).roles["drive"]
    assert one.positive == sign


def test_what_is_assumed_is_said():
    roles = guess(described("I|i;V|o;SOC|o;SOC_start|p||80;T|o||25")).roles
    assert (roles["drive"].unit, roles["voltage"].unit) == ("A", "V")
    assert (roles["soc"].unit, roles["initial_soc"].unit) == ("%", "%")
    assert roles["temperature"].unit == "degC"
    for role in ("drive", "voltage", "soc", "initial_soc", "temperature"):
        assert any("unit" in doubt for doubt in roles[role].doubts), role
    assert any("sign" in doubt for doubt in roles["drive"].doubts)
    told = guess(described("I|i|A||positive: charge;V|o|V")).roles
    assert told["drive"].doubts == told["voltage"].doubts == ()


def test_a_tie_is_a_doubt():
    one = guess(described("I|i|A;V1|o|V;V2|o|V")).roles["voltage"]
    assert "V2" in one.doubts[0]
    assert [other.name for other in one.alternatives] == ["V2"]


def test_the_true_soc_may_be_its_own_start_value():
    """A state with a start value; its derivative is no SOC."""
    found = guess(described("I|i|A;V|o|V;SOC|o|1|0.5;der_SOC|l"))
    assert names(found)["soc"] == names(found)["initial_soc"] == "SOC"
    assert found.roles["soc"].alternatives == ()


def test_names_are_taken_apart():
    assert parts("Batterie.uKlemme_1") == ["Batterie", "u", "Klemme", "1"]
    assert joined(parts("battery.stateOfCharge[2]")) == ["battery", "soc", "2"]
    assert joined(parts("SoC")) == ["soc"]
    assert suffix("I_mA") == ("current", "mA")
    assert suffix("soc_prozent") == ("soc", "%")
    assert suffix("I") is None


def test_the_first_mapping_can_be_used_and_says_why(tmp_path):
    description = described(
        "I|i|A||positive charges;T_amb|i|K|298;V|o|V;SOC|o|1;SOC_0|p|1|0.5;C_n|p|A.h|40;R0|p||0.01"
    )
    text = first_mapping(description, guess(description), "battery.fmu")
    (tmp_path / "m.toml").write_text(text, encoding="utf-8")
    mapping = load_mapping(tmp_path / "m.toml")
    assert (mapping.drive.role, mapping.drive.variable, mapping.drive.positive) == ("current", "I", "charge")
    assert mapping.voltage.variable == "V"
    assert mapping.soc.variable == "SOC"
    assert mapping.initial_soc.variable == "SOC_0"
    assert mapping.inputs == {"T_amb": 298.0}
    assert mapping.parameters == {}
    assert "# R0 = 0.01" in text
    guessed = [line for line in text.splitlines() if line.startswith(("variable", "positive"))]
    assert all("# guess: " in line for line in guessed)


@pytest.mark.parametrize(
    ("unit", "start", "ampere_hours"), [("A.h", 40, 40), ("C", 7200, 2), ("mAh", 2600, 2.6)]
)
def test_the_capacity_in_ampere_hours(unit, start, ampere_hours):
    description = described(f"I|i|A;V|o|V;capacity|p|{unit}|{start}")
    content = tomllib.loads(first_mapping(description, guess(description)))
    assert content["pack"]["capacity_Ah"] == pytest.approx(ampere_hours)


def test_what_is_needed_and_not_there_has_a_place(tmp_path):
    description = described("In1|i;In2|i;Out1|o")
    text = first_mapping(description, guess(description))
    content = tomllib.loads(text)
    assert content["drive"]["variable"] == content["voltage"]["variable"] == MISSING
    assert '# or "In2"' in text


def test_odd_names_survive(tmp_path):
    odd = 'I "load" \\ [A]'
    description = described(f"{odd}|i|A;V|o|V;a b.c|i|W|3")
    content = tomllib.loads(first_mapping(description, guess(description)))
    assert content["drive"]["variable"] == odd
    assert content["inputs"] == {"a b.c": 3.0}


FOREIGN = {
    "usual": {},
    "foreign": {
        "positive": "discharge",
        "units": {"drive": "mA", "voltage": "mV", "soc": "%", "temperature": "degC", "current": "mA"},
        "names": {
            "drive": "I_last",
            "voltage": "U_Klemme",
            "soc": "Ladezustand",
            "initial_soc": "Ladezustand_0",
        },
    },
    "voltage": {"drive": "voltage", "positive": "discharge"},
    "power": {"drive": "power", "positive": "discharge", "names": {"drive": "Leistung"}},
}


@needs_compiler
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize("dress", FOREIGN)
def test_a_real_fmu_runs_with_its_first_mapping(dress, fmi, tmp_path):
    """From the file to a probe without a contradiction, but for the sign, which only some names tell."""
    path = build_fmu(tmp_path, fmi=fmi, **FOREIGN[dress])
    with unpack(path) as folder:
        description = read_description(folder)
    file = tmp_path / "m.toml"
    text = first_mapping(description, guess(description), path.name)
    file.write_text(text, encoding="utf-8")
    mapping = load_mapping(file)
    if dress == "usual":
        mapping = mapping.model_copy(
            update={
                "drive": mapping.drive.model_copy(update={"positive": "charge"}),
                "current": mapping.current.model_copy(update={"positive": "charge"}),
            }
        )
    with open_fmu(path, mapping, isolate=False) as session:
        assert probe(session).contradictions == ()

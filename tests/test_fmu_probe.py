"""The commissioning probe on real FMUs: what it measures, and what it finds wrong with a mapping."""

import math

import pytest
from fmu_files import build_fmu, fmu_cell, mapping_text, needs_compiler
from fmu_sessions import session

from bms.errors import BatteryError
from bms.plants.fmu.errors import FmuError
from bms.plants.fmu.mapping import load_mapping
from bms.plants.fmu.probe import measured_resistance_ohm, probe
from bms.plants.fmu.probe_drive import Phase, Record, Sample
from bms.plants.fmu.probe_signs import sign_findings
from bms.plants.fmu.probe_units import measured_capacity_Ah, unit_findings
from bms.plants.fmu.probe_write import with_measured

pytestmark = needs_compiler


def report(path, cell=None, **mapping):
    with session(path, isolate=False, **mapping) as fmu:
        return probe(fmu, cell)


def wrong(path, cell=None, **mapping):
    return {one.about: one.text for one in report(path, cell, **mapping).contradictions}


@pytest.mark.parametrize("kind", ["cs", "me"])
@pytest.mark.parametrize("role", ["current", "power", "voltage"])
def test_it_measures_the_circuit(role, kind, tmp_path):
    """Resistance within 15 %: the relaxation of the first step is taken off by a straight line."""
    path = build_fmu(tmp_path, kind=kind, drive=role)
    found = report(path, role=role)
    assert found.contradictions == ()
    assert found.resistance_ohm == pytest.approx(fmu_cell().resistance_ohm, rel=0.15)
    if role == "voltage":
        assert found.capacity_Ah is None
    else:
        assert found.capacity_Ah == pytest.approx(fmu_cell().capacity_Ah, rel=1e-3)
        assert found.voltage_V == pytest.approx(float(fmu_cell().ocv(0.5)), abs=1e-6)


def test_without_relaxation_it_measures_exactly(tmp_path):
    cell = fmu_cell(relaxation=(), hysteresis=None)
    found = report(build_fmu(tmp_path, cell=cell), cell=None)
    assert found.resistance_ohm == pytest.approx(cell.resistance_ohm, rel=2e-3)
    assert found.capacity_Ah == pytest.approx(cell.capacity_Ah, rel=1e-9)


def test_a_pack_is_measured_at_its_own_terminals(tmp_path):
    """90 in series, 4 in parallel: 90 times the voltage, 90 / 4 of the resistance, 4 times the capacity."""
    path = build_fmu(tmp_path)
    one = report(path)
    pack = {"capacity_Ah": 10.0}
    many = report(path, fmu_cell().scaled(90, 4), scale={"series": 90, "parallel": 4}, pack=pack)
    assert many.contradictions == ()
    assert many.voltage_V == pytest.approx(90 * one.voltage_V)
    assert many.resistance_ohm == pytest.approx(22.5 * one.resistance_ohm, rel=1e-6)
    assert many.capacity_Ah == pytest.approx(4 * one.capacity_Ah)


def test_the_load_is_small_for_a_wrong_unit(tmp_path):
    """Amperes taken for milliamperes: the battery sees no more than a tenth of the change that is sought."""
    path = build_fmu(tmp_path, declare="no", positive="charge")
    units = {"voltage": "V", "soc": "1", "temperature": "K", "initial_soc": "1"}
    found = report(path, units=units | {"drive": "mA", "current": "mA"})
    assert "thousandth" in {one.about: one.text for one in found.contradictions}["pack"]
    assert abs(found.record.charge.last.soc - 0.5) < 0.02


@pytest.mark.parametrize(
    ("scale", "text"),
    [({"series": 90}, "90 times"), ({"series": 0.001}, "thousandth"), ({"series": 1000}, "thousand times")],
)
def test_a_voltage_that_is_not_the_cells(scale, text, tmp_path):
    assert text in wrong(build_fmu(tmp_path), fmu_cell(), scale=scale)["voltage"]


def test_a_pack_taken_for_a_cell(tmp_path):
    found = wrong(build_fmu(tmp_path), fmu_cell().scaled(90, 1))
    assert "1/" in found["voltage"]
    assert "series" in found["voltage"]


def test_per_cent_taken_for_a_fraction_and_back(tmp_path):
    per_cent = build_fmu(tmp_path, declare="no", units={"soc": "%"}, file="p.fmu")
    units = {"drive": "A", "voltage": "V", "current": "A", "temperature": "K"}
    right = units | {"soc": "%", "initial_soc": "%"}
    assert wrong(per_cent, units=right) == {}
    assert 'set unit = "%" in [soc]' in wrong(per_cent, units=right | {"soc": "1"})["soc"]
    fraction = build_fmu(tmp_path, declare="no", file="f.fmu")
    found = wrong(fraction, units=units | {"soc": "%", "initial_soc": "1"})
    assert 'set unit = "1" in [soc]' in found["initial_soc"]


def test_a_capacity_that_is_not_the_fmus(tmp_path):
    path = build_fmu(tmp_path)
    assert "0.25 times capacity_Ah" in wrong(path, pack={"capacity_Ah": 10.0})["pack"]
    doubts = [one.text for one in report(path, pack={"capacity_Ah": 2.2}).findings if one.level == "doubt"]
    assert any("nominal" in text for text in doubts)


def test_an_output_that_is_no_terminal_voltage(tmp_path):
    """The temperature without its unit, as a voltage: it does not answer the load as a battery does."""
    path = build_fmu(tmp_path, declare="no")
    units = {"drive": "A", "current": "A", "soc": "1", "temperature": "K", "initial_soc": "1"}
    found = wrong(path, voltage={"variable": "temperature", "unit": "V"}, units=units)
    assert "drive" in found


def test_check_raises_with_every_line(tmp_path):
    with pytest.raises(FmuError, match=r"as the mapping says(?s:.)*\[drive\](?s:.)*\[current\]"):
        report(build_fmu(tmp_path), positive="discharge").check()


def test_isolated_it_finds_the_same(tmp_path):
    path = build_fmu(tmp_path)
    inside = report(path)
    with session(path, isolate=True) as fmu:
        assert probe(fmu).to_json() == inside.to_json()


def test_what_was_measured_goes_into_the_file(tmp_path):
    """The two numbers change, every other line stays, comments as well."""
    path = build_fmu(tmp_path)
    found = report(path)
    text = "# mine\n" + mapping_text(pack={"capacity_Ah": 2.5, "resistance_ohm": 0.5}) + "# end\n"
    changed = with_measured(text, found)
    (tmp_path / "m.toml").write_text(changed, encoding="utf-8")
    pack = load_mapping(tmp_path / "m.toml").pack
    assert pack.resistance_ohm == pytest.approx(found.resistance_ohm, rel=1e-5)
    assert pack.capacity_Ah == 2.5
    kept = [line for line in text.splitlines() if not line.startswith("resistance_ohm")]
    assert [line for line in changed.splitlines() if not line.startswith("resistance_ohm")] == kept
    added = with_measured(mapping_text(pack=None), found)
    (tmp_path / "m.toml").write_text(added, encoding="utf-8")
    assert load_mapping(tmp_path / "m.toml").pack.capacity_Ah == pytest.approx(2.5, rel=1e-5)
    commented = with_measured("[pack]\n# resistance_ohm = \n[scale]\n", found)
    assert commented.splitlines()[2].startswith("resistance_ohm = 0.01")
    assert commented.splitlines()[3] == "[scale]"


def test_nothing_is_written_over_a_contradiction(tmp_path):
    found = report(build_fmu(tmp_path), positive="discharge")
    assert found.resistance_ohm is None
    with pytest.raises(BatteryError, match="nothing was written"):
        with_measured("", found)


def record(voltages, *, currents=None, socs=None, asked=1.0, celsius=25.0):
    """A drive with the given samples after the start; phases of two samples."""
    currents = currents or [0, 0, asked, asked, 0, 0, -asked, -asked]
    socs = socs or [0.5, 0.5, 0.5001, 0.5002, 0.5002, 0.5002, 0.5001, 0.5]
    wanted = [0, 0, asked, asked, 0, 0, -asked, -asked]
    rows = zip(wanted, currents, voltages, socs, strict=True)
    samples = [Sample(w, float(i), float(v), celsius, s) for w, i, v, s in rows]
    before = [Sample(None, 0.0, float(voltages[0]), celsius, socs[0]), *samples]
    phases = [Phase(before[at], tuple(samples[at : at + 2])) for at in range(0, 8, 2)]
    return Record(0.5, before[0], *phases, step_s=1.0, amplitude=asked)


def mapping_of(tmp_path, **top):
    (tmp_path / "m.toml").write_text(mapping_text(**top), encoding="utf-8")
    return load_mapping(tmp_path / "m.toml")


USUAL_V = [3.6, 3.6, 3.7, 3.7, 3.6, 3.6, 3.5, 3.5]


def levels(findings):
    return {one.about: one.level for one in findings}


def test_a_depth_of_discharge_is_no_soc(tmp_path):
    falling = [0.5, 0.5, 0.4999, 0.4998, 0.4998, 0.4998, 0.4999, 0.5]
    found = sign_findings(record(USUAL_V, socs=falling), mapping_of(tmp_path))
    assert levels(found) == {"drive": "ok", "current": "ok", "soc": "contradiction"}
    assert "depth of discharge" in found[-1].text


def test_a_voltage_that_ignores_the_load(tmp_path):
    found = sign_findings(record([3.6] * 8), mapping_of(tmp_path))
    assert levels(found) == {"drive": "contradiction"}
    assert "does not answer" in found[0].text


def test_a_voltage_that_moves_one_way(tmp_path):
    found = sign_findings(record([3.6, 3.6, 3.7, 3.7, 3.7, 3.7, 3.8, 3.8]), mapping_of(tmp_path))
    assert "the same way" in found[0].text


def test_a_voltage_that_answers_late(tmp_path):
    late = record([3.6, 3.6, 3.6, 3.7, 3.7, 3.6, 3.6, 3.5])
    assert levels(sign_findings(late, mapping_of(tmp_path)))["voltage"] == "doubt"


@pytest.mark.parametrize(("celsius", "unit"), [(-248.15, "degC"), (298.15, "K")])
def test_kelvin_and_degrees(celsius, unit, tmp_path):
    found = unit_findings(record(USUAL_V, celsius=celsius), mapping_of(tmp_path), None)
    texts = {one.about: one.text for one in found if one.level == "contradiction"}
    assert f'unit = "{unit}"' in texts["temperature"]


def test_a_current_that_is_not_what_was_asked_for(tmp_path):
    mapping = mapping_of(tmp_path, scale={"parallel": 4})
    quarter = record(USUAL_V, currents=[0, 0, 0.25, 0.25, 0, 0, -0.25, -0.25])
    texts = {one.about: one.text for one in unit_findings(quarter, mapping, None)}
    assert "parallel in [scale]" in texts["current"]
    for role in ("current", "power"):
        named = {one.about: one.text for one in unit_findings(quarter, mapping_of(tmp_path, role=role), None)}
        assert named["current"].endswith("check unit in [drive] and [current]")


LOW = [0.005, 0.005, 0.0051, 0.0052, 0.0052, 0.0052, 0.0051, 0.005]
SLOW = [0.005 + 0.01 * (soc - 0.005) for soc in LOW]
READ, START = 'set unit = "1" in [soc]', 'set unit = "%" in [initial_soc]'


@pytest.mark.parametrize(
    ("socs", "capacity_Ah", "units", "said", "unsaid"),
    [
        (LOW, 2.0 / 2e-4 / 3600.0, {}, START, READ),
        (SLOW, 2.0 / 2e-4 / 3600.0, {}, READ, START),
        (LOW, None, {}, f"{READ} if the FMU's SOC is a fraction, or {START}", "check unit"),
        (SLOW, 40.0, {}, f"or {START} if it takes its start", "check unit"),
        (LOW, None, {"soc": "1"}, START, READ),
        (LOW, None, {"soc": "%", "initial_soc": "%"}, READ, START),
    ],
)
def test_a_start_that_is_a_hundredth_has_two_causes(socs, capacity_Ah, units, said, unsaid, tmp_path):
    """The capacity tells them apart: a SOC in the wrong unit moves a hundredth of what it should."""
    pack = None if capacity_Ah is None else {"capacity_Ah": capacity_Ah}
    mapping = mapping_of(tmp_path, pack=pack, units=units)
    found = {one.about: one.text for one in unit_findings(record(USUAL_V, socs=socs), mapping, None)}
    assert said in found["initial_soc"] and unsaid not in found["initial_soc"]


def test_a_start_that_is_a_hundred_times_what_was_asked_has_two_causes(tmp_path):
    high = record(USUAL_V, socs=[50.0] * 8)
    both = unit_findings(high, mapping_of(tmp_path), None)[-1].text
    assert 'set unit = "%" in [soc]' in both and 'unit = "1" in [initial_soc]' in both
    one = unit_findings(high, mapping_of(tmp_path, units={"initial_soc": "1"}), None)[-1].text
    assert 'set unit = "%" in [soc]' in one and "[initial_soc]" not in one


def test_a_full_battery_still_tells_its_capacity():
    """The FMU holds its SOC at 1 while it is charged: only the discharge counts, 2 C for 2e-4."""
    full = [1.0, 1.0, 1.0, 1.0, 0.9998, 0.9996, 0.9995, 0.9994]
    held = record(USUAL_V, socs=full)
    assert measured_capacity_Ah(held) == pytest.approx(2.0 / 2e-4 / 3600.0)


def test_resistance_of_a_straight_line():
    """Two pulses of 1 A with a jump of 0.1 V and a drift of 0.02 V a step: 0.1 ohm."""
    drifting = record([3.6, 3.6, 3.72, 3.74, 3.6, 3.6, 3.48, 3.46])
    assert measured_resistance_ohm(drifting) == pytest.approx(0.1)
    assert math.isclose(measured_resistance_ohm(record(USUAL_V)), 0.1, rel_tol=1e-9)

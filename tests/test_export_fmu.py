"""A block as an FMU: what the standard asks of it, and that it is the block. Two versions of FMI."""

import ctypes
import zipfile
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from export_fmus import (
    REFUSALS,
    Slave,
    adder,
    adder_with_data,
    compile_c,
    fmu_of,
    run_alone,
    undefined_symbols,
)
from fmu_files import needs_compiler

from bms.errors import BatteryError
from bms.export import compiler
from bms.export.block import CSource, Port
from bms.export.fmu import fmu_sources, write_fmu
from bms.export.fmu_description import Timing, model_description
from bms.export.units import UNITS, find_unit

pytestmark = needs_compiler
BOTH = pytest.mark.parametrize("version", [2, 3])
ERROR = 3


@pytest.fixture
def slave(version, tmp_path, tmp_path_factory):
    path = fmu_of(adder(), version, tmp_path_factory, refusals=REFUSALS)
    made = Slave(path, version, tmp_path / "unpacked").instantiate()
    yield made
    made.fmu.freeInstance()


def refused(slave, call, *arguments, says):
    """A call that must give fmi2Error or fmi3Error, with one message, and end the simulation."""
    from fmpy.fmi1 import FMICallException

    before = len(slave.messages)
    with pytest.raises(FMICallException) as caught:
        call(*arguments)
    assert caught.value.status == ERROR
    assert len(slave.messages) == before + 1
    status, message = slave.messages[-1]
    assert status == ERROR
    assert says in message
    assert caught.value.function in message


@BOTH
def test_it_is_valid_and_runs_where_socwise_is_not(version, tmp_path, tmp_path_factory):
    path = fmu_of(adder(), version, tmp_path_factory, refusals=REFUSALS)
    time = np.arange(11.0)
    u = np.sin(time)
    problems, result = run_alone(
        path,
        tmp_path,
        inputs={"time": time, "u": u, "skip": np.zeros(11)},
        starts={"sum_start": 1.5, "negative": True, "count_start": 4},
    )
    assert problems == []
    assert result["sum"] == pytest.approx(np.concatenate([[-1.5], -1.5 + np.cumsum(u[:10])]), abs=1e-12)
    assert result["count"].tolist() == list(range(4, 15))
    assert result["odd"].tolist() == [n % 2 for n in range(4, 15)]


@BOTH
def test_description(version, tmp_path_factory):
    import fmpy

    path = fmu_of(adder(), version, tmp_path_factory, refusals=REFUSALS)
    found = fmpy.read_model_description(str(path), validate=True)
    assert found.fmiVersion == f"{version}.0"
    assert found.description == adder().description
    by_name = {v.name: v for v in found.modelVariables}
    assert list(by_name) == [
        "sum_start", "count_start", "negative", "u", "skip", "sum", "count", "odd", "time",
    ]  # fmt: skip
    assert (by_name["sum_start"].start, by_name["sum_start"].unit) == ("2.5", "Ah")
    assert by_name["u"].description == "what is added"
    (hours,) = (unit for unit in found.unitDefinitions if unit.name == "Ah")
    base = hours.baseUnit
    assert (float(base.factor), int(base.A), int(base.s)) == (3600.0, 1, 1)
    assert found.coSimulation.canGetAndSetFMUstate
    assert found.modelExchange is None
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        headers = [name for name in names if name.startswith(f"sources/fmi{version}") and name.endswith(".h")]
        assert len(headers) == 3
        # The licence of the standard's headers goes where they go.
        assert all(b"2-Clause BSD License" in archive.read(name) for name in headers)
        assert {info.date_time[0] for info in archive.infolist()} == {1980}
    assert f"binaries/{compiler.platform_folder(version)}/adder{compiler.library_suffix()}" in names
    if version == 3:
        (build,) = fmpy.model_description.read_build_description(str(path), validate=True)
        listed = build.sourceFileSets[0].sourceFiles
    else:
        with zipfile.ZipFile(path) as archive:
            root = ElementTree.fromstring(archive.read("modelDescription.xml"))
        listed = [file.get("name") for file in root.iterfind("CoSimulation/SourceFiles/File")]
    assert sorted(f"sources/{name}" for name in listed) == sorted(n for n in names if n.endswith(".c"))


@BOTH
def test_the_sources_compile_strictly_and_export_the_standard_alone(version, tmp_path):
    for name, text in fmu_sources(adder(), version, REFUSALS).items():
        (tmp_path / name).write_text(text)
    sources = sorted(path.name for path in tmp_path.glob("*.c"))
    compile_c(tmp_path, sources, tmp_path / "strict.so", "-shared", "-fPIC", "-Wconversion", "-Wshadow")
    compile_c(tmp_path, ["adder.c"], tmp_path / "adder.o", "-c")
    assert undefined_symbols(tmp_path / "adder.o") == set()


def test_the_same_block_gives_the_same_bytes(tmp_path, tmp_path_factory):
    first = fmu_of(adder(), 3, tmp_path_factory, refusals=REFUSALS)
    again = write_fmu(adder(), tmp_path / "new" / "again.fmu", 3, refusals=REFUSALS)
    assert again.read_bytes() == first.read_bytes()


@BOTH
def test_phases(slave):
    """Calls out of turn, each in a fresh life of the instance."""
    refused(slave, slave.step, 0.0, 1.0, says="not allowed instantiated")
    slave.fmu.reset()
    refused(slave, slave.fmu.exitInitializationMode, says="not allowed instantiated")
    slave.fmu.reset()
    refused(slave, slave.fmu.terminate, says="not allowed instantiated")
    slave.fmu.reset()
    slave.begin()
    refused(slave, slave.step, 0.0, 1.0, says="not allowed in initialization mode")
    slave.fmu.reset()
    slave.start()
    refused(slave, slave.begin, says="not allowed between steps")
    refused(slave, slave.step, 0.0, 1.0, says="not allowed after an error")
    slave.fmu.reset()
    slave.start()
    slave.step(0.0, 1.0)
    slave.fmu.terminate()
    assert slave.get("count") == 4
    refused(slave, slave.step, 1.0, 1.0, says="not allowed terminated")


@BOTH
def test_an_error_in_the_middle_leaves_values_and_allows_a_new_start(slave):
    slave.start()
    slave.set(u=3.0)
    slave.step(0.0, 1.0)
    slave.set(u=101.0)
    refused(slave, slave.step, 1.0, 1.0, says="u is more than 100")
    assert slave.get("sum") == 5.5
    slave.fmu.reset()
    slave.start()
    assert slave.get("sum") == 2.5
    slave.set(u=-101.0)
    refused(slave, slave.step, 0.0, 1.0, says="the block refuses")


@BOTH
def test_values(slave):
    if slave.version == 2:
        refused(slave, slave.get, "sum", says="not allowed instantiated")
        slave.fmu.reset()
    slave.begin(sum_start=7.0)
    assert slave.get("sum") == 7.0
    slave.set(negative=True)
    assert slave.get("sum") == -7.0
    slave.fmu.exitInitializationMode()
    assert slave.get("time") == 0.0
    for name, value, says in (
        ("sum_start", 1.0, "sum_start cannot be set after initialization"),
        ("sum", 1.0, "sum cannot be set at all"),
        ("time", 1.0, "time cannot be set at all"),
    ):
        state = slave.state_methods[0]()
        refused(slave, lambda n=name, v=value: slave.set(**{n: v}), says=says)
        slave.state_methods[1](state)
        slave.state_methods[2](state)
    assert slave.get("sum") == -7.0


@BOTH
def test_wrong_references_types_and_null_pointers(slave):
    real = "Real" if slave.version == 2 else "Float64"
    number = ctypes.c_double()
    reference = (ctypes.c_uint * 1)(99)
    component = ctypes.c_void_p(slave.fmu.component)

    def access(verb, kind, references, count, values):
        more = () if slave.version == 2 else (ctypes.c_size_t(count),)
        return slave.call(f"{verb}{kind}", component, references, ctypes.c_size_t(count), values, *more)

    slave.start()
    assert access("Get", real, reference, 1, ctypes.byref(number)) == ERROR
    assert "99" in slave.messages[-1][1]
    slave.fmu.reset()
    slave.start()
    reference[0] = slave.variables["count"].valueReference
    assert access("Get", real, reference, 1, ctypes.byref(number)) == ERROR
    assert "type" in slave.messages[-1][1]
    for references, values in ((None, ctypes.byref(number)), (reference, None)):
        for verb in ("Get", "Set"):
            slave.fmu.reset()
            slave.start()
            assert access(verb, real, references, 1, values) == ERROR
            assert "null pointer" in slave.messages[-1][1]
    slave.fmu.reset()
    slave.start()
    assert access("Get", real, None, 0, None) == 0
    assert access("Get", "String", None, 0, None) == 0
    assert access("Get", "String", reference, 1, None) == ERROR
    assert slave.call("Reset", None) == ERROR
    assert slave.call("Terminate", None) == ERROR


@BOTH
def test_time(slave):
    slave.start(start_time=5.0, stop_time=8.0)
    slave.step(5.0, 1.0)
    slave.step(6.0 + 1e-10, 0.5)
    assert slave.get("time") == pytest.approx(6.5)
    state = slave.state_methods[0]()
    for time, step, says in (
        (7.0, 1.0, "where the last one ended"),
        (6.5, 0.0, "must be positive"),
        (6.5, -1.0, "must be positive"),
        (6.5, float("nan"), "must be positive"),
        (6.5, 2.0, "beyond the stop"),
    ):
        refused(slave, slave.step, time, step, says=says)
        slave.state_methods[1](state)
    slave.step(6.5, 1.5)
    assert slave.get("count") == 6
    slave.state_methods[2](state)


@BOTH
def test_states_bring_everything_back(slave):
    get, put, free = slave.state_methods
    slave.start()
    slave.set(u=2.0)
    slave.step(0.0, 1.0)
    state = get()
    stored = slave.serialize(state)
    for k in range(1, 5):
        slave.step(float(k), 1.0)
    far = slave.get("sum"), slave.get("count")
    put(state)
    assert (slave.get("sum"), slave.get("count"), slave.get("time"), slave.get("u")) == (4.5, 4, 1.0, 2.0)
    for k in range(1, 5):
        slave.step(float(k), 1.0)
    assert (slave.get("sum"), slave.get("count")) == far
    slave.fmu.reset()
    restored = slave.deserialize(stored)
    put(restored)
    assert (slave.get("sum"), slave.get("time")) == (4.5, 1.0)
    free(state)
    free(restored)
    refused(slave, slave.deserialize, b"x" * len(stored), says="no state of this FMU")
    refused(slave, slave.deserialize, stored[:-1], says="no state of this FMU")


@BOTH
def test_instances_do_not_know_each_other(version, tmp_path, tmp_path_factory):
    path = fmu_of(adder(), version, tmp_path_factory, refusals=REFUSALS)
    one, two = (Slave(path, version, tmp_path / name).instantiate().start() for name in ("one", "two"))
    one.set(u=1.0)
    two.set(u=10.0)
    for k in range(3):
        one.step(float(k), 1.0)
        two.step(float(k), 1.0)
    assert (one.get("sum"), two.get("sum")) == (5.5, 32.5)
    one.fmu.freeInstance()
    two.step(3.0, 1.0)
    assert two.get("sum") == 42.5
    two.fmu.freeInstance()


@BOTH
def test_instantiation_refuses_a_wrong_token_and_bad_parameters(version, tmp_path, tmp_path_factory):
    path = fmu_of(adder(), version, tmp_path_factory, refusals=REFUSALS)
    stranger = Slave(path, version, tmp_path / "x", guid="{0}")
    with pytest.raises(Exception, match="nstantiat"):
        stranger.instantiate()
    assert "GUID or token" in stranger.messages[0][1]
    known = Slave(path, version, tmp_path / "y").instantiate()
    known.begin(count_start=-1)
    refused(known, known.fmu.exitInitializationMode, says="sum_start, count_start, negative")
    known.fmu.freeInstance()


@BOTH
def test_data_among_the_resources(version, tmp_path, tmp_path_factory):
    """Read from a folder whose name is neither ASCII nor without blanks; a missing or cut file is said."""
    path = fmu_of(adder_with_data(), version, tmp_path_factory)
    folder = tmp_path / "Prüf stand %41"
    slave = Slave(path, version, folder).instantiate().start()
    assert slave.get("sum") == 40.0
    # Not through fmpy, which unloads the library as well.
    slave.call("FreeInstance", ctypes.c_void_p(slave.fmu.component))
    file = folder / "resources" / "reader.bin"
    for content in (file.read_bytes()[:-1], file.read_bytes() + b"x", None):
        file.unlink() if content is None else file.write_bytes(content)
        slave.messages.clear()
        with pytest.raises(Exception, match="nstantiat"):
            slave.instantiate()
        assert "reader.bin" in slave.messages[0][1]


def test_a_clear_word_without_a_compiler(tmp_path, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(BatteryError, match=r"no-such-compiler.*--form c"):
        write_fmu(adder(), tmp_path / "x.fmu", 3)
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_an_fmu(tmp_path):
    broken = CSource("broken", "#error no", "#error no", 8, "x", (), (), (), "0", "0", "(void)w")
    with pytest.raises(BatteryError, match="does not take the source"):
        write_fmu(broken, tmp_path / "x.fmu", 2)
    for name in ("Model", "fmu", "fmi2Functions"):
        with pytest.raises(BatteryError, match="choose another name"):
            write_fmu(adder(name), tmp_path / "x.fmu", 2)
    with pytest.raises(BatteryError, match="FMI 1"):
        write_fmu(adder(), tmp_path / "x.fmu", 1)
    with pytest.raises(BatteryError, match="did you mean 'ohm'"):
        find_unit("ohms")
    assert list(tmp_path.iterdir()) == []


def test_units_are_those_of_the_si():
    """Identities of physics between the table's entries: P = U I, U = R I, Q = C U, P t = M phi."""

    def product(*names):
        total = {}
        for name in names:
            for base, exponent in UNITS[name].exponents.items():
                total[base] = total.get(base, 0) + exponent
        return {base: exponent for base, exponent in total.items() if exponent}

    assert product("V", "A") == product("W")
    assert product("ohm", "A") == product("V")
    assert product("F", "V") == product("C") == product("Ah")
    assert product("W", "s") == product("N.m")
    assert product("kg/s", "s") == product("kg")
    assert UNITS["Ah"].factor == 3600.0
    assert (UNITS["degC"].offset, UNITS["degC"].exponents) == (273.15, UNITS["K"].exponents)


def test_timing_is_in_the_description():
    timing = Timing(0.5, fixed=True, stop_s=30.0)
    for version, inner in ((2, None), (3, "0.5")):
        root = ElementTree.fromstring(model_description(adder(), version, "{1}", timing, []))
        experiment, simulation = root.find("DefaultExperiment"), root.find("CoSimulation")
        assert (experiment.get("stepSize"), experiment.get("stopTime")) == ("0.5", "30.0")
        assert simulation.get("canHandleVariableCommunicationStepSize") == "false"
        assert simulation.get("fixedInternalStepSize") == inner


def test_a_start_value_must_be_a_number(tmp_path):
    block, bad = adder(), Port("u", "A", "what is added", "u", float("nan"))
    with pytest.raises(BatteryError, match="start value of 'u'"):
        write_fmu(replace(block, inputs=(bad, block.inputs[1])), tmp_path / "x.fmu", 3)

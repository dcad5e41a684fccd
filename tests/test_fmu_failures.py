"""FMUs that cannot be used: one clear message each, and nothing left behind.

What goes wrong while one runs stands in test_fmu_crashes.py.
"""

import stat
import struct
import zipfile
import zlib

import pytest
from fmu_files import build_fmu, fmu_cell, mapping_text, needs_compiler, write_zip
from fmu_sessions import drive, nothing_left, session

from bms.errors import BatteryError
from bms.plants.fmu.errors import FmuError
from bms.plants.fmu.probe import probe

pytestmark = [needs_compiler, pytest.mark.usefixtures("nothing_left")]
_ = nothing_left

FMI_1 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="1.0" modelName="Battery" modelIdentifier="battery" guid="{1}"
  numberOfContinuousStates="0" numberOfEventIndicators="0">
  <ModelVariables>
    <ScalarVariable name="current" valueReference="1" causality="input"><Real start="0"/></ScalarVariable>
  </ModelVariables>
  <Implementation><CoSimulation_StandAlone>
    <Capabilities canHandleVariableCommunicationStepSize="true"/>
  </CoSimulation_StandAlone></Implementation>
</fmiModelDescription>
"""

ENTITIES = [f'<!ENTITY {b} "{10 * f"&{a};"}">' for a, b in zip("abcdefgh", "bcdefghi", strict=True)]
LAUGHS = (
    '<!DOCTYPE x [<!ENTITY a "ha">'
    + "".join(ENTITIES)
    + ']>\n<fmiModelDescription fmiVersion="2.0">&i;</fmiModelDescription>'
)


def refusal(path, text=None, **mapping):
    """The message with which an FMU is refused, in one paragraph."""
    with pytest.raises(BatteryError) as caught, session(path, text, **mapping):
        pass
    message = str(caught.value)
    assert "\n" not in message
    assert "Traceback" not in message
    return message


def changed(path, name, content):
    """Replace an entry of an archive."""
    with zipfile.ZipFile(path) as archive:
        entries = {entry: archive.read(entry) for entry in archive.namelist()}
    return write_zip(path, entries | {name: content})


def described(path):
    """Text of an FMU's description."""
    with zipfile.ZipFile(path) as archive:
        return archive.read("modelDescription.xml").decode()


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_no_binary_for_this_platform(fmi, tmp_path):
    there = ("win32", "darwin64") if fmi == "2.0" else ("x86-windows", "riscv64-linux")
    message = refusal(build_fmu(tmp_path, fmi=fmi, platforms=there))
    assert all(platform in message for platform in there)


def test_no_binary_at_all(tmp_path):
    assert "none at all" in refusal(build_fmu(tmp_path, platforms=()))


def test_binary_with_another_name(tmp_path):
    path = build_fmu(tmp_path)
    changed(path, "modelDescription.xml", described(path).replace('"battery"', '"accumulator"'))
    message = refusal(path)
    assert "accumulator" in message
    assert "battery" in message


def test_binary_that_is_none(tmp_path):
    path = build_fmu(tmp_path)
    with zipfile.ZipFile(path) as archive:
        name = next(entry for entry in archive.namelist() if entry.startswith("binaries/"))
    changed(path, name, b"MZ this is a library of another world")
    assert "cannot be loaded" in refusal(path)


def test_fmi_1(tmp_path):
    message = refusal(write_zip(tmp_path / "old.fmu", {"modelDescription.xml": FMI_1}))
    assert "FMI 1.0" in message
    assert "2.0 and 3.0" in message


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.99])
def test_truncated_zip(share, tmp_path):
    path = build_fmu(tmp_path)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    message = refusal(path)
    assert str(path) in message
    assert "not an FMU, or a damaged one" in message


def test_damaged_content(tmp_path):
    path = build_fmu(tmp_path)
    content = bytearray(path.read_bytes())
    content[200:260] = bytes(60)
    path.write_bytes(content)
    assert "damaged" in refusal(path)


def test_file_that_is_not_there_or_is_a_folder(tmp_path):
    assert "none.fmu" in refusal(tmp_path / "none.fmu")
    folder = tmp_path / "folder.fmu"
    folder.mkdir()
    assert "folder" in refusal(folder)


def test_zip_that_is_no_fmu(tmp_path):
    assert "modelDescription.xml" in refusal(write_zip(tmp_path / "photos.fmu", {"beach.txt": "sea"}))


OUTSIDE = [
    "../evil.txt",
    "resources/../../evil.txt",
    "/evil.txt",
    "C:/evil.txt",
    "..\\evil.txt",
    "\\\\host\\x",
]


@pytest.mark.parametrize("name", OUTSIDE, ids=range(len(OUTSIDE)))
def test_zip_with_a_path_outside(name, tmp_path, nothing_left):
    path = build_fmu(tmp_path)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(zipfile.ZipInfo(name), "evil")
    assert "leaves its folder" in refusal(path)
    assert list(tmp_path.rglob("evil.txt")) == []


@pytest.mark.parametrize("kind", [stat.S_IFLNK, stat.S_IFCHR])
def test_zip_with_a_link_or_a_device(kind, tmp_path):
    path = build_fmu(tmp_path)
    entry = zipfile.ZipInfo("resources/link")
    entry.external_attr = (kind | 0o777) << 16
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(entry, "/etc/passwd")
    assert "resources/link" in refusal(path)


def test_zip_with_a_name_twice(tmp_path):
    path = build_fmu(tmp_path)
    with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate name"):
        archive.writestr("resources/battery.txt", "other")
    assert "twice" in refusal(path)


@pytest.mark.parametrize("identifier", ["../../evil", "/tmp/evil", "a/b", "..", "", "C:\\evil"])
def test_model_identifier_with_a_path(identifier, tmp_path):
    path = build_fmu(tmp_path)
    changed(path, "modelDescription.xml", described(path).replace('"battery"', f'"{identifier}"'))
    message = refusal(path)
    assert "modelIdentifier" in message
    assert "Nothing was loaded" in message


def bomb(path, gigabytes, declared):
    """Add an entry of zeros, packed to a thousandth, that says it has so many bytes."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    block = packer.compress(bytes(16 << 20)) + packer.flush(zlib.Z_FULL_FLUSH)
    data = block * int(gigabytes * 64) + packer.flush()
    name = b"resources/zeros.bin"
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        info = zipfile.ZipInfo(name.decode())
        info.compress_type, info.compress_size, info.file_size = zipfile.ZIP_DEFLATED, len(data), declared
        info.CRC, info.header_offset = 0, archive.start_dir
        archive.fp.seek(archive.start_dir)
        archive.fp.write(
            struct.pack("<4s5H3I2H", b"PK\3\4", 20, 0, 8, 0, 33, 0, len(data), declared, len(name), 0)
        )
        archive.fp.write(name + data)
        archive.start_dir, archive._didModify = archive.fp.tell(), True
        archive.filelist.append(info)
    return path


@pytest.mark.parametrize(
    ("gigabytes", "declared", "says"),
    [
        (4.0, 0xFFFFFFFE, "4.3 GB; at most 2.1 GB"),
        (0.25, 250_000_000, "more than 200 times its size"),
        (4.0, 1000, "damaged"),
        pytest.param(4.0, 2_000_000_000, "more than 200 times its size", marks=pytest.mark.slow),
    ],
    ids=["honest", "tight", "lies", "large and tight"],
)
def test_small_file_that_unpacks_to_gigabytes(gigabytes, declared, says, tmp_path):
    """Whether it admits it or not."""
    path = bomb(build_fmu(tmp_path), gigabytes, declared)
    assert path.stat().st_size < 1.2e6 * (1.0 + gigabytes)
    assert says in refusal(path)


WELL = "is not well-formed XML"
BROKEN_XML = {
    "empty": ("", WELL),
    "cut": ("<fmiModelDescription fmiVersion='2.0'><ModelVariables>", WELL),
    "prose": ("Dear simulator, this is a battery.", WELL),
    "binary": (b"\x00\xff\xfe\x00battery", WELL),
    "encoding": (
        '<?xml version="1.0" encoding="klingon"?><fmiModelDescription/>',
        "klingon",
    ),
    "other": ("<html><body>404 Not Found</body></html>", "its root is <html>"),
    "bare": ('<fmiModelDescription fmiVersion="2.0"/>', "attribute 'modelName' is required"),
    "future": ('<fmiModelDescription fmiVersion="4.0"/>', "FMI 4.0; supported are FMI 2.0 and 3.0"),
    "laughs": (LAUGHS, "modelDescription.xml declares a document type"),
    "outside": ('<!DOCTYPE a SYSTEM "file:///etc/passwd"><fmiModelDescription/>', "declares a document type"),
    "deep": ("<a>" * 5000 + "</a>" * 5000, "levels"),
    "many": ("<fmiModelDescription>" + "<a/>" * 600_000 + "</fmiModelDescription>", "elements"),
    "huge": ("<fmiModelDescription>" + " " * (70 << 20) + "</fmiModelDescription>", "are read"),
    "huge and packed": ("<fmiModelDescription>" + " " * (70 << 20), "times its size"),
}


@pytest.mark.parametrize(("content", "says"), BROKEN_XML.values(), ids=BROKEN_XML)
def test_malformed_or_huge_xml(content, says, tmp_path):
    path = tmp_path / "odd.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED if says == "times its size" else 0) as archive:
        archive.writestr("modelDescription.xml", content)
    message = refusal(path)
    assert says in message
    assert message.count("modelDescription.xml") <= 1
    assert len(message) < 600


@pytest.mark.parametrize(
    ("table", "nearest"),
    [
        ({"drive": {"role": "current", "variable": "curent", "positive": "charge"}}, "current"),
        ({"voltage": {"variable": "Voltage"}}, "voltage"),
        ({"soc": {"variable": "s0c"}}, "soc"),
        ({"initial_soc": {"variable": "initial_SOC"}}, "initial_soc"),
        ({"parameters": {"fault_tim": 1.0}}, "fault_time"),
        ({"inputs": {"ambient_temperatur": 300.0}}, "ambient_temperature"),
    ],
    ids=["drive", "voltage", "soc", "initial_soc", "parameters", "inputs"],
)
def test_unknown_variable(table, nearest, tmp_path):
    message = refusal(build_fmu(tmp_path), **table)
    assert f"{nearest!r}" in message or f'"{nearest}"' in message or f"{nearest}?" in message


@pytest.mark.parametrize(
    "table",
    [
        {"drive": {"role": "current", "variable": "ambient_temperature", "positive": "charge"}},
        {"drive": {"role": "power", "variable": "current", "positive": "charge"}},
        {"voltage": {"variable": "current_out"}},
        {"voltage": {"variable": "voltage", "unit": "A"}},
        {"voltage": {"variable": "voltage", "unit": "mV"}},
        {"soc": {"variable": "soc", "unit": "%"}},
        {"temperature": {"variable": "soc"}},
    ],
    ids=["K for A", "A for W", "A for V", "declared A", "declared mV", "declared %", "1 for K"],
)
def test_unit_mismatch(table, tmp_path):
    message = refusal(build_fmu(tmp_path), **table)
    assert "unit" in message


@pytest.mark.parametrize("declare", ["no", "names"])
def test_unit_that_nobody_knows(declare, tmp_path):
    """An FMU that tells no units needs them in the mapping; a name that is usual is enough."""
    path = build_fmu(tmp_path, declare=declare)
    if declare == "no":
        message = refusal(path)
        assert "unit" in message
        units = {
            "drive": "A",
            "voltage": "V",
            "current": "A",
            "temperature": "K",
            "soc": "1",
            "initial_soc": "1",
        }
        opened = session(path, units=units)
    else:
        opened = session(path)
    with opened as fmu:
        assert 3.0 < drive(fmu.start(0.6))[-1] < 4.5


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ({"drive": {"role": "current", "variable": "voltage", "positive": "charge"}}, "input"),
        ({"parameters": {"soc": 0.5}}, "soc"),
        ({"inputs": {"fault_time": 1.0}}, "fault_time"),
        ({"initial_soc": {"variable": "voltage"}}, "voltage"),
    ],
    ids=["output as drive", "output as parameter", "parameter as input", "output as start"],
)
def test_variable_of_the_wrong_kind(table, says, tmp_path):
    assert says in refusal(build_fmu(tmp_path), **table)


def test_model_exchange_only(tmp_path):
    path = build_fmu(tmp_path, kind="me")
    message = refusal(path, kind="co-simulation")
    assert "model exchange" in message or "model-exchange" in message
    with session(path) as fmu:
        assert 3.0 < drive(fmu.start(0.6))[-1] < 4.5


def test_co_simulation_only(tmp_path):
    message = refusal(build_fmu(tmp_path, kind="cs"), kind="model-exchange")
    assert "co-simulation" in message


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_variable_step_not_supported(fmi, tmp_path):
    path = build_fmu(tmp_path, fmi=fmi, kind="cs", fixed_step_s=0.5)
    assert "0.5" in refusal(path)
    with session(path, step_s=0.5) as fmu:
        assert 3.0 < drive(fmu.start(0.6))[-1] < 4.5


def test_step_of_the_loop_that_is_no_multiple(tmp_path):
    with session(build_fmu(tmp_path), step_s=0.4) as fmu:
        plant = fmu.start(0.6)
        with pytest.raises(FmuError, match=r"0\.4"):
            plant.step(10.0, 0.0, 1.0)


@pytest.mark.parametrize("isolate", [True, False], ids=["isolated", "in process"])
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_non_ascii_path(fmi, isolate, tmp_path, nothing_left):
    """In the name of the file, of its folder, and of the place it is unpacked in."""
    import tempfile

    place = nothing_left / "Größe 100 % 电池"
    place.mkdir()
    tempfile.tempdir = str(place)
    folder = tmp_path / "Zellen für März"
    folder.mkdir()
    path = build_fmu(folder, fmi=fmi, file="Batterie Ωhm #1.fmu")
    with session(path, isolate=isolate) as fmu:
        assert 3.0 < drive(fmu.start(0.6))[-1] < 4.5
    assert list(place.iterdir()) == []
    place.rmdir()


def test_mapping_of_another_schema(tmp_path):
    assert "schema" in refusal(build_fmu(tmp_path), mapping_text(schema=2))


def contradictions(path, cell=None, **mapping):
    """What the probe says against a mapping."""
    with session(path, isolate=False, **mapping) as fmu:
        return {one.about: one.text for one in probe(fmu, cell).contradictions}


SIGNS = ("charge", "discharge")


@pytest.mark.parametrize("kind", ["cs", "me"])
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize("role", ["current", "power"])
@pytest.mark.parametrize(("right", "wrong"), [SIGNS, SIGNS[::-1]], ids=SIGNS)
def test_wrong_sign(right, wrong, role, fmi, kind, tmp_path):
    """The drive's, that of the current that is read, or both: the probe says which."""
    path = build_fmu(tmp_path, fmi=fmi, kind=kind, drive=role, positive=right)
    drive = {"role": role, "variable": role}
    good, bad = drive | {"positive": right}, drive | {"positive": wrong}
    read_wrongly = {"variable": "current_out", "positive": wrong}
    mend = f'set positive = "{right}"'
    assert contradictions(path, role=role, positive=right) == {}
    found = contradictions(path, role=role, positive=right, drive=bad)
    assert mend in found["drive"]
    found = contradictions(path, role=role, positive=right, drive=good, current=read_wrongly)
    assert "drive" not in found
    assert mend in found["current"]
    found = contradictions(path, role=role, positive=wrong)
    assert mend in found["drive"]
    assert mend in found["current"]


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize(("right", "wrong"), [SIGNS, SIGNS[::-1]], ids=SIGNS)
def test_wrong_sign_of_an_fmu_that_takes_a_voltage(right, wrong, fmi, tmp_path):
    path = build_fmu(tmp_path, fmi=fmi, drive="voltage", positive=right)
    assert contradictions(path, role="voltage", positive=right) == {}
    found = contradictions(path, role="voltage", positive=wrong)
    assert f'set positive = "{right}"' in found["current"]


def test_wrong_units_and_scale_contradict_as_well(tmp_path):
    """Of an FMU that tells no units the mapping may say anything; the probe sees what cannot be."""
    right = {"drive": "A", "voltage": "V", "current": "A", "temperature": "K", "soc": "1", "initial_soc": "1"}
    path = build_fmu(tmp_path, declare="no")
    assert contradictions(path, fmu_cell(), units=right) == {}
    for role, unit in {"drive": "mA", "voltage": "mV", "temperature": "degC", "current": "mA"}.items():
        assert contradictions(path, fmu_cell(), units=right | {role: unit}) != {}, role
    found = contradictions(path, fmu_cell(), units=right, scale={"series": 90})
    assert "series" in found["voltage"]

"""What an FMU says of itself, and what is said where it cannot be used."""

import pytest

from bms.plants.fmu.channel import Wiring
from bms.plants.fmu.description import BaseUnit, platform_name, read_description
from bms.plants.fmu.errors import FmuError
from bms.plants.fmu.wires import connect
from bms.plants.fmu.xml_guard import check_xml

FMI_2 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Akku" guid="{42}" generationTool="Tool 7"
    numberOfEventIndicators="3">
  <ModelExchange modelIdentifier="akku" completedIntegratorStepNotNeeded="true"/>
  <CoSimulation modelIdentifier="akku" canGetAndSetFMUstate="true" needsExecutionTool="true"/>
  <UnitDefinitions>
    <Unit name="degF"><BaseUnit K="1" factor="0.5555555555555556" offset="255.3722222222222"/></Unit>
    <Unit name="bar"/>
  </UnitDefinitions>
  <TypeDefinitions><SimpleType name="Temp"><Real unit="degF"/></SimpleType></TypeDefinitions>
  <LogCategories><Category name="logStatusError"/></LogCategories>
  <DefaultExperiment startTime="1.5" stepSize="0.5"/>
  <ModelVariables>
    <ScalarVariable name="i" valueReference="7" causality="input"><Real start="1e1"/></ScalarVariable>
    <ScalarVariable name="T" valueReference="8" causality="output">
      <Real declaredType="Temp"/></ScalarVariable>
    <ScalarVariable name="on" valueReference="9" causality="parameter" variability="fixed">
      <Boolean start="true"/></ScalarVariable>
    <ScalarVariable name="file" valueReference="1" causality="parameter" variability="fixed">
      <String start="a"/></ScalarVariable>
    <ScalarVariable name="pi" valueReference="2" causality="local" variability="constant" initial="exact">
      <Real start="3"/></ScalarVariable>
    <ScalarVariable name="mode" valueReference="3" causality="input" variability="discrete">
      <Integer start="2"/></ScalarVariable>
    <ScalarVariable name="x" valueReference="4" causality="local" initial="exact">
      <Real start="0.1"/></ScalarVariable>
  </ModelVariables>
  <ModelStructure/>
</fmiModelDescription>
"""

FMI_3 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="Akku" instantiationToken="{43}">
  <CoSimulation modelIdentifier="akku" fixedInternalStepSize="0.25"
      canHandleVariableCommunicationStepSize="true" canGetAndSetFMUState="true"/>
  <ModelVariables>
    <Float64 name="i" valueReference="7" causality="input" start="0"/>
    <Float32 name="v" valueReference="8" causality="output" unit="mV"/>
    <Float64 name="cells" valueReference="9" causality="output"><Dimension start="4"/></Float64>
    <UInt8 name="n" valueReference="10" causality="parameter" start="3"/>
  </ModelVariables>
  <ModelStructure/>
</fmiModelDescription>
"""


def write(folder, text, platforms=()):
    folder.joinpath("modelDescription.xml").write_text(text, encoding="utf-8")
    for name in platforms:
        (folder / "binaries" / name).mkdir(parents=True)
        (folder / "binaries" / name / "akku.so").write_text("")
    return folder


def refusal(folder, text):
    with pytest.raises(FmuError) as caught:
        read_description(write(folder, text))
    return str(caught.value)


def test_fmi_2_is_read(tmp_path):
    found = read_description(write(tmp_path, FMI_2, ["linux64", "win64"]))
    assert (found.version, found.name, found.tool, found.token) == (2, "Akku", "Tool 7", "{42}")
    assert found.platforms == ("linux64", "win64")
    assert (found.step_s, found.start_s, found.indicators) == (0.5, 1.5, 3)
    assert found.log_categories == ("logStatusError",)
    assert list(found.interfaces) == ["co-simulation", "model-exchange"]
    slave, model = found.interface(), found.interface("model-exchange")
    assert (slave.kind, slave.identifier, slave.state, slave.needs_tool) == (
        "co-simulation",
        "akku",
        True,
        True,
    )
    assert not slave.variable_step
    assert slave.fixed_step_s is None
    assert not model.state
    assert not model.completed_step
    current, on = found.variable("i"), found.variable("on")
    assert (current.reference, current.type, current.causality) == (7, "Real", "input")
    assert (current.start_number, on.start_number) == (10.0, 1.0)
    assert found.variable("file").start_number is None
    assert found.variable("T").unit == "degF"
    assert found.units["bar"] is None
    assert found.units["degF"] == BaseUnit((0, 0, 0, 0, 1, 0, 0, 0), 0.5555555555555556, 255.3722222222222)


def test_fmi_3_is_read(tmp_path):
    found = read_description(write(tmp_path, FMI_3))
    assert (found.version, found.token, found.platforms) == (3, "{43}", ())
    slave = found.interface()
    assert (slave.fixed_step_s, slave.state, slave.variable_step) == (0.25, True, True)
    assert (found.variable("v").type, found.variable("v").unit) == ("Float32", "mV")
    assert [found.variable(name).scalar for name in ("i", "cells")] == [True, False]


def test_platforms_are_named(tmp_path):
    import fmpy

    assert (platform_name(2), platform_name(3)) == (fmpy.platform, fmpy.platform_tuple)
    foreign = read_description(write(tmp_path, FMI_2, ["os2"]))
    with pytest.raises(FmuError, match=rf"{fmpy.platform}; it has os2"):
        foreign.check_platform()
    (tmp_path / "binaries" / fmpy.platform).mkdir()
    with pytest.raises(FmuError, match="it has os2"):
        read_description(tmp_path).check_platform()
    (tmp_path / "binaries" / fmpy.platform / "akku").write_text("")
    read_description(tmp_path).check_platform()


def test_unknown_names_get_the_nearest(tmp_path):
    found = read_description(write(tmp_path, FMI_2))
    with pytest.raises(FmuError, match="did you mean 'mode'"):
        found.variable("mod")
    with pytest.raises(FmuError, match=r"\[soc\]"):
        found.variable("quite another", "[soc]")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (('"2.0"', '"1.0"'), "FMI 1.0; supported are FMI 2.0 and 3.0"),
        (('fmiVersion="2.0"', ""), "without an fmiVersion"),
        (('Identifier="akku"', 'Identifier="../akku"'), "modelIdentifier"),
        (('<Real start="1e1"/>', ""), "cannot be understood"),
        (("Temp", "Temp2", 1), "cannot be understood"),
        (("</ModelVariables>", ""), "not well-formed"),
        (('valueReference="7"', 'valueReference="seven"'), "cannot be understood"),
    ],
    ids=lambda value: None if isinstance(value, tuple) else value[:20],
)
def test_what_cannot_be_used_is_said(change, says, tmp_path):
    message = refusal(tmp_path, FMI_2.replace(*change))
    assert says in message
    assert len(message) < 700


def test_scheduled_execution_alone_is_refused(tmp_path):
    text = FMI_3.replace("<CoSimulation ", '<ScheduledExecution xmlns:a="b" ')
    assert "neither co-simulation nor model exchange" in refusal(tmp_path, text)


def test_an_entity_that_multiplies_is_refused_before_it_does(tmp_path):
    path = tmp_path / "a.xml"
    path.write_text('<!DOCTYPE a [<!ENTITY b "x">]><a>&b;</a>')
    with pytest.raises(FmuError, match="document type"):
        check_xml(path)
    path.write_text('<a b="1"><c/></a>')
    assert check_xml(path) == ("a", {"b": "1"})


def wires(folder, text=FMI_2, **changes):
    values = {"kind": "co-simulation", "input": "i", "outputs": ("T",), "step_s": 0.5} | changes
    return connect(read_description(write(folder, text)), Wiring(**values))


def test_names_become_variables(tmp_path):
    found = wires(
        tmp_path,
        starts=("x",),
        inputs=(("mode", 3.0),),
        parameters=(("on", 1.0), ("i", 2.5)),
        outputs=("T", "pi"),
    )
    assert (found.input.reference, found.input_start) == (7, 2.5)
    assert [variable.name for variable in found.outputs] == ["T", "pi"]
    assert [(variable.name, value) for variable, value in found.inputs] == [("mode", 3.0)]
    assert [variable.name for variable, _ in found.parameters] == ["on"]


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"input": "T"}, "its inputs are i, mode"),
        ({"input": "mode"}, "type Integer"),
        ({"inputs": (("on", 1.0),)}, "causality parameter"),
        ({"inputs": (("i", 1.0),)}, "is driven"),
        ({"inputs": (("mode", 1.5),)}, "whole number"),
        ({"starts": ("pi",)}, "constant"),
        ({"starts": ("T",)}, "cannot be set"),
        ({"parameters": (("file", 1.0),)}, "type String"),
        ({"outputs": ("file",)}, "type String"),
        ({"step_s": 1.0}, "step_s = 0.5"),
        ({"step_s": 0.25}, "step_s = 0.5"),
    ],
    ids=str,
)
def test_what_does_not_fit_is_said(changes, says, tmp_path):
    with pytest.raises(FmuError, match=says):
        wires(tmp_path, **changes)


def test_whole_multiples_of_an_inner_step_are_taken(tmp_path):
    text = FMI_3
    for step_s in (0.25, 1.0, 2.5):
        assert wires(tmp_path, text, step_s=step_s, outputs=("v", "n")).input.name == "i"
    for step_s in (0.1, 0.3):
        with pytest.raises(FmuError, match=r"multiples of 0\.25"):
            wires(tmp_path, text, step_s=step_s, outputs=("v",))
    with pytest.raises(FmuError, match="array"):
        wires(tmp_path, text, outputs=("cells",))

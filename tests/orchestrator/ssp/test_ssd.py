from importlib.util import find_spec
from pathlib import Path
from typing import Literal

import pytest

from uuvsim_cosim.errors import InputInvalid, SystemInvalid
from uuvsim_cosim.orchestrator.parameters.ssm import read_names, read_ssm, write_ssm
from uuvsim_cosim.orchestrator.parameters.ssv import read_ssv, write_ssv
from uuvsim_cosim.orchestrator.ssp.ssd import format_ssd, read_ssd, write_ssd
from uuvsim_cosim.orchestrator.system.system import System

Version = Literal["1.0", "2.0"]
VERSIONS: list[Version] = ["1.0", "2.0"]


def schema_errors(path: Path, schema: str = "SystemStructureDescription.xsd") -> list[str]:
    from lxml import etree

    spec = find_spec("fmpy")
    assert spec is not None
    assert spec.origin is not None
    folder = Path(spec.origin).parent / "ssp" / "schema"
    found = etree.XMLSchema(file=str(folder / schema))
    found.validate(etree.parse(str(path)))
    return [str(e) for e in found.error_log]


def rich(vehicle: System) -> System:
    """Use everything that a file can hold."""
    inner = (
        System("inner", tick="0.02", description="inside")
        .add("f", "fake:filter", description="smooths")
        .add("w", "fake:wrench")
        .expose("u", "f.u")
        .expose("y", "f.y")
        .expose("thrust", "w.thrust")
        .set("f.u", 2)
    )
    return (
        vehicle.set("hull.mass", 1 / 3)
        .set("hull.J", [[1, 2], [3, 4e-300]])
        .set("controller.enabled", False)
        .set("controller.order", 4)
        .set("controller.log", 'a <"b"> & c')
        .set("current.seed", [-5, 2**31 - 1])
        .add("inner", inner, description="nested")
        .add("slow", "fake:filter", rate="0.04")
        .connect("inner.y", "slow.u", factor=2.0, offset=0.5, convert=False)
        .connect("thruster_1.thrust", "inner.thrust[2]")
        .expose("v", "slow.y")
        .group(["guidance", "controller"])
        .replace("controller", "fake:unitless")
    )


@pytest.mark.parametrize("version", VERSIONS)
def test_a_system_survives_its_file(vehicle: System, tmp_path: Path, version: Version) -> None:
    for system in (vehicle, rich(vehicle)):
        write_ssd(system, tmp_path / "x.ssd", version)
        assert read_ssd(tmp_path / "x.ssd") == system


@pytest.mark.parametrize("version", VERSIONS)
def test_equal_systems_give_equal_bytes(vehicle: System, version: Version) -> None:
    assert format_ssd(rich(vehicle), version) == format_ssd(rich(vehicle), version)


def test_a_file_of_version_1_is_valid_by_its_schema(vehicle: System, tmp_path: Path) -> None:
    write_ssd(rich(vehicle), tmp_path / "x.ssd", "1.0")
    assert schema_errors(tmp_path / "x.ssd") == []


def test_version_1_has_scalar_connectors_and_version_2_arrays(vehicle: System) -> None:
    one, two = format_ssd(vehicle, "1.0").decode(), format_ssd(vehicle, "2.0").decode()
    assert 'startConnector="tau[6]"' in one
    assert "Dimension" not in one
    assert '<ssc:Dimension size="6" />' in two
    assert 'startElement="allocation" startConnector="u" startIndices="3"' in two


def test_sources_carry_their_kind(tmp_path: Path) -> None:
    text = format_ssd(System("s").add("t", "fake:thruster")).decode()
    assert 'type="application/vnd.uuvsim.source"' in text


def test_a_connection_may_be_written_against_its_flow(vehicle: System, tmp_path: Path) -> None:
    write_ssd(System("s").add("w", "fake:wrench").add("h", "fake:hull").connect("w.tau", "h.tau"),
              tmp_path / "x.ssd")  # fmt: skip
    text = (tmp_path / "x.ssd").read_text()
    forward = 'startElement="w" startConnector="tau" endElement="h" endConnector="tau"'
    backward = 'startElement="h" startConnector="tau" endElement="w" endConnector="tau"'
    assert forward in text
    (tmp_path / "y.ssd").write_text(text.replace(forward, backward))
    assert read_ssd(tmp_path / "y.ssd") == read_ssd(tmp_path / "x.ssd")


HEAD = (
    '<ssd:SystemStructureDescription version="1.0" name="s"'
    ' xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"'
    ' xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"'
    ' xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">'
)
FOREIGN = (
    HEAD
    + """<ssd:System name="s">
  <ssd:ParameterBindings>
    <ssd:ParameterBinding prefix="hull."><ssd:ParameterValues>
      <ssv:ParameterSet version="1.0" name="top"><ssv:Parameters>
        <ssv:Parameter name="mass"><ssv:Real value="3000" unit="g"/></ssv:Parameter>
      </ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding>
  </ssd:ParameterBindings>
  <ssd:Elements>
    <ssd:Component name="hull" source="fake:hull" type="application/x-other">
      <ssd:Connectors><ssd:Connector name="eta" kind="output"/></ssd:Connectors>
      <ssd:ParameterBindings>
        <ssd:ParameterBinding source="hull.ssv"><ssd:ParameterMapping source="hull.ssm"/>
        </ssd:ParameterBinding>
      </ssd:ParameterBindings>
    </ssd:Component>
    <ssd:Component name="guidance" source="fake:guidance"/>
  </ssd:Elements>
  <ssd:Connections>
    <ssd:Connection startElement="hull" startConnector="eta[1]"
                    endElement="guidance" endConnector="eta[1]"/>
  </ssd:Connections>
</ssd:System>
<ssd:Units><ssc:Unit name="g"><ssc:BaseUnit kg="1" factor="0.001"/></ssc:Unit></ssd:Units>
</ssd:SystemStructureDescription>"""
)


def test_bindings_of_files_mappings_and_prefixes_are_applied(
    vehicle: System, tmp_path: Path
) -> None:
    hull = vehicle.describe("hull")
    write_ssv({"eta_0": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0), "mass": 7.0}, hull, tmp_path / "hull.ssv")
    write_ssm({"eta_0": "eta_0"}, tmp_path / "hull.ssm")
    (tmp_path / "s.ssd").write_text(FOREIGN)
    system = read_ssd(tmp_path / "s.ssd")
    start = system.components["hull"].start
    assert start == {"eta_0": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0), "mass": 3.0}
    assert "states no step: 0.01 s is used" in system.notes[0]


def test_every_problem_of_a_file_is_reported_at_once(tmp_path: Path) -> None:
    text = (
        FOREIGN.replace('source="fake:guidance"', 'source="gone.fmu"')
        .replace('startConnector="eta[1]"', 'startConnector="etta"')
        .replace('endElement="guidance"', 'endElement="hull"')
        .replace('name="mass"', 'name="maas"')
    )
    (tmp_path / "s.ssd").write_text(text)
    with pytest.raises(SystemInvalid) as error:
        read_ssd(tmp_path / "s.ssd")
    said = str(error.value)
    assert "gone.fmu: no such file" in said
    assert "no variable 'etta'" in said
    assert "no variable 'maas' in hull" in said
    assert "hull.ssv" in said
    assert len(error.value.problems) == 4
    assert all(p.place.startswith("s.ssd: ") for p in error.value.problems)


def test_a_problem_inside_a_nested_system_names_its_path(vehicle: System, tmp_path: Path) -> None:
    inner = System("inner").add("hull", "fake:hull", start={"mass": 5})
    write_ssd(System("outer").add("v", inner), tmp_path / "x.ssd")
    text = (tmp_path / "x.ssd").read_text().replace('value="5.0"', 'value="500.0"')
    (tmp_path / "x.ssd").write_text(text)
    with pytest.raises(SystemInvalid) as error:
        read_ssd(tmp_path / "x.ssd")
    assert len(error.value.problems) == 1
    assert "v.hull.mass: 500 kg is out of range" in str(error.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<ssd", "malformed XML"),
        ("<a/>", "expected <ssd:SystemStructureDescription>"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "document type or entities"),
        (HEAD.replace('"1.0"', '"3.0"') + "</ssd:SystemStructureDescription>", "SSP version"),
        (HEAD + "</ssd:SystemStructureDescription>", "no <ssd:System>"),
    ],
)
def test_a_file_that_is_no_ssd_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "x.ssd").write_text(text)
    with pytest.raises(InputInvalid, match=said):
        read_ssd(tmp_path / "x.ssd")


@pytest.mark.parametrize("version", VERSIONS)
def test_values_survive_their_file(vehicle: System, tmp_path: Path, version: Version) -> None:
    path = tmp_path / "hull.ssv"
    write_ssv({"mass": 0.1, "eta_0": (0.0,) * 6}, vehicle.describe("hull"), path, version)
    values, units = read_ssv(path)
    assert (values[0].name, values[0].value, values[0].unit) == ("mass", 0.1, "kg")
    assert len(values) == (2 if version == "2.0" else 7)
    assert units["kg"].factor == 1.0
    assert path.read_text().count('<ssc:Dimension size="6" />') == (version == "2.0")
    if version == "1.0":
        assert schema_errors(path, "SystemStructureParameterValues.xsd") == []


def test_a_mapping_survives_its_file_and_a_transformation_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.ssm"
    write_ssm({"tau_d[1]": "Out1"}, path, "1.0")
    assert read_names(path) == {"tau_d[1]": "Out1"}
    assert schema_errors(path, "SystemStructureParameterMapping.xsd") == []
    ssc = "http://ssp-standard.org/SSP1/SystemStructureCommon"
    path.write_text(
        path.read_text().replace(
            'target="Out1" />',
            f'target="Out1"><c:LinearTransformation xmlns:c="{ssc}" factor="2"/>'
            "</ssm:MappingEntry>",
        )
    )
    assert read_ssm(path)[0].change.factor == 2.0
    with pytest.raises(InputInvalid, match="expected names only"):
        read_names(path)


def test_relative_files_are_named_from_the_folder_of_the_ssd(tmp_path: Path) -> None:
    (tmp_path / "inner.ssd").write_bytes(format_ssd(System("i").add("h", "fake:hull")))
    outer = System("o", base=tmp_path).add("v", "inner.ssd")
    (tmp_path / "deep").mkdir()
    write_ssd(outer, tmp_path / "deep" / "o.ssd")
    assert 'source="../inner.ssd"' in (tmp_path / "deep" / "o.ssd").read_text()
    read = read_ssd(tmp_path / "deep" / "o.ssd")
    assert read.nested("v") == outer.nested("v")


def test_structural_parameters_set_the_shapes_of_a_component(
    kinetics: Path, tmp_path: Path
) -> None:
    from uuvsim_cosim.orchestrator.running.run import run

    system = System("s", "0.001").add("k", str(kinetics)).set("k.n", 2).set("k.u", [3.0, 4.0])
    system = system.set("k.gain", [[1.0, 10.0], [2.0, 100.0]])
    assert system.describe("k").variables["y"].shape == (2,)
    system.write(tmp_path / "s.ssd")
    again = read_ssd(tmp_path / "s.ssd")
    assert again.describe("k").variables["y"].shape == (2,)
    for number, s in enumerate((system, again)):
        done = run(s, until=0.002, out=tmp_path / str(number))
        assert done.signals()["k.y"].tolist() == [[31.0, 402.0]] * 3


def test_the_interface_of_an_fmu_is_written_as_its_implementation(
    kinetics: Path, tmp_path: Path
) -> None:
    system = System("s", "0.1").add("k", f"{kinetics}#interface=ModelExchange")
    system.write(tmp_path / "s.ssd")
    assert 'implementation="ModelExchange"' in (tmp_path / "s.ssd").read_text()
    again = read_ssd(tmp_path / "s.ssd")
    assert str(again.components["k"].source).endswith("kinetics.fmu#interface=ModelExchange")

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.fmus.codegen.toolchain import host
from uuvsim_cosim.fmus.export.fmu_file import write_archive
from uuvsim_cosim.fmus.importer.read_description import read_description, read_fmu
from uuvsim_cosim.models.declaration.units import parse_unit

CFmu = Callable[..., Path]


@pytest.mark.parametrize(
    ("text", "told"), [("<a>", "malformed XML"), ("<!DOCTYPE a><a/>", "declares a document type")]
)
def test_a_fault_of_the_xml_names_the_fmu_not_the_cache(
    text: str, told: str, tmp_path: Path
) -> None:
    path = tmp_path / "mine.fmu"
    write_archive(path, {"modelDescription.xml": text.encode()})
    with pytest.raises(FmuError) as caught:
        read_description(path)
    assert str(caught.value).startswith(f"{path}/modelDescription.xml: {told}")


@pytest.mark.parametrize("version", [2, 3])
def test_capabilities_are_read(version: int, c_fmu: CFmu) -> None:
    d = read_description(c_fmu(version))
    assert d.kind == f"FMI {version}.0"
    assert (d.name, d.token, d.default_step_size) == ("first_order", "{first-order}", 0.1)
    assert d.can_get_and_set_state
    assert d.can_serialize_state
    assert d.provides_directional_derivatives
    assert not d.can_be_instantiated_only_once
    assert not d.needs_execution_tool


@pytest.mark.parametrize("version", [2, 3])
def test_a_declared_type_gives_unit_and_range_that_the_variable_overrides(
    version: int, c_fmu: CFmu
) -> None:
    d = read_description(c_fmu(version))
    u = d.variables["u"]
    assert (u.unit, u.min, u.max, u.start) == ("cm", -10.0, 5.0, 0.0)
    assert d.units["cm"].conversion_to(parse_unit("m")) == (0.01, 0.0)


def test_a_unit_with_offset_is_converted(first_order_fmi2: Path) -> None:
    fahrenheit = read_description(first_order_fmi2).units["degF"]
    factor, offset = fahrenheit.conversion_to(parse_unit("degC"))
    assert 212 * factor + offset == pytest.approx(100)
    assert 32 * factor + offset == pytest.approx(0)


def test_a_unit_that_is_only_named_is_taken_by_its_name(first_order_fmi2: Path) -> None:
    assert read_description(first_order_fmi2).units["s"] == parse_unit("s")


@pytest.mark.parametrize("version", [2, 3])
def test_arrays_have_shape_and_start(version: int, c_fmu: CFmu) -> None:
    variables = read_description(c_fmu(version)).variables
    assert variables["v"].shape == (3,)
    assert variables["w"].shape == (3,)
    assert variables["m"].shape == (2, 2)
    np.testing.assert_array_equal(variables["m"].start, [[1.0, 2.0], [3.0, 4.0]])
    np.testing.assert_array_equal(variables["v"].start, np.zeros(3))


@pytest.mark.parametrize("version", [2, 3])
def test_undeclared_dependencies_differ_from_none(version: int, c_fmu: CFmu) -> None:
    variables = read_description(c_fmu(version)).variables
    assert variables["y"].dependencies == ()
    assert variables["w"].dependencies == ("v",)
    assert variables["steps" if version == 2 else "int32_out"].dependencies is None


@pytest.mark.parametrize(("version", "name"), [(2, "mode"), (3, "mode_in")])
def test_enumerations_keep_the_names_of_their_items(version: int, name: str, c_fmu: CFmu) -> None:
    fmu = read_fmu(c_fmu(version))
    assert fmu.description.variables[name].type == "Enumeration"
    assert fmu.enumerations[name] == {1: "slow", 2: "fast"}


def test_every_type_of_fmi3_is_read(first_order_fmi3: Path) -> None:
    types = {v.type for v in read_description(first_order_fmi3).variables.values()}
    assert len(types) == 14
    assert read_description(first_order_fmi3).variables["binary_in"].start == b"\x00\xff"


def test_an_alias_reads_the_value_of_its_variable(first_order_fmi3: Path) -> None:
    variables = read_description(first_order_fmi3).variables
    assert variables["level"].value_references == variables["y"].value_references
    assert variables["level"].causality == "local"


def test_parameters_without_variability_are_fixed(first_order_fmi3: Path) -> None:
    assert read_description(first_order_fmi3).variables["T"].variability == "fixed"


def test_binaries_that_there_are_are_listed(first_order_fmi2: Path) -> None:
    assert read_fmu(first_order_fmi2).binaries == (host().fmi2,)


def test_pythonfmu_is_read(pythonfmu2_controller: Path, pythonfmu3_controller: Path) -> None:
    for path in (pythonfmu2_controller, pythonfmu3_controller):
        d = read_description(path)
        shapes = {v.name: v.shape for v in d.of("input", "output")}
        assert shapes == dict.fromkeys(["eta_d", "nu_d", "eta", "nu", "tau_d"], (6,))
        assert d.variables["tau_d"].dependencies is None
        assert d.needs_execution_tool


CO_SIMULATION = "<CoSimulation modelIdentifier"


@pytest.mark.parametrize(
    ("version", "old", "new", "message"),
    [
        (2, 'fmiVersion="2.0"', 'fmiVersion="1.1"', "fmiVersion: '1.1'; expected .* 2.0 or 3.0"),
        (3, 'fmiVersion="3.0"', 'fmiVersion="3.0-beta.2"', "fmiVersion"),
        (2, CO_SIMULATION, "<Nothing modelIdentifier", "is for nothing that FMI knows only"),
        (2, CO_SIMULATION, "<ScheduledExecution modelIdentifier", "FMI knows only"),
        (
            2,
            'variability="tunable"><Real start="1"/>',
            'variability="tunable"><Real start="one"/>',
            "'k': start 'one'; expected",
        ),
        (2, 'max="5"', 'max="five"', "variable 'u': max = 'five'; expected a number"),
        (2, 'declaredType="Mode"', 'declaredType="Mood"', "'mode': unknown type 'Mood'"),
        (2, 'index="16"', 'index="99"', "index 99; expected 1 to 20"),
        (2, 'name="k"', 'name="u"', "variable 'u': declared twice"),
        (2, 'causality="input"', 'causality="in"', "variable 'u': causality 'in'; expected one of"),
        (2, 'valueReference="2"', 'valueReference="x"', "valueReference 'x'; expected a whole"),
        (2, '<BaseUnit m="1"', '<BaseUnit m="0.5"', "unit 'cm': an exponent that is not whole"),
        (2, '<Item name="slow" value="1"/>', "<Item/>", "an item without a whole value"),
        (3, 'start="1 2 3 4"', 'start="1 2 3"', "variable 'm': 3 start values; expected 1 or 4"),
        (3, '<Dimension valueReference="7"', '<Dimension valueReference="9"', "structural par"),
        (3, '<Dimension start="3"', '<Dimension start="-3"', "Dimension start '-3'"),
        (3, '<Dimension start="3"', '<Dimension start="999999999"', "elements; expected at most"),
        (3, '<Output valueReference="2"', '<Output valueReference="77"', "value reference 77"),
        (3, 'value="00ff"', 'value="0g"', "'binary_in': start '0g'"),
        (2, "<ModelVariables>", "<ModelVariables", "malformed XML"),
        (2, 'guid="{first-order}"', "", "no attribute 'guid'"),
        (2, "<fmiModelDescription ", "<!DOCTYPE a><fmiModelDescription ", "document type"),
    ],
)
def test_a_faulty_description_is_refused_at_its_place(
    version: int, old: str, new: str, message: str, c_fmu: CFmu
) -> None:
    with pytest.raises(FmuError, match=message):
        read_description(c_fmu(version, edits=[(old, new)]))


def test_a_structural_parameter_may_be_boolean_or_of_any_whole_type(
    tmp_path: Path, c_fmu: CFmu
) -> None:
    import zipfile

    with zipfile.ZipFile(c_fmu(3)) as archive:
        members = {n: archive.read(n) for n in archive.namelist()}
    text = members["modelDescription.xml"].decode()
    more = "".join(
        f'<{kind} name="s{n}" valueReference="{9000 + n}" causality="structuralParameter" '
        f'variability="fixed" start="{start}"/>'
        for n, (kind, start) in enumerate([("Boolean", "false"), ("Int8", "-1"), ("UInt16", "3")])
    )
    dimension = '<Dimension valueReference="9002"/>'
    more += f'<Float64 name="a3" valueReference="9003" start="0">{dimension}</Float64>'
    text = text.replace("</ModelVariables>", more + "</ModelVariables>")
    write_archive(tmp_path / "x.fmu", {**members, "modelDescription.xml": text.encode()})
    variables = read_description(tmp_path / "x.fmu").variables
    assert [variables[f"s{n}"].start for n in range(3)] == [False, -1, 3]
    assert variables["a3"].shape == (3,)
    without = text.replace(' variability="fixed" start="3"/>', ' variability="fixed"/>')
    write_archive(tmp_path / "z.fmu", {**members, "modelDescription.xml": without.encode()})
    with pytest.raises(FmuError, match="structural parameter 's2': no start; expected a start"):
        read_description(tmp_path / "z.fmu")
    bad = text.replace(dimension, '<Dimension valueReference="9001"/>')
    write_archive(tmp_path / "y.fmu", {**members, "modelDescription.xml": bad.encode()})
    with pytest.raises(FmuError, match="'a3': Dimension '-1'; expected a whole number, 0 or more"):
        read_description(tmp_path / "y.fmu")

"""Comparison of two interfaces: each property of FMI that a master reads, and nothing else."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import Uuvsim, write_archive
from uuvsim_cosim.fmus.check.compare_fmu import Difference, compare_interfaces
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.models.declaration.model import Model

XML = Path(__file__).parents[1] / "foreign" / "first_order_fmi3.xml"
XML1 = XML.with_name("first_order_fmi1.xml")
TERMINALS = """<fmiTerminalsAndIcons fmiVersion="3.0"><Terminals>
<Terminal name="bus" matchingRule="bus" terminalKind="can">
<TerminalMemberVariable memberName="rx" variableName="binary_in" variableKind="signal"/>
<Terminal name="inner" matchingRule="plug"/>
</Terminal></Terminals></fmiTerminalsAndIcons>"""
CHANGES = [
    ('causality="input" declaredType', 'causality="parameter" declaredType',
     ("variable", "u", "causality", "input", "parameter")),
    ('name="k" valueReference="3" causality="parameter" variability="tunable"',
     'name="k" valueReference="3" causality="parameter" variability="fixed"',
     ("variable", "k", "variability", "tunable", "fixed")),
    ('name="T" valueReference="4" causality="parameter" start="0.5"',
     'name="T" valueReference="4" causality="parameter" start="0.6"',
     ("variable", "T", "start", "0.5", "0.6")),
    ('max="5"', 'max="6"', ("variable", "u", "max", "5", "6")),
    ('start="0" unit="cm"', 'start="0" unit="m"', ("variable", "y", "unit", "cm", "m")),
    ('name="w" valueReference="9" causality="output"><Dimension start="3"',
     'name="w" valueReference="9" causality="output"><Dimension start="4"',
     ("variable", "w", "dimensions", "3", "4")),
    ('<Float32 name="float32_out"', '<Float64 name="float32_out"',
     ("variable", "float32_out", "type", "Float32", "Float64")),
    ('name="fault"', 'name="error"', ("variable", "fault", "there", "parameter, Int32", "-")),
    ('<Item name="fast" value="2"/>', '<Item name="fast" value="3"/>',
     ("variable", "mode_in", "items", "slow = 1, fast = 2", "slow = 1, fast = 3")),
    ('dependencies="8"', 'dependencies="1"', ("variable", "w", "depends on", "v", "u")),
    ('canSerializeFMUState="true"', "",
     ("capability", "CoSimulation", "canSerializeFMUState", "true", "-")),
    ('stepSize="0.1"', 'stepSize="0.2"', ("experiment", "", "stepSize", "0.10000000000000001",
                                          "0.20000000000000001")),
]  # fmt: skip


def fmu(path: Path, old: str = "", new: str = "", terminals: str = "") -> Path:
    """Write the archive of a model description in which one text is replaced."""
    text = XML.read_text()
    assert old in text
    changed = text.replace(old, new) if old else text
    members = {"modelDescription.xml": changed.encode()}
    if terminals:
        members["terminalsAndIcons/terminalsAndIcons.xml"] = terminals.encode()
    return write_archive(path, members)


@pytest.mark.parametrize(("old", "new", "found"), CHANGES, ids=[c[2][2] for c in CHANGES])
def test_each_changed_property_is_named_with_both_values(
    tmp_path: Path, old: str, new: str, found: tuple[str, ...]
) -> None:
    one, other = fmu(tmp_path / "a.fmu"), fmu(tmp_path / "b.fmu", old, new)
    differences = compare_interfaces(one, other)
    assert Difference(*found) in differences  # type: ignore[arg-type]
    others = {d.name for d in differences} - {found[1]}
    assert others <= {"level", "error"}, "an alias of y, and the new name of fault"
    back = compare_interfaces(other, one)
    topic, name, key, a, b = found
    assert Difference(topic, name, key, b, a) in back  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        ('canHandleVariableCommunicationStepSize="true"', "",
         ("capability", "CoSimulation", "canHandleVariableCommunicationStepSize", "true", "-")),
        ('name="minus_u" valueReference="0" causality="input" alias="negatedAlias"',
         'name="minus_u" valueReference="0" causality="input" alias="alias"',
         ("variable", "minus_u", "sign", "negated alias", "-")),
    ],
    ids=["capability", "sign"],
)  # fmt: skip
def test_capabilities_and_signs_of_fmi_1_are_compared(
    tmp_path: Path, old: str, new: str, found: tuple[str, ...]
) -> None:
    one = write_archive(tmp_path / "a.fmu", {"modelDescription.xml": XML1.read_bytes()})
    text = XML1.read_text()
    assert old in text
    changed = {"modelDescription.xml": text.replace(old, new).encode()}
    other = write_archive(tmp_path / "b.fmu", changed)
    assert compare_interfaces(one, other) == [Difference(*found)]  # type: ignore[arg-type]


def test_the_default_of_a_capability_of_fmi_1_is_no_difference(tmp_path: Path) -> None:
    old = ' canBeInstantiatedOnlyOncePerProcess="false"'
    text = XML1.read_text()
    files = [
        write_archive(tmp_path / f"{i}.fmu", {"modelDescription.xml": each.encode()})
        for i, each in enumerate((text, text.replace(old, "")))
    ]
    assert compare_interfaces(*files) == []


def test_equal_descriptions_do_not_differ(tmp_path: Path) -> None:
    assert compare_interfaces(fmu(tmp_path / "a.fmu"), fmu(tmp_path / "b.fmu")) == []


def test_the_default_of_a_capability_is_no_difference(tmp_path: Path) -> None:
    other = fmu(tmp_path / "b.fmu", 'canBeInstantiatedOnlyOncePerProcess="false"')
    assert compare_interfaces(fmu(tmp_path / "a.fmu"), other) == []


def test_a_unit_of_the_same_name_with_another_definition_differs(tmp_path: Path) -> None:
    other = fmu(tmp_path / "b.fmu", 'factor="0.01"', 'factor="0.1"')
    found = compare_interfaces(fmu(tmp_path / "a.fmu"), other)
    assert {(d.name, d.property) for d in found} == {(n, "unit") for n in ("u", "y", "level")}
    assert "0.1" in found[0].b
    assert "0.01" in found[0].a


def test_a_unit_of_another_name_with_the_same_definition_is_equal(tmp_path: Path) -> None:
    other = fmu(tmp_path / "b.fmu", '"cm"', '"centimetre"')
    assert compare_interfaces(fmu(tmp_path / "a.fmu"), other) == []


def test_terminals_are_compared_with_the_nested_ones(tmp_path: Path) -> None:
    one = fmu(tmp_path / "a.fmu", terminals=TERMINALS)
    other = fmu(tmp_path / "b.fmu", terminals=TERMINALS.replace("plug", "bus"))
    without = fmu(tmp_path / "c.fmu")
    assert compare_interfaces(one, other) == [
        Difference("terminal", "bus.inner", "matching rule", "plug", "bus")
    ]
    found = {(d.name, d.property, d.b) for d in compare_interfaces(one, without)}
    assert ("bus", "member rx", "-") in found
    assert ("bus.inner", "matching rule", "-") in found


def test_arrays_of_fmi_2_and_fmi_3_are_equal(declared: dict[str, Callable[[], Model]]) -> None:
    """Only the version, an attribute of FMI 2.0, one of FMI 3.0, and FMI 3.0's time differ."""
    two, three = (build_fmu(declared["linear"](), fmi=fmi) for fmi in (2, 3))
    found = [d for d in compare_interfaces(two, three) if d.topic == "variable"]
    assert [(d.name, d.a) for d in found] == [("time", "-")]


def test_the_command_has_the_status_of_diff(uuvsim: Uuvsim, tmp_path: Path) -> None:
    one, other = fmu(tmp_path / "a.fmu"), fmu(tmp_path / "b.fmu", 'max="5"', 'max="6"')
    assert uuvsim("fmu", "compare", str(one), str(one))[0] == 0
    status, out, _ = uuvsim("fmu", "compare", str(one), str(other), "--json")
    answer = json.loads(out)
    assert (status, answer["equal"]) == (1, False)
    assert answer["differences"] == [
        {"topic": "variable", "name": "u", "property": "max", "a": "5", "b": "6"}
    ]
    status, out, err = uuvsim("fmu", "compare", str(one), "none.fmu")
    assert status == 2
    assert "none.fmu" in err

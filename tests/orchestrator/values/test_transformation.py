"""Tables of values at connections and mappings: SSP's mappings of Booleans, integers and items."""

from pathlib import Path
from typing import Any, Literal

import pytest

from uuvsim_cosim.errors import ComponentFailed, InputInvalid, SystemInvalid
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.parameters.ssm import read_names
from uuvsim_cosim.orchestrator.parameters.ssp_xml import NAMESPACES
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.ssp.ssd import read_ssd, write_ssd
from uuvsim_cosim.orchestrator.system.system import System

GEARS = {"off": "slow", "on": "fast"}


def entries(kind: str, *pairs: tuple[str, str]) -> str:
    inner = "".join(f'<ssc:MapEntry source="{a}" target="{b}"/>' for a, b in pairs)
    return f"<ssc:{kind}MappingTransformation>{inner}</ssc:{kind}MappingTransformation>"


def gearbox(tmp_path: Path, value: str, mapping: str) -> System:
    names = " ".join(f'xmlns:{p}="{uri}"' for p, uri in NAMESPACES.items())
    path = tmp_path / "s.ssd"
    path.write_text(
        f'<ssd:SystemStructureDescription version="1.0" name="s" {names}><ssd:System name="s">'
        "<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet "
        f'version="1.0" name="p"><ssv:Parameters>{value}</ssv:Parameters><ssv:Enumerations>'
        '<ssc:Enumeration name="States"><ssc:Item name="off" value="0"/>'
        '<ssc:Item name="on" value="5"/></ssc:Enumeration></ssv:Enumerations></ssv:ParameterSet>'
        '</ssd:ParameterValues><ssd:ParameterMapping><ssm:ParameterMapping version="1.0">'
        f"{mapping}</ssm:ParameterMapping></ssd:ParameterMapping></ssd:ParameterBinding>"
        '</ssd:ParameterBindings><ssd:Elements><ssd:Component name="g" source="fake:gearbox"/>'
        "</ssd:Elements></ssd:System></ssd:SystemStructureDescription>"
    )
    return read_ssd(path)


def mapped(target: str, transformation: str) -> str:
    return f'<ssm:MappingEntry source="v" target="g.{target}">{transformation}</ssm:MappingEntry>'


def value(kind: str, text: str, more: str = "") -> str:
    return f'<ssv:Parameter name="v"><ssv:{kind} value="{text}"{more}/></ssv:Parameter>'


STATE = ' name="States"'
CASES = [
    ("on", value("Boolean", "false"), entries("Boolean", ("true", "0"), ("false", "1")), True),
    ("teeth", value("Integer", "7"), entries("Integer", ("7", "-70"), ("8", "1")), -70),
    ("gear", value("Integer", "7"), entries("Integer", ("7", "2")), 2),
    ("gear", value("Enumeration", "on", STATE), entries("Enumeration", ("on", "fast")), 2),
    ("gear", value("Enumeration", "on"), entries("Enumeration", ("on", "fast")), 2),
]


@pytest.mark.usefixtures("fake_sources")
@pytest.mark.parametrize(("target", "given", "table", "expected"), CASES)
def test_a_mapping_by_a_table_gives_the_parameter_what_it_says(
    tmp_path: Path, target: str, given: str, table: str, expected: Any
) -> None:
    system = gearbox(tmp_path, given, mapped(target, table))
    assert system.components["g"].start == {target: expected}


WRONG = [
    ("on", value("Boolean", "false"), entries("Boolean", ("true", "0")), "no entry; expected one"),
    ("on", value("Real", "1.0"), entries("Boolean", ("true", "0")), "expected true or false"),
    ("teeth", value("Boolean", "true"), entries("Integer", ("1", "2")), "a whole number, which"),
    ("teeth", value("Integer", "9"), entries("Integer", ("7", "2")), "'9', which has no entry"),
    ("teeth", value("Integer", "9"), entries("Integer", ("9", "2"), ("9", "3")), "one entry a so"),
    ("teeth", value("Integer", "9"), entries("Integer", ("9", "x")), "target 'x'; expected a whol"),
    ("on", value("Boolean", "true"), entries("Boolean", ("yes", "1")), "source 'yes'; expected tr"),
    ("on", value("Boolean", "true"), entries("Boolean"), "without entries"),
    ("gear", value("Enumeration", "on"), entries("Enumeration", ("no", "fast")), "no entry; expec"),
    ("gear", value("Enumeration", "on"), entries("Enumeration", ("on", "fest")), "slow', 'fast'"),
    ("on", value("Boolean", "true"), entries("String", ("a", "b")), "expected none, or one of Lin"),
]


@pytest.mark.usefixtures("fake_sources")
@pytest.mark.parametrize(("target", "given", "table", "said"), WRONG)
def test_a_mistake_in_a_table_is_named(
    tmp_path: Path, target: str, given: str, table: str, said: str
) -> None:
    with pytest.raises(SystemInvalid, match=said):
        gearbox(tmp_path, given, mapped(target, table))


@pytest.mark.usefixtures("fake_sources")
@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("nested", [False, True])
def test_a_table_at_a_connection_survives_the_file(
    tmp_path: Path, version: Literal["1.0", "2.0"], nested: bool
) -> None:
    system = System("s").add("a", "fake:gearbox").add("b", "fake:gearbox")
    if nested:
        inner = System("i").add("g", "fake:gearbox").expose("mode", "g.mode")
        system = System("s").add("a", "fake:gearbox").add("b", inner)
    system = system.connect("a.state", "b.mode", table=GEARS)
    write_ssd(system, tmp_path / "s.ssd", version)
    again = read_ssd(tmp_path / "s.ssd")
    assert again.connections == system.connections
    (transfer,) = flatten(again).transfers
    assert transfer.table == ((0, 1), (5, 2))
    assert transfer == flatten(system).transfers[0]


@pytest.mark.usefixtures("fake_sources")
@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"of": "slow"}, "item 'of' of state in a table; expected an item of its en"),
        ({"off": "fat"}, "item 'fat' of mode in a table; expected an item"),
        ({True: False}, "a table of Booleans at state of type Enumeration; expected type Boolean"),
    ],
)
def test_a_table_that_does_not_fit_its_connectors_is_refused(table: Any, said: str) -> None:
    system = System("s").add("a", "fake:gearbox").add("b", "fake:gearbox")
    with pytest.raises(SystemInvalid, match=said):
        system.connect("a.state", "b.mode", table=table).validate()


@pytest.mark.parametrize("table", [{}, {1.5: 2}, {True: 1}, {"a": 2}])
def test_a_table_of_other_values_is_refused(table: Any) -> None:
    with pytest.raises(InputInvalid, match="expected Booleans, integers, or names of items"):
        System("s").connect("a.x", "b.y", table=table)


def test_a_mapping_of_names_has_no_table(tmp_path: Path) -> None:
    path = tmp_path / "names.ssm"
    names = " ".join(f'xmlns:{p}="{uri}"' for p, uri in NAMESPACES.items())
    path.write_text(
        f'<ssm:ParameterMapping version="1.0" {names}>'
        f"{mapped('on', entries('Boolean', ('true', 'false')))}</ssm:ParameterMapping>"
    )
    with pytest.raises(InputInvalid, match="a table of values; expected names only"):
        read_names(path)


# ---- stepping -----------------------------------------------------------------------------------


def pair(fmu: Path) -> System:
    system = System("s", "0.1").add("a", str(fmu)).add("b", str(fmu))
    system = system.connect("a.boolean_out", "b.boolean_in", table={True: False, False: True})
    return system.connect("a.int32_out[1]", "b.int32_in[2]", table={0: 3, 4: -7})


def running(system: System) -> Master:
    plan = flatten(system)
    return Master(plan, prepare(plan))


def test_values_go_through_the_tables_in_initialization_and_in_stepping(
    first_order_fmi3: Path,
) -> None:
    with running(pair(first_order_fmi3)) as master:
        master.initialize()
        assert master.get("b", "boolean_in") is True
        assert list(master.get("b", "int32_in")) == [0, 3]
        master.set("a", "boolean_in", True)
        master.set("a", "int32_in", [4, 0])
        master.step(3)
        assert master.get("b", "boolean_in") is False
        assert list(master.get("b", "int32_in")) == [0, -7]
        master.reset()
        assert master.get("b", "boolean_in") is True


def test_a_value_without_an_entry_ends_the_run_by_name(first_order_fmi3: Path) -> None:
    with running(pair(first_order_fmi3)) as master:
        master.initialize()
        master.set("a", "int32_in", [5, 0])
        with pytest.raises(ComponentFailed, match=r"int32_in\[2\] has no entry in its table"):
            master.step(3)
    system = System("s", "0.1").add("a", str(first_order_fmi3)).add("b", str(first_order_fmi3))
    system = system.connect("a.int32_out[1]", "b.int32_in[2]", table={4: -7})
    with running(system) as master, pytest.raises(InputInvalid, match="0 has no entry"):
        master.initialize()

"""What other tools write in an SSD: their steps, dictionaries, bindings, borders, and mistakes."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.errors import InputInvalid, SystemInvalid, UuvsimError
from uuvsim_cosim.orchestrator.parameters.ssp_xml import NAMESPACES
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.orchestrator.ssp.ssd import format_ssd, read_ssd, write_ssd
from uuvsim_cosim.orchestrator.ssp.ssp import read_ssp, write_archive
from uuvsim_cosim.orchestrator.system.elements import Connection
from uuvsim_cosim.orchestrator.system.system import System

Read = Callable[..., System]
Reading = tuple[float, float, str]

OSP = (
    '<ssd:DefaultExperiment><ssd:Annotations><ssc:Annotation type="com.opensimulationplatform">'
    '<osp:Algorithm><osp:FixedStepAlgorithm baseStepSize="{}"/></osp:Algorithm></ssc:Annotation>'
    "</ssd:Annotations></ssd:DefaultExperiment>"
)
OMS = (
    '<ssc:Annotation type="org.openmodelica"><oms:Annotations><oms:SimulationInformation>'
    '<oms:FixedStepMaster description="oms-ma" stepSize="{}" relativeTolerance="1e-4"/>'
    "</oms:SimulationInformation></oms:Annotations></ssc:Annotation>"
)
OURS = '<ssc:Annotation type="org.uuvsim.cosim"><uuvsim:System tick="{}"/></ssc:Annotation>'
HINT = (
    '<ssd:Annotations><ssc:Annotation type="com.opensimulationplatform">'
    '<osp:StepSizeHint value="{}"/></ssc:Annotation></ssd:Annotations>'
)
FILTERS = (
    '<ssd:Component name="a" source="fake:filter"/><ssd:Component name="b" source="fake:filter"/>'
)


def ssd(elements: str, connections: str = "", top: str = "", tail: str = "") -> str:
    """Write a document: `top` ends the system, `tail` the document."""
    names = " ".join(f'xmlns:{p}="{uri}"' for p, uri in NAMESPACES.items())
    connected = f"<ssd:Connections>{connections}</ssd:Connections>" if connections else ""
    return (
        f'<ssd:SystemStructureDescription version="1.0" name="s" {names}><ssd:System name="s">'
        f"{elements}{connected}{top}</ssd:System>{tail}</ssd:SystemStructureDescription>"
    )


def inside(elements: str) -> str:
    return f"<ssd:Elements>{elements}</ssd:Elements>"


def wire(start: str, end: str, inner: str = "", **more: str) -> str:
    ends = {}
    for side, text in (("start", start), ("end", end)):
        element, _, connector = text.rpartition(".")
        ends.update({f"{side}Element": element} if element else {})
        ends[f"{side}Connector"] = connector
    attributes = " ".join(f'{k}="{v}"' for k, v in {**ends, **more}.items())
    return f"<ssd:Connection {attributes}>{inner}</ssd:Connection>"


def linear(factor: float, offset: float = 0.0) -> str:
    return f'<ssc:LinearTransformation factor="{factor}" offset="{offset}"/>'


def connectors(*named: str, unit: str = "m") -> str:
    items = "".join(
        f'<ssd:Connector name="{n}" kind="{k}"><ssc:Real unit="{unit}"/></ssd:Connector>'
        for n, k in (x.split(":") for x in named)
    )
    return f"<ssd:Connectors>{items}</ssd:Connectors>"


@pytest.fixture
def read(tmp_path: Path) -> Read:
    def reader(text: str, tick: str | None = None, name: str = "x.ssd") -> System:
        (tmp_path / name).write_text(text)
        return read_ssd(tmp_path / name, tick)

    return reader


# ---- steps --------------------------------------------------------------------------------------


@pytest.mark.parametrize("version", ["1.0", "2.0"])
def test_the_step_is_written_for_each_of_three_tools(version: Any, tmp_path: Path) -> None:
    system = System("s", "1/60").add("a", "fake:filter", rate="1/30")
    text = format_ssd(system, version).decode()
    assert 'tick="1/60"' in text
    assert 'baseStepSize="0.016666666666666666"' in text
    assert 'stepSize="0.016666666666666666"' in text
    assert '<osp:StepSizeHint value="0.03333333333333333" />' in text
    write_ssd(system, tmp_path / "x.ssd", version)
    assert read_ssd(tmp_path / "x.ssd").notes == ()


@pytest.mark.parametrize(
    ("own", "oms", "osp", "step", "said"),
    [
        ("0.01", "", "", "1/100", 0),
        ("", "1.0E-5", "", "1/100000", 0),
        ("", "", "1e-4", "1/10000", 0),
        ("", "0.02", "0.01", "1/100", 1),
        ("0.05", "0.02", "0.01", "1/20", 2),
        ("0.05", "0.050000", "5e-2", "1/20", 0),
        ("", "", "", "1/4", 0),
    ],
)
def test_of_the_steps_of_three_tools_the_first_is_taken_and_the_others_are_compared(
    read: Read, own: str, oms: str, osp: str, step: str, said: int
) -> None:
    notes = (OURS.format(own) if own else "") + (OMS.format(oms) if oms else "")
    top = f"<ssd:Annotations>{notes}</ssd:Annotations>"
    system = read(ssd(inside(FILTERS), "", top, OSP.format(osp) if osp else ""), tick="0.25")
    assert str(system.tick) == step
    assert len([n for n in system.notes if "is used" in n]) == said


def test_a_hint_is_a_components_step_in_whole_ticks(read: Read) -> None:
    text = FILTERS.replace('source="fake:filter"/>', 'source="fake:filter">' + HINT.format("0.02")
                           + "</ssd:Component>", 1)  # fmt: skip
    system = read(ssd(inside(text), "", "", OSP.format("0.01")))
    assert str(system.components["a"].rate) == "1/50"
    system = read(ssd(inside(text.replace("0.02", "0.0203")), "", "", OSP.format("0.01")))
    assert str(system.components["a"].rate) == "1/50"
    assert "no multiple of 0.01 s: 0.02 s is used" in system.notes[0]


def test_a_nested_system_without_a_step_has_that_of_the_one_around_it(read: Read) -> None:
    inner = f'<ssd:System name="i">{inside(FILTERS)}</ssd:System>'
    system = read(ssd(inside(inner), "", "", OSP.format("0.1")))
    assert {c.step_ticks for c in flatten(system).components} == {1}


# ---- signal dictionaries ------------------------------------------------------------------------


def dictionary(*entries: str, name: str = "bus") -> str:
    items = "".join(
        f'<ssb:DictionaryEntry name="{n}"><ssc:Real{f" unit={u!r}" if u else ""}/>'
        "</ssb:DictionaryEntry>"
        for n, _, u in (e.partition(":") for e in entries)
    )
    return (
        f'<ssd:SignalDictionaries><ssd:SignalDictionary name="{name}">'
        f'<ssb:SignalDictionary version="1.0">{items}</ssb:SignalDictionary>'
        "</ssd:SignalDictionary></ssd:SignalDictionaries>"
    )


REFERENCE = '<ssd:SignalDictionaryReference name="r" dictionary="bus"/>'


def test_a_dictionary_joins_what_writes_an_entry_to_what_reads_it(read: Read) -> None:
    wires = wire("a.y", "r.depth") + wire("r.depth", "b.u")
    declared = (
        f'<ssd:Component name="a" source="fake:filter">{connectors("y:output")}</ssd:Component>'
        f'<ssd:Component name="b" source="fake:filter">{connectors("u:input")}</ssd:Component>'
        '<ssd:SignalDictionaryReference name="r" dictionary="bus">'
        f"{connectors('depth:inout')}</ssd:SignalDictionaryReference>"
    )
    system = read(ssd(inside(declared), wires, dictionary("depth:cm")))
    assert system.connections == (Connection("a.y", "b.u"),)


def test_transformations_on_both_sides_of_a_dictionary_act_in_its_unit(read: Read) -> None:
    wires = wire("a.y", "r.depth", linear(2.0, 1.0)) + wire("r.depth", "b.u", linear(3.0, 0.5))
    system = read(ssd(inside(FILTERS + REFERENCE), wires, dictionary("depth:km")))
    (found,) = system.connections
    # 5 m are 0.005 km, 2 · 0.005 + 1 = 1.01 km at the entry, 1010 m, 3 · 1010 + 0.5 m at the end
    assert found.factor * 5.0 + found.offset == pytest.approx(3030.5, rel=1e-12)
    assert not found.convert


def test_a_dictionary_reaches_into_nested_systems(read: Read, tmp_path: Path) -> None:
    writer = (
        f'<ssd:System name="w">{inside(FILTERS + REFERENCE)}'
        f"<ssd:Connections>{wire('a.y', 'r.depth')}</ssd:Connections></ssd:System>"
    )
    reader = writer.replace('"w"', '"v"').replace(wire("a.y", "r.depth"), wire("r.depth", "b.u"))
    outer = f'<ssd:System name="deep">{inside(reader)}</ssd:System>'
    text = ssd(inside(writer + outer + FILTERS + REFERENCE), wire("r.depth", "a.u"),
               dictionary("depth"))  # fmt: skip
    plan = flatten(read(text))
    names = [c.path for c in plan.components]
    moved = {(names[t.source], names[t.target]) for t in plan.transfers}
    assert moved == {("w.a", "deep.v.b"), ("w.a", "a")}


def test_a_dictionary_may_be_a_file_of_its_own(read: Read, tmp_path: Path) -> None:
    (tmp_path / "bus.ssb").write_text(
        '<ssb:SignalDictionary version="1.0"><ssb:DictionaryEntry name="depth"/>'
        "</ssb:SignalDictionary>"
    )
    top = (
        '<ssd:SignalDictionaries><ssd:SignalDictionary name="bus" source="bus.ssb"/>'
        "</ssd:SignalDictionaries>"
    )
    wires = wire("a.y", "r.depth") + wire("r.depth", "b.u")
    system = read(ssd(inside(FILTERS + REFERENCE), wires, top))
    assert system.connections == (Connection("a.y", "b.u"),)


def test_elements_of_an_entry_are_joined_one_by_one(read: Read) -> None:
    parts = FILTERS + REFERENCE + '<ssd:Component name="w" source="fake:wrench"/>'
    thrusters = "".join(f'<ssd:Component name="t{i}" source="fake:thruster"/>' for i in (1, 2))
    wires = "".join(wire(f"t{i}.thrust", "r.all", endIndices=str(i)) for i in (1, 2))
    system = read(ssd(inside(parts + thrusters), wires + wire("r.all", "w.thrust"),
                      dictionary("all")))  # fmt: skip
    assert set(system.connections) == {
        Connection("t1.thrust", "w.thrust[1]"),
        Connection("t2.thrust", "w.thrust[2]"),
    }


@pytest.mark.parametrize(
    ("wires", "top", "said"),
    [
        (wire("a.y", "r.x") + wire("r.x", "b.u"), dictionary("y"), "no entry 'x'; expected"),
        (wire("a.y", "r.x"), "", "no signal dictionary 'bus'"),
        (
            wire("a.y", "r.x") + wire("b.y", "r.x") + wire("r.x", "b.u"),
            dictionary("x"),
            "written by a.y and b.y; expected one output",
        ),
        (wire("r.x", "r.y"), dictionary("x", "y"), "between two dictionaries"),
        (wire("a.y", "r.x") + wire("r.x", "b.u", linear(2)), dictionary("x:kg"),
         "unit 'm' to unit 'kg'"),
    ],
)  # fmt: skip
def test_a_mistake_at_a_dictionary_is_named(read: Read, wires: str, top: str, said: str) -> None:
    with pytest.raises(SystemInvalid, match=said):
        read(ssd(inside(FILTERS + REFERENCE), wires, top))


def test_an_entry_that_nothing_writes_is_said(read: Read) -> None:
    system = read(ssd(inside(FILTERS + REFERENCE), wire("r.x", "b.u"), dictionary("x")))
    assert "nothing writes 'x'" in " ".join(system.notes)


# ---- the border of a nested system --------------------------------------------------------------


@pytest.mark.parametrize(
    ("outer", "inner", "unit", "expected"),
    [
        ("", linear(2, 1), "m", 2 * 5 + 1),
        (linear(3, 4), linear(2, 1), "m", 2 * (3 * 5 + 4) + 1),
        (linear(3, 4), linear(2, 1), "km", 2 * 1000 * (3 * 0.005 + 4) + 1),
        (linear(3, 4), "", "m", 3 * 5 + 4),
    ],
)
def test_a_transformation_at_a_systems_own_connector_acts_on_what_is_outside(
    read: Read, outer: str, inner: str, unit: str, expected: float
) -> None:
    nested = (
        f'<ssd:System name="i">{connectors("v:input", unit=unit)}{inside(FILTERS)}'
        f"<ssd:Connections>{wire('v', 'a.u', inner)}</ssd:Connections></ssd:System>"
    )
    system = read(ssd(inside(nested + FILTERS), wire("b.y", "i.v", outer)))
    (transfer,) = flatten(system).transfers
    assert transfer.factor * 5.0 + transfer.offset == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("wires", "said"),
    [
        (wire("u", "y"), "both are connectors of the system"),
        (wire("a.y", "b.u", "<ssc:CubicTransformation/>"), "expected none, or one of Linear"),
        (wire("a.y", "b.u", '<ssc:LinearTransformation factor="x"/>'), "factor 'x'; expected"),
        (wire("a.y", "b.u", startIndices="one"), "startIndices 'one'; expected whole numbers"),
        ('<ssd:Connection startElement="a" endConnector="u"/>', "no startConnector"),
        (wire("v", "a.u", linear(2)) + wire("v", "b.u"), "the same at each"),
    ],
)
def test_a_connection_that_means_nothing_is_refused(read: Read, wires: str, said: str) -> None:
    with pytest.raises(SystemInvalid, match=said):
        read(ssd(inside(FILTERS), wires))


# ---- parameter bindings -------------------------------------------------------------------------


def binding(values: str, mapping: str = "", **more: str) -> str:
    attributes = "".join(f' {k}="{v}"' for k, v in more.items())
    mapped = (
        f'<ssd:ParameterMapping><ssm:ParameterMapping version="1.0">{mapping}'
        "</ssm:ParameterMapping></ssd:ParameterMapping>"
    )
    return (
        f"<ssd:ParameterBindings><ssd:ParameterBinding{attributes}><ssd:ParameterValues>"
        f'<ssv:ParameterSet version="1.0" name="p"><ssv:Parameters>{values}</ssv:Parameters>'
        f"</ssv:ParameterSet></ssd:ParameterValues>{mapped if mapping else ''}"
        "</ssd:ParameterBinding></ssd:ParameterBindings>"
    )


def real(name: str, value: float, unit: str = "") -> str:
    given = f' unit="{unit}"' if unit else ""
    return f'<ssv:Parameter name="{name}"><ssv:Real value="{value}"{given}/></ssv:Parameter>'


HULL = '<ssd:Component name="hull" source="fake:hull"/>'


def test_a_prefix_comes_before_the_mapping(read: Read) -> None:
    entry = '<ssm:MappingEntry source="hull.m" target="hull.mass"/>'
    system = read(ssd(binding(real("m", 3), entry, prefix="hull.") + inside(HULL)))
    assert system.components["hull"].start == {"mass": 3.0}


def test_a_mapping_transforms_after_the_unit_is_converted(read: Read) -> None:
    entry = (
        '<ssm:MappingEntry source="m" target="hull.mass">' + linear(2, 1) + "</ssm:MappingEntry>"
    )
    system = read(ssd(binding(real("m", 3000, "g"), entry) + inside(HULL)))
    assert system.components["hull"].start == {"mass": pytest.approx(7.0)}
    bare = entry.replace('target="hull.mass"', 'target="hull.mass" suppressUnitConversion="true"')
    system = read(ssd(binding(real("m", 3, "g"), bare) + inside(HULL)))
    assert system.components["hull"].start == {"mass": 7.0}


def test_a_binding_further_out_takes_priority(read: Read) -> None:
    hull = HULL.replace("/>", f">{binding(real('mass', 1))}</ssd:Component>")
    inner = f'<ssd:System name="i">{binding(real("hull.mass", 2))}{inside(hull)}</ssd:System>'
    system = read(ssd(inside(inner)))
    assert system.nested("i").components["hull"].start == {"mass": 2.0}
    system = read(ssd(binding(real("i.hull.mass", 3)) + inside(inner)))
    assert system.nested("i").components["hull"].start == {"mass": 3.0}


def test_a_binding_may_name_a_connector_of_a_system(read: Read) -> None:
    inner = (
        f'<ssd:System name="i">{connectors("p:parameter", unit="kg")}{inside(HULL)}'
        f"<ssd:Connections>{wire('p', 'hull.mass')}</ssd:Connections></ssd:System>"
    )
    system = read(ssd(binding(real("i.p", 4)) + inside(inner)))
    assert system.nested("i").components["hull"].start == {"mass": 4.0}
    system = read(
        ssd(inside(inner.replace("<ssd:Elements>", binding(real("p", 5)) + "<ssd:Elements>")))
    )
    assert system.nested("i").components["hull"].start == {"mass": 5.0}


def test_a_binding_reaches_into_a_system_in_a_file(read: Read, tmp_path: Path) -> None:
    write_ssd(System("i").add("hull", "fake:hull"), tmp_path / "inner.ssd")
    item = '<ssd:Component name="i" source="inner.ssd" type="application/x-ssp-definition"/>'
    system = read(ssd(binding(real("i.hull.mass", 6)) + inside(item)))
    assert system.nested("i").components["hull"].start == {"mass": 6.0}


def test_an_item_of_an_enumeration_is_its_number(read: Read) -> None:
    order = '<ssv:Parameter name="order"><ssv:Enumeration value="{}" name="E"/></ssv:Parameter>'
    tail = (
        '<ssd:Enumerations><ssc:Enumeration name="E"><ssc:Item name="low" value="1"/>'
        '<ssc:Item name="high" value="4"/></ssc:Enumeration></ssd:Enumerations>'
    )
    c = f'<ssd:Component name="c" source="fake:controller">{binding(order)}</ssd:Component>'
    system = read(ssd(inside(c.format("high")), "", "", tail))
    assert system.components["c"].start == {"order": 4}
    with pytest.raises(SystemInvalid, match=r"'hgih' is the item of 0 enumerations.*such as high"):
        read(ssd(inside(c.format("hgih")), "", "", tail))


@pytest.mark.parametrize(
    ("values", "more", "said"),
    [
        ('<ssv:Parameter name="mass"><ssv:Real value="x"/></ssv:Parameter>', {}, "'x'; expected a"),
        (real("mass", 1), {"type": "text/csv"}, "type 'text/csv'; expected 'application/x-ssp-par"),
        (real("mass", 1), {"source": "p.ssv"}, "p.ssv: No such file"),
        (real("mass", 1), {"source": "p.ssv", "sourceBase": "component"}, "'component' inside an"),
        (real("maas", 1), {}, "no variable 'maas' in hull; expected .* such as mass"),
    ],
)
def test_a_mistake_in_a_binding_is_named(
    read: Read, values: str, more: dict[str, str], said: str
) -> None:
    hull = HULL.replace("/>", f">{binding(values, **more)}</ssd:Component>")
    with pytest.raises(SystemInvalid, match=said) as error:
        read(ssd(inside(hull)))
    assert all(p.place.startswith("x.ssd: ") for p in error.value.problems)


# ---- elements -----------------------------------------------------------------------------------


def test_a_system_of_the_file_may_be_used_again_by_its_id(read: Read) -> None:
    first = f'<ssd:System name="i" id="vehicle">{inside(HULL)}</ssd:System>'
    again = (
        f'<ssd:Component name="j" source="#vehicle">{binding(real("hull.mass", 7))}</ssd:Component>'
    )
    system = read(ssd(inside(first + again)))
    assert system.nested("j").components["hull"].start == {"mass": 7.0}
    assert system.nested("i").components["hull"].start == {}
    with pytest.raises(SystemInvalid, match="source '#ship', unknown"):
        read(ssd(inside(first + again.replace("#vehicle", "#ship"))))


def test_a_system_that_holds_itself_is_refused(read: Read) -> None:
    loop = '<ssd:Component name="j" source="#i"/>'
    with pytest.raises(SystemInvalid, match="part of"):
        read(ssd(inside(f'<ssd:System name="i" id="i">{inside(loop)}</ssd:System>')))


def test_prefixes_without_a_namespace_are_taken_as_those_of_ssp(read: Read, tmp_path: Path) -> None:
    text = ssd(inside(FILTERS), "", "", OSP.format("0.1"))
    system = read(text.replace(f'xmlns:osp="{NAMESPACES["osp"]}"', ""))
    assert str(system.tick) == "1/10"
    assert "prefix osp without a namespace" in system.notes[0]
    with pytest.raises(InputInvalid, match="unbound prefix"):
        read(text.replace("ssd:Elements", "other:Elements"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('<ssd:Component name="a"/>', "a: no source; expected an FMU"),
        ('<ssd:Component name="a" source="x.mo" type="text/x-modelica"/>', "x.mo"),
        ('<ssd:Component name="a" source="fake:filter" implementation="Sequential"/>',
         "implementation 'Sequential'"),
        (f'<ssd:Component name="a" source="fake:filter">{HINT.format("soon")}</ssd:Component>',
         "step 'soon'; expected seconds"),
        (f'<ssd:Component name="a" source="fake:filter">{HINT.format("0")}</ssd:Component>',
         "step of 0 s; expected more than 0"),
    ],
)  # fmt: skip
def test_a_component_that_cannot_be_is_named(read: Read, text: str, said: str) -> None:
    with pytest.raises(SystemInvalid, match=said):
        read(ssd(inside(text)))


@pytest.mark.parametrize(
    "unit",
    [
        '<ssc:Unit name="x"><ssc:BaseUnit m="one"/></ssc:Unit>',
        '<ssc:Unit name="x"><ssc:BaseUnit m="1" factor="nan"/></ssc:Unit>',
        '<ssc:Unit name="x"><ssc:BaseUnit m="1" factor="0"/></ssc:Unit>',
    ],
)
def test_a_wrong_unit_is_one_sentence(read: Read, unit: str) -> None:
    with pytest.raises(UuvsimError, match="<ssc:Unit name='x'>"):
        read(ssd(inside(FILTERS), "", "", f"<ssd:Units>{unit}</ssd:Units>"))


# ---- variants -----------------------------------------------------------------------------------


def test_a_variant_is_read_by_its_name_with_or_without_its_ending(tmp_path: Path) -> None:
    one, two = (System(n).add("a", "fake:filter") for n in ("one", "two"))
    members = {"SystemStructure.ssd": format_ssd(one), "Heavy.ssd": format_ssd(two)}
    write_archive(members, tmp_path / "x.ssp")
    assert load(tmp_path / "x.ssp").name == "one"
    assert load(f"{tmp_path / 'x.ssp'}#Heavy").name == "two"
    assert read_ssp(tmp_path / "x.ssp", "Heavy.ssd").name == "two"
    with pytest.raises(UuvsimError, match=r"no variant 'Haevy'.*such as Heavy"):
        load(f"{tmp_path / 'x.ssp'}#Haevy")


def test_a_variant_of_a_package_may_be_a_nested_system(read: Read, tmp_path: Path) -> None:
    inner = System("i").add("hull", "fake:hull")
    members = {"SystemStructure.ssd": format_ssd(System("o").add("a", "fake:filter")),
               "B.ssd": format_ssd(inner)}  # fmt: skip
    write_archive(members, tmp_path / "sub.ssp")
    system = read(ssd(inside('<ssd:Component name="v" source="sub.ssp#B.ssd"/>')))
    assert list(system.nested("v").components) == ["hull"]


def test_a_value_of_a_connector_that_leads_to_nothing_is_said(read: Read) -> None:
    idle = connectors("C1:input")
    inner = f'<ssd:System name="i">{idle}{binding(real("C1", 1))}{inside(FILTERS)}</ssd:System>'
    outer = f'<ssd:System name="o">{inside(inner)}</ssd:System>'
    system = read(ssd(binding(real("o.i.C1", 2)) + inside(outer)))
    assert "value of 'o.i.C1', a connector that is not connected" in " ".join(system.notes)
    assert "value of 'C1' belongs to no component" in " ".join(system.notes)


def test_a_start_time_is_where_a_run_begins(read: Read) -> None:
    tail = OSP.format("0.1").replace(
        "<ssd:DefaultExperiment", '<ssd:DefaultExperiment startTime="10"'
    )
    system = read(ssd(inside(FILTERS), "", "", tail))
    assert system.start_time == 10.0
    assert flatten(system).start == 10
    assert 'startTime="10.0"' in format_ssd(system).decode()


def test_the_default_experiment_says_where_a_run_ends(read: Read, tmp_path: Path) -> None:
    tail = '<ssd:DefaultExperiment startTime="0" stopTime="2.5"/>'
    system = read(ssd(inside(FILTERS), tail=tail))
    assert system.stop_time == 2.5
    write_ssd(system, tmp_path / "again.ssd")
    assert read_ssd(tmp_path / "again.ssd") == system
    assert read(ssd(inside(FILTERS))).stop_time is None


def test_a_proxy_is_read_as_its_file(first_order_fmi2: Path, tmp_path: Path) -> None:
    (tmp_path / "x.fmu").write_bytes(first_order_fmi2.read_bytes())
    uri = "proxyfmu://{}?file=x.fmu"
    file = tmp_path / "s.ssd"
    file.write_text(ssd(inside(f'<ssd:Component name="a" source="{uri.format("localhost")}"/>')))
    system = read_ssd(file)
    assert system.components["a"].source == "x.fmu"
    assert any("the file of proxyfmu is read" in note for note in system.notes)
    file.write_text(ssd(inside(f'<ssd:Component name="a" source="{uri.format("elsewhere")}"/>')))
    with pytest.raises(SystemInvalid, match="nothing is run on other machines") as raised:
        read_ssd(file)
    assert len(raised.value.problems) == 1


def test_an_item_is_found_in_the_enumeration_of_its_variable(
    first_order_fmi2: Path, tmp_path: Path
) -> None:
    (tmp_path / "x.fmu").write_bytes(first_order_fmi2.read_bytes())
    value = (
        "<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet "
        'version="1.0" name="p"><ssv:Parameters><ssv:Parameter name="mode"><ssv:Enumeration '
        'value="{}"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues>'
        "</ssd:ParameterBinding></ssd:ParameterBindings>"
    )
    component = '<ssd:Component name="a" source="x.fmu">{}</ssd:Component>'
    file = tmp_path / "s.ssd"
    file.write_text(ssd(inside(component.format(value.format("fast")))))
    assert read_ssd(file).components["a"].start == {"mode": 2}
    file.write_text(ssd(inside(component.format(value.format("fastest")))))
    with pytest.raises(SystemInvalid, match="an item of its enumeration, 'slow', 'fast'"):
        read_ssd(file)

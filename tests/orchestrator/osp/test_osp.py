"""OspSystemStructure.xml: what libcosim runs is read, and means the same."""

import dataclasses
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uuvsim_cosim as uv
from uuvsim_cosim.errors import InputInvalid, SystemInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import PlannedComponent
from uuvsim_cosim.orchestrator.ssp.ssp import pack
from uuvsim_cosim.orchestrator.system.elements import Connection, StepGroup
from uuvsim_cosim.orchestrator.system.resolve import resolve
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.orchestrator.system.variable_step import PowerBond, VariableStep

Write = Callable[..., Path]

GROUPS = """<OspModelDescription xmlns="https://open-simulation-platform.com/OspModelDescription/1.0.1"
 version="1.0"><UnitDefinitions/><VariableGroups>
  <Generic name="out"><Variable ref="y"/></Generic>
  <Generic name="in"><Variable ref="u" unit="N"/></Generic>
  <LinearMechanicalPort name="a port">
    <Force name="force"><Variable ref="y"/></Force>
    <LinearVelocity name="velocity"><Variable ref="u"/></LinearVelocity></LinearMechanicalPort>
  <LinearMechanicalPort name="the other port">
    <Force name="other force"><Variable ref="u"/></Force>
    <LinearVelocity name="other velocity"><Variable ref="y"/></LinearVelocity>
  </LinearMechanicalPort>
  <Generic name="three out"><Variable ref="w[1]"/><Variable ref="w[2]"/><Variable ref="w[3]"/>
  </Generic>
  <Generic name="three in"><Variable ref="v[1]"/><Variable ref="v[2]"/><Variable ref="v[3]"/>
  </Generic>
</VariableGroups></OspModelDescription>"""

NAMES = ("a", "b", "c")


@pytest.fixture
def osp(tmp_path: Path, first_order_fmi2: Path) -> Write:
    """Write a system of three first-order FMUs, with the given parts."""
    shutil.copy(first_order_fmi2, tmp_path / "first.fmu")
    (tmp_path / "first_order_OspModelDescription.xml").write_text(GROUPS)

    def write(
        connections: str = "",
        functions: str = "",
        head: str = "<BaseStepSize>0.01</BaseStepSize><Algorithm>fixedStep</Algorithm>",
        edit: tuple[str, str] = ("", ""),
        tail: str = "",
    ) -> Path:
        simulators = "".join(
            f'<Simulator name="{n}" source="first.fmu"><InitialValues>'
            f'<InitialValue variable="k"><Real value="{i}"/></InitialValue>'
            "</InitialValues></Simulator>"
            for i, n in enumerate(NAMES, 1)
        )
        functions = f"<Functions>{functions}</Functions>" if functions else ""
        text = (
            '<?xml version="1.0" encoding="utf-8"?><OspSystemStructure version="0.1" '
            'xmlns="http://opensimulationplatform.com/MSMI/OSPSystemStructure">'
            f"{head}<Simulators>{simulators}</Simulators>{functions}"
            f"<Connections>{connections}</Connections>{tail}</OspSystemStructure>"
        )
        assert edit[0] in text
        path = tmp_path / "OspSystemStructure.xml"
        path.write_text(text.replace(*edit))
        return path

    return write


def joined(a: str, b: str, kind: str = "Variable", **more: str) -> str:
    attributes = "".join(f' {k}="{v}"' for k, v in more.items())
    ends = "".join(
        f'<{kind} simulator="{s}" name="{n}"/>' for s, n in (a.split(".", 1), b.split(".", 1))
    )
    return f"<{kind}Connection{attributes}>{ends}</{kind}Connection>"


def signal(variable: str, signal: str, group: str = "") -> str:
    (s, n), (f, m) = variable.split(".", 1), signal.split(".", 1)
    return (
        f'<Signal{group}Connection><Variable{group} simulator="{s}" name="{n}"/>'
        f'<Signal{group} function="{f}" name="{m}"/></Signal{group}Connection>'
    )


def instantiate(planned: PlannedComponent) -> Component:
    return resolve(planned.source).instantiate(planned.path)


def trajectory(system: System, steps: int = 50) -> dict[str, list[float]]:
    found: dict[str, list[float]] = {n: [] for n in NAMES}
    with Master(flatten(system), instantiate) as master:
        master.initialize()
        for _ in range(steps):
            master.step(1)
            for n in NAMES:
                found[n].append(float(master.get(n, "y")))
    return found


def test_a_connection_leads_from_the_output_whichever_is_named_first(osp: Write) -> None:
    system = uv.load(osp(joined("a.y", "b.u") + joined("c.u", "b.y")))
    assert system.connections == (Connection("a.y", "b.u"), Connection("b.y", "c.u"))
    assert system.components["b"].start == {"k": 2.0}
    assert str(system.tick) == "1/100"


def test_groups_are_joined_in_order_and_inside_each_other(osp: Write) -> None:
    ports = joined("a.a port", "b.the other port", "VariableGroup")
    three = joined("a.three out", "c.three in", "VariableGroup")
    system = uv.load(osp(ports + three))
    assert set(system.connections) == {
        Connection("a.y", "b.u"),
        Connection("b.y", "a.u"),
        Connection("a.w", "c.v"),
    }


def test_a_group_inside_a_group_is_found_by_its_name(osp: Write) -> None:
    system = uv.load(osp(joined("a.force", "b.other force", "VariableGroup")))
    assert system.connections == (Connection("a.y", "b.u"),)


def test_a_linear_transformation_is_part_of_its_connections_and_takes_bare_numbers(
    osp: Write,
) -> None:
    functions = '<LinearTransformation name="f" factor="0.5" offset="2"/>'
    connections = signal("a.y", "f.in") + signal("b.u", "f.out") + signal("c.u", "f.out")
    system = uv.load(osp(connections, functions))
    assert system.connections == (
        Connection("a.y", "b.u", 0.5, 2.0, convert=False),
        Connection("a.y", "c.u", 0.5, 2.0, convert=False),
    )


def test_a_sum_adds_no_delay(osp: Write) -> None:
    functions = '<Sum name="s" inputCount="2"/>'
    summed = signal("a.y", "s.in[0]") + signal("b.y", "s.in[1]") + signal("c.u", "s.out")
    drive = '<InitialValue variable="u"><Real value="1"/></InitialValue>'
    edit = ('<InitialValue variable="k"><Real value="1"/></InitialValue>', drive)
    with_sum = uv.load(osp(summed, functions, edit=edit))
    assert with_sum.groups == (StepGroup(("s", "c"), "gauss-seidel"),)
    direct = uv.load(osp(joined("a.y", "c.u"), edit=edit))
    assert trajectory(with_sum) == trajectory(direct)
    assert trajectory(direct, 50)["c"][-1] > 0.0


def test_a_sum_is_stepped_for_each_simulator_that_it_feeds(osp: Write) -> None:
    functions = '<Sum name="s" inputCount="1"/>'
    connections = signal("a.y", "s.in[0]") + signal("b.u", "s.out") + signal("c.u", "s.out")
    edit = ('name="c" source="first.fmu"', 'name="c" source="first.fmu" stepSize="0.03"')
    system = uv.load(osp(connections, functions, edit=edit))
    assert set(system.components) == {"a", "b", "c", "s_b", "s_c"}
    assert str(system.components["s_c"].rate) == "3/100"


def test_a_vector_sum_takes_groups(osp: Write) -> None:
    functions = '<VectorSum name="s" inputCount="2" dimension="3"/>'
    connections = (
        signal("a.three out", "s.in[0]", "Group")
        + signal("b.three out", "s.in[1]", "Group")
        + signal("c.three in", "s.out", "Group")
    )
    system = uv.load(osp(connections, functions))
    plan = flatten(system)
    assert plan.components[3].description.variables["u"].shape == (6,)
    moved = {
        (t.source_variable.name, t.target_variable.name, t.target_elements) for t in plan.transfers
    }
    assert moved == {("w", "u", (0, 1, 2)), ("w", "u", (3, 4, 5)), ("y", "v", (0, 1, 2))}


def test_a_step_is_rounded_to_base_steps_with_a_remark(osp: Write) -> None:
    edit = ('name="b" source="first.fmu"', 'name="b" source="first.fmu" stepSize="0.0203"')
    system = uv.load(osp(edit=edit))
    assert str(system.components["b"].rate) == "1/50"
    assert "stepSize 0.0203 s is no multiple of the base step of 0.01 s" in system.notes[0]


def test_what_is_not_done_is_said(osp: Write) -> None:
    bond = joined("a.y", "b.u", powerBond="p") + joined("a.u", "b.y", powerBond="p")
    head = "<StartTime>1</StartTime><EndTime>2</EndTime><Algorithm>ecco</Algorithm>"
    system = uv.load(osp(bond, head=head))
    said = "\n".join(system.notes)
    assert "no BaseStepSize: 0.1 s is used" in said
    assert "Algorithm ecco has no EccoConfiguration" in said
    assert "every step is 0.1 s" in said
    assert (system.start_time, system.stop_time) == (1.0, 2.0)


ECCO = {
    "SafetyFactor": "0.9", "StepSize": "0.001", "MinimumStepSize": "0.0001",
    "MaximumStepSize": "0.05", "MinimumChangeRate": "0.2", "MaximumChangeRate": "1.5",
    "ProportionalGain": "0.2", "IntegralGain": "0.15", "RelativeTolerance": "1e-4",
    "AbsoluteTolerance": "1e-4",
}  # fmt: skip
BOND = joined("a.y", "b.u", powerBond="p") + joined("a.u", "b.y", powerBond="p")


def ecco(**changes: str) -> str:
    rows = "".join(f"<{k}>{v}</{k}>" for k, v in {**ECCO, **changes}.items() if v)
    return f"<EccoConfiguration>{rows}</EccoConfiguration>"


def test_ecco_is_a_variable_step_by_power_bonds(osp: Write) -> None:
    head = "<BaseStepSize>0.01</BaseStepSize><Algorithm>ecco</Algorithm>"
    edit = ('name="b" source="first.fmu"', 'name="b" source="first.fmu" stepSize="0.02"')
    system = uv.load(osp(BOND, head=head, tail=ecco(), edit=edit))
    assert any("the stepSize of b is not used" in note for note in system.notes)
    assert system.base_step == Fraction(1, 10**9)
    assert system.variable_step == VariableStep(
        Fraction(1, 10**4), Fraction(1, 20), Fraction(1, 1000), 1e-4, 1e-4, 0, rollback=False,
        estimate="bonds", safety=0.9, slowest=0.2, fastest=1.5, proportional=0.2, integral=0.15,
        bonds=(PowerBond("p", ("a.u", "a.y"), ("b.u", "b.y")),),
    )  # fmt: skip
    assert set(trajectory(system, 3)) == set(NAMES)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"SafetyFactor": ""}, "no SafetyFactor"),
        ({"MinimumStepSize": "0.1"}, "0 < smallest <= largest"),
        ({"MaximumChangeRate": "fast"}, "fast"),
        ({"Safety": "1"}, "'Safety'"),
    ],
)
def test_a_wrong_ecco_configuration_is_refused(
    osp: Write, changes: dict[str, str], expected: str
) -> None:
    with pytest.raises(SystemInvalid) as wrong:
        uv.load(osp(BOND, head="<Algorithm>ecco</Algorithm>", tail=ecco(**changes)))
    assert expected in str(wrong.value)


def test_a_bond_of_connections_in_one_direction_is_refused(osp: Write) -> None:
    one_way = joined("a.y", "b.u", powerBond="p") + joined("a.y", "c.u", powerBond="p")
    with pytest.raises(SystemInvalid, match="one connection from each of two simulators"):
        uv.load(osp(one_way, head="<Algorithm>ecco</Algorithm>", tail=ecco()))


def test_a_proxy_is_read_as_its_file(osp: Write) -> None:
    edit = ('name="b" source="first.fmu"', 'name="b" source="proxyfmu://localhost?file=first.fmu"')
    system = uv.load(osp(edit=edit))
    assert system.components["b"].source == "first.fmu"
    assert "--isolate" in system.notes[0]


def test_a_system_survives_being_written_as_ssd(osp: Write, tmp_path: Path) -> None:
    functions = '<Sum name="s" inputCount="2"/><LinearTransformation name="f" factor="2"/>'
    connections = (
        signal("a.y", "s.in[0]") + signal("b.y", "s.in[1]") + signal("c.u", "s.out")
        + signal("c.y", "f.in") + signal("a.u", "f.out")
    )  # fmt: skip
    system = uv.load(osp(connections, functions))
    system.write(tmp_path / "x.ssd")
    assert uv.load(tmp_path / "x.ssd") == system


LIBCOSIM = """
import json, sys
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver

path, until = sys.argv[1], float(sys.argv[2])
load = CosimExecution.from_osp_config_file if path.endswith("xml") else CosimExecution.from_ssp_file
execution = load(path)
observer = CosimObserver.create_last_value()
execution.add_observer(observer)
execution.simulate_until(round(until * 1e9))
found = {}
for info in execution.slave_infos():
    reals = [v for v in execution.slave_variables(info.index) if v.type == 0]
    values = observer.last_real_values(info.index, [v.reference for v in reals]) if reals else []
    names = [f"{info.name.decode()}.{v.name.decode()}" for v in reals]
    found.update(zip(names, values))
open(sys.argv[3], "w").write(json.dumps(found))
"""


def libcosim(path: Path, until: float) -> dict[str, float]:
    """Run a system in libcosim, in a process of its own; give the last value of each real."""
    out = path.with_name("libcosim.json")
    command = [sys.executable, "-c", LIBCOSIM, str(path), str(until), str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    found: dict[str, float] = json.loads(out.read_text())
    return found


@pytest.mark.parametrize("fmi", [1, 2])
def test_libcosim_gives_the_same(
    osp: Write, fmi: int, c_fmu: Callable[..., Path], tmp_path: Path
) -> None:
    if fmi == 1:  # libcosim reads outputs before it initializes an FMU of FMI 1.0
        shutil.copy(c_fmu(1, flags=["-DREADS_EARLY"]), tmp_path / "first.fmu")
    functions = (
        '<LinearTransformation name="f" factor="-0.5" offset="0.3"/><Sum name="s" inputCount="2"/>'
    )
    connections = (
        signal("a.y", "s.in[0]") + signal("b.y", "s.in[1]") + signal("c.u", "s.out")
        + signal("c.y", "f.in") + signal("a.u", "f.out")
        + joined("a.force", "b.other force", "VariableGroup")
    )  # fmt: skip
    path = osp(connections, functions)
    theirs, ours = libcosim(path, 0.5), trajectory(uv.load(path), 50)
    for n in NAMES:
        assert theirs[f"{n}.y"] != 0.0
        np.testing.assert_allclose(ours[n][-1], theirs[f"{n}.y"], rtol=1e-14)


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"edit": ('source="first.fmu"', 'source="frist.fmu"')}, r"frist.fmu: no such file"),
    ({"edit": ('name="b"', 'name="a"')}, r"<Simulator name='a'>: a second simulator"),
    ({"edit": ('name="b" ', "")}, r"no name; expected name="),
    ({"edit": ('<Real value="2"/>', "")}, r"variable='k'>: no value; expected one such as <Real"),
    ({"edit": ('<Real value="2"/>', '<Real value="x"/>')}, r"'x'>; expected a value of type Real"),
    (
        {"edit": ('<Real value="2"/>', '<Rael value="2"/>')},
        r"no type 'Rael'; expected .*such as Real",
    ),
    ({"edit": ("0.01<", "soon<")}, r"<BaseStepSize>: step 'soon'; expected seconds"),
    ({"edit": ("0.01<", "-1<")}, r"<BaseStepSize>: step of -1 s; expected more than 0"),
    ({"edit": ("fixedStep", "euler")}, r"<Algorithm>: no algorithm 'euler'"),
    (
        {"edit": ("Simulators>", "Simulator>")},
        r"no section 'Simulator'; expected .*such as Simulators",
    ),
    ({"tail": "<EndTime>-1</EndTime>"}, r"<EndTime>: -1 s; expected a time after"),
    ({"connections": joined("a.y", "d.u")}, r"no simulator 'd'; expected a simulator, one of a, b"),
    ({"connections": joined("a.y", "b.uu")}, r"no variable 'uu' in first_order; .* such as u"),
    ({"connections": joined("a.y", "b.y")}, r"a.y is output and b.y is output; .*an input"),
    ({"connections": "<VariableConnection/>"}, r"0 of <Variable> .* expected two of <Variable>"),
    ({"connections": "<Wire/>"}, r"no connection 'Wire'"),
    ({"connections": joined("a.out", "b.ni", "VariableGroup")}, r"no variable group 'ni' in 'b'"),
    (
        {"connections": joined("a.out", "b.three in", "VariableGroup")},
        r"'out' has 1 variables and 'three in' has 3; expected groups of equally many",
    ),
    ({"functions": '<Sum name="s" inputCount="none"/>'}, r"inputCount 'none'; expected a whole"),
    ({"functions": '<Product name="s"/>'}, r"no function 'Product'"),
    (
        {"functions": '<Sum name="s" inputCount="2"/>', "connections": signal("c.u", "s.out")},
        r"<Sum name='s'>: nothing is connected to in\[0\], in\[1\]",
    ),
    (
        {"functions": '<Sum name="s" inputCount="1"/>', "connections": signal("a.y", "s.in[1]")},
        r"signal 'in\[1\]'; expected in\[0\] to in\[0\] or out",
    ),
    (
        {"functions": '<Sum name="s" inputCount="1"/>', "connections": signal("a.u", "s.in[0]")},
        r"a.u is input; expected an output",
    ),
    ({"connections": joined("a.y", "b.u", powerBond="p")}, r"power bond 'p': 1 connections"),
    (
        {
            "connections": joined("a.y", "b.u", powerBond="p").replace(
                'name="', 'causality="input" name="'
            )
            + joined("a.u", "b.y", powerBond="p")
        },
        r"power bond 'p': causalities 'input' and 'input'; expected one 'input' and one 'output'",
    ),
    (
        {"edit": ('source="first.fmu"', 'source="proxyfmu://10.0.0.1:9?file=first.fmu"')},
        r"nothing is run on other machines",
    ),
]


@pytest.mark.parametrize(("parts", "said"), WRONG)
def test_a_mistake_is_one_sentence_with_its_place(
    osp: Write, parts: dict[str, Any], said: str
) -> None:
    with pytest.raises(SystemInvalid, match=said) as error:
        uv.load(osp(**parts))
    assert all(p.place.startswith("OspSystemStructure.xml: ") for p in error.value.problems)


def test_every_mistake_is_reported_at_once(osp: Write) -> None:
    with pytest.raises(SystemInvalid) as error:
        uv.load(osp(joined("a.y", "d.u") + joined("a.y", "b.y") + "<Wire/>"))
    assert len(error.value.problems) == 3


def test_a_missing_file_of_groups_is_named(osp: Write, tmp_path: Path) -> None:
    path = osp(joined("a.out", "b.in", "VariableGroup"))
    (tmp_path / "first_order_OspModelDescription.xml").unlink()
    with pytest.raises(SystemInvalid, match="first_order_OspModelDescription"):
        uv.load(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<a/>", "expected <OspSystemStructure>"),
        ("<OspSystemStructure", "malformed XML"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><OspSystemStructure>&b;</OspSystemStructure>', "DOCTYPE"),
    ],
)
def test_a_file_that_is_none_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "x.xml").write_text(text)
    with pytest.raises(InputInvalid, match=said):
        uv.load(tmp_path / "x.xml")


def test_libcosim_runs_the_packed_survey_and_agrees(tmp_path: Path) -> None:
    """Its steps are all Jacobi, so the group goes; its times are whole nanoseconds."""
    pack(uv.load("bluerov2_survey"), tmp_path / "survey.ssp", seed=1)
    theirs = libcosim(tmp_path / "survey.ssp", 0.5)
    system = dataclasses.replace(uv.load(tmp_path / "survey.ssp"), groups=())
    with Master(flatten(system), instantiate) as master:
        master.initialize()
        master.step(50)
        eta, position = master.get("hull", "eta"), master.get("navigation", "eta")
    assert theirs["hull.eta[1]"] != 0.0
    for name, ours in (("hull.eta", eta), ("navigation.eta", position)):
        expected = [theirs[f"{name}[{i}]"] for i in range(1, 7)]
        np.testing.assert_allclose(ours, expected, rtol=1e-10, atol=1e-12)

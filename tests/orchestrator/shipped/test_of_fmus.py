"""A system of FMUs: connected where name, type, dimensions and unit agree, and only there."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path

import pytest

import uuvsim_cosim as uuv
from tests.conftest import Uuvsim, write_archive
from uuvsim_cosim.errors import InputInvalid, SystemInvalid
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.orchestrator.shipped.of_fmus import system_of_fmus

UNITS = """<UnitDefinitions>
<Unit name="m"><BaseUnit m="1"/></Unit><Unit name="metre"><BaseUnit m="1"/></Unit>
<Unit name="cm"><BaseUnit m="1" factor="0.01"/></Unit><Unit name="s"><BaseUnit s="1"/></Unit>
</UnitDefinitions>"""


def fmu(path: Path, variables: str, experiment: str = "") -> Path:
    """Write an FMU without a binary; each variable is "output Float64 y m"."""
    rows = ""
    for reference, text in enumerate(filter(None, map(str.strip, variables.split(","))), 1):
        causality, kind, name, *unit = text.split()
        shape = "".join(f'<Dimension start="{u}"/>' for u in unit if u.isdigit())
        given = "".join(f' unit="{u}"' for u in unit if not u.isdigit())
        discrete = "" if kind.startswith("Float") else ' variability="discrete"'
        start = ' start="0"' if causality == "input" and not shape else ""
        start = start.replace("0", "false") if kind == "Boolean" else start
        start = ' start="0 0 0"' if causality == "input" and shape else start
        rows += (f'<{kind} name="{name}" valueReference="{reference}" causality="{causality}"'
                 f"{given}{discrete}{start}>{shape}</{kind}>")  # fmt: skip
    text = (
        f'<fmiModelDescription fmiVersion="3.0" modelName="{path.stem}" instantiationToken="x">'
        f'<CoSimulation modelIdentifier="m"/>{UNITS}<DefaultExperiment {experiment}/>'
        f"<ModelVariables>{rows}</ModelVariables><ModelStructure/></fmiModelDescription>"
    )
    return write_archive(path, {"modelDescription.xml": text.encode()})


def reasons(tmp_path: Path, output: str, target: str) -> list[str]:
    """Join two FMUs; return the reasons why the one input stays open."""
    a = fmu(tmp_path / "a.fmu", f"output {output}")
    b = fmu(tmp_path / "b.fmu", f"input {target}")
    made = system_of_fmus([a, b])
    assert len(made.by_name) + len(made.open) == 1
    return [o.reason for o in made.open]


@pytest.mark.parametrize(
    ("output", "target"),
    [("Float64 y m", "Float64 y m"), ("Float64 y m", "Float64 y metre"), ("Float64 y", "Float64 y"),
     ("Boolean y", "Boolean y"), ("Float64 y m 3", "Float64 y m 3")],
)  # fmt: skip
def test_equal_names_types_and_units_are_connected(
    tmp_path: Path, output: str, target: str
) -> None:
    assert reasons(tmp_path, output, target) == []


@pytest.mark.parametrize(
    ("output", "target", "reason"),
    [
        ("Float64 y m", "Float64 y cm", "unit m to cm: conversion by 100"),
        ("Float64 y m", "Float64 y s", "unit m to s, another quantity"),
        ("Float64 y m", "Float64 y", "unit m to not stated"),
        ("Float64 y", "Float64 y m", "unit not stated to m"),
        ("Int32 y", "Float64 y", "type Int32 to Float64"),
        ("Boolean y", "Int32 y", "type Boolean to Int32, not possible"),
        ("Float64 y m", "Float64 y m 3", "dimensions: a scalar to 3"),
        ("Float64 x m", "Float64 y m", "no output of this name"),
        ("Float64 speed m", "Float64 Speed m", "no output of this name, but of a similar one"),
    ],
)
def test_the_rest_stays_open_with_its_reason(
    tmp_path: Path, output: str, target: str, reason: str
) -> None:
    assert reasons(tmp_path, output, target) == [reason]


def test_two_outputs_that_fit_are_both_named_and_the_user_chooses(tmp_path: Path) -> None:
    files = [
        fmu(tmp_path / "a.fmu", "output Float64 y m"),
        fmu(tmp_path / "b.fmu", "output Float64 y m, input Float64 z m"),
        fmu(tmp_path / "c.fmu", "input Float64 y m"),
    ]
    made = system_of_fmus(files)
    assert made.by_name == ()
    assert (made.open[1].target, made.open[1].sources) == ("c.y", ("a.y", "b.y"))
    assert made.open[1].reason == "2 outputs fit"
    chosen = system_of_fmus(files, connections=[("b.y", "c.y")])
    assert [(c.source, c.target) for c in chosen.system.connections] == [("b.y", "c.y")]
    assert [o.target for o in chosen.open] == ["b.z"]


def test_the_one_output_of_equal_unit_is_taken_beside_others(tmp_path: Path) -> None:
    files = [
        fmu(tmp_path / "a.fmu", "output Float64 y s"),
        fmu(tmp_path / "b.fmu", "output Float64 y m"),
        fmu(tmp_path / "c.fmu", "input Float64 y m"),
    ]
    assert system_of_fmus(files).by_name == (("b.y", "c.y"),)


def test_a_chosen_connection_that_is_impossible_is_refused(tmp_path: Path) -> None:
    files = [fmu(tmp_path / "a.fmu", "output Float64 y s"),
             fmu(tmp_path / "b.fmu", "input Float64 y m")]  # fmt: skip
    with pytest.raises(SystemInvalid, match="unit 's' to unit 'm'"):
        system_of_fmus(files, connections=[("a.y", "b.y")])


def test_steps_are_those_of_the_fmus_and_the_tick_divides_them(tmp_path: Path) -> None:
    files = [
        fmu(tmp_path / "a.fmu", "output Float64 y m", 'stepSize="0.004" stopTime="2"'),
        fmu(tmp_path / "b.fmu", "input Float64 y m", 'stepSize="0.01" stopTime="3"'),
        fmu(tmp_path / "c.fmu", "input Float64 y m"),
    ]
    system = system_of_fmus(files).system
    assert system.base_step == Fraction(2, 1000)
    assert [e.rate for e in system.elements] == [Fraction(4, 1000), Fraction(1, 100), None]
    assert system.stop_time == 3.0
    assert system.remarks == (
        "step: 0.002 s for c, which state none", "stop time: 3 s; the FMUs state a 2 s, b 3 s",
    )  # fmt: skip
    assert system_of_fmus(files, step="1/60").system.base_step == Fraction(1, 60)
    with pytest.raises(InputInvalid, match="0"):
        system_of_fmus(files, step="-1")


def test_one_file_twice_makes_two_components(tmp_path: Path) -> None:
    file = fmu(tmp_path / "my tank.fmu", "output Float64 y m")
    assert list(system_of_fmus([file, file]).system.components) == ["my_tank", "my_tank_2"]


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The FMUs of a battery and a thruster in the folder of the test."""
    monkeypatch.chdir(tmp_path)
    for name in ("battery", "thruster_t200"):
        built = build_fmu(uuv.declare(name), fmi=2)
        Path(f"{name}.fmu").write_bytes(built.read_bytes())
    return ["battery.fmu", "thruster_t200.fmu"]


def test_the_command_writes_a_system_that_runs(uuvsim: Uuvsim, files: list[str]) -> None:
    status, out, err = uuvsim("systems", "new", "bench", "--from", *files, "--json")
    found = json.loads(out)
    assert status == 0, err
    assert {"output": "battery.voltage", "input": "thruster_t200.voltage",
            "connected_by": "name and unit"} in found["connections"]  # fmt: skip
    assert [o["open_input"] for o in found["open"]][:1] == ["thruster_t200.u"]
    text = Path("bench.ssd").read_text()
    assert 'source="battery.fmu"' in text, "relative to the file"
    assert uuvsim("run", "bench.ssd", "--until", "0.1", "--no-report")[0] == 0


def test_the_command_takes_files_in_each_order_and_refuses_wrong_options(
    uuvsim: Uuvsim, files: list[str]
) -> None:
    assert uuvsim("systems", "new", "--from", files[0], "--from", files[1], "one")[0] == 0
    assert uuvsim("systems", "new", "--from", *files, "-o", "two.ssd")[0] == 0
    names = [list(uuv.load(f"{n}.ssd").components) for n in ("one", "two")]
    assert names == [["battery", "thruster_t200"]] * 2
    for wrong, said in (
        (("systems", "new", "--from", *files, "--vehicle", "bluerov2"), "--vehicle"),
        (("systems", "new", "x", "--step", "1"), "--from"),
        (("systems", "new"), "NAME"),
        (("systems", "new", "x", "--from", "none.fmu"), "none.fmu"),
        (("systems", "new", "x", "--from", *files, "--connect", "y"), "component.input"),
    ):
        status, _, err = uuvsim(*wrong)
        assert (status, said in err) == (2, True), err

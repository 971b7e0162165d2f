import shutil
from dataclasses import FrozenInstanceError
from fractions import Fraction
from pathlib import Path

import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import SystemInvalid
from uuvsim_cosim.orchestrator.system.sources import ModelSource
from uuvsim_cosim.orchestrator.system.system import System


def problems(error: pytest.ExceptionInfo[SystemInvalid]) -> str:
    return "\n".join(str(p) for p in error.value.problems)


def test_an_edit_gives_a_new_system_and_leaves_the_old_one(vehicle: System) -> None:
    heavier = vehicle.set("hull.mass", 20)
    assert vehicle.components["hull"].start == {}
    assert heavier.components["hull"].start == {"mass": 20.0}
    with pytest.raises(FrozenInstanceError):
        vehicle.name = "other"  # type: ignore[misc]


def test_components_connections_and_descriptions_can_be_read_back(vehicle: System) -> None:
    assert list(vehicle.components)[:2] == ["hull", "current"]
    assert ("wrench.tau", "hull.tau") in {(c.source, c.target) for c in vehicle.connections}
    assert vehicle.describe("hull").variables["mass"].unit == "kg"
    assert vehicle.base_step == Fraction(1, 100)


def test_every_problem_is_listed_with_the_names_that_are_close(vehicle: System) -> None:
    from dataclasses import replace

    from uuvsim_cosim.orchestrator.system.elements import Connection

    wrong = (
        Connection("hul.eta", "guidance.eta"),
        Connection("hull.etta", "guidance.eta"),
        Connection("guidance.speed", "guidance.eta"),
        Connection("hull.eta", "hull.v_c"),
        Connection("current.v_c", "guidance.eta[1:3]"),
    )
    with pytest.raises(SystemInvalid) as error:
        replace(vehicle, connections=wrong)
    assert len(error.value.problems) == 5
    text = problems(error)
    assert "such as hull" in text
    assert "such as eta" in text
    assert "of causality parameter" in text
    assert "6 elements to 3 elements" in text
    assert "unit 'km/h' to unit '1'" in text


@pytest.mark.parametrize(
    ("source", "target", "said"),
    [
        ("controller.eta", "guidance.eta", "of causality input; expected an output"),
        ("hull.eta", "current.v_c", "of causality output; expected an input"),
        ("hull.tau", "hull.eta", "expected the other way round"),
        ("hull.eta[7]", "thruster_1.u", "expected indices from 1 to 6"),
        ("hull.eta[0]", "thruster_1.u", "expected indices from 1 to 6"),
        ("thruster_1.thrust[1]", "wrench.thrust[1]", "which is a scalar"),
        ("hull", "guidance.eta", "expected hull.VARIABLE"),
        ("hull.eta", "hull.tau", "unit '1' to unit 'N'; expected equal or commensurable"),
    ],
)
def test_a_wrong_connection_is_refused(
    vehicle: System, source: str, target: str, said: str
) -> None:
    with pytest.raises(SystemInvalid) as error:
        vehicle.connect(source, target)
    assert said in problems(error)


def test_two_sources_for_one_input_are_refused_with_both_names(vehicle: System) -> None:
    with pytest.raises(SystemInvalid) as error:
        vehicle.connect("allocation.u[2]", "thruster_1.u")
    assert "thruster_1.u: 2 sources, allocation.u[1] and allocation.u[2]" in problems(error)


def test_a_slice_is_the_same_as_its_elements_and_a_full_set_of_them_the_whole() -> None:
    s = System("s").add("a", "fake:allocation").add("w", "fake:wrench").add("h", "fake:hull")
    assert s.connect("w.tau[1:3]", "h.tau[4:6]") == (
        s.connect("w.tau[1]", "h.tau[4]")
        .connect("w.tau[2]", "h.tau[5]")
        .connect("w.tau[3]", "h.tau[6]")
    )
    whole = s.connect("w.tau[1:3]", "h.tau[1:3]").connect("w.tau[4:6]", "h.tau[4:6]")
    assert whole == s.connect("w.tau", "h.tau")


@pytest.mark.parametrize(
    ("path", "value", "held"),
    [
        ("current.speed", 0.4, 0.4),
        ("current.speed", "0.4", 0.4),
        ("current.speed", "3.6 km/h", 1.0),
        ("hull.mass", "2000 g", 2.0),
        ("hull.eta_0", [1, 2, 3, 4, 5, 6], (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)),
        ("hull.eta_0", "[1, 2, 3, 4, 5, 6]", (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)),
        ("hull.eta_0[3]", 2, (0.0, 0.0, 2.0, 0.0, 0.0, 0.0)),
        ("hull.J[1,2]", 2, ((1.0, 2.0), (0.0, 1.0))),
        ("hull.J", [1, 2, 3, 4], ((1.0, 2.0), (3.0, 4.0))),
        ("controller.enabled", "false", False),
        ("controller.order", "2", 2),
        ("controller.log", "1.5 m", "1.5 m"),
    ],
)
def test_values_are_held_in_the_unit_and_shape_of_their_variable(
    vehicle: System, path: str, value: object, held: object
) -> None:
    name, _, key = path.partition(".")
    assert vehicle.set(path, value).components[name].start[key.partition("[")[0]] == held


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("current.speed", 4, "4 m/s is out of range; expected a value in [0, 3] m/s"),
        ("current.speed", "1 kg", "a value in 'kg'; expected one in 'm/s'"),
        ("current.speed", "fast", "expected a value of type Float64 such as '0.4 m/s'"),
        ("current.speed", [1, 2], "2 values; expected a scalar"),
        ("current.speed", None, "expected a value of type Float64"),
        ("current.speed", float("nan"), "nan; expected"),
        ("hull.eta_0", [1, 2], "2 values; expected 6 values"),
        ("hull.eta_0", 1, "a scalar; expected 6 values"),
        ("hull.J", [[1], [2, 3]], "lists of different lengths"),
        ("controller.order", 1.5, "1.5; expected a value of type Int32"),
        ("controller.enabled", 3, "3; expected a value of type Boolean"),
        ("hull.maas", 3, "such as mass"),
        ("hull.nu_dot", [0] * 6, "is an output without a settable start value"),
        ("hul.mass", 3, "such as hull"),
        ("mass", 3, "expected COMPONENT.VARIABLE such as hull.mass"),
    ],
)
def test_a_value_that_does_not_fit_is_refused(
    vehicle: System, path: str, value: object, said: str
) -> None:
    with pytest.raises(SystemInvalid) as error:
        vehicle.set(path, value)
    assert said in problems(error)


def test_a_step_that_the_tick_does_not_divide_is_refused_with_both_numbers() -> None:
    with pytest.raises(SystemInvalid) as error:
        System("s", tick="0.01").add("hull", "fake:hull", rate="0.025")
    assert "0.025 s" in problems(error)
    assert "0.01 s" in problems(error)
    assert "such as 0.02 or 0.03" in problems(error)


@pytest.mark.parametrize("tick", ["0", "-1", "fast", "1/0"])
def test_a_tick_that_is_no_time_is_refused(tick: str) -> None:
    with pytest.raises(SystemInvalid, match="expected"):
        System("s", tick=tick)


def test_a_source_that_cannot_be_read_is_refused_by_name() -> None:
    with pytest.raises(SystemInvalid, match=r"a: .*no/such.fmu: no such file; expected an FMU"):
        System("s").add("a", "no/such.fmu")
    with pytest.raises(SystemInvalid, match=r"of an unknown kind; expected a .fmu"):
        System("s").add("a", "nothing.txt")
    with pytest.raises(SystemInvalid, match=r"there is no model 'lqrr' \(did you mean lqr"):
        System("s").add("a", "lqrr")


def test_a_nested_system_is_connected_by_what_it_exposes(vehicle: System) -> None:
    inner = System("drive").add("a", "fake:allocation").add("t", "fake:thruster")
    inner = inner.connect("a.u[1]", "t.u").expose("tau_d", "a.tau_d").expose("thrust", "t.thrust")
    outer = System("outer").add("drive", inner).add("c", "fake:controller")
    outer = outer.connect("c.tau_d", "drive.tau_d").set("c.Kp", 3)
    assert outer.describe("drive").variables["thrust"].unit == "N"
    assert outer.describe("drive.t").name == "thruster"
    with pytest.raises(SystemInvalid, match="no variable 'u' in drive"):
        outer.connect("c.tau_d[1]", "drive.u")


def test_an_edit_reaches_into_a_nested_system() -> None:
    inner = System("inner").add("hull", "fake:hull")
    outer = System("outer").add("v", inner, start={"hull.mass": 5}).set("v.hull.J[1,1]", 4)
    start = outer.nested("v").components["hull"].start
    assert start == {"mass": 5.0, "J": ((4.0, 0.0), (0.0, 1.0))}
    assert inner.components["hull"].start == {}


def test_disconnect_and_remove_take_away_what_they_name(vehicle: System) -> None:
    fewer = vehicle.disconnect("wrench.thrust[2]")
    assert len(vehicle.connections) - len(fewer.connections) == 1
    gone = vehicle.remove("thruster_2")
    assert "thruster_2" not in gone.components
    assert not [c for c in gone.connections if "thruster_2" in c.source + c.target]
    with pytest.raises(SystemInvalid, match="not connected"):
        fewer.disconnect("wrench.thrust[2]")


def test_a_group_names_components_that_exist_and_each_once(vehicle: System) -> None:
    grouped = vehicle.group(["guidance", "controller"])
    assert grouped.groups[0].algorithm == "gauss-seidel"
    with pytest.raises(SystemInvalid, match="no component 'guide'"):
        vehicle.group(["guide", "controller"])
    with pytest.raises(SystemInvalid, match="in two groups"):
        grouped.group(["controller", "allocation"])


def test_a_unit_that_one_side_leaves_out_is_noted(vehicle: System) -> None:
    s = System("s").add("f", "fake:foreign").add("t", "fake:thruster")
    s = s.connect("t.thrust", "f.In1")
    assert s.notes == ("f.In1: no unit given; N is used, that of t.thrust",)


def test_exposed_elements_keep_their_own_units() -> None:
    hull = System("inner").add("hull", "model:bluerov2_heavy")
    heading = hull.expose("psi", "hull.eta[6]").interface().variables["psi"]
    assert (heading.shape, heading.units) == ((), ("rad",))
    for i in range(1, 7):
        hull = hull.expose(f"pose[{i}]", f"hull.eta[{7 - i}]")
    pose = hull.interface().variables["pose"]
    assert (pose.shape, pose.units) == ((6,), ("rad",) * 3 + ("m",) * 3)


def test_a_declaration_is_shared_until_a_file_that_it_reads_is_edited(tmp_path: Path) -> None:
    folder = tmp_path / "rov"
    shutil.copytree(content("models", "vehicles", "bluerov2_heavy"), folder)
    file = folder / "parameters.yaml"
    file.write_text(file.read_text().replace("vehicle: bluerov2_heavy", "vehicle: rov"))
    source = ModelSource(f"model:vehicle?id={folder}")
    first = source.describe().variables["m"].start
    assert source.lowered() is source.lowered()
    assert source.declare() is source.lowered().model
    old = f"m: {{value: {first:g}"
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, f"m: {{value: {first + 1:g}"))
    assert source.describe().variables["m"].start == first + 1
    native = source.instantiate("rov", backend="native")
    assert native.get(native.description.variables["m"]) == first + 1

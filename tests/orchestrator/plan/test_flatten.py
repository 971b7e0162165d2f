from fractions import Fraction

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid, SystemInvalid
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.loop_delays import loop_delays
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.plan.plan_table import format_plan
from uuvsim_cosim.orchestrator.plan.seeds import component_seed
from uuvsim_cosim.orchestrator.system.system import System


def between(plan: Plan, source: str, target: str) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    paths = [c.path for c in plan.components]
    return [
        (t.source_elements, t.target_elements)
        for t in plan.transfers
        if (paths[t.source], paths[t.target]) == (source, target)
    ]


def test_a_whole_connection_is_one_transfer_of_all_elements(vehicle: System) -> None:
    every = tuple(range(6))
    assert between(flatten(vehicle), "wrench", "hull") == [(every, every)]


def test_an_element_is_transferred_alone(vehicle: System) -> None:
    assert between(flatten(vehicle), "allocation", "thruster_3") == [((2,), (0,))]


def test_elements_between_the_same_variables_are_one_transfer() -> None:
    s = System("s").add("w", "fake:wrench").add("h", "fake:hull")
    s = s.connect("w.tau[1]", "h.tau[3]").connect("w.tau[5:6]", "h.tau[1:2]")
    assert between(flatten(s), "w", "h") == [((0, 4, 5), (2, 0, 1))]


def test_units_are_converted_in_the_transfer(vehicle: System) -> None:
    plan = flatten(vehicle)
    t = next(t for t in plan.transfers if t.source_variable.name == "v_c")
    assert t.factor == pytest.approx(1 / 3.6, rel=1e-15)
    assert t.offset == 0.0


def test_start_values_have_the_shape_of_their_variable(vehicle: System) -> None:
    plan = flatten(vehicle.set("hull.J", [1, 2, 3, 4]).set("hull.mass", 3))
    start = plan.components[0].start
    np.testing.assert_array_equal(start["J"], [[1, 2], [3, 4]])
    assert start["mass"] == 3.0


def test_seeds_depend_on_the_systems_seed_and_the_path_alone(vehicle: System) -> None:
    a = {c.path: c.seed for c in flatten(vehicle, seed=7).components}
    reordered = System("other").add("thruster_1", "fake:thruster").add("hull", "fake:hull")
    b = {c.path: c.seed for c in flatten(reordered, seed=7).components}
    assert a["hull"] == b["hull"] == component_seed(7, "hull")
    assert len(set(a.values())) == len(a)
    assert flatten(vehicle, seed=8).components[0].seed != a["hull"]
    assert all(-(2**31) <= n < 2**31 for s in a.values() for n in s)
    assert component_seed(0, "imu") == (-556779910, -246920945)


@pytest.mark.parametrize("seed", [-1, 2**64, 10**30])
def test_a_seed_that_would_draw_what_another_draws_is_refused(seed: int, vehicle: System) -> None:
    with pytest.raises(InputInvalid, match=rf"seed {seed}: expected an integer of 0 … 2\^64 - 1"):
        flatten(vehicle, seed=seed)
    assert component_seed(2**64 - 1, "hull") != component_seed(0, "hull")


def test_a_seed_that_the_user_sets_holds(vehicle: System) -> None:
    plan = flatten(vehicle.set("current.seed", [1, 2]))
    assert next(c.seed for c in plan.components if c.path == "current") == (1, 2)


def test_nested_systems_dissolve_into_paths(vehicle: System) -> None:
    drive = System("drive").add("a", "fake:allocation").add("t", "fake:thruster")
    drive = drive.connect("a.u[1]", "t.u").expose("tau_d", "a.tau_d").expose("thrust", "t.thrust")
    outer = (
        System("outer")
        .add("c", "fake:controller")
        .add("drive", drive)
        .add("w", "fake:wrench")
        .connect("c.tau_d", "drive.tau_d")
        .connect("drive.thrust", "w.thrust[4]")
    )
    plan = flatten(outer)
    assert [c.path for c in plan.components] == ["c", "drive.a", "drive.t", "w"]
    assert between(plan, "c", "drive.a") == [(tuple(range(6)), tuple(range(6)))]
    assert between(plan, "drive.t", "w") == [((0,), (3,))]


def test_a_slower_component_steps_in_whole_ticks(vehicle: System) -> None:
    s = System("s", tick="1/60").add("hull", "fake:hull", rate="1/20")
    assert flatten(s).components[0].step_ticks == 3
    outer = System("outer", tick="1/60").add("s", System("i", tick="0.02").add("h", "fake:hull"))
    with pytest.raises(SystemInvalid, match=r"0\.02 s, which the tick of 1/60 s"):
        flatten(outer)


def test_all_are_stepped_by_jacobi_unless_grouped(vehicle: System) -> None:
    plan = flatten(vehicle.group(["controller", "allocation"]))
    names = [[plan.components[i].path for i in g.members] for g in plan.groups]
    assert [g.algorithm for g in plan.groups] == ["jacobi", "gauss-seidel"]
    assert names[1] == ["controller", "allocation"]
    assert "hull" in names[0]


def test_outputs_become_known_after_the_inputs_that_they_depend_on(vehicle: System) -> None:
    plan = flatten(vehicle)
    order = [plan.components[e[0]].path for e in plan.initialization]
    last = {name: i for i, name in enumerate(order)}
    assert all(len(e) == 1 for e in plan.initialization)
    assert order.index("hull") < last["controller"] < last["allocation"] < last["thruster_1"]
    assert last["wrench"] < last["hull"]
    assert plan.warnings == ()


def loop(a: str, b: str) -> System:
    s = System("s").add("a", "fake:filter").add("b", "fake:filter")
    return s.connect(f"a.{a}", "b.u").connect(f"b.{b}", "a.u")


def test_an_algebraic_loop_is_named_hop_by_hop() -> None:
    plan = flatten(loop("y", "y").with_loops("delay"))
    assert (0, 1) in plan.initialization
    assert len(plan.warnings) == 1
    assert plan.warnings[0].startswith("algebraic loop")
    assert "a.y -> b.u" in plan.warnings[0]
    assert "b.y -> a.u" in plan.warnings[0]


def test_a_loop_through_an_undeclared_hop_is_iterated_with_a_warning_that_names_it() -> None:
    plan = flatten(loop("y", "silent"))
    assert (0, 1) in plan.initialization
    assert "not declared (b.u -> b.silent)" in plan.warnings[0]
    assert "a.y -> b.u" in plan.warnings[0]
    assert "b.silent -> a.u" in plan.warnings[0]


def test_a_component_fed_by_itself_is_a_loop() -> None:
    plan = flatten(System("s").add("a", "fake:filter").connect("a.y", "a.u"), loops="delay")
    assert (0, 0) in plan.initialization


def test_a_loop_delay_is_one_step_a_hop(vehicle: System) -> None:
    loops = loop_delays(flatten(vehicle))
    longest = loops[0]
    assert "thruster_1 … thruster_4" in longest.path
    assert len(longest.path) == 6  # hull, guidance, controller, allocation, thrusters, wrench
    assert longest.delay == Fraction(6, 100)
    assert len(loops) == 2
    slow = System("s").add("a", "fake:filter", rate="0.05").add("b", "fake:filter")
    slow = slow.connect("a.y", "b.u").connect("b.y", "a.u")
    assert loop_delays(flatten(slow, loops="delay"))[0].delay == Fraction(6, 100)


def test_a_hop_inside_a_gauss_seidel_group_costs_nothing(vehicle: System) -> None:
    grouped = vehicle.group(["guidance", "controller", "allocation"])
    assert loop_delays(flatten(grouped))[0].delay == Fraction(4, 100)


def test_the_plan_can_be_read_as_text(vehicle: System) -> None:
    text = format_plan(flatten(vehicle.group(["controller", "allocation"])))
    assert "tick 0.01 s, 10 components" in text
    assert "allocation.u[2]" in text
    assert "km/h -> m/s" in text
    assert "gauss-seidel 1" in text


def test_an_empty_system_has_no_plan() -> None:
    with pytest.raises(SystemInvalid, match="no components"):
        flatten(System("empty"))

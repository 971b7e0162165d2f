from pathlib import Path

import pytest

from uuvsim_cosim.errors import SystemInvalid
from uuvsim_cosim.orchestrator.parameters.ssm import write_ssm
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.slot import format_slot
from uuvsim_cosim.orchestrator.system.system import System

ALL_MAPPED = {
    **{f"eta_d[{i}]": f"In{i}" for i in range(1, 7)},
    **{f"eta[{i}]": f"In{i + 6}" for i in range(1, 7)},
    **{f"tau_d[{i}]": f"Out{i}" for i in range(1, 7)},
}


def test_a_slot_lists_what_is_connected_and_nothing_else(vehicle: System) -> None:
    found = vehicle.slot("hull")
    assert [(c.name, c.direction, c.shape, c.unit_text) for c in found.connectors] == [
        ("tau", "input", (6,), "N"),
        ("v_c", "input", (3,), "m/s"),
        ("eta", "output", (6,), "1"),
    ]
    assert found.connectors[2].peers == ("guidance.eta", "controller.eta")
    assert [v.name for v in found.parameters] == ["mass", "eta_0", "J"]


def test_a_slot_can_be_read_as_text(vehicle: System) -> None:
    text = format_slot(vehicle.slot("controller"))
    assert "slot controller, now fake:controller, steps every 0.01 s" in text
    assert "from guidance.eta_d" in text
    assert "to allocation.tau_d" in text


def test_equal_names_fit_without_a_map(vehicle: System) -> None:
    swapped = vehicle.replace("controller", "fake:controller2")
    assert swapped.connections == vehicle.connections
    assert swapped.components["controller"].source == "fake:controller2"


def test_scalars_are_mapped_element_by_element(vehicle: System) -> None:
    swapped = vehicle.replace("controller", "fake:foreign", map=ALL_MAPPED)
    pairs = {(c.source, c.target) for c in swapped.connections}
    assert ("controller.Out3", "allocation.tau_d[3]") in pairs
    assert ("hull.eta[2]", "controller.In8") in pairs
    assert ("guidance.eta_d[6]", "controller.In6") in pairs
    flatten(swapped)


def test_a_mapping_file_does_the_same(vehicle: System, tmp_path: Path) -> None:
    write_ssm(ALL_MAPPED, tmp_path / "controller.ssm")
    by_file = vehicle.replace("controller", "fake:foreign", map=tmp_path / "controller.ssm")
    assert by_file == vehicle.replace("controller", "fake:foreign", map=ALL_MAPPED)


def test_a_whole_array_is_renamed(vehicle: System) -> None:
    swapped = vehicle.replace(
        "controller", "fake:controller2", map={"eta_d": "eta", "eta": "eta_d"}
    )
    pairs = {(c.source, c.target) for c in swapped.connections}
    assert ("guidance.eta_d", "controller.eta") in pairs
    assert ("hull.eta", "controller.eta_d") in pairs


def test_a_missing_unit_is_taken_as_the_slots_and_noted(vehicle: System) -> None:
    swapped = vehicle.replace("controller", "fake:unitless")
    assert swapped.components["controller"].units == {"tau_d": "N"}
    assert any("controller: no unit given" in n and "tau_d in N" in n for n in swapped.notes)
    assert swapped.describe("controller").variables["tau_d"].unit == "N"


def test_a_wrong_unit_is_refused_with_both(vehicle: System) -> None:
    with pytest.raises(SystemInvalid, match=r"tau_d has unit 'm/s'; expected an output .* in N"):
        vehicle.replace("controller", "fake:wrong_unit")


def test_another_unit_of_the_same_kind_is_converted(vehicle: System) -> None:
    plan = flatten(vehicle.replace("controller", "fake:other_unit"))
    t = next(t for t in plan.transfers if t.source_variable.name == "tau_d")
    assert t.factor == 1000.0


def test_what_does_not_fit_is_refused_with_what_is_missing_and_what_was_there(
    vehicle: System,
) -> None:
    with pytest.raises(SystemInvalid) as error:
        vehicle.replace("controller", "fake:half")
    text = str(error.value)
    assert len(error.value.problems) == 2
    assert "controller.eta_d: missing in half, which has inputs eta[6] and outputs tau[3]" in text
    assert "controller.tau_d: missing in half" in text
    assert "a map controller.tau_d=NAME" in text


def test_a_map_of_unknown_names_is_refused_on_both_sides(vehicle: System) -> None:
    with pytest.raises(SystemInvalid) as error:
        vehicle.replace("controller", "fake:foreign", map={"tau": "Out1", "tau_d[1]": "Aut1"})
    text = str(error.value)
    assert "map controller.tau=Out1: no variable 'tau' in controller, the slot" in text
    assert "no variable 'Aut1' in foreign, the replacement; expected" in text
    assert "such as Out1" in text


def test_the_slots_step_holds_unless_another_is_given() -> None:
    s = System("s").add("hull", "fake:hull", rate="0.02")
    assert s.replace("hull", "fake:hull").components["hull"].rate == s.components["hull"].rate
    assert flatten(s.replace("hull", "fake:hull", rate=0.05)).components[0].step_ticks == 5


def test_start_values_are_kept_in_the_units_of_the_new_component(vehicle: System) -> None:
    tuned = vehicle.set("controller.Kp", 200).set("controller.order", 3)
    swapped = tuned.replace("controller", "fake:foreign", map=ALL_MAPPED, start={"gain": 2})
    assert swapped.components["controller"].start == {"Kp": 0.2, "gain": 2.0}


def test_an_extra_parameter_of_the_replacement_can_be_set(vehicle: System) -> None:
    swapped = vehicle.replace("controller", "fake:foreign", map=ALL_MAPPED)
    assert swapped.set("controller.gain", 3).components["controller"].start["gain"] == 3.0


def test_a_component_inside_a_nested_system_is_swapped(vehicle: System) -> None:
    inner = System("inner").add("c", "fake:controller").expose("tau_d", "c.tau_d")
    outer = System("outer").add("v", inner).add("a", "fake:allocation")
    outer = outer.connect("v.tau_d", "a.tau_d")
    swapped = outer.replace(
        "v.c", "fake:foreign", map={f"tau_d[{i}]": f"Out{i}" for i in range(1, 7)}
    )
    assert len(flatten(swapped).transfers) == 6
    assert outer.slot("v.c").connectors[0].peers == ("tau_d",)


def test_a_swapped_system_can_be_swapped_back(vehicle: System) -> None:
    back = {new: old for old, new in ALL_MAPPED.items()}
    there = vehicle.replace("controller", "fake:foreign", map=ALL_MAPPED)
    assert there.replace("controller", "fake:controller", map=back).connections == (
        vehicle.connections
    )


def test_each_element_keeps_its_own_unit(tmp_path: Path) -> None:
    from uuvsim_cosim.orchestrator.running.library import load

    law = tmp_path / "law.py"
    law.write_text(
        "class Law:\n"
        '    inputs = {n: (6, "1") for n in ()}\n'
        '    outputs = {"tau_d": (6, ("N", "N", "kN", "N.m", "N.m", "N"))}\n'
        "    def step(self, t, dt, u):\n"
        '        return {"tau_d": [0.0] * 6}\n'
    )
    with pytest.raises(SystemInvalid, match=r"tau_d\[6\] has unit 'N'; expected .* in N\.m"):
        load("bluerov2_hold").replace("controller", f"{law}:Law")


def test_elements_are_converted_each_in_its_own_unit() -> None:
    from uuvsim_cosim.orchestrator.plan.flatten import flatten

    plan = flatten(two_units("kN", "N.m"))
    assert {(t.factor, t.source_elements) for t in plan.transfers} == {
        (1000.0, (0,)),
        (1.0, (1,)),
    }


def two_units(*units: str) -> System:
    """A source whose two elements have the given units, on an input in N and N.m."""
    from uuvsim_cosim.fmus.description import Description, Variable
    from uuvsim_cosim.orchestrator.system import resolve

    def described(causality: str, each: tuple[str, ...]) -> Description:
        v = Variable("tau", "Float64", causality, "continuous", (2,), element_units=each)  # type: ignore[arg-type]
        return Description("two", "native", {"tau": v})

    class Two:
        kind = "two"

        def __init__(self, text: str, base: object) -> None:
            self.text = text

        def describe(self) -> Description:
            return (
                described("output", units)
                if "out" in self.text
                else described("input", ("N", "N.m"))
            )

    resolve.register("two", Two)  # type: ignore[arg-type]
    return System("s").add("a", "two:out").add("b", "two:in").connect("a.tau", "b.tau")

"""A component that is made for another vehicle than its hull is named."""

from pathlib import Path

import pytest

from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.running.library import available, load
from uuvsim_cosim.orchestrator.system.system import System


def warned(system: System) -> dict[str, str]:
    """Return the warnings about vehicles by component."""
    found = [w for w in flatten(system).warnings if ", but " in w and " is made for " in w]
    found += [w for w in flatten(system).warnings if "its gains" in w]
    return {w.partition(":")[0]: w for w in found}


def test_a_hull_on_another_vehicles_thrusters_and_gains_is_named() -> None:
    system = load("bluerov2_hold").replace("hull", "model:remus100")
    found = warned(system)
    assert set(found) == {"wrench", "allocation", "controller"}
    assert found["wrench"] == (
        "wrench: is made for bluerov2_heavy, but hull is remus100; expected a component for that "
        "vehicle, such as model:wrench?vehicle=remus100"
    )


@pytest.mark.parametrize("name", available())
def test_no_shipped_system_mixes_vehicles(name: str) -> None:
    assert not warned(load(name))


def test_another_set_of_the_same_vehicle_is_the_same_vehicle() -> None:
    assert not warned(load("bluerov2_hold").replace("hull", "model:bluerov2_heavy@wu_2018"))
    assert not warned(load("bluerov2_hold").replace("hull", "model:vehicle?id=bluerov2_heavy"))


def test_gains_of_a_preset_do_not_follow_the_vehicle() -> None:
    system = (
        System("s", "0.01")
        .add("hull", "model:pool8")
        .add("controller", "model:controller?vehicle=pool8")
    )
    assert set(warned(system)) == {"controller"}
    assert "its gains (bluerov2_pid) are those of bluerov2_heavy" in warned(system)["controller"]


def test_a_component_fits_any_hull_beside_it() -> None:
    system = (
        System("s", "0.01")
        .add("a", "model:bluerov2_heavy")
        .add("b", "model:pool8")
        .add("wrench", "model:wrench")
        .add("other", "model:wrench?vehicle=pool8")
        .add("third", "model:allocation?vehicle=bluerov2")
    )
    assert set(warned(system)) == {"third"}


def test_vehicles_of_nested_systems_are_compared_within_each() -> None:
    inner = System("v", "0.01").add("hull", "model:pool8").add("wrench", "model:wrench")
    system = System("s", "0.01").add("one", inner).add("hull", "model:bluerov2_heavy")
    assert set(warned(system)) == {"one.wrench"}


def test_a_vehicle_in_a_folder_is_known_by_the_id_in_its_file(tmp_path: Path) -> None:
    from uuvsim_cosim.models.importing.new_vehicle import write_vehicle

    folder = write_vehicle("my_rov", tmp_path, "box")
    system = load("bluerov2_hold").replace("hull", f"model:{folder}")
    assert "hull is my_rov" in warned(system)["wrench"]

"""A component that is made for another vehicle than its hull is refused."""

from dataclasses import replace
from pathlib import Path

import pytest

from uuvsim_cosim.errors import SystemInvalid
from uuvsim_cosim.orchestrator.plan.flatten import flatten, plan_to_inspect
from uuvsim_cosim.orchestrator.running.library import available, load
from uuvsim_cosim.orchestrator.ssp.ssd import read_ssd, write_ssd
from uuvsim_cosim.orchestrator.system.system import System


def refused(system: System) -> dict[str, str]:
    """Return the messages about components by path; empty if the system is not refused."""
    try:
        flatten(system)
    except SystemInvalid as error:
        return {p.place: str(p) for p in error.problems}
    return {}


def test_a_hull_on_another_vehicles_thrusters_and_gains_is_refused() -> None:
    found = refused(load("bluerov2_hold").replace("hull", "model:remus100"))
    assert set(found) == {"wrench", "allocation", "controller"}
    assert found["wrench"] == (
        "wrench: made for bluerov2_heavy, but hull is remus100: 8 thrusters, not 1; expected "
        "`uuvsim run hold --vehicle remus100`, or --force (in Python: with_mismatches('warn'))"
    )


def test_a_survey_is_resolved_by_a_survey() -> None:
    found = refused(load("bluerov2_survey").replace("hull", "model:rexrov"))
    assert all("`uuvsim run survey --vehicle rexrov`" in text for text in found.values())
    assert "thruster 1 at (0.156, 0.111, 0.085) m, not (-0.8909" in found["allocation"]


def test_a_survey_of_another_name_is_resolved_by_a_survey() -> None:
    """`uuvsim systems new` names the system after its vehicle, not after its mission."""
    survey = replace(load("bluerov2_survey"), name="my_rov")
    found = refused(survey.replace("hull", "model:pool8"))
    assert "wrench" in found
    assert all("`uuvsim run survey --vehicle pool8`" in text for text in found.values())


def test_a_bare_hull_has_no_mission() -> None:
    system = System("bare", "0.01").add("hull", "model:pool8").add("wrench", "model:wrench")
    text = refused(system.connect("wrench.tau", "hull.tau"))["wrench"]
    assert "expected one with vehicle=pool8, as in model:wrench?vehicle=pool8" in text
    assert "uuvsim run" not in text


def test_a_system_that_allows_mismatches_is_warned_of_each() -> None:
    mixed = load("bluerov2_hold").replace("hull", "model:rexrov")
    warnings = flatten(mixed.with_mismatches("warn")).warnings
    made = [w for w in warnings if ", but hull is rexrov: " in w]
    assert len(made) == len({w.partition(":")[0] for w in made}) + 1  # the controller has two
    assert not any("--force" in w for w in made)


def test_a_refused_system_can_be_inspected() -> None:
    plan, reason = plan_to_inspect(load("bluerov2_hold").replace("hull", "model:rexrov"))
    assert len(plan.components) == 13
    assert "hull is rexrov" in reason


def test_the_policy_is_kept_in_a_file(tmp_path: Path) -> None:
    mixed = load("bluerov2_hold").replace("hull", "model:rexrov").with_mismatches("warn")
    write_ssd(mixed, tmp_path / "mixed.ssd")
    assert read_ssd(tmp_path / "mixed.ssd").mismatches == "warn"
    with pytest.raises(SystemInvalid, match="refuse or warn"):
        mixed.with_mismatches("ignore")  # type: ignore[arg-type]


@pytest.mark.parametrize("name", available())
def test_no_shipped_system_mixes_vehicles(name: str) -> None:
    assert not refused(load(name))


def test_another_set_of_the_same_vehicle_is_the_same_vehicle() -> None:
    assert not refused(load("bluerov2_hold").replace("hull", "model:bluerov2_heavy@wu_2018"))
    assert not refused(load("bluerov2_hold").replace("hull", "model:vehicle?id=bluerov2_heavy"))


def test_gains_of_a_preset_do_not_follow_the_vehicle() -> None:
    hull = System("s", "0.01").add("hull", "model:pool8")
    found = refused(hull.add("controller", "model:controller?vehicle=pool8"))
    assert "its gains (bluerov2_pid) are made for bluerov2_heavy" in found["controller"]
    own = {"Kp": [1.0] * 6, "Ki": [0.0] * 6, "Kd": [1.0] * 6}
    assert not refused(hull.add("controller", "model:controller?vehicle=pool8", own))


def test_a_component_fits_any_hull_beside_it() -> None:
    system = (
        System("s", "0.01")
        .add("a", "model:bluerov2_heavy")
        .add("b", "model:pool8")
        .add("wrench", "model:wrench")
        .add("other", "model:wrench?vehicle=pool8")
        .add("third", "model:allocation?vehicle=bluerov2")
    )
    assert set(refused(system)) == {"third"}


def test_vehicles_of_nested_systems_are_compared_within_each() -> None:
    inner = System("v", "0.01").add("hull", "model:pool8").add("wrench", "model:wrench")
    system = System("s", "0.01").add("one", inner).add("hull", "model:bluerov2_heavy")
    assert set(refused(system)) == {"one.wrench"}


def test_a_vehicle_in_a_folder_is_compared_by_its_figures(tmp_path: Path) -> None:
    from shutil import copytree

    from uuvsim_cosim.content import content

    same = copytree(content("models", "vehicles", "bluerov2_heavy"), tmp_path / "my_rov")
    for file in same.glob("*.yaml"):
        text = file.read_text().replace("id: bluerov2_heavy", "id: my_rov")
        file.write_text(text.replace("vehicle: bluerov2_heavy", "vehicle: my_rov"))
    system = load("bluerov2_hold").replace("hull", f"model:{same}")
    assert not refused(system)
    places = same / "thrusters.yaml"
    places.write_text(places.read_text().replace("0.156", "0.176", 1))
    found = refused(system)
    assert set(found) == {"wrench", "allocation"}
    assert "thruster 1 at (0.156, 0.111, 0.085) m, not (0.176, " in found["wrench"]


def test_an_exported_allocation_is_compared_by_its_places(tmp_path: Path) -> None:
    from uuvsim_cosim.fmus.export.fmu_file import build_fmu
    from uuvsim_cosim.orchestrator.system.sources import ModelSource

    fmu = build_fmu(ModelSource("model:wrench?vehicle=bluerov2_heavy").lowered(), fmi=3)
    hull = System("s", "0.01").add("hull", "model:rexrov").add("wrench", str(fmu))
    assert "not (-0.8909, -0.3344, -0.5288) m" in refused(hull)["wrench"]
    fits = System("s", "0.01").add("hull", "model:bluerov2_heavy").add("wrench", str(fmu))
    assert not refused(fits)

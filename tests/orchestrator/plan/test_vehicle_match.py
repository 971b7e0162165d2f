"""A component that is made for another vehicle, or another set, than its hull is refused."""

from dataclasses import replace
from pathlib import Path
from shutil import copytree

import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import SystemInvalid
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.fmus.export.model_description import FmiVersion
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.orchestrator.plan.flatten import flatten, plan_to_inspect
from uuvsim_cosim.orchestrator.running.library import available, load
from uuvsim_cosim.orchestrator.shipped.of_vehicle import system_of
from uuvsim_cosim.orchestrator.ssp.ssd import read_ssd, write_ssd
from uuvsim_cosim.orchestrator.ssp.ssp import pack
from uuvsim_cosim.orchestrator.system.system import System


def copy_of_heavy(folder: Path) -> Path:
    """Copy a vehicle as one of the user's own, `my_rov`."""
    same = copytree(content("models", "vehicles", "bluerov2_heavy"), folder / "my_rov")
    for file in same.glob("*.yaml"):
        text = file.read_text().replace("id: bluerov2_heavy", "id: my_rov")
        file.write_text(text.replace("vehicle: bluerov2_heavy", "vehicle: my_rov"))
    return same


def refused(system: System) -> dict[str, str]:
    """Return the messages about components by path; empty if the system is not refused."""
    try:
        flatten(system)
    except SystemInvalid as error:
        return {p.place: str(p) for p in error.problems}
    return {}


def test_a_hull_on_another_vehicles_thrusters_and_gains_is_refused() -> None:
    found = refused(load("bluerov2_hold").replace("hull", "model:remus100"))
    assert list(found.values()) == [  # one line, for there is one cause
        "controller, allocation, wrench, thruster_1 to thruster_8: made for bluerov2_heavy, but "
        "hull is remus100: inertia with added mass of surge 19.9 kg, not 31.4 kg; 8 thrusters, "
        "not 1; 51.5 N at full command, not 105 N (model:propeller); expected `uuvsim run hold "
        "--vehicle remus100`, or --force (in Python: with_mismatches('warn'))"
    ]


def test_a_survey_is_resolved_by_a_survey() -> None:
    found = refused(load("bluerov2_survey").replace("hull", "model:rexrov"))
    (text,) = found.values()
    assert "`uuvsim run survey --vehicle rexrov`" in text
    assert "thruster 1 at (0.156, 0.111, 0.085) m, not (-0.8909" in text


def test_a_survey_of_another_name_is_resolved_by_a_survey() -> None:
    """`uuvsim systems new` names the system after its vehicle, not after its mission."""
    survey = replace(load("bluerov2_survey"), name="my_rov")
    found = refused(survey.replace("hull", "model:pool8"))
    (text,) = found.values()
    assert "wrench" in text
    assert "`uuvsim run survey --vehicle pool8`" in text


def test_a_bare_hull_has_no_mission() -> None:
    system = System("bare", "0.01").add("hull", "model:pool8").add("wrench", "model:wrench")
    text = refused(system.connect("wrench.tau", "hull.tau"))["wrench"]
    assert "expected one with vehicle=pool8, as in model:wrench?vehicle=pool8" in text
    assert "uuvsim run" not in text


def test_a_system_that_allows_mismatches_is_warned() -> None:
    mixed = load("bluerov2_hold").replace("hull", "model:rexrov")
    warnings = flatten(mixed.with_mismatches("warn")).warnings
    (made,) = [w for w in warnings if ", but hull is rexrov: " in w]
    assert "--force" not in made


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


def test_a_hull_with_another_set_of_the_same_vehicle_is_refused() -> None:
    assert refused(load("bluerov2_hold").replace("hull", "model:bluerov2_heavy@wu_2018")) == {
        "controller": "controller: made for bluerov2_heavy@von_benzon_2022, but hull is "
        "bluerov2_heavy@wu_2018: inertia with added mass of surge 19.9 kg, not 17 kg; expected "
        "`uuvsim run hold --vehicle bluerov2_heavy@wu_2018`, or --force (in Python: "
        "with_mismatches('warn'))"
    }


@pytest.mark.parametrize(
    "same", ["vehicle?id=bluerov2_heavy", "bluerov2_heavy@von_benzon_2022",
             "vehicle?id=bluerov2_heavy&set=von_benzon_2022"],
)  # fmt: skip
def test_another_address_of_the_same_set_is_not_refused(same: str) -> None:
    assert not refused(load("bluerov2_hold").replace("hull", f"model:{same}"))


@pytest.mark.parametrize(
    "law", ["lqr?vehicle=bluerov2", "mpc?vehicle=bluerov2", "lqr?vehicle=bluerov2_heavy@wu_2018",
            "lqr?id=vehicle&vehicle=bluerov2_heavy@wu_2018", "sliding_mode?vehicle=pool8"],
)  # fmt: skip
def test_gains_for_another_inertia_are_refused_however_near_it_is(law: str) -> None:
    found = refused(load("bluerov2_hold").replace("controller", f"model:{law}"))
    assert "inertia with added mass of surge" in found["controller"]


def test_gains_for_another_damping_are_refused(tmp_path: Path) -> None:
    same = copy_of_heavy(tmp_path)
    file = same / "parameters.yaml"
    file.write_text(file.read_text().replace("D_q_11: {value: 141.0", "D_q_11: {value: 135.0", 1))
    found = refused(load("bluerov2_hold").replace("hull", f"model:{same}"))
    assert "quadratic damping of surge 141 N.s2/m2, not 135 N.s2/m2" in found["controller"]


def with_line(folder: Path, old: str, new: str) -> str:
    """Return the address of a copy of the vehicle with another line in its default set."""
    file = copy_of_heavy(folder) / "parameters.yaml"
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new, 1))
    return f"model:{file.parent}"


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("      x_g: {value: 0.002", "centre of gravity at (0, 0, 0) m, not (0.002, 0, 0) m"),
        ("      I_b_12: {value: 0.006, unit: kg.m2, source: a test}\n      x_g: {value: 0.0",
         "inertia with added mass of roll with pitch 0 kg.m2, not 0.006 kg.m2"),
        ("      M_A_15: {value: 0.05, unit: kg.m, source: a test}\n      x_g: {value: 0.0",
         "inertia with added mass of surge with pitch 0 kg.m, not 0.05 kg.m"),
    ],
)  # fmt: skip
def test_gains_for_another_centre_of_gravity_or_product_of_inertia_are_refused(
    line: str, found: str, tmp_path: Path
) -> None:
    own = with_line(tmp_path, "      z_b: {", f"{line}, unit: m, source: a test}}\n      z_b: {{")
    text = refused(load("bluerov2_hold").replace("hull", own))["controller"]
    assert f"hull is {own.removeprefix('model:')}: {found}; expected" in text


def test_gains_for_another_centre_of_buoyancy_are_refused(tmp_path: Path) -> None:
    own = with_line(tmp_path, "z_b: {value: -0.01,", "z_b: {value: -0.02,")
    text = refused(load("bluerov2_hold").replace("hull", own))["controller"]
    assert "centre of buoyancy at (0, 0, -0.01) m, not (0, 0, -0.02) m" in text


def test_gains_for_products_of_inertia_of_the_other_sign_are_refused() -> None:
    """Two sets of the RexROV differ only in the frame in which its tensor was read."""
    law = "model:lqr?vehicle=rexrov@berg_2012"
    system = System("s", "0.01").add("lqr", law).add("hull", "model:rexrov@uuv_simulator")
    text = refused(system)["lqr"]
    assert "hull is rexrov@uuv_simulator: inertia with added mass of roll with yaw -" in text


def test_small_differences_of_places_and_products_are_no_mismatch(tmp_path: Path) -> None:
    """0.8 mm, and 0.5 % of the mean of the moments of inertia about the two axes."""
    product = "I_b_12: {value: 0.002, unit: kg.m2, source: a test}"
    new = f"{product}\n      z_b: {{value: -0.0108,"
    own = with_line(tmp_path, "z_b: {value: -0.01,", new)
    assert not refused(load("bluerov2_hold").replace("hull", own))


def test_values_that_a_user_sets_are_deliberate() -> None:
    hold = load("bluerov2_hold")
    assert not refused(hold.set("hull.m", 14.5).set("hull.D_q_11", 80.0))
    jets = hold.replace("thruster_1", "model:thruster").set("thruster_1.K_n", 1e-4)
    assert not refused(jets)


def test_an_inertia_that_a_user_sets_in_a_controller_is_deliberate(tmp_path: Path) -> None:
    own = with_line(tmp_path, "m: {value: 13.5,", "m: {value: 14.5,")
    hold = load("bluerov2_hold").replace("hull", own).set("controller.Kp", [1.0] * 6)
    assert "inertia with added mass of surge" in refused(hold)["controller"]
    assert not refused(hold.set("controller.M_ff", [20.86, 21.6, 33.2, 0.449, 0.365, 0.592]))


def test_another_thruster_below_an_allocation_is_refused() -> None:
    hold = load("bluerov2_hold")
    found = refused(hold.replace("thruster_1", "model:thruster_jet"))
    assert found == {
        "thruster_1": "thruster_1: model:thruster_jet, but hull is bluerov2_heavy: 2.73 N at full "
        "command, not 51.5 N (model:thruster_t200); expected model:thruster_t200, or `model: "
        "thruster_jet` in the vehicle's thrusters.yaml and a system made from it, or --force (in "
        "Python: with_mismatches('warn'))"
    }
    assert not refused(hold.replace("thruster_1", "model:thruster"))  # a T200 at 16 V, as a formula


def test_an_allocation_to_other_thrusters_is_refused() -> None:
    quadratic = "model:allocation_quadratic?vehicle=bluerov2_heavy"
    other = load("bluerov2_hold").replace("allocation", quadratic)
    assert "2.73 N at full command, not 51.5 N" in refused(other)["allocation"]
    assert not refused(other.set("allocation.f_max", 51.5))


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_exported_controller_carries_its_vehicle_and_set(fmi: FmiVersion) -> None:
    hold = load("bluerov2_hold")
    for set_, fits in (("von_benzon_2022", True), ("wu_2018", False)):
        model = declare("lqr", id="vehicle", vehicle=f"bluerov2_heavy@{set_}")
        found = refused(hold.replace("controller", str(build_fmu(model, fmi=fmi))))
        assert (not found) is fits
    assert "controller: made for bluerov2_heavy@wu_2018, but hull is" in found["controller"]


def test_an_exported_hull_carries_its_vehicle_and_set() -> None:
    hold = load("bluerov2_hold")
    assert not refused(hold.replace("hull", str(build_fmu(declare("bluerov2_heavy")))))
    other = str(build_fmu(declare("bluerov2_heavy", set="wu_2018")))
    assert "hull is bluerov2_heavy@wu_2018" in refused(hold.replace("hull", other))["controller"]


def test_a_packed_system_is_refused_like_its_original(tmp_path: Path) -> None:
    mixed = load("bluerov2_hold").replace("controller", "model:lqr?vehicle=bluerov2")
    pack(mixed.with_mismatches("warn"), tmp_path / "mixed.ssp")
    read = load(str(tmp_path / "mixed.ssp")).with_mismatches("refuse")
    assert "made for bluerov2, but hull is bluerov2_heavy" in refused(read)["controller"]
    pack(load("bluerov2_hold"), tmp_path / "hold.ssp")
    assert not refused(load(str(tmp_path / "hold.ssp")))


def test_a_python_class_states_its_vehicle(tmp_path: Path) -> None:
    law = """class Law:
    inputs = {"eta_d": 6, "nu_d": 6, "eta": 6, "nu": 6}
    outputs = {"tau_d": 6}
    %s
    def step(self, t, dt, u):
        return {"tau_d": [0.0] * 6}
"""
    for stated, fits in (("", True), ("vehicle = 'bluerov2_heavy'", True),
                         ("vehicle = 'bluerov2_heavy@wu_2018'", False)):  # fmt: skip
        file = tmp_path / f"law_{len(stated)}.py"
        file.write_text(law % stated)
        found = refused(load("bluerov2_hold").replace("controller", f"{file}:Law"))
        assert (not found) is fits
    assert "made for bluerov2_heavy@wu_2018" in found["controller"]


def test_a_component_for_a_vehicle_without_files_is_refused(tmp_path: Path) -> None:
    """Its figures are not known, so that nothing shows that they are those of the hull."""
    file = tmp_path / "law.py"
    file.write_text("""class Law:
    inputs = {"eta_d": 6, "nu_d": 6, "eta": 6, "nu": 6}
    outputs = {"tau_d": 6}
    vehicle = "their_rov"
    def step(self, t, dt, u):
        return {"tau_d": [0.0] * 6}
""")
    text = refused(load("bluerov2_hold").replace("controller", f"{file}:Law"))["controller"]
    assert text.startswith(
        "controller: made for their_rov, but hull is bluerov2_heavy: nothing here"
    )


def test_a_preset_without_a_vehicle_fits_any(tmp_path: Path) -> None:
    text = content("models", "controllers", "bluerov2_pid", "controller.yaml").read_text()
    own = tmp_path / "own.yaml"
    own.write_text(text.replace("vehicle: bluerov2_heavy@von_benzon_2022\n", ""))
    hull = System("s", "0.01").add("hull", "model:pool8")
    assert not refused(hull.add("controller", f"model:controller?vehicle=pool8&id={own}"))


def test_a_component_that_states_no_vehicle_is_compared_within_a_factor(tmp_path: Path) -> None:
    law = """class Law:
    inputs = {"eta_d": 6, "nu_d": 6, "eta": 6, "nu": 6}
    outputs = {"tau_d": 6}
    parameters = {"M_ff": ([%g * x for x in (19.86, 20.62, 32.18, 0.449, 0.365, 0.592)], None)}
    def step(self, t, dt, u):
        return {"tau_d": [0.0] * 6}
"""
    for factor, fits in ((2.4, True), (2.6, False), (0.38, False)):
        file = tmp_path / f"law_{factor}.py"
        file.write_text(law % factor)
        found = refused(load("bluerov2_hold").replace("controller", f"{file}:Law"))
        assert (not found) is fits


def test_gains_of_a_preset_do_not_follow_the_vehicle() -> None:
    hull = System("s", "0.01").add("hull", "model:pool8")
    found = refused(hull.add("controller", "model:controller?vehicle=pool8"))
    (text,) = found.values()
    assert text.startswith("controller (gains of bluerov2_pid): made for bluerov2_heavy, but")
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


def test_another_set_in_a_folder_is_refused_with_the_command_that_flies_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As `uuvsim identify --save-as my_rov@my_fit` writes it."""
    copy_of_heavy(tmp_path)
    monkeypatch.chdir(tmp_path)
    hold = load("bluerov2_hold")
    text = refused(hold.replace("hull", "model:my_rov@wu_2018"))["controller"]
    assert "made for bluerov2_heavy, but hull is my_rov@wu_2018: inertia" in text
    assert "expected `uuvsim run hold --vehicle my_rov@wu_2018`, or --force" in text
    assert not refused(system_of("my_rov@wu_2018"))


def test_a_vehicle_in_a_folder_is_compared_by_its_figures(tmp_path: Path) -> None:
    same = copy_of_heavy(tmp_path)
    system = load("bluerov2_hold").replace("hull", f"model:{same}")
    assert not refused(system)
    places = same / "thrusters.yaml"
    places.write_text(places.read_text().replace("0.156", "0.176", 1))
    found = refused(system)
    (text,) = found.values()
    assert text.startswith("allocation, wrench: ")
    assert "thruster 1 at (0.156, 0.111, 0.085) m, not (0.176, " in text


def test_an_exported_allocation_is_compared_by_its_places(tmp_path: Path) -> None:
    fmu = build_fmu(declare("wrench", vehicle="bluerov2_heavy"))
    hull = System("s", "0.01").add("hull", "model:rexrov").add("wrench", str(fmu))
    assert "not (-0.8909, -0.3344, -0.5288) m" in refused(hull)["wrench"]
    fits = System("s", "0.01").add("hull", "model:bluerov2_heavy").add("wrench", str(fmu))
    assert not refused(fits)

"""Adding a vehicle is adding a folder: written, checked, wrong in every way, and simulated."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from uuvsim_cosim.cli import status_of
from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.checks.checks import checks_of
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.importing.new_vehicle import _SIZES as SIZES
from uuvsim_cosim.models.importing.new_vehicle import RHO, write_vehicle
from uuvsim_cosim.models.vehicles.outline import outline_svg
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.system.system import System


@pytest.mark.parametrize("shape", ["box", "torpedo"])
def test_a_new_vehicle_holds_every_check_at_once(shape: str, tmp_path: Path) -> None:
    folder = write_vehicle("mine", tmp_path, shape)
    assert all(c.holds for c in checks_of(str(folder)))
    assert declare(str(folder)).name == "mine"
    assert declare(f"{folder}@estimated").name == "mine"
    assert outline_svg(str(folder)).startswith("<svg")


def test_the_drag_of_a_new_box_is_that_of_its_faces(tmp_path: Path) -> None:
    text = (write_vehicle("mine", tmp_path, "box") / "parameters.yaml").read_text()
    p = {name: float(value) for name, value in re.findall(r"(D_[lq]_\d\d): {value: (\S+),", text)}
    length, breadth, height = SIZES["box"]
    faces = (breadth * height, length * height, length * breadth)
    for i, face in enumerate(faces, 1):
        assert p[f"D_q_{i}{i}"] == pytest.approx(0.5 * RHO * 1.05 * face, rel=1e-5)
        assert p[f"D_l_{i}{i}"] == pytest.approx(0.1 * p[f"D_q_{i}{i}"], rel=1e-5)  # at 0.1 m/s


def test_each_line_of_a_new_vehicle_says_its_unit_and_source(tmp_path: Path) -> None:
    text = (write_vehicle("mine", tmp_path) / "parameters.yaml").read_text()
    numbers = [r for r in text.splitlines() if "value:" in r]
    assert len(numbers) > 20
    assert all("unit:" in r and "source:" in r for r in numbers)


def test_the_command_writes_it_and_says_how_to_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert not status_of(["models", "new", "my_auv", "--shape", "torpedo"])
    said = capsys.readouterr().out
    assert "model:my_auv" in said
    assert not status_of(["models", "check", "my_auv"])
    assert "7 of 7 comparisons hold" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "shape", "message"),
    [
        ("My-Rov", "box", "lower case"),
        ("mine", "cube", "box or torpedo"),
        ("there", "box", "unused"),
    ],
)
def test_what_cannot_be_written_is_refused(
    name: str, shape: str, message: str, tmp_path: Path
) -> None:
    write_vehicle("there", tmp_path)
    with pytest.raises(InputInvalid, match=message):
        write_vehicle(name, tmp_path, shape)


def steered(vehicle: str, u: float, rudder: float) -> System:
    """Hull, propeller and fins of one folder, wired by the connectors that all of them share."""
    return (
        System("steered", "0.02")
        .add("hull", f"model:{vehicle}", start={"eta_0": [0, 0, 20, 0, 0, 0]})
        .add("propeller", f"model:propeller?vehicle={vehicle}", start={"u": u})
        .add(
            "fins", f"model:fins?vehicle={vehicle}&contact=true", start={"u": [rudder] * 2 + [0, 0]}
        )
        .connect("propeller.tau", "fins.contact")
        .connect("fins.tau", "hull.tau")
        .connect("hull.nu_r", "propeller.nu_r")
        .connect("hull.nu_r", "fins.nu_r")
    )


@pytest.mark.parametrize("shipped", [None, "remus100"])
def test_driven_and_steered_it_turns_the_way_of_its_rudder(
    shipped: str | None, tmp_path: Path
) -> None:
    """A rudder turned right-handed leads to port. One's own folder: no code, and no entry."""
    vehicle = shipped or str(write_vehicle("mine", tmp_path, "torpedo"))
    for rudder, side in ((0.1, -1), (-0.1, 1)):
        out = tmp_path / f"run{side}"
        run(steered(vehicle, 0.5, rudder), until=10, out=out, backend="native")
        nu = read_signals(out)["hull.nu"]
        assert nu[-1, 0] > 0.5
        assert side * nu[-1, 5] > 0.05


# ---- mistakes -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("      D_q_11:", "      Dq_11:", "expected one such as D_q_11"),
        ("      M_A_11:", "      M_A_1:", "expected one such as M_A_"),
        ("      M_A_11:", "      Xudot:", "expected M_A_11, its negative"),
        ("      D_q_22:", "      Y_v|v|:", "expected D_q_22, its negative"),
        ("      m: {", "      mass: {", "mass: not a parameter of a hull; expected m"),
        ("      I_g_11:", "      Ixx:", "expected I_g_11 about CG, or I_b_11 about CO"),
        ("M_A_11: {value: 6.2", "M_A_11: {value: -6.2", "added mass (M_A) has the eigenvalue"),
        (
            "I_g_22: {value: 0.27",
            "I_g_13: {value: 0.9, unit: kg.m2, source: nobody}\n      I_g_22: {value: 0.27",
            "inertia about CG (M_RB)",
        ),
        ("shape: box", "shape: cube", "expected box, torpedo or ellipsoid"),
        ("size: {value: [0.45, 0.35", "size: {value: [0.45, -0.35", "expected a length above 0"),
        ("unit: m, shape", "unit: kg, shape", "size: unit 'kg'; expected 'm'"),
        ("      height: {", "      U_f: {", "U_f"),
    ],
)
def test_a_mistake_says_where_what_and_what_would_be_right(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    folder = write_vehicle("mine", tmp_path)
    path = folder / "parameters.yaml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ParameterInvalid) as caught:
        declare(str(folder))
    assert message in str(caught.value)
    assert "parameters.yaml:" in str(caught.value)


def test_strips_without_their_density_are_refused(tmp_path: Path) -> None:
    folder = write_vehicle("mine", tmp_path, "torpedo")
    path = folder / "parameters.yaml"
    rows = [r for r in path.read_text().splitlines() if "      h_y:" not in r and "x_bow:" not in r]
    path.write_text("\n".join(rows))
    with pytest.raises(ParameterInvalid, match="x_bow, h_y missing; expected all that cross-flow"):
        declare(str(folder))


def test_a_name_that_is_nearly_a_vehicle_is_answered_with_it() -> None:
    with pytest.raises(InputInvalid, match="remus100"):
        declare("remus10")


def test_an_edited_file_is_read_again(tmp_path: Path) -> None:
    folder = write_vehicle("mine", tmp_path)
    before = declare(str(folder)).variables["z_b"].start[0]
    path = folder / "parameters.yaml"
    path.write_text(path.read_text().replace("z_b: {value: -0.02", "z_b: {value: -0.0312345"))
    assert before == -0.02
    assert declare(str(folder)).variables["z_b"].start[0] == -0.0312345


@pytest.mark.parametrize(
    ("set", "expect", "message"),
    [
        ("none", "{nu: [1, null, null, null, null, null]}", "set: 'none'; expected estimated"),
        ("estimated", "{nu: [1]}", "expected six numbers"),
        ("estimated", "{speed: [1, 2, 3, 4, 5, 6]}", "expected eta, nu, nu_dot or nu_r"),
    ],
)
def test_a_check_that_cannot_be_made_is_refused(
    set: str, expect: str, message: str, tmp_path: Path
) -> None:
    folder = write_vehicle("mine", tmp_path)
    (folder / "checks.yaml").write_text(
        f"vehicle: mine\nchecks:\n  - {{what: speed, set: {set}, until: 0, expect: {expect},"
        " tolerance: 1, source: nobody}\n"
    )
    with pytest.raises(InputInvalid, match=message):
        list(checks_of(str(folder)))


def test_a_check_that_fails_is_said_with_both_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_vehicle("mine", tmp_path)
    (folder / "checks.yaml").write_text(
        "vehicle: mine\nchecks:\n  - {what: standing still, set: estimated, until: 0,"
        " expect: {nu: [1, 0, 0, 0, 0, 0]}, tolerance: 0.1, source: nobody}\n"
    )
    assert status_of(["models", "check", str(folder)]) == 2
    said = capsys.readouterr()
    assert "FAILS" in said.out
    assert "standing still deviates by 1; expected at most 0.1 (nobody)" in said.err


def test_a_check_reads_every_file_and_says_all_mistakes_at_once(tmp_path: Path) -> None:
    folder = write_vehicle("mine", tmp_path, "torpedo")
    for file, old, new in (
        ("parameters.yaml", "unit: kg, source", "unit: stones, source"),
        ("parameters.yaml", "I_g_22: {value: ", "I_g_22: {value: -"),
        ("parameters.yaml", "M_A_22: {value: ", "M_A_22: {value: -"),
        ("parameters.yaml", "D_q_11:", "Dq_11:"),
        ("thrusters.yaml", "model: propeller", "model: propellor"),
        ("thrusters.yaml", "r: {value: [-0.8", "r: {value: [-9.8"),
        ("propeller.yaml", "T_nn:", "T_nnn:"),
        ("fins.yaml", "a: {value: [0, 1, 0]", "a: {value: [0, 3, 0]"),
    ):
        text = (folder / file).read_text()
        assert old in text
        (folder / file).write_text(text.replace(old, new, 1))
    (folder / "fin.yaml").write_text("fins: []\n")
    with pytest.raises(ParameterInvalid) as refused:
        list(checks_of(str(folder)))
    said = str(refused.value).splitlines()
    for words in (
        r"parameters.yaml:\d+: m: unknown unit 'stones'",
        r"parameters.yaml:\d+: sets.estimated: I_g_22: inertia",
        r"parameters.yaml:\d+: sets.estimated: M_A_22: added mass",
        r"parameters.yaml:\d+: Dq_11: not a parameter",
        r"thrusters.yaml:\d+: model: 'propellor'; expected one such as propeller",
        r"thrusters.yaml:\d+: .* m from CO; expected at most",
        r"propeller.yaml:\d+: parameters.T_nnn: unknown; expected one such as T_nn",
        r"fins.yaml:\d+: a = .*; expected length 1",
        r"fin.yaml: not a file of a vehicle, nothing reads it; expected .*fins.yaml",
    ):
        assert sum(bool(re.search(words, line)) for line in said) == 1, (words, said)


def test_the_off_diagonal_that_a_mass_cannot_bear_is_named_by_its_line(tmp_path: Path) -> None:
    path = write_vehicle("mine", tmp_path) / "parameters.yaml"
    text = path.read_text().replace(
        "      M_A_66:", "      M_A_26: {value: 90, unit: kg.m, source: nobody}\n      M_A_66:"
    )
    path.write_text(text)
    line = text[: text.index("M_A_26")].count("\n") + 1
    with pytest.raises(ParameterInvalid, match=rf":{line}: sets.estimated: M_A_26: added mass"):
        declare(str(path.parent))


def test_an_inertia_that_no_body_has_fails_a_check(tmp_path: Path) -> None:
    path = write_vehicle("mine", tmp_path) / "parameters.yaml"
    path.write_text(path.read_text().replace("I_g_22: {value: 0.27", "I_g_22: {value: 2.27"))
    failed = {c.what: c.off for c in checks_of(str(path.parent)) if not c.holds}
    assert failed == {"inertia is of a body": pytest.approx(2.279441 / (0.195081 + 0.34271) - 1)}

"""Limits, axes and gains that follow from a vehicle's own files."""

import re
from collections.abc import Callable
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.control.vehicle_design import (
    AXES,
    control_design,
    propelled_speed,
    thrusters_of,
)
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.importing.new_vehicle import write_vehicle

Made = Callable[[list[tuple[list[float], list[float]]]], str]


@pytest.fixture
def with_thrusters(tmp_path: Path) -> Made:
    """Make a BlueROV2 Heavy with other thrusters: (r, e) of each; return its folder."""

    def made(places: list[tuple[list[float], list[float]]]) -> str:
        folder = copytree(content("models", "vehicles", "bluerov2_heavy"), tmp_path / "my_rov")
        rows = "".join(
            f"  - {{name: t{i}, r: {{value: {r}, unit: m}}, e: {{value: {e}, unit: '1'}}}}\n"
            for i, (r, e) in enumerate(places, 1)
        )
        text = f"vehicle: my_rov\nsource: chosen\nmodel: thruster_t200\nthrusters:\n{rows}"
        (folder / "thrusters.yaml").write_text(text)
        return str(folder)

    return made


def test_four_thrusters_at_45_degrees_give_twice_root_two_of_the_weaker_way() -> None:
    t = thrusters_of("pool8")
    assert t.tau_max[0] == pytest.approx(2 * np.sqrt(2) * t.forward, rel=1e-6)
    assert t.tau_max[2] == pytest.approx(4 * t.forward, rel=1e-6)


def test_the_largest_force_of_an_axis_is_made_without_force_in_the_others() -> None:
    t = thrusters_of("bluerov2_heavy")
    for axis in t.controlled:
        wanted = np.zeros(6)
        wanted[axis] = t.tau_max[axis]
        f = np.linalg.pinv(t.T) @ wanted
        assert t.T @ f == pytest.approx(wanted, abs=1e-6)


@pytest.mark.parametrize(
    ("vehicle", "missing", "passive"),
    [
        ("bluerov2", [], ["pitch"]),
        ("bluerov2_heavy", [], []),
        ("rexrov2", [], []),
        ("sphere", [], ["pitch"]),
        ("desistek_saga", ["sway"], ["roll", "pitch"]),
        ("remus100", ["sway", "heave", "yaw"], ["roll", "pitch"]),
    ],
)
def test_axes_follow_from_the_places(vehicle: str, missing: list[str], passive: list[str]) -> None:
    t = thrusters_of(vehicle)
    assert [AXES[i] for i in t.missing] == missing
    assert [AXES[i] for i in t.passive] == passive


@pytest.mark.parametrize("vehicle", ["bluerov2", "desistek_saga", "rexrov2", "pool8"])
def test_every_loop_has_the_stated_margins(vehicle: str) -> None:
    for m in control_design(vehicle).margins:
        assert m.phase >= 45
        assert m.gain >= 2 or m.gain <= 0.5


def test_axes_without_force_get_no_gain() -> None:
    design = control_design("desistek_saga")
    assert not design.K[[1, 3, 4]].any()
    assert design.tau_max.tolist()[1] == 0


def test_the_declared_law_has_the_designed_gains() -> None:
    K = declare("lqr", id="vehicle", vehicle="bluerov2").variables["K"].start
    assert K.ravel() == pytest.approx(control_design("bluerov2").K.ravel(), rel=0, abs=0)


def test_thrust_equals_drag_at_the_propelled_speed() -> None:
    # 40 N ahead and D_q_11 = 8 N.s2/m2 of the ECA A9, without linear damping: u² = 40 / 8.
    assert propelled_speed("eca_a9") == pytest.approx(np.sqrt(5.0), rel=1e-9)


def test_a_vehicle_without_thrusters_is_refused(tmp_path: Path) -> None:
    folder = copytree(content("models", "vehicles", "bluerov2_heavy"), tmp_path / "my_rov")
    (folder / "thrusters.yaml").unlink()
    with pytest.raises(ParameterInvalid, match="no thrusters and no propeller"):
        control_design(str(folder))


def test_too_few_thrusters_are_refused_with_the_missing_directions(with_thrusters: Made) -> None:
    two = with_thrusters([([0, 0.2, 0], [1, 0, 0]), ([0, -0.2, 0], [1, 0, 0])])
    with pytest.raises(ParameterInvalid, match="2 thrusters: no force in heave alone"):
        control_design(two)


def test_thrusters_that_cancel_each_other_are_named(with_thrusters: Made) -> None:
    line = with_thrusters(
        [
            ([0.2, 0, 0], [1, 0, 0]),
            ([-0.2, 0, 0], [-1, 0, 0]),
            ([0, 0, 0.1], [0, 0, 1]),
        ]
    )
    with pytest.raises(ParameterInvalid) as refused:
        control_design(line)
    assert "no force in yaw alone; 't1' and 't2' push along the same line" in str(refused.value)


def test_a_hull_that_nothing_holds_upright_is_refused(tmp_path: Path) -> None:
    folder = copytree(content("models", "vehicles", "bluerov2"), tmp_path / "my_rov")
    file = folder / "parameters.yaml"
    file.write_text(file.read_text().replace("z_g: {value: 0.02", "z_g: {value: -0.02", 1))
    with pytest.raises(
        InputInvalid, match="pitch: neither controlled by thrusters nor stable by weight"
    ):
        control_design(str(folder))


def with_mass(mass: float, folder: Path) -> str:
    """Write a new vehicle of 20.6 L with a mass [kg]; return its folder."""
    file = write_vehicle("my_rov", folder) / "parameters.yaml"
    file.write_text(re.sub(r"m: {value: [\d.]+", f"m: {{value: {mass}", file.read_text(), count=1))
    return str(file.parent)


def test_gains_do_not_depend_on_the_net_weight(tmp_path: Path) -> None:
    """A system with this vehicle is refused when it is built: the plan checks what is carried."""
    assert control_design(with_mass(60.0, tmp_path)).remarks == ()


def test_a_large_net_weight_within_the_vertical_thrust_is_reported(tmp_path: Path) -> None:
    assert control_design(with_mass(28.0, tmp_path)).remarks == (
        "weight: 67.4 N heavier than the water that it displaces, 94 % of the usable vertical "
        "thrust (71.8 N)",
    )
    assert control_design("bluerov2_heavy").remarks == ()


def test_a_redundant_pair_on_one_line_is_reported(with_thrusters: Made) -> None:
    g = thrusters_of("bluerov2_heavy").geometry
    places = [(r, e) for r, e in zip(g.r.tolist(), g.e.tolist(), strict=True)]
    pair = [([0.2, 0.0, 0.0], [1.0, 0.0, 0.0]), ([-0.2, 0.0, 0.0], [-1.0, 0.0, 0.0])]
    (remark,) = control_design(with_thrusters([*places, *pair])).remarks
    assert remark.startswith(
        "thrusters: 't9' and 't10' push along the same line, against each other; each runs both"
    )

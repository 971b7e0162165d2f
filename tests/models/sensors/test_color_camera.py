"""The colour camera as a component: the same image by C, by numpy, natively and as FMU."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_here
from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.worlds.obstacles import Sphere
from uuvsim_cosim.models.worlds.scene import Scene, save_scene
from uuvsim_cosim.models.worlds.terrain import Terrain

SIZE: dict[str, Any] = {"columns": 16, "rows": 12, "period": "0.2"}
ETA, Q = [0.0, 1.0, 10.0, 0.0, 0.0, 0.3], [np.cos(0.15), 0.0, 0.0, np.sin(0.15)]
GIVEN: dict[str, Any] = {"eta": ETA, "q": Q, "seed": [3, 5]}
PRESETS = ["rov_class", "camera_class"]


@pytest.fixture(scope="module")
def hills(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Hills with a ball on them, in front of the camera."""
    x = np.arange(40) - 20.0
    z = 14 + np.sin(x[:, None] / 4) * np.cos(x[None, :] / 5)
    folder: Path = tmp_path_factory.mktemp("hills")
    terrain = Terrain(z.astype(np.float32), 1.5, (-30.0, -30.0))
    save_scene(Scene("hills", terrain, (Sphere((5, 3, 11), 1.0),), None, "hills", "made"), folder)
    return str(folder)


def step(component: Any, n: int = 40, **values: Any) -> dict[str, Any]:
    """Set values, step n times 10 ms, return the outputs."""
    variables = component.description.variables
    for name, value in values.items():
        component.set(variables[name], np.asarray(value) if np.ndim(value) else value)
    component.enter_initialization_mode(0.0, None)
    component.exit_initialization_mode()
    for k in range(n):
        component.do_step(k * 0.01, 0.01)
    return {k: component.get(v) for k, v in variables.items() if v.causality == "output"}


def image(scene: str, options: dict[str, Any] | None = None, **values: Any) -> dict[str, Any]:
    model = declare("color_camera", scene=scene, **SIZE | (options or {}))
    return step(Native(model, "s"), **GIVEN | values)


@pytest.mark.parametrize("noise", [True, False])
@pytest.mark.parametrize("id", PRESETS)
def test_c_agrees_with_the_model_in_numpy(hills: str, id: str, noise: bool) -> None:
    options = {
        "depth": True, "labels": True, "normals": True, "others": 1, "noise": noise, "id": id,
        "port": noise, "rolling": True,
    }  # fmt: skip
    model = declare("color_camera", scene=hills, **SIZE | options)
    given: dict[str, Any] = {"eta": ETA, "q": Q, "other_eta_1": [4.0, 0.0, 10.5, 0.1, 0.2, 0.3]}
    given["nu"] = [1.0, 0.2, -0.1, 0.2, 0.1, 0.4]
    parameters: dict[str, Any] = {"other_size": [[0.4, 0.8]]}
    found = step(Native(model, "s"), 40, **given, **parameters)
    wanted = simulate(model, until=0.4, h=0.01, inputs=given, parameters=parameters)
    for v in model.of_kind("output"):
        a, b = np.ravel(found[v.name]).astype(float), np.ravel(wanted[v.name][-1])
        if v.name == "image":  # a level may lie between two numbers, to rounding
            assert np.mean(a != b) < 0.01
            assert np.abs(a - b).max() <= 1.0
        else:
            np.testing.assert_allclose(a, b, rtol=1e-3 if v.name == "mean" else 1e-5)
    assert found["valid"]
    assert np.ptp(found["image"]) > 10
    if id == "rov_class":
        assert set(np.ravel(found["label"])) >= {1, 2, 3}  # bed, ball, the other


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_fmu_has_the_bits_of_the_native_component(hills: str, tmp_path: Path, fmi: Any) -> None:
    model = declare("color_camera", scene=hills, depth=True, labels=True, normals=True, **SIZE)
    wanted = step(Native(model, "s"), **GIVEN)
    component = instantiate_here(
        read_fmu(build_fmu(model, fmi=fmi, target=tmp_path / "c.fmu")), "s"
    )
    found = step(component, **GIVEN)
    component.free()
    for name, value in found.items():
        np.testing.assert_array_equal(value, wanted[name], err_msg=name)
    left_out = {"image", "depth", "label", "normal"} if fmi == 2 else set()
    assert set(wanted) - set(found) == left_out


def test_an_equal_seed_gives_equal_bits_and_another_one_another_noise(hills: str) -> None:
    one, same = (image(hills)["image"] for _ in range(2))
    np.testing.assert_array_equal(one, same)
    assert (image(hills, seed=[3, 6])["image"] != one).any()


def test_the_mean_and_the_share_of_saturated_levels_are_those_of_the_image(hills: str) -> None:
    found = image(hills, exposure_time=0.3)
    assert found["mean"] == pytest.approx(np.mean(found["image"]), rel=1e-12)
    assert found["saturated"] == pytest.approx(np.mean(found["image"] == 255), rel=1e-12)
    assert found["saturated"] > 0.0


def test_grey_levels_rise_with_the_exposure_and_the_lamps(hills: str) -> None:
    at_night = {"sun": [0.0, 0.0, 0.0], "exposure_time": 20.0}
    dark = image(hills, {"noise": False}, **at_night, lamp=0.0)["mean"]
    half, full = (image(hills, {"noise": False}, **at_night, lamp=k)["mean"] for k in (0.5, 1.0))
    assert dark == 0.0
    assert full == pytest.approx(2.0 * half, rel=0.05)


def test_a_camera_above_the_water_is_not_valid_and_shows_noise_alone(hills: str) -> None:
    found = image(hills, {"depth": True}, eta=[0.0, 1.0, -1.0, 0.0, 0.0, 0.0])
    assert not found["valid"]
    assert not np.any(found["depth"])
    assert np.max(found["image"]) < 3


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"columns": 0}, "0 x 12 pixels"),
        ({"columns": 4000, "rows": 3000}, "1 to 250000 values"),
        ({"water": "tap"}, "water: 'tap'"),
        ({"texture_seed": -1}, "texture_seed = -1"),
        ({"labels": "perhaps"}, "true, false"),
        ({"others": 100}, "others = 100"),
        ({"id": "kodak"}, "camera_class, rov_class"),
    ],
)
def test_a_wrong_option_is_refused_by_one_message(options: dict[str, Any], words: str) -> None:
    with pytest.raises((ParameterInvalid, InputInvalid), match=words):
        declare("color_camera", **SIZE | options)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("value: 1144", "value: 0", "focal_length 0, width 1920 pixels"),
        ("-0.2, 0.1, 0.2, 0.2, 0.1]", "-0.2]", "2 numbers; expected 3 of each lamp"),
    ],
)
def test_a_wrong_preset_is_refused_by_one_message(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    shipped = content("models", "sensors", "rov_class", "color_camera.yaml").read_text()
    assert old in shipped
    (tmp_path / "own.yaml").write_text(shipped.replace(old, new))
    with pytest.raises(ParameterInvalid, match=words):
        declare("color_camera", id=str(tmp_path / "own.yaml"))

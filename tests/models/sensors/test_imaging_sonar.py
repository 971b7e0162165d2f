"""Imaging sonar as a component: the same image by C, by numpy, natively and as FMU."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

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

SIZE: dict[str, Any] = {"beams": 7, "bins": 30, "columns": 24, "rays": 10, "range_max": 25}
ETA, Q = [0.0, 1.0, 8.0, 0.0, 0.0, 0.3], [np.cos(0.15), 0.0, 0.0, np.sin(0.15)]
GIVEN: dict[str, Any] = {"eta": ETA, "q": Q, "seed": [3, 5]}


@pytest.fixture(scope="module")
def hills(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Hills with a ball on them, in front of the sonar."""
    x = np.arange(40) - 20.0
    z = 14 + np.sin(x[:, None] / 4) * np.cos(x[None, :] / 5)
    folder: Path = tmp_path_factory.mktemp("hills")
    terrain = Terrain(z.astype(np.float32), 1.5, (-30.0, -30.0))
    save_scene(Scene("hills", terrain, (Sphere((9, 4, 12), 1.5),), None, "hills", "made"), folder)
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
    return step(
        Native(declare("imaging_sonar", scene=scene, **SIZE | (options or {})), "s"),
        **GIVEN | values,
    )


def test_c_agrees_with_the_model_in_numpy(hills: str) -> None:
    options = {"complex": True, "labels": True, "others": 1, "shading": "none"}
    model = declare("imaging_sonar", scene=hills, **SIZE | options)
    given = {"eta": ETA, "q": Q, "other_eta_1": [6.0, -1.0, 11.0, 0.1, 0.2, 0.3]}
    parameters = {"other_size": [[0.4, 0.8]], "absorption": 0.3}
    found = step(Native(model, "s"), **given, **parameters)
    wanted = simulate(model, until=0.4, h=0.01, inputs=given, parameters=parameters)
    for v in model.of_kind("output"):
        a, b = np.ravel(found[v.name]).astype(float), np.ravel(wanted[v.name][-1])
        np.testing.assert_allclose(a, b, atol=1e-5 * max(1.0, np.abs(b).max()), err_msg=v.name)
    assert found["valid"]
    assert set(np.ravel(found["label"])) == {0, 1, 2, 3}  # nothing, the bed, the ball, the other


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_fmu_has_the_bits_of_the_native_component(hills: str, tmp_path: Path, fmi: Any) -> None:
    model = declare("imaging_sonar", scene=hills, labels=True, **SIZE)
    wanted = step(Native(model, "s"), **GIVEN)
    path = build_fmu(model, fmi=fmi, target=tmp_path / "sonar.fmu")
    component = instantiate_here(read_fmu(path), "s")
    found = step(component, **GIVEN)
    component.free()
    for name, value in found.items():
        np.testing.assert_array_equal(value, wanted[name], err_msg=name)


def test_an_equal_pose_gives_equal_bits_and_another_one_another_speckle(hills: str) -> None:
    one, same = (image(hills, noise_level=-200.0)["magnitude"] for _ in range(2))
    np.testing.assert_array_equal(one, same)
    moved = image(hills, noise_level=-200.0, eta=[0.5, *ETA[1:]])["magnitude"]
    assert np.corrcoef(one, moved)[0, 1] < 0.9


def test_the_mean_and_the_peak_are_those_of_the_magnitudes(hills: str) -> None:
    found = image(hills)
    assert found["mean"] == pytest.approx(np.mean(found["magnitude"]), rel=1e-6)
    assert found["peak"] == np.max(found["magnitude"])


def test_only_noise_is_no_range(hills: str) -> None:
    found = image(hills, source_level=-100.0)
    assert not found["valid"]
    assert not np.any(found["range"])
    assert np.all(found["magnitude"] > 0.0)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"bins": 200_000}, "at most"),
        ({"beams": -1}, "1 or more of each"),
        ({"tvg": 35}, "0, 10, 20, 30, 40"),
        ({"shading": "round"}, "none, hamming, hann"),
        ({"range_max": 0.5}, "rising"),
        ({"columns": 2}, "one within a beam"),
        ({"complex": "perhaps"}, "true, false"),
    ],
)
def test_a_wrong_option_is_refused_by_one_message(options: dict[str, Any], words: str) -> None:
    with pytest.raises((ParameterInvalid, InputInvalid), match=words):
        declare("imaging_sonar", **SIZE | options)

"""Images of a colour camera as observations of bytes."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from uuvsim_cosim.envs import Channel, CosimEnv, FunctionTask
from uuvsim_cosim.envs.camera_picture import CameraPicture
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.running.library import load

ROWS, COLUMNS = 6, 8


def env() -> CosimEnv:
    """Hold a depth, and see the image alone."""
    source = f"model:color_camera?columns={COLUMNS}&rows={ROWS}&scene=flat&period=0.1"
    system = load("bluerov2_task").add("camera", source)
    for signal in ("eta", "q"):
        system = system.connect(f"hull.{signal}", f"camera.{signal}")
    return CosimEnv(
        FunctionTask(
            system,
            actions=[Channel("allocation.tau_d[3]", -100, 100, "N")],
            observations=["camera.image"],
            reward=lambda m: -np.abs(m["hull.eta"][:, 2] - 12.0),
            action_step="0.1",
            horizon=2,
            signals=["hull.eta"],
        )
    )


def test_an_environment_of_images_passes_gymnasiums_checks() -> None:
    made = CameraPicture(env(), ROWS, COLUMNS)
    assert made.observation_space == gymnasium.spaces.Box(0, 255, (ROWS, COLUMNS, 3), np.uint8)
    with pytest.warns(UserWarning, match="different from the unwrapped version"):
        check_env(made, skip_render_check=True)
    made.close()


def test_an_image_has_the_grey_levels_of_the_camera() -> None:
    made = CameraPicture(env(), ROWS, COLUMNS)
    made.reset(seed=1)
    for _ in range(2):
        seen = made.step(made.action_space.sample())[0]
    assert seen.dtype == np.uint8
    assert seen.max() > 10
    levels = made.unwrapped.step(made.action_space.sample())[0]
    np.testing.assert_array_equal(made.observation(levels).ravel(), levels)
    made.close()


def test_an_image_of_another_size_is_refused() -> None:
    with pytest.raises(InputInvalid, match=r"144,\); expected the 192 grey levels of 8 rows"):
        CameraPicture(env(), 8, 8)

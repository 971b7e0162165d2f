"""Images of a sonar as observations: bytes, of one environment and of many."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from uuvsim_cosim.envs import Channel, CosimEnv, CosimVectorEnv, FunctionTask
from uuvsim_cosim.envs.sonar_picture import SonarPicture, SonarPictures, picture_of
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.running.library import load

SHAPE = (8, 16)


def task(*more: str) -> FunctionTask:
    """Hold a depth, and see the sonar alone."""
    options = "beams=8&bins=16&columns=10&rays=6&range_max=25&scene=flat&period=0.1"
    system = load("bluerov2_task").add("sonar", f"model:imaging_sonar?{options}")
    for signal in ("eta", "q"):
        system = system.connect(f"hull.{signal}", f"sonar.{signal}")
    return FunctionTask(
        system,
        actions=[Channel("allocation.tau_d[3]", -100, 100, "N")],
        observations=["sonar.magnitude", *more],
        reward=lambda m: -np.abs(m["hull.eta"][:, 2] - 12.0),
        action_step="0.1",
        horizon=2,
        signals=["hull.eta"],
    )


def test_an_environment_of_pictures_passes_gymnasiums_checks() -> None:
    env = SonarPicture(CosimEnv(task()), SHAPE)
    assert env.observation_space == gymnasium.spaces.Box(0, 255, SHAPE, np.uint8)
    with pytest.warns(UserWarning, match="different from the unwrapped version"):
        check_env(env, skip_render_check=True)
    env.close()


def test_pictures_of_many_environments_are_those_of_each() -> None:
    many = SonarPictures(CosimVectorEnv(task(), 3, backend="kernel"), SHAPE)
    one = SonarPicture(CosimEnv(task()), SHAPE)
    found, _ = many.reset(seed=4)
    alone, _ = one.reset(seed=5)
    for _ in range(5):
        np.testing.assert_array_equal(found[1], alone)
        found = many.step(np.zeros((3, 1)))[0]
        alone = one.step(np.zeros(1))[0]
    assert found.dtype == np.uint8
    assert len(np.unique(found)) > 20
    many.close()
    one.close()


def test_other_observations_beside_the_picture_are_refused() -> None:
    env: Any = CosimEnv(task("hull.eta[3]"))
    with pytest.raises(InputInvalid, match="128 magnitudes of 8 beams of 16 bins alone"):
        SonarPicture(env, SHAPE)
    env.close()


def test_levels_that_do_not_rise_are_refused() -> None:
    with pytest.raises(InputInvalid, match="two that rise"):
        picture_of(np.zeros(3), (100.0, 100.0))

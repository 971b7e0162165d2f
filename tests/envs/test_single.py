from __future__ import annotations

import copy
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from tests.envs.drift import LIMIT, Drift, Lag, drifting
from uuvsim_cosim.envs import Channel, CosimEnv, FunctionTask, register
from uuvsim_cosim.errors import ComponentFailed, InputInvalid, ToolchainError

Make = Callable[..., CosimEnv]
BOTH = pytest.mark.parametrize("backend", ["kernel", "master"])


@pytest.fixture
def make() -> Iterator[Make]:
    made: list[CosimEnv] = []

    def one(backend: Any = "auto", render_mode: str | None = None, **options: Any) -> CosimEnv:
        made.append(CosimEnv(Drift(**options), backend=backend, render_mode=render_mode))
        return made[-1]

    yield one
    for env in made:
        env.close()


def lived(env: CosimEnv, seed: int | None, steps: int = LIMIT) -> list[Any]:
    """An episode under actions that depend on the step alone."""
    first: list[Any] = [env.reset(seed=seed)]
    pushes = [np.sin(np.arange(3) + k).astype(np.float32) for k in range(steps)]
    return first + [env.step(a) for a in pushes]


def assert_same(a: list[Any], b: list[Any]) -> None:
    for x, y in zip(a, b, strict=True):
        np.testing.assert_array_equal(x[0], y[0])
        assert x[1:] == y[1:]


class Seen:
    """A window for a machine without a screen."""

    shown = 0

    def __init__(self, title: str, *, render_fps: float) -> None:
        assert render_fps == 5.0

    def show(self, pixels: np.ndarray) -> bool:
        Seen.shown += 1
        return True

    def close(self) -> None:
        pass


@BOTH
def test_gymnasium_finds_nothing_wrong(monkeypatch: pytest.MonkeyPatch, backend: Any) -> None:
    monkeypatch.setattr("uuvsim_cosim.envs.pictures.window.Window", Seen)
    before = Seen.shown
    register("tests/Single-v0", "tests.envs.drift:Drift", backend=backend)
    env = gymnasium.make("tests/Single-v0", render_mode="rgb_array")
    check_env(env.unwrapped)
    env.close()
    assert Seen.shown > before
    del gymnasium.registry["tests/Single-v0"]


def test_gymnasium_finds_nothing_wrong_with_an_fmu(first_order_fmi3: Path) -> None:
    env = CosimEnv(Lag(first_order_fmi3))
    check_env(env, skip_render_check=True)
    env.close()


def test_kernel_and_master_live_the_same_episodes(make: Make) -> None:
    kernel, master = make("kernel"), make("master")
    for seed in (3, None, None, 3, 2**63):
        assert_same(lived(kernel, seed), lived(master, seed))


@BOTH
def test_a_seed_gives_the_same_episodes_again_and_another_gives_others(
    make: Make, backend: Any
) -> None:
    env = make(backend)
    first = [lived(env, 5), lived(env, None), lived(env, None)]
    again = [lived(env, 5), lived(env, None), lived(env, None)]
    for a, b in zip(first, again, strict=True):
        assert_same(a, b)
    starts = [e[0][0].tolist() for e in [*first, lived(env, 6)]]
    assert len(set(map(tuple, starts))) == 4


def test_a_seed_reaches_the_noise_of_components(make: Make) -> None:
    env = make()
    current = []
    for seed in (1, 2):
        env.reset(seed=seed, options={"start": {"hull.eta_0": [0, 0, 5, 0, 0, 0]}})
        for _ in range(5):
            observation = env.step(np.zeros(3))[0]
        current.append(observation[-2:].tolist())
    assert current[0] != current[1]


def test_interleaved_environments_do_not_touch_each_other(make: Make) -> None:
    a, b = make(), make()
    alone = lived(a, 1)
    a.reset(seed=1)
    b.reset(seed=2)
    for k in range(LIMIT):
        action = np.sin(np.arange(3) + k).astype(np.float32)
        b.step(-action)
        np.testing.assert_array_equal(a.step(action)[0], alone[k + 1][0])


@BOTH
def test_the_time_limit_truncates_and_the_end_terminates(make: Make, backend: Any) -> None:
    ends = [e[2:4] for e in lived(make(backend), 1)[1:]]
    assert ends == [(False, False)] * (LIMIT - 1) + [(False, True)]
    env = make(backend, reach=0.0)
    env.reset(seed=1)
    assert env.step(np.zeros(3))[2:4] == (True, False)


def test_an_action_is_held_for_an_exact_number_of_steps(make: Make) -> None:
    env = make()
    env.reset(seed=1)
    plant = env._simulation.episodes.plant  # type: ignore[union-attr]
    ticks = []
    plant_step = plant.step
    plant.step = lambda n: (ticks.append(n), plant_step(n))[1]  # type: ignore[method-assign,assignment]
    for _ in range(LIMIT):
        env.step(np.zeros(3))
    assert ticks == [4] * LIMIT
    moment = env._simulation.episodes.moment  # type: ignore[union-attr]
    assert moment.time.tolist() == [1.6]


@BOTH
def test_start_values_by_name_hold_for_one_episode(make: Make, backend: Any) -> None:
    env = make(backend)
    eta = np.array([1, 2, 3, 0, 0, 0.5])
    seen, _ = env.reset(seed=1, options={"start": {"hull.eta_0": eta, "hull.m": 12.5}})
    np.testing.assert_allclose(seen[:5], [0.02, 0.04, 0.06, np.sin(0.5), np.cos(0.5)], rtol=1e-6)
    again, _ = env.reset(seed=1)
    assert not np.array_equal(seen, again)
    np.testing.assert_array_equal(env.reset(seed=1)[0], again)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"start": {"hull.eta0": [0] * 6}}, "'hull.eta0': no such variable.*hull.eta_0"),
        ({"start": {"hull.eta_0": [0] * 5}}, r"numbers of shape \(5,\)"),
        ({"start": {"hull.eta_0": [np.nan] * 6}}, "not finite"),
        ({"start": {"hull.eta_0": "north"}}, "expected numbers"),
        ({"start": {"hull.eta": [0] * 6}}, "of causality output"),
        ({"start": 3}, "expected start values by name"),
        (3, "expected a dictionary"),
    ],
)
def test_wrong_options_are_refused_and_the_environment_lives_on(
    make: Make, options: Any, words: str
) -> None:
    env = make()
    env.reset(seed=1)
    with pytest.raises(InputInvalid, match=words):
        env.reset(options=options)
    env.reset(seed=1)
    env.step(np.zeros(3))


@pytest.mark.parametrize("seed", ["one", 1.5, -1, True])
def test_a_wrong_seed_is_refused(make: Make, seed: Any) -> None:
    with pytest.raises(InputInvalid, match="expected a whole number from 0 to"):
        make().reset(seed=seed)


def test_steps_outside_an_episode_are_refused(make: Make) -> None:
    env = make(reach=0.0)
    with pytest.raises(InputInvalid, match="no episode has begun; expected reset"):
        env.step(np.zeros(3))
    env.reset(seed=1)
    env.step(np.zeros(3))
    with pytest.raises(InputInvalid, match="the episode has ended; expected reset"):
        env.step(np.zeros(3))
    env.close()
    env.close()
    for call in (env.reset, lambda: env.step(np.zeros(3)), env.render):
        with pytest.raises(InputInvalid, match="is closed"):
            call()


@pytest.mark.parametrize("closed", [False, True])
def test_a_copy_of_an_environment_without_an_episode_begins_as_one_that_is_new(
    make: Make, closed: bool
) -> None:
    env = make()
    if closed:
        lived(env, 2)
        env.close()
    other = pickle.loads(pickle.dumps(env))
    fresh = make()
    assert np.array_equal(other.reset(seed=5)[0], fresh.reset(seed=5)[0])
    for one in (env, other, fresh):
        one.close()


@pytest.mark.parametrize("how", [copy.deepcopy, lambda e: pickle.loads(pickle.dumps(e))])
def test_a_copy_goes_on_with_the_next_episode(make: Make, how: Callable[[Any], Any]) -> None:
    env = make()
    lived(env, 4)
    other = how(env)
    with pytest.raises(InputInvalid, match=r"expected reset\(\)"):
        other.step(np.zeros(3))
    assert_same(lived(env, None), lived(other, None))
    other.close()


@pytest.mark.parametrize(
    ("fault", "words"),
    [(1, "y is nan"), (2, "too hot"), (7, "asks to end"), (8, "before the step's end")],
)
def test_a_failure_terminates_with_a_sentence(
    first_order_fmi3: Path, fault: int, words: str
) -> None:
    env = CosimEnv(Lag(first_order_fmi3, fault=fault))
    for _ in range(2):  # an environment that has failed can be reset
        env.reset(seed=1)
        last = None
        for _ in range(4):
            last = env.step(np.ones(1))
            assert last[1] > 0
            assert last[2:4] == (False, False)
        observation, reward, terminated, truncated, info = env.step(np.ones(1))
        assert (reward, terminated, truncated) == (0.0, True, False)
        assert last is not None
        np.testing.assert_array_equal(observation, last[0])
        assert words in info["failure"]
        assert info["failure"].startswith("component 'lag' failed at t = 0.")
    env.close()


def test_a_failure_is_the_same_in_kernel_and_master(make: Make) -> None:
    runs = []
    for backend in ("kernel", "master"):
        env = make(backend, force=1e308)
        env.reset(seed=1)
        runs.append([env.step(np.ones(3)) for _ in range(1)])
        assert runs[-1][-1][2]
        assert "'hull' failed" in runs[-1][-1][4].pop("failure")
    assert_same(*runs)


def test_a_start_that_fails_is_an_error(first_order_fmi3: Path) -> None:
    env = CosimEnv(Lag(first_order_fmi3))
    with pytest.raises((ComponentFailed, InputInvalid)):
        env.reset(seed=1, options={"start": {"lag.u": np.nan}})
    env.close()


def test_a_wrong_task_lists_every_problem() -> None:
    task = Drift()
    task.actions = (Channel("hull.tauu", -1, 1),)
    task.observations = (Channel("hul.eta"), Channel("hull.eta[6]", sin_cos=True))
    task.signals = ("hull.spead",)
    with pytest.raises(InputInvalid, match="task Drift: 3 problems") as refused:
        CosimEnv(task)
    for words in ("hull.tauu", "'hul.eta'", "hull.spead", "such as tau", "such as hull"):
        assert words in str(refused.value)


@pytest.mark.parametrize(
    ("step", "horizon", "words"),
    [
        ("0.12", "1.2", "action_step: 0.12 s, where a communication step takes 0.05 s"),
        ("0.2", "0.5", "horizon: 0.5 s, where an action takes 0.2 s"),
        ("0", "1", "action_step: 0 s"),
        ("0.2", "-1", "horizon: -1 s"),
    ],
)
def test_times_that_do_not_fit_are_refused_with_both_numbers(
    step: str, horizon: str, words: str
) -> None:
    from fractions import Fraction

    task = Drift()
    task.action_step, task.horizon = Fraction(step), Fraction(horizon)
    with pytest.raises(InputInvalid, match=words):
        CosimEnv(task)


def test_three_tenths_over_one_tenth_is_always_three() -> None:
    from uuvsim_cosim.envs.episodes.episodes import check_times

    task = Drift()
    from fractions import Fraction

    task.action_step, task.horizon = Fraction(str(0.3)), Fraction(str(0.9))
    assert check_times(task, Fraction("0.1")) == []


def test_what_is_no_task_is_refused() -> None:
    with pytest.raises(InputInvalid, match="expected a Task"):
        CosimEnv("uuvsim/StationKeeping-v0")  # type: ignore[arg-type]
    with pytest.raises(InputInvalid, match="render_mode 'ansi'; expected one of rgb_array, human"):
        CosimEnv(Drift(), render_mode="ansi")


def test_rewards_of_a_wrong_shape_are_refused(make: Make) -> None:
    env = make()
    env.reset(seed=1)
    env.task.reward = lambda m: np.zeros((1, 1))  # type: ignore[method-assign,assignment]
    with pytest.raises(InputInvalid, match=r"rewards of shape \(1, 1\); expected \(1,\)"):
        env.step(np.zeros(3))


def test_a_kernel_that_does_not_compile_says_what(
    make: Make, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("UUVSIM_CACHE", str(tmp_path))
    monkeypatch.setenv("CC", "false")
    with pytest.raises(ToolchainError):
        make("kernel")


def test_an_environment_of_a_file_and_a_reward_takes_a_few_lines(tmp_path: Path) -> None:
    drifting().write(tmp_path / "drifting.ssd")
    env = CosimEnv.of(
        tmp_path / "drifting.ssd",
        actions=[Channel("hull.tau[1]", -40, 40)],
        observations=["hull.nu", "hull.eta[1:2]"],
        reward=lambda m: m["hull.nu"][:, 0],
        action_step="0.1",
        horizon=2,
    )
    env.reset(seed=1)
    rewards = [env.step(np.ones(1))[1] for _ in range(20)]
    assert rewards[-1] > 0.1
    assert isinstance(env.task, FunctionTask)
    env.close()


def test_a_task_that_shows_nothing_of_its_own_shows_every_hull(make: Make) -> None:
    env = make(render_mode="rgb_array")
    env.reset(seed=1)
    first = env.render()
    assert first.dtype == np.uint8
    assert first.shape[2] == 3
    env.step(np.ones(3))
    assert env.metadata["render_fps"] == 5.0

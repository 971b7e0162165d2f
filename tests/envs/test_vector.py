from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from tests.envs.drift import LIMIT, Drift, Lag
from uuvsim_cosim.envs import CosimEnv, CosimVectorEnv
from uuvsim_cosim.errors import InputInvalid, UuvsimError

Make = Callable[..., CosimVectorEnv]
KINDS: dict[str, dict[str, Any]] = {
    "kernel": {"backend": "kernel"},
    "threads": {"backend": "kernel", "threads": 2},
    "master": {"backend": "master", "processes": 0},
    "processes": {"backend": "master", "processes": 2},
}
EACH = pytest.mark.parametrize("kind", KINDS)


@pytest.fixture
def make() -> Iterator[Make]:
    made: list[CosimVectorEnv] = []

    def some(kind: str = "kernel", n: int = 5, reach: float = 1e9, **more: Any) -> CosimVectorEnv:
        made.append(CosimVectorEnv(Drift(reach=reach), n, **{**KINDS[kind], **more}))
        return made[-1]

    yield some
    for env in made:
        env.close()


def actions(n: int, k: int) -> np.ndarray:
    return np.sin(np.arange(3 * n).reshape(n, 3) + k).astype(np.float32)


@EACH
def test_environment_i_of_seed_s_is_the_single_one_of_seed_s_plus_i(make: Make, kind: str) -> None:
    """Over several episodes of different lengths, with resets in the step after the end."""
    n, reach = 5, 0.9
    many = make(kind, n, reach)
    ones = [CosimEnv(Drift(reach=reach), backend="kernel") for _ in range(n)]
    seen, infos = many.reset(seed=10)
    singles = [env.reset(seed=10 + i) for i, env in enumerate(ones)]
    ended = [False] * n
    lengths = set()
    for k in range(4 * LIMIT):
        for i, (observation, info) in enumerate(singles):
            np.testing.assert_array_equal(seen[i], observation)
            assert infos["depth"][i] == info["depth"]
        a = actions(n, k)
        seen, rewards, terminated, truncated, infos = many.step(a)
        singles = []
        for i, env in enumerate(ones):
            if ended[i]:
                observation, info = env.reset()
                rest: tuple[Any, ...] = (0.0, False, False)
            else:
                observation, *own, info = env.step(a[i])
                rest = tuple(own)
            assert (rewards[i], terminated[i], truncated[i]) == rest
            singles.append((observation, info))
            ended[i] = rest[1] or rest[2]
            if rest[1]:
                lengths.add(k)
    assert len(lengths) > 2
    for env in ones:
        env.close()


def test_the_two_autoreset_modes_live_the_same_episodes(make: Make) -> None:
    next_step, same_step = make(reach=0.9), make(reach=0.9, autoreset_mode="SameStep")
    assert next_step.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert same_step.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    n = next_step.num_envs
    zero = np.zeros((n, 3))
    episodes: list[list[list[list[float]]]] = [[[] for _ in range(n)] for _ in range(2)]
    first = [e.reset(seed=1)[0] for e in (next_step, same_step)]
    for which in range(2):
        for i in range(n):
            episodes[which][i].append(first[which][i].tolist())
    for _ in range(40):
        seen = next_step.step(zero)[0]
        for i in range(n):
            episodes[0][i].append(seen[i].tolist())
        seen, _, terminated, truncated, infos = same_step.step(zero)
        for i in range(n):
            if terminated[i] or truncated[i]:
                episodes[1][i].append(infos["final_obs"][i].tolist())
            episodes[1][i].append(seen[i].tolist())
    for i in range(n):
        assert episodes[1][i][:40] == episodes[0][i][:40]


def test_the_last_observation_and_info_are_kept_as_gymnasium_keeps_them(make: Make) -> None:
    ours = make(n=3, reach=0.9, autoreset_mode=AutoresetMode.SAME_STEP)
    theirs = SyncVectorEnv(
        [lambda: CosimEnv(Drift(reach=0.9))] * 3, autoreset_mode=AutoresetMode.SAME_STEP
    )
    a, b = ours.reset(seed=4), theirs.reset(seed=4)
    np.testing.assert_array_equal(a[0], b[0])
    compared = 0
    for k in range(3 * LIMIT):
        x, y = ours.step(actions(3, k)), theirs.step(actions(3, k))
        for p, q in zip(x[:4], y[:4], strict=True):
            np.testing.assert_array_equal(p, q)
        assert x[4].keys() == y[4].keys()
        _assert_equal_infos(x[4], y[4])
        compared += "final_obs" in x[4]
    assert compared > 2
    theirs.close()


def _assert_equal_infos(ours: dict[str, Any], theirs: dict[str, Any]) -> None:
    for key, value in theirs.items():
        if key.startswith("_"):
            np.testing.assert_array_equal(ours[key], value)
        elif isinstance(value, dict):
            _assert_equal_infos(ours[key], value)
        else:
            for i in np.flatnonzero(theirs[f"_{key}"]):
                np.testing.assert_array_equal(ours[key][i], value[i])


def test_next_step_is_what_gymnasium_does_with_single_environments(make: Make) -> None:
    ours, theirs = make(n=3, reach=0.9), SyncVectorEnv([lambda: CosimEnv(Drift(reach=0.9))] * 3)
    np.testing.assert_array_equal(ours.reset(seed=4)[0], theirs.reset(seed=4)[0])
    for k in range(3 * LIMIT):
        x, y = ours.step(actions(3, k)), theirs.step(actions(3, k))
        for p, q in zip(x[:4], y[:4], strict=True):
            np.testing.assert_array_equal(p, q)
        _assert_equal_infos(x[4], y[4])
    theirs.close()


@EACH
def test_disabled_waits_for_a_reset_of_those_that_have_ended(make: Make, kind: str) -> None:
    env = make(kind, 3, reach=0.0, autoreset_mode="Disabled")
    env.reset(seed=1)
    before = env.step(np.zeros((3, 3)))[0]
    with pytest.raises(InputInvalid, match=r"environments 0, 1, 2 have ended.*reset_mask"):
        env.step(np.zeros((3, 3)))
    mask = np.array([True, False, True])
    seen, infos = env.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(seen[1], before[1])
    assert not np.array_equal(seen[0], before[0])
    np.testing.assert_array_equal(infos["_depth"], mask)
    with pytest.raises(InputInvalid, match="environments 1 have ended"):
        env.step(np.zeros((3, 3)))
    single = CosimEnv(Drift())
    single.reset(seed=3)
    np.testing.assert_array_equal(seen[2], single.reset()[0])
    single.close()


@pytest.mark.parametrize("mask", [np.ones(4, bool), np.ones(5), np.zeros(5, bool), [True], "all"])
def test_a_wrong_mask_is_refused(make: Make, mask: Any) -> None:
    env = make(autoreset_mode="Disabled")
    env.reset(seed=1)
    with pytest.raises(InputInvalid, match="5 Booleans, at least one of them true"):
        env.reset(options={"reset_mask": mask})


def test_a_mask_needs_a_first_reset_of_all(make: Make) -> None:
    with pytest.raises(InputInvalid, match="before any reset"):
        make(autoreset_mode="Disabled").reset(options={"reset_mask": np.ones(5, bool)})


def test_a_list_gives_each_environment_its_seed(make: Make) -> None:
    env = make(n=3)
    seen, _ = env.reset(seed=[7, 3, 7])
    np.testing.assert_array_equal(seen[0], seen[2])
    single = CosimEnv(Drift())
    np.testing.assert_array_equal(seen[1], single.reset(seed=3)[0])
    single.close()
    with pytest.raises(InputInvalid, match="seed: 2 numbers; expected one, or 3"):
        env.reset(seed=[1, 2])
    with pytest.raises(InputInvalid, match="expected a whole number"):
        env.reset(seed=[1, 2, "x"])  # type: ignore[list-item]
    with pytest.raises(InputInvalid, match="expected a whole number"):
        env.reset(seed="abc")  # type: ignore[arg-type]


def test_without_a_seed_environments_differ_and_go_on(make: Make) -> None:
    env = make(n=3)
    first = env.reset()[0]
    assert len(np.unique(first, axis=0)) == 3
    assert not np.array_equal(env.reset()[0], first)


@EACH
def test_start_values_of_options_may_differ_by_environment(make: Make, kind: str) -> None:
    env = make(kind, 3, autoreset_mode="Disabled")
    eta = np.zeros((3, 6))
    eta[:, 0] = 1, 2, 3
    seen, _ = env.reset(seed=1, options={"start": {"hull.eta_0": eta}})
    np.testing.assert_allclose(seen[:, 0], [0.02, 0.04, 0.06])
    seen, _ = env.reset(options={"start": {"hull.eta_0": [5, 0, 0, 0, 0, 0]},
                                 "reset_mask": np.array([False, True, False])})  # fmt: skip
    np.testing.assert_allclose(seen[:, 0], [0.02, 0.1, 0.06])


@pytest.mark.parametrize("processes", [0, 2])
def test_one_that_fails_ends_alone(first_order_fmi3: Path, processes: int) -> None:
    env = CosimVectorEnv(Lag(first_order_fmi3, fault=2, only=11), 3, processes=processes)
    env.reset(seed=10)
    for _ in range(4):
        last = env.step(np.ones((3, 1)))
    seen, rewards, terminated, truncated, infos = env.step(np.ones((3, 1)))
    assert terminated.tolist() == [False, True, False]
    assert not truncated.any()
    assert rewards[1] == 0.0
    np.testing.assert_array_equal(seen[1], last[0][1])
    assert "too hot" in infos["failure"][1]
    assert infos["failure"][0] is None
    assert infos["_failure"].tolist() == [False, True, False]
    seen, rewards, terminated, _, infos = env.step(np.ones((3, 1)))
    assert not terminated.any()
    assert seen[1] == 0.0
    assert "failure" not in infos
    env.close()


def test_a_killed_worker_is_a_sentence_and_closing_works(make: Make) -> None:
    env = make("processes", 4)
    env.reset(seed=1)
    env._simulation.episodes.plant._workers[0]._process.kill()  # type: ignore[union-attr,attr-defined]
    with pytest.raises(UuvsimError, match="worker process of environments 0 to 1 ended"):
        env.step(np.zeros((4, 3)))
    env.close()


@EACH
def test_a_pickled_copy_goes_on_with_the_next_episodes(make: Make, kind: str) -> None:
    env = make(kind, 3, autoreset_mode="SameStep")
    env.reset(seed=5)
    other = pickle.loads(pickle.dumps(env))
    assert other.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    np.testing.assert_array_equal(env.reset()[0], other.reset()[0])
    other.close()


def test_results_are_not_changed_by_later_calls(make: Make) -> None:
    env = make()
    kept = [env.reset(seed=1)[0]]
    kept += [env.step(actions(5, k))[0] for k in range(3)]
    copies = [k.copy() for k in kept]
    env.step(actions(5, 9))
    env.reset()
    for a, b in zip(kept, copies, strict=True):
        np.testing.assert_array_equal(a, b)


def test_spaces_hold_what_comes_out(make: Make) -> None:
    env = make()
    env.action_space.seed(1)
    seen, _ = env.reset(seed=1)
    assert seen in env.observation_space
    for _ in range(LIMIT + 2):
        seen, rewards, terminated, truncated, _ = env.step(env.action_space.sample())
        assert seen in env.observation_space
        assert rewards.dtype == np.float64
        assert terminated.dtype == truncated.dtype == bool


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"n": 0}, "num_envs 0; expected a whole number from 1"),
        ({"autoreset_mode": "Never"}, "autoreset_mode 'Never'; expected one of 'NextStep'"),
        ({"render_mode": "human"}, "expected 'rgb_array'"),
        ({"threads": 0}, "threads 0; expected a whole number from 1"),
        ({"threads": 1.5}, "threads 1.5; expected a whole number from 1"),
        ({"backend": "master", "processes": 1.5}, "processes 1.5; expected a whole number from 0"),
        ({"n": True}, "num_envs True; expected a whole number from 1"),
        ({"n": 10**9}, r"1000000000 environments of at least \d+ bytes need .* are available"),
        ({"n": 10**9, "backend": "master"}, r"1000000000 environments of at least 4096 bytes"),
    ],
)
def test_wrong_options_are_refused(make: Make, options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputInvalid, match=words):
        make(**options)


def test_steps_before_a_reset_or_after_closing_are_refused(make: Make) -> None:
    env = make()
    with pytest.raises(InputInvalid, match=r"expected reset\(\) first"):
        env.step(np.zeros((5, 3)))
    env.reset(seed=1)
    with pytest.raises(InputInvalid, match=r"shape \(3, 5\); expected numbers of shape \(5, 3\)"):
        env.step(np.zeros((3, 5)))
    env.close()
    env.close()
    with pytest.raises(InputInvalid, match="are closed"):
        env.step(np.zeros((5, 3)))


def test_float32_follows_float64(make: Make) -> None:
    exact, quick = make(), make(dtype="float32")
    np.testing.assert_allclose(exact.reset(seed=1)[0], quick.reset(seed=1)[0], atol=1e-5)
    for k in range(LIMIT):
        a, b = exact.step(actions(5, k)), quick.step(actions(5, k))
        np.testing.assert_allclose(a[0], b[0], atol=1e-4)


def test_each_environment_is_drawn(make: Make) -> None:
    env = make(n=2, render_mode="rgb_array")
    env.reset(seed=1)
    frames = env.render()
    assert frames is not None
    assert len(frames) == 2
    assert frames[0].shape == frames[1].shape

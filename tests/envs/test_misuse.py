"""What used to be accepted in silence, or ended in somebody else's exception."""

from __future__ import annotations

import logging
from typing import Any

import gymnasium
import numpy as np
import pytest

from tests.envs.drift import LIMIT, Drift, drifting
from tests.envs.two import Advance
from uuvsim_cosim import envs
from uuvsim_cosim.envs import Channel, CosimEnv, CosimParallelEnv, CosimVectorEnv, Solo
from uuvsim_cosim.envs.plants.choice import log_warnings_once
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.plan.flatten import flatten

GOOD: dict[str, Any] = {
    "actions": [Channel("hull.tau[1]", -40, 40)],
    "observations": ["hull.nu"],
    "reward": lambda m: m["hull.nu"][:, 0],
    "action_step": "0.1",
    "horizon": 2,
}


@pytest.mark.parametrize(
    ("seed", "refused"), [(2**64 - 1, False), (2**64, True), (2**64 + 5, True)]
)
def test_seeds_do_not_wrap(seed: int, refused: bool) -> None:
    for env in (CosimEnv(Drift()), CosimVectorEnv(Drift(), 1)):
        if refused:
            with pytest.raises(InputInvalid, match=r"from 0 to 2\^64 - 1"):
                env.reset(seed=seed)
        else:
            env.reset(seed=seed)
        env.close()


def test_the_seeds_of_a_vector_do_not_wrap() -> None:
    env = CosimVectorEnv(Drift(), 3)
    env.reset(seed=2**64 - 3)
    with pytest.raises(InputInvalid, match=r"to 2\^64 - 3, for 3 environments"):
        env.reset(seed=2**64 - 2)
    with pytest.raises(InputInvalid, match="expected a whole number"):
        env.reset(seed=[1, 2, 2**64])
    env.close()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"strat": {}}, "'strat': no such option; expected one such as start"),
        ({"zzz": 1}, "'zzz': no such option; expected one of start, reset_mask"),
        ({"start": 5}, "expected start values by name"),
        ({"start": []}, "expected start values by name"),
        ({"reset_mask": np.ones(2, bool)}, "reset_mask; expected it with .*'Disabled' only"),
    ],
)
@pytest.mark.parametrize("many", [False, True])
def test_options_that_are_none_are_refused(options: dict[str, Any], words: str, many: bool) -> None:
    env: Any = CosimVectorEnv(Drift(), 2) if many else CosimEnv(Drift())
    with pytest.raises(InputInvalid, match=words):
        env.reset(seed=1, options=options)
    env.close()


def test_a_team_refuses_options_that_are_nearly_ours() -> None:
    env = CosimParallelEnv(Advance(1))
    with pytest.raises(InputInvalid, match="expected one such as start"):
        env.reset(seed=1, options={"strat": {}})
    with pytest.raises(InputInvalid, match="'Disabled' only"):
        env.reset(seed=1, options={"reset_mask": np.ones(1, bool)})
    env.close()


def test_a_refused_first_reset_decides_no_seed() -> None:
    env = CosimEnv(Drift())
    with pytest.raises(InputInvalid):
        env.reset(seed=5, options={"start": {"hull.mm": 1}})
    first = env.reset()[0]
    assert not np.array_equal(first, env.reset(seed=0)[0])
    env.close()


def test_an_action_has_the_shape_of_its_space() -> None:
    one, many = CosimEnv(Drift()), CosimVectorEnv(Drift(), 1)
    one.reset(seed=1)
    many.reset(seed=1)
    with pytest.raises(InputInvalid, match=r"shape \(1, 3\); expected 3 numbers"):
        one.step(np.zeros((1, 3)))
    with pytest.raises(InputInvalid, match=r"shape \(3,\); expected numbers of shape \(1, 3\)"):
        many.step(np.zeros(3))
    one.close()
    many.close()


class Off(Drift):
    """Drift that gives something wrong for environment 1."""

    def __init__(self, what: str, value: float) -> None:
        super().__init__()
        self.what, self.value = what, value

    def put(self, what: str, values: Any) -> Any:
        values = np.array(values)
        if what == self.what:
            values[1, ...] = self.value
        return values

    def reward(self, m: Any) -> Any:
        return self.put("reward", super().reward(m))

    def extra(self, m: Any) -> Any:
        return self.put("extra", super().extra(m))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("reward", r"task Off: reward\(\): in environment 1 is"),
        ("extra", r"task Off: observation 11, extra\(\)\[:, 0\], in environment 1 is"),
    ],
)
def test_what_is_not_finite_names_task_environment_and_number(
    what: str, words: str, value: float
) -> None:
    env = CosimVectorEnv(Off(what, value), 3)
    with pytest.raises(InputInvalid, match=words + f" {value}; expected a finite number"):
        _lived(env)
    env.close()


def test_what_is_not_finite_of_a_team_names_the_agent() -> None:
    class Sick(Advance):
        def observe(self, m: Any) -> Any:
            seen = super().observe(m)
            return {**seen, "rov_2": seen["rov_2"] * self.factor}

        def reward(self, m: Any) -> Any:
            return {**super().reward(m), "rov_2": np.full(m.n, np.inf)}

        factor = 1.0

    task = Sick(2)
    env = CosimParallelEnv(task)
    env.reset(seed=1)
    with pytest.raises(InputInvalid, match=r"task Sick: reward\(\), 'rov_2',: in environment 0"):
        env.step({a: np.zeros(1) for a in env.agents})
    task.factor = np.nan
    with pytest.raises(InputInvalid, match=r"observe\(\), 'rov_2': number 0 in environment 0 is"):
        env.reset()
    env.close()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"horizon": "abc"}, "horizon 'abc'; expected seconds"),
        ({"horizon": None}, "horizon None; expected seconds"),
        ({"action_step": float("inf")}, "action_step inf; expected seconds"),
        ({"action_step": "1/0"}, "action_step '1/0'; expected seconds"),
        ({"reward": None}, "reward None; expected a function"),
        ({"terminated": 3}, "terminated 3; expected a function"),
        ({"start": lambda d: None}, r"start\(\): None; expected start values by name"),
        ({"info": lambda m: None}, r"info\(\): None; expected arrays by name"),
        ({"info": lambda m: {"a": 1.0}}, r"info\(\), 'a': of shape \(\); expected 1 rows"),
        ({"reward": lambda m: None}, r"reward\(\): rewards of shape \(\)"),
        ({"reward": lambda m: "x"}, r"reward\(\): 'x'; expected numbers"),
        ({"foo": 1}, "CosimEnv.of: option 'foo'; expected an option of its own, one of"),
        (
            {"rewrad": 1},
            "CosimEnv.of: option 'rewrad'; expected an option of its own such as reward",
        ),
        ({"actions": "hull.tau"}, r"actions 'hull.tau'; expected a list of channels, \['hull"),
        ({"observations": "hull.nu"}, r"observations 'hull.nu'; expected a list of channels"),
        ({"signals": "hull.nu"}, r"signals 'hull.nu'; expected a list of names, \['hull.nu'\]"),
        ({"actions": [3]}, "actions: 3; expected a Channel"),
        ({"actions": None}, "actions None; expected a list of channels"),
    ],
)
def test_a_wrong_argument_is_a_sentence(change: dict[str, Any], words: str) -> None:
    with pytest.raises(InputInvalid, match=words):
        _lived(CosimEnv.of(drifting(), **{**GOOD, **change}))


def _lived(env: Any) -> None:
    env.reset(seed=1)
    env.step(np.zeros(env.action_space.shape))


def test_a_missing_argument_is_named() -> None:
    with pytest.raises(InputInvalid, match=r"CosimEnv.of: no reward, horizon; expected a value"):
        CosimEnv.of(drifting(), **{k: v for k, v in GOOD.items() if k not in ("reward", "horizon")})


def test_a_wrong_only_observation_is_one_problem() -> None:
    with pytest.raises(InputInvalid) as caught:
        CosimEnv.of(drifting(), **{**GOOD, "observations": ["hull.nuu"]})
    assert "observations: none" not in str(caught.value)
    assert "problems" not in str(caught.value)
    with pytest.raises(InputInvalid, match="observations: none; expected at least one"):
        CosimEnv.of(drifting(), **{**GOOD, "observations": []})


def test_what_is_of_many_is_refused_for_one_and_says_where_it_belongs() -> None:
    for option in ({"threads": 2}, {"dtype": "float32"}, {"processes": 2}):
        with pytest.raises(
            InputInvalid, match=r"applies to many environments; expected it in make_vec"
        ):
            gymnasium.make("uuvsim/StationKeeping-v0", **option)


def test_a_note_of_a_system_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    from dataclasses import replace

    plan = replace(flatten(drifting()), warnings=("lag.y: no unit given, a test",))
    with caplog.at_level(logging.WARNING):
        assert log_warnings_once(plan).warnings == ()
        log_warnings_once(plan)
    assert caplog.text.count("lag.y: no unit given, a test") == 1


@pytest.fixture
def registered() -> Any:
    envs.register("tests/Timed-v0", "tests.envs.drift:Drift")
    yield "tests/Timed-v0"
    del gymnasium.registry["tests/Timed-v0"]


def test_the_spec_says_how_long_an_episode_is_and_wrappers_use_it(registered: str) -> None:
    env = gymnasium.make(registered)
    assert not any("TimeLimit" in type(e).__name__ for e in _layers(env))
    aware = gymnasium.wrappers.TimeAwareObservation(env)
    assert aware.reset(seed=1)[0].shape == (14,)
    ends = [aware.step(np.zeros(3, np.float32))[2:4] for _ in range(LIMIT)]
    assert ends == [(False, False)] * (LIMIT - 1) + [(False, True)]
    assert env.spec is not None
    again = gymnasium.make(env.spec)
    again.reset(seed=1)
    ends = [again.step(np.zeros(3, np.float32))[2:4] for _ in range(LIMIT)]
    assert ends == [(False, False)] * (LIMIT - 1) + [(False, True)]
    many: Any = gymnasium.make_vec(env.spec, num_envs=2)
    assert isinstance(many, CosimVectorEnv)
    assert many.spec is not None
    assert many.spec.max_episode_steps == LIMIT
    for each in (aware, again, many):
        each.close()


def _layers(env: Any) -> list[Any]:
    return [env, *(_layers(env.env) if isinstance(env, gymnasium.Wrapper) else [])]


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_gymnasiums_own_processes_give_the_same(registered: str, mode: str) -> None:
    from gymnasium.vector import AsyncVectorEnv, AutoresetMode

    theirs = AsyncVectorEnv([_drift] * 2, autoreset_mode=AutoresetMode(mode), context="spawn")
    ours = CosimVectorEnv(Drift(), 2, autoreset_mode=mode)
    np.testing.assert_array_equal(theirs.reset(seed=4)[0], ours.reset(seed=4)[0])
    for k in range(LIMIT + 2):
        action = np.full((2, 3), np.sin(k), np.float32)
        a, b = theirs.step(action), ours.step(action)
        for x, y in zip(a[:4], b[:4], strict=True):
            np.testing.assert_array_equal(x, y)
        if mode == "Disabled" and b[3].any():
            options = [{"reset_mask": b[3]} for _ in range(2)]
            seen = [e.reset(options=o)[0] for e, o in zip((theirs, ours), options, strict=True)]
            np.testing.assert_array_equal(*seen)
    theirs.close()
    ours.close()


def _drift() -> Any:
    return CosimEnv(Drift())


def test_a_reward_of_the_team_is_its_mean_to_one_agent_for_all() -> None:
    class Shared(Advance):
        team_reward = True

        def reward(self, m: Any) -> Any:
            total = sum(super().reward(m).values())
            return dict.fromkeys(self.agents, total)

    summed, shared = CosimEnv(Solo(Advance(2))), CosimEnv(Solo(Shared(2)))
    for env in (summed, shared):
        env.reset(seed=1)
    actions = np.array([0.5, 1.0], np.float32)
    assert shared.step(actions)[1] == pytest.approx(summed.step(actions)[1])
    summed.close()
    shared.close()

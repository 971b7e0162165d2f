from __future__ import annotations

import copy
import subprocess
import sys
from functools import partial
from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from tests.envs.sound import LIMIT, Pair, Sound, many
from uuvsim_cosim.envs.conformance.suite import (
    CLAIMS,
    ConformanceFailed,
    cases,
    check,
    examine,
    main,
)
from uuvsim_cosim.errors import InputInvalid

# ---- broken in one way each ---------------------------------------------------------------


class SharesItsInfo(Sound):
    kept: ClassVar[dict[str, Any]] = {}

    def info(self, failed: bool = False) -> dict[str, Any]:
        self.kept.update(super().info(failed))
        return self.kept


class DrawsWithoutSeed(Sound):
    def seen(self) -> Any:
        seen = super().seen()
        if self.k > 3:
            seen[0] = np.random.default_rng().uniform(-1, 1)
        return seen


class IgnoresItsSeed(Sound):
    episode = 0

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        self.episode = 0 if seed is not None else self.episode + 1
        self.own = np.random.default_rng(self.episode)
        return super().reset(seed=seed, options=options)

    def rng(self) -> np.random.Generator:
        return self.own


class SeedsOnlyItsStart(Sound):
    episode = 0

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        self.episode = 0 if seed is not None else self.episode + 1
        self.own = np.random.default_rng(self.episode)
        return super().reset(seed=seed, options=options)

    def seen(self) -> Any:
        noise = self.own.normal(0, 0.01)
        return np.clip([self.x + noise, self.k / LIMIT], -1, 1).astype(np.float32)


class RepeatsItsEpisode(Sound):
    last = 0

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        self.last = self.last if seed is None else seed
        return super().reset(seed=self.last, options=options)


class SharesItsGenerator(Sound):
    shared = np.random.default_rng(0)

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        if seed is not None:
            SharesItsGenerator.shared = np.random.default_rng(seed)
        return super().reset(seed=seed, options=options)

    def rng(self) -> np.random.Generator:
        return SharesItsGenerator.shared


class CannotBePickled(Sound):
    def __init__(self) -> None:
        super().__init__()
        self.law = lambda x: x


class ForgetsWhenPickled(Sound):
    gain = 1.0

    def __init__(self) -> None:
        super().__init__()
        self.gain = 2.0

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in self.__dict__.items() if k != "gain"}

    def step(self, action: Any) -> Any:
        return super().step(self.gain * action)


class GivesDoubles(Sound):
    def seen(self) -> Any:
        return super().seen().astype(np.float64 if self.k > 4 else np.float32)


class LeavesItsSpace(Sound):
    def seen(self) -> Any:
        return super().seen() + np.float32(2 * (self.k > 4))


class ReusesItsArray(Sound):
    def __init__(self) -> None:
        super().__init__()
        self.buffer = np.zeros(2, np.float32)

    def seen(self) -> Any:
        if self.k < 4:
            return super().seen()
        self.buffer[:] = super().seen()
        return self.buffer


class ChangesItsAction(Sound):
    def step(self, action: Any) -> Any:
        np.clip(action, -0.5, 0.5, out=action)
        return super().step(action)


class SumsItsTime(Sound):
    t = 0.0

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        self.t = 0.0
        return super().reset(seed=seed, options=options)

    def step(self, action: Any) -> Any:
        end = self.t + 0.3
        while self.t < end:  # four sub-steps of 0.1 s now and then
            self.t += 0.1
        return super().step(action)

    def info(self, failed: bool = False) -> dict[str, Any]:
        return {"time": self.t}


class CallsItsLimitTermination(Sound):
    def ends(self, failed: bool) -> tuple[bool, bool]:
        return failed or abs(self.x) > 0.9 or self.k >= LIMIT, False


class HasNoLimit(Sound):
    def ends(self, failed: bool) -> tuple[bool, bool]:
        return False, False


class CallsFailureTruncation(Sound):
    def ends(self, failed: bool) -> tuple[bool, bool]:
        return abs(self.x) > 0.9 and not failed, failed or self.k >= LIMIT


class RaisesItsFailure(Sound):
    def ends(self, failed: bool) -> tuple[bool, bool]:
        if failed:
            raise RuntimeError("the pump stands")
        return super().ends(failed)


class FailsWithNaN(Sound):
    def seen(self) -> Any:
        failed = self.fails_at is not None and self.k == self.fails_at
        return np.full(2, np.nan, np.float32) if failed else super().seen()


class FailsWithoutReason(Sound):
    def info(self, failed: bool = False) -> dict[str, Any]:
        return super().info()


class TakesAnySeed(Sound):
    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        right = isinstance(seed, int) and seed >= 0
        return super().reset(seed=seed if right else None, options=options)


class ClosesOnce(Sound):
    open = True

    def close(self) -> None:
        if not self.open:
            raise ValueError("closed already")
        self.open = False


BROKEN: list[tuple[str, type[Sound]]] = [
    ("interface", SharesItsInfo),
    ("same_seed_same_trajectory", DrawsWithoutSeed),
    ("seed_reaches_observations", IgnoresItsSeed),
    ("noise_follows_seed", SeedsOnlyItsStart),
    ("another_episode_without_seed", RepeatsItsEpisode),
    ("interleaved", SharesItsGenerator),
    ("pickling", CannotBePickled),
    ("pickling", ForgetsWhenPickled),
    ("observations_in_space", GivesDoubles),
    ("observations_in_space", LeavesItsSpace),
    ("observations_kept", ReusesItsArray),
    ("actions_unchanged", ChangesItsAction),
    ("exact_substeps", SumsItsTime),
    ("time_limit_is_truncation", CallsItsLimitTermination),
    ("time_limit_is_truncation", HasNoLimit),
    ("failure_is_termination", CallsFailureTruncation),
    ("failure_is_termination", RaisesItsFailure),
    ("failure_is_termination", FailsWithNaN),
    ("failure_is_termination", FailsWithoutReason),
    ("wrong_seed_refused", TakesAnySeed),
    ("close_twice", ClosesOnce),
]


class Sync(SyncVectorEnv):
    """Rows of Sound, of which subclasses break the vector."""

    mode = AutoresetMode.NEXT_STEP

    def __init__(self, n: int) -> None:
        super().__init__([Sound] * n, autoreset_mode=self.mode)


class HidesItsMode(Sync):
    def __init__(self, n: int) -> None:
        super().__init__(n)
        self.metadata = {}


class SpreadsItsSeeds(Sync):
    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        if isinstance(seed, int):
            seed = [seed + 2 * i for i in range(self.num_envs)]
        return super().reset(seed=seed, options=options)


class LosesTheLast(Sync):
    mode = AutoresetMode.SAME_STEP

    def step(self, actions: Any) -> Any:
        *given, info = super().step(actions)
        info.pop("final_obs", None)
        return *given, info


class GivesTheNextForTheLast(Sync):
    mode = AutoresetMode.SAME_STEP

    def step(self, actions: Any) -> Any:
        observation, *given, info = super().step(actions)
        for i, final in enumerate(info.get("final_obs", ())):
            if final is not None:
                info["final_obs"][i] = observation[i].copy()
        return observation, *given, info


class RewardsItsReset(Sync):
    over: Any = False

    def step(self, actions: Any) -> Any:
        observation, reward, terminated, truncated, info = super().step(actions)
        reward = np.where(self.over, 1.0, reward)
        self.over = terminated | truncated
        return observation, reward, terminated, truncated, info


class SharesRows(Sync):
    def __init__(self, n: int) -> None:
        super().__init__(n)
        self.copy = False


BROKEN_VECTORS = [
    ("autoreset_declared", HidesItsMode),
    ("row_is_single_environment", SpreadsItsSeeds),
    ("terminal_observation_kept", LosesTheLast),
    ("terminal_observation_kept", GivesTheNextForTheLast),
    ("autoreset_obeyed", RewardsItsReset),
    ("observations_kept", SharesRows),
]


class MakesSpacesAnew(Pair):
    def action_space(self, agent: str) -> Any:
        return copy.deepcopy(self.points[agent].action_space)


class EndsWithoutTruncation(Pair):
    def step(self, actions: Any) -> Any:
        observation, reward, terminated, truncated, info = super().step(actions)
        ended = {a: terminated[a] or truncated[a] for a in terminated}
        return observation, reward, ended, dict.fromkeys(ended, False), info


class ClosesOncePair(Pair):
    open = True

    def close(self) -> None:
        if not self.open:
            raise ValueError("closed already")
        self.open = False


class TakesAnySeedPair(Pair):
    def reset(self, seed: Any = None, options: Any = None) -> Any:
        return super().reset(seed if isinstance(seed, int) and seed >= 0 else None, options)


class RepeatsItsEpisodePair(Pair):
    last = 0

    def reset(self, seed: Any = None, options: Any = None) -> Any:
        self.last = self.last if seed is None else seed
        return super().reset(self.last, options)


class SumsItsTimePair(Pair):
    def step(self, actions: Any) -> Any:
        *given, info = super().step(actions)
        late = 0.1 * (self.k > 6)
        return *given, {a: {"time": i["time"] + late} for a, i in info.items()}


BROKEN_PAIRS = [
    ("interface", MakesSpacesAnew),
    ("same_seed_same_trajectory", partial(Pair, DrawsWithoutSeed)),
    ("seed_reaches_observations", partial(Pair, IgnoresItsSeed)),
    ("noise_follows_seed", partial(Pair, SeedsOnlyItsStart)),
    ("another_episode_without_seed", RepeatsItsEpisodePair),
    ("interleaved", partial(Pair, SharesItsGenerator)),  # which interface sees as well
    ("pickling", partial(Pair, CannotBePickled)),
    ("observations_in_space", partial(Pair, GivesDoubles)),
    ("observations_kept", partial(Pair, ReusesItsArray)),
    ("actions_unchanged", partial(Pair, ChangesItsAction)),
    ("exact_substeps", SumsItsTimePair),
    ("time_limit_is_truncation", EndsWithoutTruncation),
    ("wrong_seed_refused", TakesAnySeedPair),
    ("close_twice", ClosesOncePair),
]


def failures(report: Any) -> list[str]:
    return [o.claim for o in report.failures]


START = {"x": 0.1}


# ---- claims -------------------------------------------------------------------------------


def test_a_sound_environment_keeps_every_claim() -> None:
    report = check(
        Sound, vector=many, failing=lambda: Sound(fails_at=5), time_limit=LIMIT, start=START
    )
    assert not report.of("not applicable")


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_each_autoreset_mode_of_gymnasium_keeps_every_claim(mode: AutoresetMode) -> None:
    report = check(Sound, vector=lambda n: SyncVectorEnv([Sound] * n, autoreset_mode=mode))
    kept = [o for o in report.outcomes if o.kind == "vector" and o.verdict != "holds"]
    assert not kept


@pytest.mark.parametrize(("claim", "env"), BROKEN, ids=lambda v: getattr(v, "__name__", ""))
def test_an_environment_broken_in_one_way_fails_one_claim(claim: str, env: Any) -> None:
    failing = (lambda: env(fails_at=5)) if claim == "failure_is_termination" else None
    report = examine(env, failing=failing, time_limit=LIMIT, start=START)
    assert failures(report) == [claim]


@pytest.mark.parametrize(("claim", "env"), BROKEN_VECTORS, ids=lambda v: getattr(v, "__name__", ""))
def test_a_vector_broken_in_one_way_fails_one_claim(claim: str, env: Any) -> None:
    assert failures(examine(Sound, vector=env)) == [claim]


def test_a_sound_team_keeps_every_claim() -> None:
    report = check(Pair, time_limit=LIMIT, start=START)
    assert [o.claim for o in report.of("not applicable")] == ["failure_is_termination"]


@pytest.mark.parametrize(("claim", "env"), BROKEN_PAIRS, ids=lambda v: getattr(v, "__name__", ""))
def test_a_team_broken_in_one_way_fails_one_claim(claim: str, env: Any) -> None:
    failed = failures(examine(env, time_limit=LIMIT, start=START))
    assert failed == (["interface", claim] if claim == "interleaved" else [claim])


def test_every_claim_has_an_environment_that_fails_it() -> None:
    broken = {name for name, _ in (*BROKEN, *BROKEN_VECTORS)}
    assert broken == {c.name for c in CLAIMS}


def test_a_limit_that_nobody_declared_is_seen_when_all_episodes_end_at_it() -> None:
    report = examine(CallsItsLimitTermination, claims=["time_limit_is_truncation"])
    assert "exactly 20 steps" in report.failures[0].sentence


class Twice(ClosesOnce, TakesAnySeed):
    pass


def test_check_raises_with_every_failure() -> None:
    with pytest.raises(ConformanceFailed, match="2 claims fail") as caught:
        check(Twice)
    assert failures(caught.value.report) == ["wrong_seed_refused", "close_twice"]


@pytest.mark.parametrize("name", ["CartPole-v1", "MountainCarContinuous-v0"])
def test_environments_of_gymnasium_conform(name: str) -> None:
    report = check(name)
    assert {o.claim for o in report.of("not applicable")} <= {
        "noise_follows_seed",
        "exact_substeps",
        "time_limit_is_truncation",
        "failure_is_termination",
        "row_is_single_environment",
    }
    assert all(len(o.sentence) > 20 for o in report.of("not applicable"))


@pytest.mark.parametrize("name", ["uuvsim/StationKeeping-v0", "uuvsim/TargetTrackingTarget-v0"])
def test_environments_that_ship_keep_every_claim(name: str) -> None:
    assert not check(name, strict=True).of("not applicable")


def test_an_environment_that_is_only_a_team_is_examined() -> None:
    from pettingzoo.test.example_envs import generated_agents_parallel_v0

    report = examine(generated_agents_parallel_v0.parallel_env, claims=["close_twice", "interface"])
    assert {o.kind for o in report.outcomes} == {"parallel"}


def test_strict_counts_advice_on_spaces() -> None:
    assert failures(examine("CartPole-v1", claims=["interface"], strict=True)) == ["interface"]


def test_an_unknown_id_is_refused_with_near_names() -> None:
    with pytest.raises(InputInvalid, match=r"CartPole-v9.*CartPole-v1"):
        check("CartPole-v9")


def test_an_instance_is_examined_by_its_spec_and_refused_without() -> None:
    env = gymnasium.make("CartPole-v1")
    assert check(env, claims=["close_twice"]).outcomes
    env.close()
    with pytest.raises(InputInvalid, match="a function that makes a new one"):
        check(Sound())


def test_what_is_no_environment_is_refused() -> None:
    with pytest.raises(InputInvalid, match=r"an object of type dict; expected a gymnasium.Env"):
        check(dict)
    with pytest.raises(InputInvalid, match="expected module:function"):
        check("tests.envs.sound:Silent")


def test_an_unknown_claim_is_refused() -> None:
    with pytest.raises(InputInvalid, match="no claim 'speed'"):
        check(Sound, claims=["speed"])


@pytest.mark.parametrize("case", cases(Sound, vector=many), ids=str)
def test_claims_are_tests_of_their_own(case: Any) -> None:
    case()


def test_a_case_that_fails_is_an_assertion() -> None:
    case = next(c for c in cases(ClosesOnce) if c.claim.name == "close_twice")
    with pytest.raises(AssertionError, match="closed already"):
        case()


def test_the_command_says_what_fails(capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        main(["tests.envs.conformance.test_conformance:ClosesOnce", "--claim", "close_twice"]) == 1
    )
    assert "✗ single   close_twice: the second close raises" in capsys.readouterr().out
    assert main(["tests.envs.sound:Sound", "--claim", "close_twice"]) == 0
    assert main(["NoSuch-v0"]) == 2
    assert main(["--list"]) == 0
    assert "A second close does nothing" in capsys.readouterr().out


def test_the_module_runs_from_the_command_line() -> None:
    module = [sys.executable, "-m", "uuvsim_cosim.envs.conformance"]
    command = [*module, "CartPole-v1", "--claim", "close_twice"]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (0, "")
    assert "CartPole-v1: 2 hold, 0 fail, 0 not applicable" in run.stdout

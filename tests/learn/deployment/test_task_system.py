"""A task with its policy as one system: the bits of an environment, also on a page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from tests.kernels.web_assembly.test_module import NEEDS_NODE, mastered
from uuvsim_cosim.envs.single import CosimEnv
from uuvsim_cosim.envs.task.task import Channel, Moment, Task, TeamTask
from uuvsim_cosim.envs.tasks.altitude_following import AltitudeFollowing
from uuvsim_cosim.envs.tasks.station_keeping import StationKeeping
from uuvsim_cosim.envs.tasks.target_tracking import TargetTracking
from uuvsim_cosim.envs.team import CosimParallelEnv
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.kernels.web_assembly.module import web_assembly
from uuvsim_cosim.kernels.web_assembly.node import run_in_node
from uuvsim_cosim.kernels.web_assembly.output_hash import output_hash
from uuvsim_cosim.learn import load_policies, make_task
from uuvsim_cosim.learn.deployment.task_system import task_system
from uuvsim_cosim.learn.policies.policy import Named, Policy
from uuvsim_cosim.learn.training.agents import widths
from uuvsim_cosim.learn.training.loading import policies_by_agent
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.running.library import load

SEED = 7


def some_policy(task: Task | TeamTask) -> Policy:
    """Return a network of random weights, whose actions are of middle size."""
    observed, acted = widths(task)
    random = np.random.default_rng(0)
    tensors = {
        "0.weight": 0.3 * random.normal(size=(16, observed)),
        "0.bias": 0.1 * random.normal(size=16),
        "1.weight": 0.4 * random.normal(size=(acted, 16)),
        "1.bias": np.zeros(acted),
    }
    named = [tuple(Named(f"x{i}", -1.0, 1.0) for i in range(n)) for n in (observed, acted)]
    return Policy("tanh", {k: v.astype(np.float32) for k, v in tensors.items()}, *named, "a task")


class Sinking(Task):
    """Reach a depth; it observes channels, and has a system with random numbers."""

    def expressions(self, m: Any) -> Mapping[str, Any]:
        depth, before = m["hull.eta"][2], m.before["hull.eta"][2]
        return {"reward": before - depth + 0.01 * m.time, "terminated": depth > 10.3}

    @classmethod
    def make(cls) -> Sinking:
        return cls(
            load("bluerov2_task"),
            actions=[Channel("allocation.tau_d[3]", -20.0, 100.0, "N")],
            observations=[Channel("hull.eta[3]", 0.0, 20.0), Channel("hull.nu")],
            action_step="0.1",
            horizon=2,
            signals=["hull.eta"],
        )


def the_task(name: str) -> tuple[Task | TeamTask, dict[str, Policy]]:
    """Return a task of few seconds with its policies by agent."""
    if name == "sinking":
        task: Task | TeamTask = Sinking.make()
        return task, {"agent": some_policy(task)}
    if name == "station keeping":
        task = StationKeeping(horizon=2)
        return task, {"agent": some_policy(task)}
    policies = load_policies({"source": "source_sac", "transition_2": "transition_2_masac"}[name])
    task = make_task(name, {**policies[0].options, "horizon": 4})
    return task, policies_by_agent(task, policies, name)


TASKS = ("sinking", "station keeping", "source", "transition_2")


@pytest.mark.parametrize("name", TASKS)
def test_an_environment_with_the_actions_of_the_system_has_its_bits(name: str) -> None:
    task, policies = the_task(name)
    team = isinstance(task, TeamTask)
    prefix = {agent: f"{agent}_" if team else "" for agent in policies}
    plan = flatten(task_system(task, policies, SEED, "episode"))
    ticks, acts = int(task.action_step / plan.tick), int(task.horizon / task.action_step)
    env: Any = CosimParallelEnv(task) if isinstance(task, TeamTask) else CosimEnv(task)  # type: ignore[arg-type]
    seen, _ = env.reset(seed=SEED)
    total, over = 0.0, False
    with Master(plan, prepare(plan)) as master:

        def output(agent: str, what: str) -> np.ndarray:
            return np.atleast_1d(master.get("task", prefix[agent] + what))

        master.initialize()
        for _ in range(acts):
            moment = env._simulation.episodes.moment
            for signal in task.signals:
                ours = np.ravel(master.get(*signal.rsplit(".", 1)))
                assert np.array_equal(ours, np.ravel(moment[signal][0])), signal
            master.step(1)  # at the tick, the task observes and acts
            assert master.get("task", "return") == total
            for agent in policies:
                known = seen[agent] if team else seen
                assert np.array_equal(output(agent, "observation").astype(np.float32), known)
            actions = {agent: output(agent, "action") for agent in policies}
            seen, reward, terminated, truncated, _ = env.step(actions if team else actions["agent"])
            total += np.mean(list(reward.values())) if team else reward
            over = all(terminated.values()) if team else terminated
            master.step(ticks - 1)
            if over or (all(truncated.values()) if team else truncated):
                break
        assert master.get("task", "ended") == 0.0
        master.step(1)
        assert (master.get("task", "return"), master.get("task", "ended")) == (total, 1.0)
        master.step(2 * ticks)
        assert master.get("task", "return") == total  # rewards after the end do not count
    assert over == (name == "sinking")


@NEEDS_NODE
@pytest.mark.parametrize("name", ["station keeping", "transition_2"])
def test_a_page_computes_the_bits_of_the_native_components(name: str) -> None:
    system = task_system(*the_task(name), SEED, "episode")
    found = run_in_node(web_assembly(system), 150)
    assert found.hash == output_hash(*mastered(system, 150))
    assert found.failure == ""
    assert found.imports == ()


def test_another_seed_gives_another_episode_and_another_policy_another_component() -> None:
    task, policies = the_task("station keeping")
    one = task_system(task, policies, SEED, "episode")
    assert task_system(task, policies, SEED, "episode") == one
    assert task_system(task, policies, SEED + 1, "episode") != one
    changed = {**policies["agent"].tensors, "1.bias": np.full(6, 0.5, np.float32)}
    other = Policy("tanh", changed, policies["agent"].observation, policies["agent"].action, "x")
    system = task_system(task, {"agent": other}, SEED, "episode")
    assert system.components["task"].source != one.components["task"].source


class Python(StationKeeping):
    """Observes by a method of its own."""

    def extra(self, m: Moment) -> Any:
        return super().extra(m)


class Ends(StationKeeping):
    """Ends by a method of its own."""

    def terminated(self, m: Moment) -> Any:
        return m.time > 1.0


class Coming(TargetTracking):
    """Has agents that come and go."""

    def present(self, m: Moment) -> Any:
        return super().present(m)


@pytest.mark.parametrize(
    ("task", "reason"),
    [(AltitudeFollowing(), "extra() is computed by Python"),
     (StationKeeping(privileged=True), "extra() is computed by Python"),
     (TargetTracking(3), "observe() is computed by Python"),
     (Ends(), "terminated() is computed by Python"),
     (Python(), "extra() is computed by Python"),
     (Coming(), "its agents come and go (present())")],
)  # fmt: skip
def test_a_task_that_is_no_component_is_refused_by_name(task: Any, reason: str) -> None:
    with pytest.raises(InputInvalid) as refused:
        task_system(task, {}, SEED, "episode")
    assert f"task {type(task).__name__}: {reason}; expected" in str(refused.value)

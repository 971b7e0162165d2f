"""Compiled expressions of tasks: bits of the NumPy form, who is called, and refusals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
import pytest

import uuvsim_cosim as uuv
from tests.envs.tasks.moments import ArrayMoment
from uuvsim_cosim.envs import Channel, CosimEnv, CosimVectorEnv, Logical, Solo, Task
from uuvsim_cosim.envs.task.expressions import Given, declared_methods, evaluated_of
from uuvsim_cosim.envs.task.task import TeamTask
from uuvsim_cosim.envs.tasks import (
    AltitudeFollowing,
    DisturbanceRejection,
    StationKeeping,
    TargetTracking,
    TrajectoryFollowing,
)
from uuvsim_cosim.errors import InputInvalid

SHIPPED = {
    "one tracker": lambda: Solo(TargetTracking(n_trackers=1, motion="rest")),
    "two trackers, two obstacles": lambda: Solo(TargetTracking(n_obstacles=2)),
    "links, own credit": lambda: Solo(
        TargetTracking(delay=0.3, noise=0.1, loss=0.1, knowledge_range=1.0, n_obstacles=3,
                       rules={"credit": "own", "end_on_collision": True})
    ),
    "the paper's rules, free slots": lambda: Solo(
        TargetTracking(profile="table1", n_obstacles=4, slots=(2, 5))
    ),
    "fewer slots than a team has": lambda: Solo(TargetTracking(n_trackers=1, slots=(0, 0))),
    "station, thrusters": lambda: StationKeeping(action="thrusters"),
    "station, velocity, navigation": lambda: StationKeeping(
        action="velocity", observation="navigation", region=1.0
    ),
    "trajectory": TrajectoryFollowing,
    "disturbance": DisturbanceRejection,
}  # fmt: skip


def leaves(results: Any, path: str = "") -> dict[str, Any]:
    if not isinstance(results, Mapping):
        return {path: np.asarray(results)}
    return {k: v for name, x in results.items() for k, v in leaves(x, f"{path}.{name}").items()}


@pytest.mark.parametrize("name", SHIPPED)
def test_expressions_of_shipped_tasks_have_the_bits_of_their_numpy_form(name: str) -> None:
    task, n = SHIPPED[name](), 11  # no multiple of the lanes
    envs = CosimVectorEnv(task, n)
    width = envs.single_action_space.shape[0]  # type: ignore[index]
    rng = np.random.default_rng(0)
    envs.reset(seed=3)
    evaluated = evaluated_of(task)
    assert evaluated is not None
    for _ in range(6):
        m = envs._simulation.episodes.moment  # type: ignore[union-attr]
        found = evaluated.of(m)
        assert set(found) == {"extra", "reward", "terminated", "info"}
        wanted = {method: getattr(task, method)(m) for method in found}
        for place, values in leaves(wanted).items():
            mine = leaves(found)[place]
            assert (mine.dtype, mine.shape) == (values.dtype, values.shape), place
            assert np.ascontiguousarray(mine).tobytes() == np.ascontiguousarray(values).tobytes()
        envs.step(rng.uniform(-1, 1, (n, width)))
    envs.close()


@pytest.mark.parametrize("n", [1, 11])
def test_compiled_observations_have_the_bits_of_the_box(n: int) -> None:
    envs = CosimVectorEnv(StationKeeping(region=0.5, away=2.0), n)
    simulation, clipped = envs._simulation, 0
    assert simulation is not None
    given, _ = envs.reset(seed=3)
    for _ in range(5):
        m = simulation.episodes.moment
        extra = simulation._given("extra", m)
        wanted = simulation.observation_box.of(m.values, extra)
        assert (given.dtype, given.shape) == (wanted.dtype, wanted.shape)
        assert given.tobytes() == wanted.tobytes()
        assert given.flags.c_contiguous
        clipped += int((given == simulation.observation_box.high).sum())
        given = envs.step(np.ones((n, 6)))[0]
    assert clipped
    envs.close()


class Unlimited(Task):
    """Observe a number that may be beyond its limits."""

    number = 7.0

    def expressions(self, m: Any) -> Mapping[str, Any]:
        return {"extra": ca.vertcat(self.number + 0.0 * m["hull.eta"][0], -5.0, 0.25)}

    @property
    def extra_limits(self) -> tuple[Any, Any]:
        return [-2.0, -3.0, -1.0], [2.0, 3.0, 1.0]


def unlimited(number: float) -> Unlimited:
    task = Unlimited(
        uuv.load("bluerov2_task"),
        actions=[Channel("allocation.tau_d[3]", -100, 100, "N")],
        observations=[],
        signals=["hull.eta"],
        action_step="0.1",
        horizon=1,
    )
    task.number = number
    return task


def test_compiled_observations_are_clipped() -> None:
    env = CosimEnv(unlimited(7.0))
    assert env.reset(seed=0)[0].tolist() == [2.0, -3.0, 0.25]
    env.close()


def test_compiled_observations_that_are_not_finite_are_refused() -> None:
    env = CosimEnv(unlimited(np.nan))
    with pytest.raises(InputInvalid, match=r"extra\(\)\[:, 0\].*finite"):
        env.reset(seed=0)
    env.close()


def plain(task: type[Task] | type[TeamTask], **options: Any) -> Any:
    """Return a task whose environment calls the methods in NumPy."""
    return type("Plain", (task,), {"expressions": lambda self, m: None})(**options)


def test_an_environment_gives_the_same_bits_with_and_without_expressions() -> None:
    envs = [CosimVectorEnv(Solo(t), 5) for t in (TargetTracking(), plain(TargetTracking))]
    rng = np.random.default_rng(1)
    for a, b in zip(*(e.reset(seed=2) for e in envs), strict=True):
        assert repr(a) == repr(b)
    for _ in range(60):  # over the end of an episode
        actions = rng.uniform(-1, 1, (5, 4))
        one, other = (e.step(actions) for e in envs)
        for a, b in zip(one[:4], other[:4], strict=True):
            assert np.asarray(a).tobytes() == np.asarray(b).tobytes()
        assert leaves(one[4]).keys() == leaves(other[4]).keys()


def test_what_only_numpy_has_declares_nothing() -> None:
    for task in (
        AltitudeFollowing(),
        StationKeeping(privileged=True),
        TargetTracking(3),
        TargetTracking(rules={"edges": "exponential"}),
        TargetTracking(n_obstacles=9),
    ):
        assert evaluated_of(task) is None


def test_a_method_that_a_subclass_overrides_is_called() -> None:
    class Frugal(StationKeeping):
        def reward(self, m: Any) -> Any:
            return super().reward(m) - 100.0

    assert declared_methods(Frugal()) == {"extra", "info", "observe", "terminated"}
    env = CosimEnv(Frugal())
    env.reset(seed=0)
    assert env.step(np.zeros(6))[1] < -99


def test_a_method_on_which_results_may_depend_ends_the_use_of_expressions() -> None:
    class Elsewhere(StationKeeping):
        def wanted(self, m: Any) -> Any:
            return super().wanted(m) + 1.0

    class Helped(StationKeeping):
        def of_my_own(self) -> None: ...

        def start(self, draws: Any) -> Any:
            return super().start(draws)

    assert declared_methods(Elsewhere()) == frozenset()
    assert "reward" in declared_methods(Helped())
    task = StationKeeping()
    task.reward = lambda m: np.full(m.n, 7.0)  # type: ignore[method-assign]
    assert "reward" not in declared_methods(task)


class Dive(Task):
    """A task of expressions alone."""

    def __init__(self, results: Any = None) -> None:
        super().__init__(
            uuv.load("bluerov2_task"),
            actions=[Channel("allocation.tau_d[3]", -100, 100, "N")],
            observations=[Channel("hull.eta[3]", 0, 20)],
            action_step="0.1",
            horizon=20,
            signals=["hull.nu"],
        )
        self.results = results

    def expressions(self, m: Any) -> Any:
        if self.results is not None:
            return self.results(m)
        rise = m.before["hull.eta"][2] - m["hull.eta"][2]
        return {
            "reward": rise + m.action["agent"][0] + m.start["current.speed"],
            "terminated": m.step > 2,
            "info": {"time": m.time, "deep": Logical(m["hull.eta"][2] > 10.0), "one": 1.0},
        }

    def start(self, draws: Any) -> Any:
        return {"current.speed": np.linspace(0.1, 0.3, draws.n)}


def test_a_task_of_expressions_alone_reads_all_of_a_moment() -> None:
    envs = CosimVectorEnv(Dive(), 3)
    envs.reset(seed=0)
    before = np.full(3, 10.0)
    actions = np.array([[0.5], [0.0], [-0.5]])
    for k in range(1, 4):
        _, reward, terminated, _, infos = envs.step(actions)
        m = envs._simulation.episodes.moment  # type: ignore[union-attr]
        depth = m["hull.eta"][:, 2]
        np.testing.assert_array_equal(
            reward, before - depth + actions[:, 0] + np.linspace(0.1, 0.3, 3)
        )
        np.testing.assert_array_equal(terminated, k > 2)
        np.testing.assert_array_equal(infos["time"], k / 10)
        np.testing.assert_array_equal(infos["deep"], depth > 10.0)
        assert infos["deep"].dtype == bool
        np.testing.assert_array_equal(infos["one"], 1.0)
        before = depth


def test_its_methods_take_any_moment() -> None:
    eta = np.array([[0, 0, 12.0, 0, 0, 0], [0, 0, 9.0, 0, 0, 0]])
    m = ArrayMoment(
        {"hull.eta": eta},
        {"agent": np.array([[0.25], [0.5]])},
        {"current.speed": np.array([0.5, 0.25])},
        ArrayMoment({"hull.eta": eta + 1.0}),
        step=np.array([2, 3]),
    )
    task = Dive()
    np.testing.assert_array_equal(task.reward(m), [1.75, 1.75])
    np.testing.assert_array_equal(task.terminated(m), [False, True])
    np.testing.assert_array_equal(task.info(m)["deep"], [True, False])
    assert task.extra(m) is None
    assert Given(task)("extra", m) is None


@pytest.mark.parametrize(
    ("results", "message"),
    [
        (lambda m: {"rewards": 0.0}, "'rewards'; expected some of extra, info, observe"),
        (lambda m: 3, "3; expected expressions by name"),
        (lambda m: {"reward": "deep"}, "reward: 'deep'; expected a CasADi expression"),
        (lambda m: {"reward": ca.SX.sym("x")}, "symbols of m alone"),
        (lambda m: {"reward": m["hull.q"][0]}, "hull.q.*is not read by this task"),
        (lambda m: {"reward": m.start["hull.mass"]}, "start value 'hull.mass'"),
        (lambda m: {"reward": m.before.step}, "before.step"),
        (lambda m: {"reward": m.before.before["hull.eta"][0]}, "one action back"),
    ],
)
def test_wrong_expressions_are_refused_by_name(results: Any, message: str) -> None:
    with pytest.raises(InputInvalid, match=message):
        CosimEnv(Dive(results))


def test_a_task_without_reward_and_expressions_cannot_be_made() -> None:
    with pytest.raises(TypeError, match="reward or expressions"):
        Task(uuv.load("bluerov2_task"), actions=[], observations=[], action_step="0.1", horizon=20)


def test_a_value_that_is_not_finite_is_refused_as_in_numpy() -> None:
    env = CosimEnv(Dive(lambda m: {"reward": ca.log(m["hull.eta"][0] - 100.0)}))
    env.reset(seed=0)
    with pytest.raises(InputInvalid, match=r"reward\(\).*is nan"):
        env.step(np.zeros(1))

"""What is learned from a dataset alone, acts: in evaluations, and as a component as torch does."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from uuvsim_cosim.cli import status_of
from uuvsim_cosim.content import content
from uuvsim_cosim.envs.tasks.evaluation import evaluate
from uuvsim_cosim.envs.tasks.tracking_scenarios import SCENARIOS
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.learn.data.collect import collect
from uuvsim_cosim.learn.data.dataset import Dataset, Episode
from uuvsim_cosim.learn.data.dataset_files import read_dataset
from uuvsim_cosim.learn.data.recorded import from_recordings
from uuvsim_cosim.learn.deployment.export import policy_model
from uuvsim_cosim.learn.offline.decision_transformer import (
    DecisionTransformer,
    DtSettings,
    Transformer,
)
from uuvsim_cosim.learn.offline.offline import OFFLINE, offline_learner, train_offline
from uuvsim_cosim.learn.policies.policy import Named, Policy, SequenceRunner
from uuvsim_cosim.learn.shared.errors import LearningDiverged
from uuvsim_cosim.learn.training.loading import acting_in
from uuvsim_cosim.orchestrator.running.run import run

SHIPPED = content("models", "datasets") / "transition_1_scripted.npz"
SMALL: dict[str, dict[str, Any]] = {
    "bc": {"hidden": 16, "steps": 60},
    "iql": {"hidden": 16, "steps": 60},
    "dt": {"hidden": 16, "blocks": 1, "context": 4, "steps": 40, "batch": 16},
}


@pytest.fixture(autouse=True, scope="module")
def one_thread() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="module")
def data() -> Dataset:
    return collect("transition_1", "scripted", 12, options={"horizon": 6})


def made_up(reward: float = 1.0) -> Dataset:
    """Return a game of one number, where what is right is to do the same with the other sign."""
    r = np.random.default_rng(0)
    episodes = []
    for _ in range(40):
        o = r.uniform(-1, 1, (11, 1)).astype(np.float32)
        a = r.uniform(-1, 1, (10, 1)).astype(np.float32)
        episodes.append(Episode(o, a, -reward * ((a + 0.5 * o[:-1]) ** 2)[:, 0], False))
    return Dataset(episodes, (Named("o", -1, 1),), (Named("a", -1, 1),), "none")


def cloned(data: Dataset) -> Dataset:
    every = [replace(e, action=-0.5 * e.observation[:-1]) for e in data.episodes]
    return replace(data, episodes=every)


# ---- what is learned ------------------------------------------------------------------------


@pytest.mark.parametrize("algorithm", ["bc", "dt"])
def test_what_was_done_is_done_again(algorithm: str) -> None:
    steps = {"hidden": 32, "batch": 32} | ({"context": 3, "blocks": 1} if algorithm == "dt" else {})
    learner, _ = offline_learner(cloned(made_up()), algorithm, steps, 0)
    for _ in range(300):
        loss = learner.update()["loss"]
    assert loss < 2e-3


def test_iql_does_better_than_what_was_done() -> None:
    learner, _ = offline_learner(made_up(), "iql", {"hidden": 32, "gamma": 0.0, "batch": 64}, 0)
    for _ in range(400):
        learner.update()
    o = np.linspace(-0.9, 0.9, 19)[:, None]
    error = np.abs(learner.policy()(o) + 0.5 * o).mean()
    assert error < 0.12  # of actions drawn evenly, about 0.54


@pytest.mark.parametrize("algorithm", list(OFFLINE))
def test_equal_seeds_give_equal_bits(algorithm: str) -> None:
    def learned(seed: int) -> Mapping[str, Any]:
        learner, _ = offline_learner(made_up(), algorithm, SMALL[algorithm], seed)
        for _ in range(5):
            learner.update()
        return learner.policy().tensors

    first, again, other = learned(1), learned(1), learned(2)
    assert all(np.array_equal(first[k], again[k]) for k in first)
    assert not all(np.array_equal(first[k], other[k]) for k in first)


@pytest.mark.parametrize("algorithm", list(OFFLINE))
def test_a_policy_of_each_kind_is_written_and_evaluated(
    algorithm: str, data: Dataset, tmp_path: Path
) -> None:
    learned = train_offline(data, algorithm, settings=SMALL[algorithm], folder=tmp_path / "x")
    policy = Policy.load(tmp_path / "x" / "policy.npz")
    assert policy.trained["algorithm"] == algorithm
    assert policy.options == {"horizon": 6}
    task = SCENARIOS["transition_1"](**policy.options)
    acts = acting_in(task, [policy], "transition_1")
    first, again = (evaluate(task, acts, 3).returns for _ in range(2))
    assert np.array_equal(first, again)  # a memory is emptied between
    assert learned.updates == SMALL[algorithm]["steps"]


# ---- a transformer acts alike everywhere ----------------------------------------------------


@pytest.fixture(scope="module")
def trained(data: Dataset) -> DecisionTransformer:
    learner = DecisionTransformer(data, DtSettings(**SMALL["dt"]), 0)
    for _ in range(40):
        learner.update()
    return learner


def by_torch(learner: DecisionTransformer, observations: np.ndarray) -> np.ndarray:
    """Act in torch along a row of observations, whole sequences of K at a time."""
    policy, K = learner.policy(), learner.settings.context
    s, acts = policy.settings, len(policy.action)
    steps = np.arange(len(observations))
    to_go = ((s["return_to_go"] - steps * s["reward"]) / s["return_scale"])[:, None]
    o = (observations - policy.tensors["shift"]) * policy.tensors["scale"]
    done = np.zeros((len(o), acts))
    for t in steps:
        at = np.arange(t - K + 1, t + 1)
        there, places = at >= 0, np.maximum(at, 0)
        given = (torch.tensor(x[places][None], dtype=torch.float32) for x in (to_go, o, done))
        time = torch.from_numpy(np.minimum(places, learner.net.embed_time.num_embeddings - 1))
        with torch.inference_mode():
            acted = learner.net(*given, time[None], torch.from_numpy(there)[None])
        done[t] = torch.tanh(acted[0, -1]).numpy()
    return done


def test_a_transformer_in_numpy_and_as_a_component_acts_as_torch(
    trained: DecisionTransformer, data: Dataset
) -> None:
    observations = data.episodes[0].observation  # one more than was lived: beyond its times
    want = by_torch(trained, observations)
    policy = trained.policy()
    runner = SequenceRunner(policy)
    assert np.allclose([runner(o[None])[0] for o in observations], want, rtol=0, atol=2e-6)
    both = SequenceRunner(policy)
    two = [both(np.stack([o, data.episodes[1].observation[k]]))[0]
           for k, o in enumerate(observations)]  # fmt: skip
    assert np.allclose(two, want, rtol=0, atol=2e-6)
    component = Native(policy_model(policy, plain=True), "p")
    v, rows = component.description.variables, []
    component.enter_initialization_mode(0.0, None)
    component.exit_initialization_mode()
    for k, row in enumerate(observations):
        component.set(v["observation"], np.asarray(row, float))
        component.do_step(0.4 * k, 0.4)
        rows.append(np.ravel(component.get(v["action"])))
    assert np.allclose(rows, want, rtol=0, atol=1e-5)
    assert np.ptp(want) > 0.05


def test_a_transformer_drives_a_vehicle_as_it_acts_in_gymnasium(
    trained: DecisionTransformer, tmp_path: Path
) -> None:
    policy = trained.policy()
    file = policy.save(tmp_path / "dt.npz")
    system = SCENARIOS["transition_1"]().system.replace("tracker_1.pilot", f"policy:{file}")
    folder = run(system, until=4.8, out=tmp_path / "run", backend="native").folder
    (lived,) = from_recordings("transition_1", [folder]).episodes
    runner = SequenceRunner(policy)
    acted = [runner(o[None])[0] for o in lived.observation[:-1]]
    assert np.allclose(acted, lived.action, rtol=0, atol=1e-4)
    assert np.ptp(lived.action) > 0.05


def test_what_comes_later_changes_nothing_before() -> None:
    net = Transformer(3, 2, 8, DtSettings(hidden=16, blocks=2, context=5))
    r = torch.Generator().manual_seed(0)
    to_go, o, a = (torch.randn(2, 5, w, generator=r) for w in (1, 3, 2))
    there = torch.ones(2, 5, dtype=torch.bool)
    there[:, 0] = False
    before = net(to_go, o, a, torch.arange(5).expand(2, 5), there)
    o[:, 3:], a[:, 2:], to_go[:, 3:] = 0.0, 0.0, 0.0
    o[:, 0] = 9.0  # not there
    after = net(to_go, o, a, torch.arange(5).expand(2, 5), there)
    assert torch.allclose(before[:, 1:3], after[:, 1:3], atol=1e-6)
    assert not torch.allclose(before[:, 3], after[:, 3], atol=1e-3)


def test_episodes_of_another_number_need_a_beginning(trained: DecisionTransformer) -> None:
    runner = SequenceRunner(trained.policy())
    runner(np.zeros((2, 31)))
    with pytest.raises(InputInvalid, match=r"3 episodes after 2"):
        runner(np.zeros((3, 31)))
    runner.begin()
    assert runner(np.zeros((3, 31))).shape == (3, 2)


# ---- what ships -----------------------------------------------------------------------------


def test_the_shipped_dataset_is_small_and_of_its_teacher() -> None:
    shipped = read_dataset(SHIPPED)
    assert SHIPPED.stat().st_size < 500_000
    assert shipped.task == "transition_1"
    assert shipped.returns.mean() > 90


# ---- wrong input ----------------------------------------------------------------------------


def test_a_dataset_with_other_spaces_is_refused_in_words(data: Dataset, tmp_path: Path) -> None:
    words = r"observation space of 31 numbers .* expected 45 numbers .* as transition_1 has"
    with pytest.raises(InputInvalid, match=words):
        train_offline(data, "bc", options={"slots": [3, 2]}, folder=tmp_path / "x")
    bare = replace(data, task="")
    with pytest.raises(InputInvalid, match="names no task; expected one, by --task"):
        train_offline(bare, "bc", folder=tmp_path / "x")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"observation": np.full((11, 1), np.nan, np.float32)}, "episode 0: NaN or infinity"),
        ({"action": np.full((10, 1), 3.0, np.float32)}, "an action of 3; expected actions in"),
        ({"reward": np.zeros(4, np.float32)}, r"shapes .*\(4,\); expected"),
    ],
)
def test_what_cannot_be_learned_from_is_refused(change: dict[str, Any], words: str) -> None:
    good = made_up()
    with pytest.raises(InputInvalid, match=words):
        replace(good, episodes=[replace(good.episodes[0], **change)])


def test_a_loss_that_is_no_number_keeps_what_was_before(data: Dataset, tmp_path: Path) -> None:
    huge = replace(data, episodes=[replace(e, reward=e.reward * 1e25) for e in data.episodes])
    with pytest.raises(LearningDiverged, match=r"the previous training, of \d+ updates, is in"):
        train_offline(huge, "iql", settings={"hidden": 8, "steps": 3}, folder=tmp_path / "x")
    assert np.isfinite(Policy.load(tmp_path / "x" / "policy.npz").tensors["0.weight"]).all()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere.npz"], "nowhere.npz: no such dataset"),
        ([str(SHIPPED), "--algo", "cql"], "algorithm 'cql': does not learn from a dataset"),
        ([str(SHIPPED), "--set", "contxt=3"], "setting 'contxt'; expected one such as context"),
        ([str(SHIPPED), "--set", "context=0"], "context 0; expected a whole number from 1"),
        ([str(SHIPPED), "--set", "heads=7"], "heads 7: expected a divisor of hidden"),
        ([str(SHIPPED), "--task", "uuvsim/StationKeeping-v0"], "expected"),
        ([__file__], "expected a whole dataset"),
    ],
)
def test_wrong_input_is_one_sentence(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert status_of(["train-offline", *arguments, "-o", "never-made"]) == 2
    said = capsys.readouterr().err
    assert words in " ".join(said.split())
    assert "Traceback" not in said
    assert not Path("never-made").exists()

"""What was lived, or recorded, is what a dataset holds."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.cli import status_of
from uuvsim_cosim.content import content
from uuvsim_cosim.envs.tasks.evaluation import evaluate
from uuvsim_cosim.envs.tasks.scripted import scripted_policy
from uuvsim_cosim.envs.tasks.tracking_scenarios import SCENARIOS
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.data.collect import COLLECTING_SEED, collect
from uuvsim_cosim.learn.data.dataset import Dataset
from uuvsim_cosim.learn.data.dataset_files import read_dataset, write_dataset
from uuvsim_cosim.learn.data.recorded import from_recordings
from uuvsim_cosim.learn.policies.policy import Policy
from uuvsim_cosim.orchestrator.recording.export import export
from uuvsim_cosim.orchestrator.running.run import run

SOURCE_SAC = content("models", "policies") / "source_sac.npz"


@pytest.fixture(scope="module")
def data() -> Dataset:
    return collect("transition_1", "scripted", 6, options={"horizon": 6})


def same(a: Dataset, b: Dataset, tolerance: float) -> bool:
    return len(a.episodes) == len(b.episodes) and all(
        np.allclose(getattr(x, k), getattr(y, k), rtol=tolerance, atol=tolerance)
        and x.terminated == y.terminated
        for x, y in zip(a.episodes, b.episodes, strict=True)
        for k in ("observation", "action", "reward")
    )


def test_the_returns_are_those_of_an_evaluation_on_the_same_seeds(data: Dataset) -> None:
    task = SCENARIOS["transition_1"](horizon=6)
    want = evaluate(task, scripted_policy(task), 6, seed=COLLECTING_SEED)
    assert np.allclose(data.returns, want.returns, rtol=1e-4)
    assert [len(e.action) for e in data.episodes] == [15] * 6
    assert not any(e.terminated for e in data.episodes)


def test_a_policy_does_with_what_was_seen_what_was_done() -> None:
    policy = Policy.load(SOURCE_SAC)
    (e,) = collect("transition_1", SOURCE_SAC, 1, options={"horizon": 6}).episodes
    assert np.allclose(policy(e.observation[:-1]), e.action, atol=1e-6)


def test_a_collision_ends_an_episode_and_is_no_time_limit() -> None:
    options = {"rules": {"end_on_collision": True}}
    found = collect("source", "random", 24, options=options)
    short = [e for e in found.episodes if len(e.action) < 50]
    assert short
    assert all(e.terminated for e in short)
    assert not any(e.terminated for e in found.episodes if len(e.action) == 50 and e.reward[-1] > 0)


def test_mixed_is_scripted_noisy_and_random_in_turn() -> None:
    found = collect("transition_1", "mixed", 30)
    scripted, noisy, random = (found.returns[i::3].mean() for i in range(3))
    assert scripted > noisy > random


def test_each_agent_of_a_team_has_episodes_of_its_own() -> None:
    found = collect("transition_2", "scripted", 3, options={"horizon": 4})
    assert len(found.episodes) == 6
    a, b = found.episodes[:2]
    assert not np.array_equal(a.observation, b.observation)


@pytest.mark.parametrize(("name", "tolerance"), [("d.npz", 2e-3), ("d-v0", 0.0)])
def test_what_is_written_is_read_again(
    name: str, tolerance: float, data: Dataset, tmp_path: Path
) -> None:
    read = read_dataset(write_dataset(data, tmp_path / name))
    assert same(read, data, tolerance)
    assert (read.task, read.options) == (data.task, data.options)
    assert read.action == data.action
    assert np.allclose([c.high for c in read.observation], [c.high for c in data.observation])


def test_minari_itself_reads_the_folder(
    data: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import minari

    write_dataset(data, tmp_path / "tracking-v0")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    read = minari.load_dataset("tracking-v0")
    assert (read.total_episodes, read.total_steps) == (6, 90)
    assert np.array_equal(read[2].observations, data.episodes[2].observation)
    assert read[2].truncations[-1]
    assert read.spec.version == 0
    assert list(minari.list_local_datasets()) == ["tracking-v0"]


# ---- recorded runs --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    system = SCENARIOS["transition_1"]().system.replace("tracker_1.pilot", f"policy:{SOURCE_SAC}")
    folder = tmp_path_factory.mktemp("recorded") / "run"
    return run(system, until=8.0, out=folder, backend="native").folder


def test_what_a_policy_did_in_a_recorded_run_is_what_it_does_with_what_it_saw(
    recorded: Path, tmp_path: Path
) -> None:
    found = from_recordings("transition_1", [recorded])
    (e,) = found.episodes
    assert len(e.action) == 20
    assert np.allclose(Policy.load(SOURCE_SAC)(e.observation[:-1]), e.action, atol=1e-4)
    assert np.ptp(e.action) > 0.05
    assert e.reward[-5:].mean() > 1.5  # near the target
    export(recorded, tmp_path / "r.mcap")
    again = from_recordings("transition_1", [tmp_path / "r.mcap", recorded / "signals.parquet"])
    assert all(np.array_equal(x.action, e.action) for x in again.episodes)
    assert len(again.episodes) == 2


def test_a_recording_is_cut_at_the_horizon(recorded: Path) -> None:
    found = from_recordings("transition_1", [recorded], options={"horizon": 4})
    assert [len(e.action) for e in found.episodes] == [10, 10]


def test_a_signal_that_was_not_recorded_is_named(recorded: Path) -> None:
    with pytest.raises(InputInvalid, match=r"tracker_2\.hull\.eta.* not recorded; expected"):
        from_recordings("transition_2", [recorded])


def test_an_action_that_was_not_recorded_is_named(tmp_path: Path) -> None:
    folder = run(SCENARIOS["transition_1"]().system, until=1.0, out=tmp_path / "run",
                 backend="native").folder  # fmt: skip
    words = r"neither tracker_1\.pilot\.a nor tracker_1\.pilot\.action recorded; .* --signal"
    with pytest.raises(InputInvalid, match=words):
        from_recordings("transition_1", [folder])
    # An acceleration that somebody gave, and a rate, by other names.
    given = {"tracker_1.pilot.a": "tracker_1.wrench.current_total",
             "tracker_1.pilot.omega": "tracker_1.wrench.current_total"}  # fmt: skip
    (e,) = from_recordings("transition_1", [folder], renamed=given).episodes
    assert e.action.shape == (2, 2)


# ---- wrong input ----------------------------------------------------------------------------


def test_half_a_dataset_is_refused(data: Dataset, tmp_path: Path) -> None:
    whole = write_dataset(data, tmp_path / "d.npz")
    whole.write_bytes(whole.read_bytes()[:3000])
    with pytest.raises(InputInvalid, match="expected a whole dataset"):
        read_dataset(whole)
    folder = write_dataset(data, tmp_path / "d-v0")
    next((folder / "data" / "3").glob("*.arrow")).write_bytes(b"half")
    with pytest.raises(InputInvalid, match="expected a whole dataset of Minari's"):
        read_dataset(folder)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["transitoin_1", "-o", "x.npz"], "no such task; expected one such as transition_1"),
        (["source", "-o", "x.npz", "--policy", "nobody.npz"], "nobody.npz: no such file"),
        (["source", "-o", "x.npz", "--episodes", "0"], "0 episodes; expected 1"),
        (["source", "-o", str(Path(__file__).parent)], "exists; expected a new folder"),
        (["source", "-o", "x.npz", "--recorded", "r", "--policy", "random"], "expected one of"),
        (["source", "-o", "mixed"], "mixed: has no version; expected a .npz, or a folder of "
         "Minari's, as mixed-v0"),
        (["source", "-o", "a.csv"], "a.csv: no dataset is written as .csv; expected a .npz, or"),
        (["source", "-o", "x.npz", "--signal", "a=b"], "applies to --recorded runs"),
        (["source", "-o", "x.npz", "--recorded", "r", "-n", "3", "--seed", "3"],
         "--episodes 3 and --seed 3: applies to episodes of a policy; expected no --recorded"),
        (["source", "-o", "x.npz", "--recorded", "nowhere"], "nowhere"),
        (["transition_2", "-o", "x.npz", "--policy", str(SOURCE_SAC), "--task-set",
          "slots=[3,2]"], "observes 31 numbers"),
    ],
)  # fmt: skip
def test_wrong_input_is_one_sentence(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert status_of(["collect", *arguments]) == 2
    said = capsys.readouterr().err
    assert words in " ".join(said.split())
    assert "Traceback" not in said
    assert not list(tmp_path.iterdir())


def test_the_counts_are_there_for_programs(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "source.npz"
    assert status_of(["collect", "source", "--episodes", "2", "-o", str(file), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    data = read_dataset(file)
    assert (answer["episodes"], answer["actions"]) == (2, data.steps)
    assert data.steps == sum(len(e.action) for e in data.episodes)
